"""Names and numbers of labels in the truth of images, and names of data layers. Imports nothing."""

BEAUTY, TRUTH = "Beauty", "Truth"  # the view layers, and so the layers of each EXR
HIDDEN = "Hidden"  # pass of the layer TRUTH: 1 where the point is hidden from the other eye, else 0
LOOSE = "LooseThickness"  # pass of the layer TRUTH: metres of loose material above the hard ground
DISTANCE = "Distance"  # pass of the layer TRUTH of cameras beside the pair: metres along the ray of the pixel
SKY_DEPTH_M = 1.0e10  # the value that Cycles writes where a ray hits nothing
UV_LAYER = "UVMap"  # of the ground, where it has texture coordinates
NORMAL_AOV = "GeometricNormal"  # value pass: the facet's normal, without bump or smooth shading
ALBEDO_AOV = "Albedo"  # value pass of maps of the ground only
SALT_AOV = "Salt"  # value pass of such maps: the share of salt in the surface that a pixel sees
#: Value passes of an image of direct light, by light group: radiance of the ground by light that was baked to it.
BAKED_AOVS = {"Sun": "Baked", "Planet": "BakedPlanet"}
#: Attributes of the ground's vertices, by light group: their indirect irradiance over pi, in three bands.
BAKED_ATTRIBUTES = {"Sun": "icymoon_baked_light", "Planet": "icymoon_baked_light_planet"}
#: Value passes of such an image, by light group: an error as large as the error of the baked light, see ``bake``.
BAKED_ERROR_AOVS = {"Sun": "BakedError", "Planet": "BakedErrorPlanet"}
#: Attributes of the ground's vertices, by light group: the same error of this irradiance, the mean of the bands.
BAKED_ERROR_ATTRIBUTES = {group: f"{name}_error" for group, name in BAKED_ATTRIBUTES.items()}
#: Value of BAKED_ATTRIBUTES without baked light, which marks the pixels that show such ground.
NOT_BAKED = -1.0e30

#: Light groups of the Beauty layer, each a pass ``Combined_<group>``, and the setting that weighs it.
LIGHT_GROUPS = {"Sun": "sun_scale", "Planet": "planet_scale"}
#: Light groups of lamps, in the order of ``light.lamps``; an image has as many as the scene has lamps.
LAMP_GROUPS = tuple(f"Lamp{k + 1}" for k in range(8))
IMAGE_PASS = f"{BEAUTY}.Combined"
GROUP_PASSES = tuple(f"{IMAGE_PASS}_{group}" for group in (*LIGHT_GROUPS, *LAMP_GROUPS))
NORMAL_PASS = f"{TRUTH}.{NORMAL_AOV}"
BAKED_ERROR_PASSES = {group: f"{BEAUTY}.{name}" for group, name in BAKED_ERROR_AOVS.items()}
_RADIANCE = {IMAGE_PASS, *GROUP_PASSES, *BAKED_ERROR_PASSES.values()}
#: Passes (``LAYER.PASS``) that a pair's files store as 16-bit floats, by ``quality.half_floats``.
HALF_FLOAT_PASSES = {
    "NONE": set[str](),
    "RADIANCE": _RADIANCE,
    "RADIANCE_NORMALS": _RADIANCE | {f"{TRUTH}.Normal", NORMAL_PASS},
}


def list_rounded_passes(files: str, half_floats: str) -> set[str]:
    """List the passes that are stored as 16-bit floats with this ``quality.files`` and ``quality.half_floats``."""
    return HALF_FLOAT_PASSES["RADIANCE_NORMALS" if files == "COMPACT" else half_floats]


#: Names of the values of the semantic channel (material index).
SEMANTIC_NAMES = {0: "sky", 1: "terrain", 2: "rock", 3: "lander", 4: "planet"}
TERRAIN, ROCK, LANDER, PLANET = 1, 2, 3, 4
#: Tags of objects in the sky, which follow the camera and are no part of the site.
SKY_TAGS = ("planet", "rings", "moons", "stars")
#: Semantic value of a pixel that a turned sensor does not see. Only read and exported data has it, never a pair.
NOT_SEEN = 255
#: Labels of instances. Objects have theirs in the object-index pass, at most 32767 in Blender: the
#: terrain, then the user's objects, each its own pass index or else the next free number. Rocks are
#: instances, which have no object index; theirs are in a value pass that is 0 elsewhere, numbered from
#: ``FIRST_ROCK_INSTANCE`` by size, the largest first, then their debris. Single precision is exact up to 2^24.
TERRAIN_INSTANCE = 1
FIRST_OBJECT_INSTANCE, LAST_OBJECT_INSTANCE = 2, 32767
FIRST_LINK_INSTANCE = 30_001  # of our lander, whose objects of the user may have low numbers
FIRST_ROCK_INSTANCE = 100_000
INSTANCE_AOV = "InstanceLabel"  # value pass
FACE_ATTRIBUTE = "icymoon_face"  # of the triangles of a shape of rocks: the plane that each lies on
INSTANCE_ATTRIBUTE = "instance_label"  # of the rocks' points, which their instances inherit
