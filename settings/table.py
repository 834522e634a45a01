"""The table of settings: every setting there is, once.

``TOPICS`` is the only list of settings. Blender's property groups (``Scene.icymoon``), the keys of
presets and TOML files, ``--set topic.key=value``, the documentation and the provenance in
``pair.json`` are all made from it. ``scene_properties`` gives Blender its properties.

Units are part of the names (``_m``, ``_deg``, ``_px`` …) and the number is the same everywhere:
what the sidebar shows is what the TOML file states.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from . import trust_boundary

Value = bool | int | float | str | list[dict[str, Any]]

#: What a change of a setting forces to be made again, dearest first. "response" only needs the
#: images to be developed again, "run" states where and how fast and changes no result.
EFFECTS = ("geometry", "material", "light", "camera", "sampling", "response", "run")


@dataclass(frozen=True)
class Setting:
    """One setting. ``minimum``/``maximum`` are what is accepted, ``soft`` is where sliders end."""

    key: str
    label: str
    default: Value
    description: str
    effect: str
    unit: str = ""
    minimum: float = -math.inf
    maximum: float = math.inf
    soft: tuple[float, float] | None = None
    choices: tuple[tuple[str, str, str], ...] = ()
    subtype: str = "NONE"
    precision: int = 3
    entries: tuple[Setting, ...] = ()  # of a list of tables, the settings of each table
    trust: str = ""  # of a text, which of ``trust_boundary.CLASSES`` it is

    def __post_init__(self) -> None:
        if (self.kind == "text") != (self.trust in trust_boundary.CLASSES):
            raise ValueError(f"{self.key} must state as trust what a text of it may name, and only a text may.")

    @property
    def kind(self) -> str:
        """'choice', 'bool', 'int', 'float', 'text' or 'list' (of tables with ``entries``)."""
        if self.entries:
            return "list"
        if self.choices:
            return "choice"
        return {bool: "bool", int: "int", float: "float", str: "text"}[type(self.default)]


@dataclass(frozen=True)
class Topic:
    """A group of settings that is one sub-panel and one TOML table."""

    key: str
    label: str
    description: str
    settings: tuple[Setting, ...]
    parent: str = ""  # label of the panel that its sub-panel is in, if it is not in the sidebar itself

    def __getitem__(self, key: str) -> Setting:
        for setting in self.settings:
            if setting.key == key:
                return setting
        raise KeyError(f"{self.key}.{key}")


def _metres(key: str, label: str, default: float, low: float, high: float, soft: tuple[float, float],
            description: str, effect: str) -> Setting:
    return Setting(key, label, default, description, effect, "m", low, high, soft, subtype="DISTANCE", precision=4)


def _degrees(key: str, label: str, default: float, low: float, high: float, description: str, effect: str,
             soft: tuple[float, float] | None = None, precision: int = 2) -> Setting:
    return Setting(key, f"{label} (°)", default, description, effect, "deg", low, high, soft, precision=precision)


def _fraction(key: str, label: str, default: float, description: str, effect: str, low: float = 0.0,
              high: float = 1.0) -> Setting:
    return Setting(key, label, default, description, effect, "1", low, high, subtype="FACTOR")


def _signed(key: str, label: str, description: str, effect: str) -> Setting:
    return Setting(key, label, 0.0, description, effect, "1", -1.0, 1.0, subtype="FACTOR")


def _file(key: str, label: str, description: str) -> Setting:
    return Setting(key, label, "", f"{description}; // is the .blend's folder", "material", subtype="FILE_PATH",
                   trust="read")


#: Parent panel of the topics that each hold one landform.
LANDFORMS = "Landforms"

#: One entry of ``terrain.layers``.
LAYER = (
    Setting("basis", "Basis", "GRADIENT", "Noise that the layer is made of", "geometry",
            choices=(("GRADIENT", "Gradient Noise", "Rounded hills (Perlin)"),
                     ("MIDPOINT", "Mid-Point", "Displacement: straight slopes between random points"),
                     ("CELLS", "Cells", "Square steps of random height"),
                     ("VORONOI_F1", "Voronoi F1", "Distance to the nearest of random points: cones"),
                     ("VORONOI_F2", "Voronoi F2", "Distance to the second nearest point"),
                     ("VORONOI_F2_F1", "Voronoi F2-F1", "Zero on the edges between points, highest at the points"),
                     ("CRACKLE", "Crackle", "Flat plates with narrow cracks between"))),
    Setting("fractal", "Fractal", "FBM", "How the octaves are combined", "geometry",
            choices=(("FBM", "fBm", "Plain sum: equally rough everywhere"),
                     ("MULTIFRACTAL", "Multifractal", "Product: smooth plains between rough heights"),
                     ("HYBRID", "Hybrid", "Each octave scaled by the one before: smooth valleys"),
                     ("RIDGED", "Ridged", "Sharp crests, rough near them"),
                     ("HETERO", "Hetero Terrain", "Each octave scaled by the height so far: smooth low ground"),
                     ("TURBULENCE", "Turbulence", "Sum of magnitudes: rounded lumps with creases"))),
    _metres("amplitude_m", "Amplitude", 0.1, -1.0e4, 1.0e4, (-2.0, 2.0),
            "RMS height of the layer; negative turns it upside down", "geometry"),
    _metres("scale_m", "Scale", 2.0, 1.0e-3, 1.0e5, (0.1, 20.0), "Wavelength of the layer's first octave", "geometry"),
    Setting("octaves", "Octaves", 6, "Number of octaves; those that the mesh cannot carry are left out", "geometry",
            "octaves", 1, 16, (1, 10)),
    Setting("lacunarity", "Lacunarity", 2.0, "Ratio of wavelengths of successive octaves", "geometry", "1",
            1.2, 4.0, (1.5, 3.0)),
    _fraction("roughness", "Roughness", 0.5, "Ratio of the amplitudes of successive octaves", "geometry"),
    _metres("warp_m", "Warp", 0.0, 0.0, 1.0e4, (0.0, 2.0),
            "RMS distance by which noise of the same scale moves the layer's points sideways", "geometry"),
)

TERRAIN = Topic("terrain", "Terrain", "Shape of the ground as a random surface with stated statistics", (
    _metres("size_m", "Size", 20.0, 0.01, 1.0e5, (1.0, 100.0),
            "Side of the square patch of ground, centred on the origin", "geometry"),
    Setting("resolution", "Vertices per Side", 1025,
            "Vertices along each side of the patch; their spacing is size / (vertices - 1)", "geometry",
            "vertices", 2, 4097, (65, 2049)),
    _degrees("rms_slope_deg", "Ruggedness, RMS Slope", 12.0, 0.0, 75.0,
             "Root-mean-square slope of the ground between points one slope baseline apart: "
             "about 5 for smooth plains, 10 to 15 for ridged plains, above 25 for broken ground", "geometry",
             (0.0, 45.0)),
    _metres("slope_baseline_m", "Slope Baseline", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0),
            "Distance between the two points at which the ruggedness is stated", "geometry"),
    Setting("hurst", "Hurst Exponent", 0.8,
            "How roughness changes with scale: RMS deviation grows as distance to this power. "
            "Below 0.5 the slopes at centimetres become absurdly steep", "geometry", "1", 0.05, 1.0, (0.3, 1.0)),
    _fraction("multifractality", "Multifractality", 0.5,
              "0: equally rough everywhere (fractional Brownian); 1: hollows smooth, heights rough", "geometry"),
    _metres("outer_scale_m", "Largest Feature", 8.0, 1.0e-3, 1.0e5, (0.5, 50.0),
            "Longest wavelength; the roughness law holds up to 0.3 of it, and longer swells are absent", "geometry"),
    _metres("inner_scale_m", "Smallest Feature", 0.02, 1.0e-4, 1.0e4, (0.005, 1.0),
            "Shortest wavelength; the roughness law holds down to half of it and the ground is smooth below. "
            "What two vertex spacings do not carry is left out of the mesh", "geometry"),
    Setting("lacunarity", "Lacunarity", 2.0,
            "Largest ratio of wavelengths of successive octaves, which are spaced evenly from the largest feature to "
            "the smallest; above 2.5 the roughness law shows steps", "geometry", "1", 1.2, 4.0, (1.5, 3.0)),
    _degrees("regional_slope_deg", "Regional Slope", 0.0, 0.0, 60.0,
             "Slope of the patch as a whole, as on the flank of a ridge; not part of the ruggedness", "geometry",
             (0.0, 30.0)),
    _degrees("regional_slope_azimuth_deg", "Slope Falls Toward", 180.0, -360.0, 360.0,
             "Direction in which the patch as a whole falls, from north (+Y) over east (+X)", "geometry"),
    _metres("body_radius_m", "Body Radius", 2.521e5, 1.0e4, 1.0e8, (1.0e5, 3.0e6),
            "Mean radius of the moon, which sets where its horizon is: 252.1 km for Enceladus, 1560.8 km for Europa. "
            "Ground on a uniform grid is not curved", "geometry"),
    Setting("layers", "Layers of Noise", [], "Fractal noise added to the ground, one table per layer", "geometry",
            entries=LAYER),
))

MESH = Topic("mesh", "Mesh", "How finely procedural ground is cut into triangles, and how far it goes", (
    Setting("kind", "Spacing", "GRADED", "Where the vertices of procedural ground are", "geometry",
            choices=(("GRADED", "Graded",
                      "Rings about the site, as fine at every distance as the images show, out to the horizon"),
                     ("GRID", "Uniform Grid", "A square of Terrain Size with equal spacing, and nothing beyond"))),
    Setting("error_px", "Largest Error", 1.0,
            "Distance between the mesh and the described ground, in pixels as seen from the nearer eye, that 95 % of "
            "the pixels keep to, whatever the heading", "geometry", "px", 1.0e-3, 100.0, (0.05, 5.0), subtype="PIXEL"),
    Setting("edge_px", "Longest Edge", 8.0,
            "Longest edge of a triangle on level ground as seen from the nearer eye, however smooth the ground; "
            "what is finer does not shade the image", "geometry", "px", 0.1, 1000.0, (1.0, 20.0), subtype="PIXEL"),
    _metres("farthest_m", "Farthest", 1.0e5, 1.0, 1.0e6, (10.0, 1.0e5),
            "Distance at which the ground ends, if no horizon hides it before", "geometry"),
    Setting("most", "Most Vertices", 2000000,
            "Upper bound on the number of vertices; where the largest error asks for more, the mesh keeps to this and "
            "reports what error it has", "geometry", "vertices", 1000, 100000000, (10000, 10000000)),
))

RIDGES = Topic("ridges", "Ridges", "Double ridges with a trough between, young ones over old ones", (
    _metres("height_m", "Height", 0.0, 0.0, 1000.0, (0.0, 5.0), "Height of the crests above the plain; 0 for no ridges",
            "geometry"),
    _metres("width_m", "Width", 4.0, 0.01, 1.0e4, (0.5, 50.0), "Width of a ridge from foot to foot", "geometry"),
    _metres("spacing_m", "Spacing", 9.0, 0.01, 1.0e5, (1.0, 100.0),
            "Mean distance between ridges of one set; at least 1.2 widths are kept", "geometry"),
    _fraction("trough", "Trough", 0.5, "Depth of the trough between the crests as a share of the height; "
              "0 for a single, flat-topped ridge", "geometry"),
    Setting("sets", "Sets", 2, "Directions of ridges; each set crosses those before it", "geometry", "sets", 1, 6),
    _degrees("azimuth_deg", "Direction", 60.0, -360.0, 360.0,
             "Mean direction that the ridges run in, from north (+Y) over east (+X)", "geometry"),
    _degrees("spread_deg", "Spread", 50.0, 0.0, 90.0, "Largest deviation of a set's direction from the mean",
             "geometry"),
), LANDFORMS)

CRACKS = Topic("cracks", "Cracks", "Fractures along the edges of plates", (
    _metres("depth_m", "Depth", 0.0, 0.0, 1000.0, (0.0, 2.0), "Depth of the cracks below the ground; 0 for no cracks",
            "geometry"),
    _metres("width_m", "Width", 0.4, 1.0e-3, 1.0e4, (0.05, 5.0), "Width of a crack from edge to edge", "geometry"),
    _metres("rim_m", "Rim", 0.0, 0.0, 1000.0, (0.0, 1.0), "Height of the rims that were pushed up beside the cracks",
            "geometry"),
    _metres("plate_m", "Plate", 3.0, 0.01, 1.0e5, (0.5, 50.0), "Mean distance between cracks, across them", "geometry"),
    Setting("elongation", "Elongation", 1.0, "Length of a plate over its width: 1 for polygons, above 5 for the "
            "sub-parallel fractures beside a tiger stripe", "geometry", "1", 1.0, 100.0, (1.0, 15.0)),
    _degrees("azimuth_deg", "Direction", 0.0, -360.0, 360.0,
             "Direction that elongated cracks run in, from north (+Y) over east (+X)", "geometry"),
), LANDFORMS)

CHAOS = Topic("chaos", "Chaos", "Plates of broken crust, lifted and tilted, in a lumpy matrix", (
    _metres("relief_m", "Relief", 0.0, 0.0, 1.0e4, (0.0, 10.0),
            "Height of the highest plates above the matrix, the lowest half as high; 0 for no plates", "geometry"),
    _metres("plate_m", "Plate", 4.0, 0.01, 1.0e5, (0.5, 50.0), "Mean width of a plate", "geometry"),
    _fraction("plate_share", "Plate Share", 0.6, "Share of the plates that still stand; the others are matrix",
              "geometry"),
    _metres("gap_m", "Gap", 0.3, 0.0, 1.0e4, (0.0, 5.0), "Width of the gap between neighbouring plates", "geometry"),
    _degrees("tilt_deg", "Tilt", 8.0, 0.0, 60.0, "Largest slope of a plate's top toward east or north", "geometry",
             (0.0, 30.0)),
    _metres("matrix_m", "Matrix Relief", 0.0, 0.0, 1000.0, (0.0, 2.0), "RMS height of the lumps between the plates",
            "geometry"),
), LANDFORMS)

CRATERS = Topic("craters", "Craters", "Small bowl-shaped craters, their sizes a power law", (
    _fraction("coverage", "Coverage", 0.0, "Craters' area over the ground's area; 0 for none", "geometry", high=2.0),
    _metres("smallest_m", "Smallest", 0.4, 1.0e-3, 1.0e4, (0.1, 10.0), "Diameter at which the size law starts",
            "geometry"),
    _metres("largest_m", "Largest", 5.0, 1.0e-3, 1.0e4, (0.5, 50.0), "Diameter at which the size law ends", "geometry"),
    Setting("power_index", "Size Index", 3.0,
            "Exponent of the cumulative power law N(>D) ~ D^-index: about 2 for primary craters, 4 for secondaries",
            "geometry", "1", 0.5, 6.0, (1.0, 5.0)),
    _fraction("depth_ratio", "Depth", 0.2, "Depth of a fresh crater from rim to floor over its diameter", "geometry"),
    _fraction("rim_ratio", "Rim", 0.04, "Height of a fresh crater's rim above the ground over its diameter",
              "geometry"),
    _fraction("freshness", "Freshness", 0.3,
              "How deep the oldest crater still is as a share of a fresh one; 1 for all fresh", "geometry"),
    Setting("most", "Most Craters", 5000, "Number of craters above which the settings are refused", "geometry",
            "craters", 0, 50000, (0, 10000)),
), LANDFORMS)

HOLLOWS = Topic("hollows", "Hollows", "Cups with sharp rims left by sublimation without wind", (
    _metres("depth_m", "Depth", 0.0, 0.0, 100.0, (0.0, 1.0), "Depth of the deepest hollow under its rims, the "
            "shallowest being 0.6 of it; 0 for no hollows", "geometry"),
    _metres("diameter_m", "Diameter", 0.6, 1.0e-3, 1.0e4, (0.1, 5.0), "Mean diameter of a hollow", "geometry"),
    Setting("elongation", "Elongation", 1.0, "Length of a hollow over its width; sastrugi, which need wind, have "
            "about 5", "geometry", "1", 1.0, 100.0, (1.0, 10.0)),
    _degrees("azimuth_deg", "Direction", 0.0, -360.0, 360.0,
             "Direction in which hollows are long, from north (+Y) over east (+X)", "geometry"),
), LANDFORMS)

PENITENTES = Topic("penitentes", "Penitentes", "Blades of ice in rows along the Sun's path, leaning toward noon", (
    _metres("height_m", "Height", 0.0, 0.0, 100.0, (0.0, 6.0),
            "Height of the tallest blades above the troughs; 0 for none", "geometry"),
    _metres("spacing_m", "Spacing", 1.5, 0.01, 1000.0, (0.2, 10.0), "Mean distance between rows of blades", "geometry"),
    _fraction("sharpness", "Sharpness", 0.8, "0: rounded ridges; 1: knife edges between concave walls", "geometry"),
    Setting("elongation", "Elongation", 1.5, "Length of a blade over the spacing of rows", "geometry", "1",
            0.5, 100.0, (0.5, 10.0)),
    _fraction("variation", "Variation", 0.6, "How much lower blades are than the tallest, and how deep the saddles "
              "between them; 0 for unbroken rows of one height", "geometry"),
    _degrees("noon_azimuth_deg", "Noon Sun", 0.0, -360.0, 360.0,
             "Azimuth of the noon Sun, toward which blades lean; the rows run at right angles to it", "geometry"),
    _degrees("lean_deg", "Lean", 0.0, 0.0, 60.0, "Zenith distance of the noon Sun, which is how far blades lean; held "
             "to what a height field can show", "geometry", (0.0, 30.0)),
), LANDFORMS)

MANTLE = Topic("mantle", "Mantle", "Snow that smooths the ground by filling its hollows", (
    _metres("thickness_m", "Thickness", 0.0, 0.0, 1000.0, (0.0, 1.0),
            "Thickness of the snow in deep hollows; 0 for none. Ground above its surroundings keeps its shape",
            "geometry"),
    _metres("length_m", "Smoothing Length", 1.5, 1.0e-3, 1.0e5, (0.1, 10.0),
            "Wavelength below which the snow's surface is smooth", "geometry"),
), LANDFORMS)

SOURCE = Topic("source", "Ground", "Where the ground comes from: generated, or a mesh or height map of your own", (
    Setting("kind", "Source", "PROCEDURAL", "What the ground is made of", "geometry",
            choices=(("PROCEDURAL", "Procedural", "A random surface with the statistics of the Terrain topic"),
                     ("MESH", "Mesh File", "A reconstructed mesh: OBJ, PLY, STL, glTF, USD or FBX"),
                     ("HEIGHT_MAP", "Height Map", "A digital elevation model: GeoTIFF, NPY, EXR or grey PNG"))),
    Setting("file", "File", "", "Mesh or height map to stand on; ~ is your home folder, // the folder of the .blend "
            "file. Pairs are named by its content, not by its place", "geometry", subtype="FILE_PATH", trust="read"),
    Setting("scale", "Metres per Unit", 1.0,
            "Metres per unit of a mesh file: 1 for metres, 0.001 for millimetres. glTF, USD and FBX state their unit "
            "themselves; this is applied on top", "geometry", "m/unit", 1.0e-6, 1.0e6, (0.001, 1000.0), precision=6),
    Setting("up_axis", "Up Axis", "AUTO", "Axis of a mesh file's coordinates that points up; for USD and FBX, of the "
            "scene that they become in Blender", "geometry",
            choices=(("AUTO", "As Usual", "What the format states or usually is: Y in OBJ and glTF, Z in PLY and STL, "
                      "as stated inside USD and FBX"),
                     ("X", "X", "+X points up"), ("Y", "Y", "+Y points up"), ("Z", "Z", "+Z points up"),
                     ("-X", "-X", "-X points up"), ("-Y", "-Y", "-Y points up"), ("-Z", "-Z", "-Z points up"))),
    Setting("centre", "Centre", True, "Measure the site from the middle of the ground and from its median height; "
            "otherwise the file's own coordinates are kept", "geometry"),
    _metres("origin_x_m", "Origin East", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0),
            "How far east of the ground's middle (or of the file's origin) the site's origin is put", "geometry"),
    _metres("origin_y_m", "Origin North", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0),
            "How far north of the ground's middle (or of the file's origin) the site's origin is put", "geometry"),
    _metres("metres_per_pixel", "Metres per Pixel", 0.0, 0.0, 1.0e5, (0.0, 100.0),
            "Size of a pixel of a height map; 0 for what a GeoTIFF states", "geometry"),
    Setting("height_scale_m", "Metres per Value", 1.0,
            "Metres per unit of the values in a height map: 1 where it holds metres; for PNG, metres per grey level. A "
            "GeoTIFF states its unit and scale itself; this is applied on top", "geometry", "m",
            1.0e-9, 1.0e6, (1.0e-3, 10.0), precision=6),
    Setting("detail", "Add Roughness", False,
            "Add the Terrain topic's roughness below what the file resolves", "geometry"),
    Setting("repair", "Repair", True,
            "Drop broken faces, merge duplicate vertices and turn the upper side of a mesh up", "geometry"),
))

SURFACE = Topic("surface", "Surface", "Snow or ice that the ground is made of", (
    Setting("model", "Model", "PRINCIPLED", "Law by which the surface reflects light", "material",
            choices=(("PRINCIPLED", "Snow (Principled)", "Subsurface scattering and gloss, as of terrestrial snow and "
                      "ice. Costs 1.4 times Lambert, 7 with all light subsurface; has no opposition surge"),
                     ("LAMBERT", "Lambert", "Equally bright from everywhere: the cheapest. Misses limb, opposition "
                      "surge and all dependence on phase; up to 18 % off in the mean of a sunlit scene of ice"),
                     ("LOMMEL_SEELIGER", "Lommel-Seeliger", "Single scattering of dark dust. Costs little more than "
                      "Lambert; misses the light scattered many times, which is most of what ice returns"),
                     ("LUNAR_LAMBERT", "Lunar-Lambert", "Lommel-Seeliger and Lambert mixed, as in mosaics of moons. "
                      "Costs little more than Lambert; has no dependence on phase, so no opposition surge"),
                     ("HAPKE", "Hapke", "Particulate ice with phase function, opposition surge and roughness, from "
                      "the Hapke topic. Costs 1.2 times Lambert with OSL, 1.8 without; has no gloss"))),
    _fraction("albedo", "Albedo", 0.9,
              "Share of the light that clean, flat ice reflects, from all sides to all sides (in a white furnace)",
              "material"),
    _fraction("lommel_seeliger_share", "Lommel-Seeliger Share", 0.7, "Of the lunar-Lambert law: 0 is Lambert's, "
              "1 Lommel and Seeliger's; both have the same albedo", "material"),
    _fraction("albedo_variation", "Albedo Variation", 0.0,
              "Depth of the random dark patches as a fraction of the albedo", "material"),
    _metres("albedo_patch_m", "Albedo Patch", 0.5, 1.0e-4, 1.0e4, (0.01, 10.0),
            "Wavelength of the dark patches", "material"),
    _signed("trough_dirt", "Dirt in Troughs",
            "How much darker the ground is one standard deviation of height under its mean plane than as much above "
            "it; negative for dark heights", "material"),
    _signed("slope_dirt", "Dirt on Slopes",
            "How much darker slopes of 45 degrees and more are than level ground; negative for dark level ground",
            "material"),
    _fraction("salt_share", "Salt Share", 0.0, "Share of the ground that salts have stained", "material"),
    _metres("salt_patch_m", "Salt Patch", 1.0, 1.0e-4, 1.0e4, (0.05, 20.0), "Wavelength of the stains", "material"),
    _fraction("salt_red", "Salt Red", 1.0, "Reflectance of stained over clean ice in red", "material"),
    _fraction("salt_green", "Salt Green", 0.85, "Reflectance of stained over clean ice in green", "material"),
    _fraction("salt_blue", "Salt Blue", 0.6, "Reflectance of stained over clean ice in blue: irradiated salt absorbs "
              "near 0.45 µm", "material"),
    _fraction("subsurface_weight", "Subsurface Weight", 0.0,
              "Share of the light that enters the snow and leaves it elsewhere (random walk); "
              "1 makes a render about five times as dear as 0", "material"),
    _metres("subsurface_radius_m", "Subsurface Radius", 0.005, 0.0, 10.0, (0.0, 0.1),
            "Mean free path of light in the snow", "material"),
    _fraction("transmission", "Transmission", 0.0,
              "Share of the light that passes into clear ice and does not come back", "material"),
    _fraction("roughness", "Roughness", 0.6, "Microfacet roughness of the specular reflection", "material"),
    _fraction("specular", "Specular Level", 0.5,
              "Strength of the specular reflection; 0.5 is what the refractive index gives", "material"),
    Setting("refractive_index", "Refractive Index", 1.31, "Of water ice in the visible: 1.31", "material", "1",
            1.0, 3.0, (1.0, 2.0)),
    _metres("grain_size_m", "Grain Size", 0.03, 1.0e-4, 1.0e3, (0.001, 1.0),
            "Wavelength of the fine relief that is finer than the mesh", "material"),
    _metres("grain_amplitude_m", "Grain Relief", 0.004, 0.0, 1.0, (0.0, 0.05),
            "Height of the fine relief from lowest to highest", "material"),
    Setting("relief", "Fine Relief", "BUMP", "How the fine relief is made", "material",
            choices=(("BUMP", "Bump", "Shades the surface; true depth stays that of the mesh. Free"),
                     ("DISPLACEMENT", "Displacement",
                      "Moves the mesh's vertices, depth and shadows with them; what two vertex spacings do not carry "
                      "is left out"))),
))

TEXTURES = Topic("textures", "Textures", "Images on the ground and rocks, without visible repeats or as baked", (
    Setting("set", "Texture", "NONE", "Which images lie on the ground and on rocks", "material",
            choices=(("NONE", "None", "Procedural ice only"),
                     ("FROST", "Frost", "Generated: crystals of hoar with bright tips"),
                     ("GRAINS", "Grains", "Generated: rounded grains with dark gaps"),
                     ("CRACKS", "Cracks", "Generated: plates of crust with dark cracks between"),
                     ("OWN", "Own Images", "The files below; those left empty are not used"),
                     ("MESH", "From Mesh", "Albedo, roughness and normals that an OBJ, glTF or PLY file of the ground "
                      "names or holds, by its UV coordinates"))),
    Setting("mapping", "Mapping", "OBJECT", "How the images lie on the ground; those of the mesh always lie by UV",
            "material",
            choices=(("OBJECT", "By Place", "Seen from above, on walls from the side, as wide as Image Width states"),
                     ("UV", "By UV", "Where the UV coordinates of a mesh file say, as they were baked; Image Width and "
                      "Repeats do not count. Rocks, which have none, take the images' mean"))),
    _metres("width_m", "Image Width", 0.5, 1.0e-3, 1.0e4, (0.05, 10.0), "Width of the image mapped by place",
            "material"),
    Setting("repeat", "Repeats", "TURNED", "How the image, mapped by place, goes on beyond its edges", "material",
            choices=(("TURNED", "Shifted and Turned", "Hexagons from random places at random angles: no repeat shows"),
                     ("SHIFTED", "Shifted", "Hexagons from random places: for images with a direction"),
                     ("PLAIN", "Plain", "One image beside the other"))),
    _metres("height_m", "Relief Height", 0.005, -10.0, 10.0, (-0.05, 0.05),
            "Height of white over black in the height map; bump or displacement, as Fine Relief of the surface",
            "material"),
    _file("albedo_file", "Albedo", "Image whose brightness over its mean multiplies the albedo"),
    _file("roughness_file", "Roughness", "Image of the roughness, 0 to 1"),
    _file("normal_file", "Normal", "Image of normals (OpenGL: green is up)"),
    _file("transmission_file", "Transmission", "Image of the share of light that passes into clear ice, 0 to 1"),
    _file("height_file", "Height", "Image of heights, see Relief Height"),
))

ROCK_SURFACE = Topic("rock_surface", "Rock Surface", "Snow or ice that rocks with a surface of their own are made of",
                     SURFACE.settings)

HAPKE = Topic("hapke", "Hapke", "Parameters of Hapke's law, for every surface whose model it is", (
    _fraction("w", "Single-Scattering Albedo", 0.964,
              "Share of the light met by a grain that it scatters (w); clean ice is above 0.95", "material"),
    Setting("b", "Lobe Width b", 0.429, "Asymmetry of both lobes of the phase function: 0 for even scattering, near 1 "
            "for narrow lobes. Negative turns them round", "material", "1", -0.99, 0.99, (0.0, 0.9)),
    Setting("c", "Lobe Share c", 0.113, "Balance of the lobes, Hapke's convention of 2012: 1 for all light back to the "
            "source, -1 for all light onward. McGuire's and ISIS' c is (1 + c)/2", "material", "1", -1.0, 1.0),
    Setting("b_s0", "Shadow-Hiding Amplitude", 0.5, "Height of the opposition surge from shadows that grains hide "
            "(BS0); above 1 it stands for coherent backscatter too", "material", "1", 0.0, 3.0, (0.0, 1.0)),
    Setting("h_s", "Shadow-Hiding Width", 0.0016, "Half-width parameter of that surge: it is halved where the "
            "tangent of half the phase angle is this; 0 for no surge", "material", "1", 0.0, 10.0, (0.0, 0.1),
            precision=5),
    _fraction("b_c0", "Backscatter Amplitude", 0.0, "Height of the surge from interference of light that "
              "takes one path both ways (BC0), as a share of all light", "material"),
    Setting("h_c", "Backscatter Width", 0.0, "Half-width parameter of that surge, in the tangent of half the "
            "phase angle; 0 for no surge", "material", "1", 0.0, 10.0, (0.0, 0.1), precision=5),
    _degrees("theta_bar_deg", "Roughness", 10.0, 0.0, 60.0, "Mean slope angle of the relief that neither mesh nor "
             "grain relief resolves; 0 makes the surface of nodes twice as cheap", "material", (0.0, 40.0)),
    _degrees("theta_bar_range_deg", "Roughness Range", 0.0, -60.0, 60.0, "By how much the roughness image of the "
             "textures varies that angle: white less black, the image's mean being the roughness above, all held "
             "between 0 and 60. 0 leaves the image unused", "material", (-30.0, 30.0)),
    _fraction("filling_factor", "Filling Factor", 0.0, "Share of the volume that grains fill; 0 for the model of 1993 "
              "without porosity. Grains cannot be packed closer than 0.7522", "material", high=0.75),
    Setting("h_function", "H Function", "1981", "Approximation of multiple scattering; parameters belong to the one "
            "that they were fitted with", "material",
            choices=(("1981", "1981", "Up to 4 % off; all fits of the Voyager era"),
                     ("1993", "1993", "Up to 0.8 % off"),
                     ("2002", "2002", "Up to 1 % off; the one of eradiate and of the later book"))),
    Setting("accuracy", "Accuracy", "FAST", "What is exact beside the light that comes straight from the Sun",
            "material",
            choices=(("FAST", "Fast", "Light from the ground is weighted as if it came from the Sun: 2 to 4 % dark in "
                      "the mean, up to 10 % in shadows"),
                     ("ACCURATE", "Accurate", "Light from the ground has the right albedo: within 1 % in the mean, 8 % "
                      "in shadows; surges are blurred by the Sun's disc exactly. Needs OSL and the CPU"),
                     ("REFERENCE", "Reference", "Three interreflections have the law at all ends: within 0.1 % in the "
                      "mean, 1 % in shadows. Between ice only: objects of your own get no sunlight back. Approximate "
                      "where dirt or images vary the ice: neighbours are taken to be like the place they light. Needs "
                      "OSL and the CPU"))),
    Setting("backend", "Shader", "AUTO", "How the law is built in Cycles", "material",
            choices=(("AUTO", "Automatic", "OSL where it is available, else nodes; warns if that lowers accuracy"),
                     ("OSL", "OSL", "Open Shading Language; refused where there is none and on the GPU"),
                     ("NODES", "Nodes", "Works in every Blender on every device; fast accuracy only"))),
))

ROCKS = Topic("rocks", "Rocks", "Rocks lying on the ground", (
    Setting("law", "Size Law", "POWER", "How many rocks there are of each size", "geometry",
            choices=(("POWER", "Power Law", "N(>D) ~ D^-index, as fitted to block counts on Enceladus"),
                     ("GOLOMBEK", "Golombek", "Covered share k exp(-q D), q = 1.79 + 0.152/k per m, k the coverage: "
                                              "fitted to rocks on Mars, an analogue"))),
    _fraction("coverage", "Coverage", 0.0,
              "Share of the ground under rocks, overlaps counted twice; 0 for none. In Golombek's law the share "
              "under rocks of all sizes, of which those from smallest to largest are made", "geometry", high=0.5),
    _metres("smallest_m", "Smallest", 0.1, 1.0e-3, 100.0, (0.02, 1.0),
            "Diameter at which the size distribution starts", "geometry"),
    _metres("largest_m", "Largest", 0.8, 1.0e-3, 100.0, (0.05, 5.0),
            "Diameter at which the size distribution ends", "geometry"),
    Setting("power_index", "Size Index", 3.0,
            "Exponent of the cumulative power law N(>D) ~ D^-index: higher means more small rocks", "geometry",
            "1", 0.5, 6.0, (1.0, 5.0)),
    Setting("family", "Shapes", "MIXED", "What the rocks look like", "geometry",
            choices=(("MIXED", "Mixed", "Fragments, boulders and slabs in equal numbers"),
                     ("FRAGMENTS", "Fragments", "Broken polyhedra"),
                     ("BOULDERS", "Boulders", "Worn and lumpy"),
                     ("SLABS", "Slabs", "Flat plates with broken sides"))),
    _fraction("angularity", "Angularity", 0.7,
              "0: worn round; 1: freshly broken, with sharp edges. Boulders stay half worn", "geometry"),
    Setting("elongation", "Elongation", 1.4, "Length over width of a rock seen from above, median", "geometry", "1",
            1.0, 5.0, (1.0, 3.0)),
    Setting("height_ratio", "Height over Width", 0.6,
            "Height of a rock over its mean width, median; slabs have 0.45 of it", "geometry", "1",
            0.05, 3.0, (0.2, 1.5)),
    _degrees("tilt_deg", "Tilt", 15.0, 0.0, 180.0,
             "RMS angle, about each of two axes, by which rocks lean from lying along the ground", "geometry",
             (0.0, 60.0)),
    _fraction("burial", "Burial", 0.25, "Mean share of a rock's height that is under the ground", "geometry",
              high=0.9),
    _fraction("clustering", "Clustering", 0.0, "Share of the rocks that lie in clusters; the others lie anywhere",
              "geometry"),
    Setting("cluster_blocks", "Rocks per Cluster", 20.0, "Mean number of rocks in a cluster", "geometry", "blocks",
            1.0, 1.0e5, (2.0, 200.0)),
    _metres("cluster_radius_m", "Cluster Radius", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0),
            "Standard deviation, east and north, of a cluster's rocks about its centre", "geometry"),
    _metres("clear_radius_m", "Clear Radius", 0.0, 0.0, 1.0e4, (0.0, 5.0),
            "Radius of the circle about the site of the camera that no rock reaches into, for a lander", "geometry"),
    Setting("most", "Most Rocks", 20000,
            "Upper bound on the number of rocks; the smallest ones are left out, with a warning, to keep it",
            "geometry", "blocks", 0, 200000, (0, 50000)),
    Setting("own_surface", "Own Surface", False,
            "Make the rocks of what Rock Surface describes, instead of what the ground is made of", "material"),
))

LIGHT = Topic("light", "Light", "The Sun and the planet as the body's sky shows them; nothing else lights the ground", (
    Setting("directions_from", "Sky From", "ANGLES", "Where the positions of Sun and planet come from",
            "light", choices=(
                ("ANGLES", "Angles", "The settings below"),
                ("DATE", "Date", "Body, date and site; elements good to 0.25° from 2000 to 2060"),
                ("KERNELS", "SPICE Kernels", "Body, date and site, exactly; needs kernels and SpiceyPy"))),
    Setting("body", "Body", "ENCELADUS", "Moon that the site is on: ENCELADUS or EUROPA, with kernels any",
            "light", trust="name"),
    Setting("parent", "Parent", "SATURN", "Planet that the moon goes around, as the kernels name it", "light",
            trust="name"),
    Setting("date_utc", "Date (UTC)", "2038-06-01T12:00:00", "Date and time of the scene, as 2038-06-01T12:00:00",
            "light", trust="name"),
    _degrees("latitude_deg", "Latitude", -80.0, -90.0, 90.0,
             "Planetocentric latitude of the site; also how high the poles of body and planet stand in the north. "
             "The Sun that angles place does not depend on it", "light"),
    _degrees("longitude_deg", "Longitude", 0.0, -360.0, 360.0,
             "East longitude of the site; the planet stands over -4 on Enceladus and over -1.5 on Europa, whose "
             "meridians are those of craters", "light"),
    Setting("kernels", "Kernels", "", "A meta-kernel, or a folder whose kernels are all loaded", "light",
            subtype="FILE_PATH", trust="read"),
    Setting("sun_irradiance_wm2", "Sun Irradiance (W/m²)", 14.82,
            "Solar irradiance on a surface facing the Sun, all wavelengths: 14.82 at Saturn, 50.26 at Jupiter "
            "(1361 W/m² / distance² in au)", "light", "W/m²", 0.0, 1.0e5, (0.0, 100.0)),
    _degrees("sun_angular_diameter_deg", "Sun Diameter", 0.0556, 0.0, 90.0,
             "Apparent diameter of the Sun's disc: 0.0556 at Saturn, 0.1024 at Jupiter; it sets the softness of "
             "shadows", "light", (0.0, 1.0), precision=4),
    Setting("irradiance_band", "Irradiance Counts", "BOLOMETRIC",
            "Which wavelengths the irradiance counts; the camera response takes its band out of it", "response",
            choices=(("BOLOMETRIC", "All Wavelengths", "The solar constant scaled to the distance"),
                     ("CAMERA", "Camera Band", "Only what the camera's band holds"))),
    Setting("sun_scale", "Sun Factor", 1.0, "Factor on the Sun's light when images are evaluated", "response", "1",
            0.0, 1.0e6, (0.0, 10.0)),
    Setting("planet_scale", "Planet Factor", 1.0, "Factor on the planet's light when images are evaluated", "response",
            "1", 0.0, 1.0e6, (0.0, 10.0)),
    Setting("sun_temperature_k", "Sun Temperature (K)", 5772.0,
            "Colour temperature: sets the camera band's share and the balance of the bands R, G, B, which is even at "
            "5772", "light", "K", 500.0, 50000.0, (3000.0, 10000.0), precision=0),
    _degrees("sun_elevation_deg", "Sun Elevation", 20.0, -90.0, 90.0,
             "Height of the Sun's centre above the local horizon; below 0 it is night", "light"),
    _degrees("sun_azimuth_deg", "Sun Azimuth", 60.0, -360.0, 360.0,
             "Direction of the Sun from north (+Y) over east (+X)", "light"),
    Setting("planet", "Planet", False,
            "The planet that the moon goes around stands in the sky, lit by the Sun, and shines on the ground",
            "light"),
    _degrees("planet_elevation_deg", "Planet Elevation", 10.0, -90.0, 90.0,
             "Height of the planet's centre above the horizon; below minus half its diameter it gives nothing",
             "light"),
    _degrees("planet_azimuth_deg", "Planet Azimuth", 0.0, -360.0, 360.0,
             "Direction of the planet from north (+Y) over east (+X)", "light"),
    _degrees("planet_angular_diameter_deg", "Planet Diameter", 29.33, 0.0, 120.0,
             "Apparent diameter of its equator: 29.33 for Saturn from Enceladus, 12.23 for Jupiter from Europa",
             "light", (0.0, 40.0)),
    _fraction("planet_flattening", "Planet Flattening", 0.0,
              "1 - polar / equatorial radius: 0.098 for Saturn, 0.065 for Jupiter", "light", high=0.5),
    _fraction("planet_albedo", "Planet Albedo", 0.499,
              "Geometric albedo: brightness at full phase relative to a white disc of its size", "light", high=2.0),
    Setting("planet_phase_law", "Planet Phase Law", "LAMBERT", "How its brightness falls with the phase", "light",
            choices=(("LAMBERT", "Lambert", "A matt sphere"),
                     ("SATURN", "Saturn", "Published curve of Saturn's globe (Mallama and Hilton 2018)"),
                     ("JUPITER", "Jupiter", "Published curve of Jupiter (Mallama and Hilton 2018)"))),
    Setting("planet_least", "Least Planet Light", 1.0e-4,
            "Light of the planet over that of the Sun, on level or on facing ground, below which it does not light the "
            "ground by day: it would be lost under the noise of a camera exposed for the Sun. 0 for always", "light",
            "1", 0.0, 1.0, (0.0, 0.01), precision=6),
    Setting("planet_rings", "Planet Rings", False,
            "Saturn's rings A, B, C and the Cassini Division about the planet's equator, and their shadow on it, which "
            "takes up to 20 % of its light. From Enceladus they are a line; raise Planet Elevation by the angle that "
            "they are to open to", "light"),
    Setting("stars", "Stars", False, "Stars in the sky, at their true brightness; they give the ground no light",
            "light"),
    Setting("stars_faintest_mag", "Faintest Star (mag)", 2.5,
            "Faintest V magnitude. Down to 2.5 they are the stars there are; fainter ones are drawn from the seed, in "
            "their true numbers", "light", "mag", -2.0, 8.0, (0.0, 6.5), precision=1),
))

RIG = Topic("rig", "Stereo Camera", "Two identical cameras, parallel unless toed in; the left one is the reference", (
    _metres("baseline_m", "Baseline", 0.25, 1.0e-4, 100.0, (0.02, 1.0),
            "Distance between the two optical centres", "camera"),
    Setting("focal_length_mm", "Focal Length", 32.0, "Focal length of both lenses", "camera", "mm", 1.0, 5000.0,
            (5.0, 200.0), subtype="DISTANCE_CAMERA"),
    Setting("sensor_width_mm", "Sensor Width", 60.0, "Width of both sensors; pixels are square", "camera", "mm",
            1.0, 100.0, (5.0, 70.0), subtype="DISTANCE_CAMERA"),
    Setting("width_px", "Image Width", 640, "Columns of the images", "camera", "px", 4, 16384, (64, 2048),
            subtype="PIXEL"),
    Setting("height_px", "Image Height", 480, "Rows of the images", "camera", "px", 4, 16384, (64, 2048),
            subtype="PIXEL"),
    _metres("height_m", "Height above Ground", 1.6, 1.0e-3, 1.0e4, (0.3, 5.0),
            "Height of the left camera above the ground beneath it", "camera"),
    _degrees("pitch_deg", "Pitch Down", 45.84, -90.0, 90.0,
             "Angle of the optical axis below the horizontal", "camera"),
    _degrees("heading_deg", "Heading", 0.0, -360.0, 360.0,
             "Direction of the optical axis from north (+Y) over east (+X)", "camera"),
    Setting("principal_x_px", "Principal Point Right", 0.0,
            "Columns by which the optical axis is right of the middle of the image", "camera", "px", -8192.0, 8192.0,
            (-50.0, 50.0), subtype="PIXEL"),
    Setting("principal_y_px", "Principal Point Down", 0.0,
            "Rows by which the optical axis is below the middle of the image", "camera", "px", -8192.0, 8192.0,
            (-50.0, 50.0), subtype="PIXEL"),
    *(Setting(f"distortion_{name}", f"Distortion {name}", 0.0, text, "response", "1", -10.0, 10.0, (-0.5, 0.5),
              precision=5) for name, text in (
        ("k1", "Radial distortion, r² term, in OpenCV's Brown-Conrady model. Below 0 gives barrel distortion"),
        ("k2", "Radial distortion, r⁴ term"), ("p1", "Tangential distortion, vertical decentring"),
        ("p2", "Tangential distortion, horizontal decentring"), ("k3", "Radial distortion, r⁶ term"))),
    _fraction("overscan", "Overscan", 0.0, "Margin rendered beyond each border, as a share of the width and height. A "
              "lens with distortion and turned eyes need it", "camera", high=2.0),
    _degrees("toe_in_deg", "Toe-in", 0.0, 0.0, 45.0, "Angle by which each eye is turned toward the other about its own "
             "vertical; 0 for parallel eyes", "camera", (0.0, 10.0), 3),
    _metres("focus_distance_m", "Focus Distance", 0.0, 0.0, 1.0e5, (0.0, 10.0),
            "Depth that is in focus; 0 for everything. The camera response sets the aperture. Truth is always "
            "sharp", "camera"),
    *(Setting(key, label, 0.0, f"{text} during the exposure. It blurs the images; the truth is that of the middle "
              "of the exposure", "camera", unit, -1.0e4, 1.0e4, (-soft, soft)) for key, label, unit, soft, text in (
        ("speed_right_m_s", "Speed Right (m/s)", "m/s", 1.0, "Motion of both eyes to the right"),
        ("speed_down_m_s", "Speed Down (m/s)", "m/s", 1.0, "Motion of both eyes along the image's columns"),
        ("speed_forward_m_s", "Speed Forward (m/s)", "m/s", 1.0, "Motion of both eyes along the optical axis"),
        ("turn_right_deg_s", "Turn Right (°/s)", "deg/s", 30.0, "Turn of the rig to the right about the left eye"),
        ("turn_down_deg_s", "Turn Down (°/s)", "deg/s", 30.0, "Turn of the rig downward about the left eye"),
        ("roll_deg_s", "Roll (°/s)", "deg/s", 30.0, "Turn of the rig clockwise about the left eye's optical axis"))),
    Setting("motion_exposure_s", "Motion Exposure (s)", 0.0, "Exposure time for motion blur. 0 takes that of the "
            "camera response, which must not be automatic then", "camera", "s", 0.0, 1.0e5, (0.0, 1.0), precision=6),
    _metres("x_m", "Site East", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "East coordinate of the left camera", "camera"),
    _metres("y_m", "Site North", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "North coordinate of the left camera",
            "camera"),
))

SENSOR = Topic("sensor", "Camera Response",
               "From radiance to digital numbers (EMVA 1288); applied when images are evaluated, never needs a new "
               "render", (
    Setting("auto_exposure", "Auto Exposure", True,
            "Choose one exposure for both eyes from the brightest part of the left image", "response"),
    _fraction("auto_percentile", "Auto Percentile", 0.99,
              "Share of the pixels that are at or below the exposure target", "response"),
    _fraction("auto_target", "Auto Target", 0.8,
              "Exposure target, as a share of the full well (divided by the gain where that is above 1)",
              "response", low=0.01),
    Setting("exposure_s", "Exposure (s)", 0.001, "Exposure time when auto exposure is off", "response", "s",
            1.0e-7, 1.0e5, (1.0e-5, 1.0), precision=6),
    Setting("brackets", "Merged Exposures", 1, "Images of different exposure that are merged into one (HDR); 1 for "
            "none", "response", "exposures", 1, 9),
    Setting("bracket_stops", "Exposure Step (stops)", 2.0,
            "Ratio of successive exposures as a power of two; they lie evenly about the exposure", "response",
            "stops", 0.1, 8.0, (0.5, 4.0)),
    Setting("encoding", "8-bit Encoding", "LINEAR", "How images of more than 8 bits become 8 bits for matchers",
            "response",
            choices=(("LINEAR", "Linear", "The top bits"),
                     ("SQUARE_ROOT", "Square Root", "Equal steps of shot noise, as rovers send their images"))),
    Setting("f_number", "f-Number", 8.0, "Focal length over the diameter of the aperture", "response", "1",
            0.5, 256.0, (1.0, 32.0)),
    Setting("pixel_pitch_um", "Pixel Pitch (µm)", 0.0, "Side of a pixel, which sets how much light and how many "
            "particles it receives; 0 for sensor width / columns", "response", "µm", 0.0, 1000.0, (0.0, 30.0),
            precision=2),
    _fraction("transmission", "Transmission", 0.9, "Share of the light that lens and filter pass on", "response"),
    Setting("band_centre_nm", "Band Centre (nm)", 600.0, "Middle of the band of wavelengths that is detected",
            "response", "nm", 100.0, 20000.0, (300.0, 1100.0), precision=0),
    Setting("band_width_nm", "Band Width (nm)", 200.0, "Width of the band of wavelengths that is detected",
            "response", "nm", 0.1, 20000.0, (5.0, 700.0), precision=0),
    _fraction("quantum_efficiency", "Quantum Efficiency", 0.5, "Electrons per photon, mean over the band", "response"),
    Setting("full_well_e", "Full Well (e-)", 20000.0, "Electrons that a pixel holds before it saturates",
            "response", "e-", 1.0, 1.0e7, (1000.0, 1.0e5), precision=0),
    Setting("gain", "Gain", 1.0, "Gain, relative to that at which a full well gives the largest number",
            "response", "1", 0.01, 1000.0, (0.5, 16.0)),
    Setting("read_noise_e", "Read Noise (e-)", 15.0, "Standard deviation of the noise of reading a pixel",
            "response", "e-", 0.0, 1.0e5, (0.0, 100.0), precision=1),
    Setting("shot_noise", "Shot Noise", True, "Poisson noise of photo-electrons and dark current", "response"),
    Setting("dark_current_e_s", "Dark Current (e-/s)", 10.0, "Electrons per second without light at the reference "
            "temperature", "response", "e-/s", 0.0, 1.0e7, (0.0, 1000.0)),
    Setting("temperature_k", "Temperature (K)", 253.0, "Temperature of the sensor, which sets its dark current",
            "response", "K", 0.0, 500.0, (150.0, 330.0), precision=0),
    Setting("dark_reference_k", "Dark Reference (K)", 293.0, "Temperature for which the dark current is given",
            "response", "K", 1.0, 500.0, (200.0, 330.0), precision=0),
    Setting("dark_doubling_k", "Dark Doubling (K)", 8.0, "Rise in temperature that doubles the dark current",
            "response", "K", 1.0, 50.0, (4.0, 12.0), precision=1),
    _fraction("prnu", "PRNU", 0.0, "Photo-response non-uniformity: standard deviation of the pixels' sensitivity",
              "response"),
    Setting("dsnu_e", "DSNU (e-)", 0.0, "Dark-signal non-uniformity: standard deviation of the pixels' offsets",
            "response", "e-", 0.0, 1.0e5, (0.0, 100.0), precision=1),
    _fraction("blooming", "Blooming", 0.0, "Share of a full well's overflow that runs along the column; the rest is "
              "drained", "response"),
    _fraction("black_level", "Black Level", 0.0, "Number read without light, as a share of the converter's range",
              "response", high=0.5),
    Setting("bits", "Bits", 8, "Bits of the analogue-digital converter", "response", "bits", 8, 16),
    Setting("psf_sigma_px", "Point Spread (px)", 0.0, "Standard deviation of the lens's Gaussian point spread",
            "response", "px", 0.0, 50.0, (0.0, 3.0), precision=2),
    _fraction("veiling_glare", "Veiling Glare", 0.0, "Share of the image's light that is spread evenly over it "
              "(ISO 9358)", "response"),
    Setting("radiation_flux_cm2_s", "Particles (1/cm² s)", 0.0, "Charged particles per cm² of the sensor and second "
            "that get through the shield", "response", "1/(cm² s)", 0.0, 1.0e12, (0.0, 1.0e6), precision=0),
    Setting("radiation_depth_um", "Sensitive Depth (µm)", 10.0, "Depth of silicon in which particles free electrons",
            "response", "µm", 0.1, 1000.0, (2.0, 50.0), precision=1),
    Setting("radiation_e_per_um", "Ionisation (e-/µm)", 80.0, "Electrons that a particle frees per micrometre",
            "response", "e-/µm", 0.0, 1.0e6, (50.0, 500.0), precision=0),
    Setting("noise_seed", "Noise Seed", 0, "Seed of the noise. Another seed draws other noise for the same sensor",
            "response", "1", 0, 2147483647, (0, 100)),
))

QUALITY = Topic("quality", "Render Quality", "Noise, bias and speed of a render", (
    Setting("samples", "Samples", 32, "Light paths per pixel and eye", "sampling", "samples", 1, 65536, (1, 1024)),
    Setting("denoiser", "Denoiser", "NONE",
            "Applied to each eye; the truth is never touched", "sampling",
            choices=(("NONE", "None", "Leave the noise of the light paths in the images"),
                     ("OIDN", "OpenImageDenoise",
                      "Remove the noise; cheap, but what guides it, the noise-free albedo and normal, flatters stereo "
                      "matchers"),
                     ("OIDN_COLOUR", "OIDN, Colour Alone",
                      "Remove the noise without guides: smooths fine texture away"))),
    Setting("noise_threshold", "Noise Threshold", 0.0,
            "Relative noise at which a pixel gets no more light paths; 0 gives all pixels the same number. Saves time "
            "in the sky and on smooth light, and leaves noise that is uneven over the image. Each pixel gets "
            "16 threshold^-0.3 at least: 32 at 0.1, 64 at 0.01", "sampling", "1",
            0.0, 1.0, (0.0, 0.1)),
    Setting("diffuse_bounces", "Bounces", 4,
            "Diffuse interreflections followed; 4 are within 1 % of all even at albedo 1", "sampling", "bounces",
            0, 128, (0, 16)),
    Setting("walk_px", "Shortest Walk (px)", 0.1,
            "Mean free path of light under the surface, in pixels where level ground is nearest, below which it is not "
            "followed: the light then leaves where it entered, as much of it within 3 %. 0 always follows it",
            "material", "px", 0.0, 100.0, (0.0, 1.0)),
    Setting("fine_relief", "Fine Relief", "ALL", "What light meets the relief that shades as bump or comes as a normal "
            "image, of Lambert's law and of Principled ice without a walk under the surface; all light does with "
            "others", "material",
            choices=(("ALL", "All Light", "Light that comes by way of other ground has met its relief too"),
                     ("CAMERA", "Camera Alone", "Light comes by way of ground as smooth as its mesh. Saves a tenth of "
                      "a pair; under a low Sun shadows are brighter, by 2 % where relief is a twenty-fifth as high as "
                      "wide, by 5 % at an eighth, and the mean is off by less than 0.1 % and 0.3 %"))),
    Setting("truth", "Truth", "FULL", "Which truth is rendered with the images", "sampling",
            choices=(("FULL", "Full", "Depth, normals and labels, in a render of their own, one light path per pixel"),
                     ("DEPTH", "Depth Alone", "Out of the render of the light, which saves the other one where the "
                      "images are neither blurred nor turned in"))),
    Setting("device", "Device", "CPU", "Processor that computes the light paths", "run",
            choices=(("CPU", "CPU", "All processor cores"),
                     ("GPU", "GPU", "The graphics cards that Cycles can use; refused if there is none"))),
    Setting("threads", "Threads", 0, "Processor threads; 0 for all", "run", "threads", 0, 1024, (0, 64)),
))

DATASET = Topic("dataset", "Data Set", "Where pairs go and how they vary", (
    Setting("folder", "Folder", "~/icymoon",
            "Where the data set is written; ~ is your home folder, // the folder of the .blend file",
            "run", subtype="DIR_PATH", trust="written"),
    Setting("seed", "Seed", 1,
            "The one seed from which terrain, rocks, grains, render noise and sensor noise are all drawn",
            "geometry", "1", 0, 2147483647, (0, 100)),
    Setting("headings", "Headings", 1,
            "Pairs rendered at the site, with the rig turned by equal steps between them; 4 for a panorama", "run",
            "pairs", 1, 360, (1, 12)),
    Setting("plan", "Plan", "datasets/guiss_smoke",
            "Plan of a data set: a TOML file, or the name of a shipped one. It does not use the present scene",
            "run", trust="read"),
    Setting("workers", "Workers", 0, "Processes that render a data set side by side; 0 for the number in the "
            "preferences, or else one per four processors", "run", "processes", 0, 1024, (0, 16)),
    Setting("evaluate", "Evaluate Afterwards", False,
            "Match and measure the whole data set when all of it is rendered", "run"),
    Setting("leave_running", "Leave Running", False, "Go on rendering the data set when Blender is closed or another "
            "file is opened; the next Blender shows it again", "run"),
    Setting("methods", "Matchers", "bm,sgbm", "Stereo matchers that Evaluate runs, separated by commas: bm, sgbm, "
            "sgbm_wls, jplv, igev, dsmnet; options as in sgbm:window=7; one that you have set up in the preferences as "
            "own:NAME", "run", trust="matchers"),
))

TOPICS: dict[str, Topic] = {t.key: t for t in (
    SOURCE, TERRAIN, MESH, RIDGES, CRACKS, CHAOS, CRATERS, HOLLOWS, PENITENTES, MANTLE, SURFACE, HAPKE, TEXTURES,
    ROCKS, ROCK_SURFACE, LIGHT, RIG, SENSOR, QUALITY, DATASET)}


def all_settings() -> list[tuple[str, Setting]]:
    """Every (topic key, setting) in the order of the sidebar."""
    return [(topic.key, setting) for topic in TOPICS.values() for setting in topic.settings]
