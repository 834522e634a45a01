"""The table of settings.

``TOPICS`` is the only list of settings. Blender's property groups (``Scene.icymoon``), the keys of presets and TOML
files, ``--set topic.key=value``, the documentation and the provenance in ``pair.json`` are all made from it.
``scene_properties`` gives Blender its properties.

Units are part of the names (``_m``, ``_deg``, ``_px`` …). The sidebar and the TOML files have the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..paper_stand_ins import items as stand_ins
from ..plugins.landforms import RELEASE, PluginLandform, landform_plugins
from . import trust_boundary

Value = bool | int | float | str | list[dict[str, Any]]

#: What must be made again after a change of a setting, the most expensive first. After a change of
#: "response" only the images are developed again. A change of "run" changes no result.
EFFECTS = ("geometry", "material", "light", "lander", "camera", "sampling", "response", "run")


@dataclass(frozen=True)
class Setting:
    """One setting. ``minimum`` and ``maximum`` bound what is accepted, ``soft`` is the range of the slider."""

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
    entries: tuple[Setting, ...] = ()  # for a list of tables: the settings of each table
    trust: str = ""  # for a text: one of ``trust_boundary.CLASSES``
    zero: str = ""  # for a number: what 0 stands for, where that is not simply none of it

    def __post_init__(self) -> None:
        if (self.kind == "text") != (self.trust in trust_boundary.CLASSES):
            raise ValueError(f"{self.key}: a text must have a class of trust, and no other setting may have one.")

    @cached_property  # asked for each field at every redraw
    def kind(self) -> str:
        """'choice', 'bool', 'int', 'float', 'text' or 'list'; the ``entries`` describe the tables of a list."""
        if self.entries:
            return "list"
        if self.choices:
            return "choice"
        return {bool: "bool", int: "int", float: "float", str: "text"}[type(self.default)]


@dataclass(frozen=True)
class Topic:
    """A group of settings: one sub-panel and one TOML table."""

    key: str
    label: str
    description: str
    settings: tuple[Setting, ...]
    parent: str = ""  # label of the parent panel; empty if the panel is at the top of the sidebar
    plugin: str = ""  # package and version of the plug-in that it is of

    @cached_property
    def _by_key(self) -> dict[str, Setting]:
        return {setting.key: setting for setting in self.settings}

    def __getitem__(self, key: str) -> Setting:
        try:
            return self._by_key[key]
        except KeyError:
            raise KeyError(f"{self.key}.{key}") from None


def _metres(key: str, label: str, default: float, low: float, high: float, soft: tuple[float, float],
            description: str, effect: str, zero: str = "") -> Setting:
    return Setting(key, label, default, description, effect, "m", low, high, soft, subtype="DISTANCE", precision=4,
                   zero=zero)


def _degrees(key: str, label: str, default: float, low: float, high: float, description: str, effect: str,
             soft: tuple[float, float] | None = None, precision: int = 2) -> Setting:
    return Setting(key, f"{label} (°)", default, description, effect, "deg", low, high, soft, precision=precision)


def _fraction(key: str, label: str, default: float, description: str, effect: str, low: float = 0.0,
              high: float = 1.0) -> Setting:
    return Setting(key, label, default, description, effect, "1", low, high, subtype="FACTOR")


def _signed(key: str, label: str, description: str, effect: str) -> Setting:
    # No FACTOR: Blender fills its slider from the minimum, so that 0 would look like a half.
    return Setting(key, label, 0.0, description, effect, "1", -1.0, 1.0)


def _file(key: str, label: str, description: str) -> Setting:
    return Setting(key, label, "", f"{description}. // is the folder of the .blend file", "material",
                   subtype="FILE_PATH", trust="read")


def _stand_in(description: str, effect: str, items: Sequence[stand_ins.TextureItem | stand_ins.MeshItem]) -> Setting:
    return Setting("stand_in", "Stand-In", items[0].key, description, effect,
                   choices=tuple((item.key, item.title, f"In place of {item.paper} of the GUISS paper: {item.known}")
                                 for item in items))


#: Parent panel of the topics that describe one landform each.
LANDFORMS = "Landforms"

#: One entry of ``terrain.layers``.
LAYER = (
    Setting("basis", "Basis", "GRADIENT", "Type of noise that the layer is made of", "geometry",
            choices=(("GRADIENT", "Gradient Noise", "Rounded hills (Perlin)"),
                     ("MIDPOINT", "Mid-Point", "Midpoint displacement: straight slopes between random points"),
                     ("CELLS", "Cells", "Square steps of random height"),
                     ("VORONOI_F1", "Voronoi F1", "Distance to the nearest random point: cones"),
                     ("VORONOI_F2", "Voronoi F2", "Distance to the second nearest random point"),
                     ("VORONOI_F2_F1", "Voronoi F2-F1", "Zero on the edges between cells, highest at their points"),
                     ("CRACKLE", "Crackle", "Flat plates separated by narrow cracks"))),
    Setting("fractal", "Fractal", "FBM", "How the octaves are combined", "geometry",
            choices=(("FBM", "fBm", "Plain sum: equally rough everywhere"),
                     ("MULTIFRACTAL", "Multifractal", "Product: smooth plains between rough heights"),
                     ("HYBRID", "Hybrid", "Each octave scaled by the previous one: smooth valleys"),
                     ("RIDGED", "Ridged", "Sharp crests with rough flanks"),
                     ("HETERO", "Hetero Terrain", "Each octave scaled by the height so far: smooth low ground"),
                     ("TURBULENCE", "Turbulence", "Sum of magnitudes: rounded lumps with creases"),
                     ("CRESTS", "Crests", "Sum of sharp crests: equally rough everywhere"))),
    _metres("amplitude_m", "Amplitude", 0.1, -1.0e4, 1.0e4, (-2.0, 2.0),
            "RMS height of the layer. A negative value turns it upside down", "geometry"),
    _metres("scale_m", "Scale", 2.0, 1.0e-3, 1.0e5, (0.1, 20.0), "Wavelength of the layer's first octave", "geometry"),
    Setting("octaves", "Octaves", 6, "Number of octaves. Octaves that are too fine for the mesh are left out",
            "geometry", "octaves", 1, 16, (1, 10)),
    Setting("lacunarity", "Lacunarity", 2.0, "Ratio of wavelengths of successive octaves", "geometry", "1",
            1.2, 4.0, (1.5, 3.0)),
    _fraction("roughness", "Roughness", 0.5, "Ratio of the amplitudes of successive octaves", "geometry"),
    _metres("warp_m", "Warp", 0.0, 0.0, 1.0e4, (0.0, 2.0),
            "RMS horizontal displacement of the layer, by noise of the same scale", "geometry"),
)

TERRAIN = Topic("terrain", "Ground", "Shape of the ground: a random surface with given statistics, and its landforms", (
    _metres("size_m", "Size", 20.0, 0.01, 1.0e5, (1.0, 100.0),
            "Side of the square patch of ground, centred on the origin", "geometry"),
    Setting("resolution", "Vertices per Side", 1025,
            "Vertices along each side of the patch; their spacing is size / (vertices - 1)", "geometry",
            "vertices", 2, 4097, (65, 2049)),
    _degrees("rms_slope_deg", "Roughness, RMS Slope", 12.0, 0.0, 75.0,
             "Root-mean-square slope between points that are one slope baseline apart. "
             "Smooth plains have about 5, ridged plains 10 to 15, broken ground above 25", "geometry",
             (0.0, 45.0)),
    _metres("slope_baseline_m", "Slope Baseline", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0),
            "Distance between the points whose slope is the roughness", "geometry"),
    Setting("hurst", "Hurst Exponent", 0.8,
            "How roughness changes with scale: the RMS deviation grows as distance to this power. "
            "Below 0.5, slopes over centimetres are unrealistically steep", "geometry", "1", 0.05, 1.0, (0.3, 1.0)),
    _fraction("multifractality", "Multifractality", 0.5,
              "0 is equally rough everywhere (fractional Brownian motion). 1 has smooth hollows and rough heights",
              "geometry"),
    _metres("outer_scale_m", "Largest Feature", 8.0, 1.0e-3, 1.0e5, (0.5, 50.0),
            "Longest wavelength of the ground. The roughness law holds up to 0.3 of it", "geometry"),
    _metres("inner_scale_m", "Smallest Feature", 0.02, 1.0e-4, 1.0e4, (0.005, 1.0),
            "Shortest wavelength of the ground; the roughness law holds down to half of it. "
            "Wavelengths below two vertex spacings are left out of the mesh", "geometry"),
    Setting("lacunarity", "Lacunarity", 2.0,
            "Largest ratio of the wavelengths of successive octaves, which are spaced evenly. "
            "Above 2.5 the roughness law shows steps", "geometry", "1", 1.2, 4.0, (1.5, 3.0)),
    _degrees("regional_slope_deg", "Regional Slope", 0.0, 0.0, 60.0,
             "Slope of the whole patch, as on the flank of a ridge. The roughness does not include it", "geometry",
             (0.0, 30.0)),
    _degrees("regional_slope_azimuth_deg", "Downslope Direction", 180.0, -360.0, 360.0,
             "Direction in which the whole patch slopes down, from north (+Y) over east (+X)", "geometry"),
    _metres("body_radius_m", "Moon Radius", 2.521e5, 1.0e4, 1.0e8, (1.0e5, 3.0e6),
            "Mean radius of the moon, which sets the distance of the horizon: 252.1 km for Enceladus, 1560.8 km for "
            "Europa. Ground on a uniform grid is flat", "geometry"),
    Setting("variant", "Variant", 0,
            "Number of a ground among others of the same kind: relief, layers and landforms are at other places, rocks "
            "are not. Each terrain preset has its own number, so two presets do not have the same hills at one seed",
            "geometry", "1", 0, 2**31 - 1, (0, 100)),
    Setting("layers", "Layers of Noise", [], "Fractal noise that is added to the ground, one table per layer",
            "geometry", entries=LAYER),
))

MESH = Topic("mesh", "Mesh", "Resolution and extent of the mesh of procedural ground", (
    Setting("kind", "Spacing", "GRADED", "How the vertices of procedural ground are spaced", "geometry",
            choices=(("GRADED", "Graded",
                      "Rings around the site, out to the horizon, with triangles as fine as the images resolve"),
                     ("GRID", "Uniform Grid", "A square of Ground Size with equal spacing"))),
    Setting("error_px", "Largest Error", 1.0,
            "Distance between the mesh and the exact ground, in pixels of the nearer eye. 95 % of the pixels are "
            "within it, for every heading", "geometry", "px", 1.0e-3, 100.0, (0.05, 5.0), subtype="PIXEL"),
    Setting("edge_px", "Longest Edge", 8.0,
            "Longest edge of a triangle on level ground, in pixels of the nearer eye. "
            "It also limits triangles on smooth ground", "geometry", "px", 0.1, 1000.0, (1.0, 20.0), subtype="PIXEL"),
    _metres("farthest_m", "Maximum Distance", 1.0e5, 1.0, 1.0e6, (10.0, 1.0e5),
            "Distance at which the ground ends if the horizon is farther away", "geometry"),
    Setting("most", "Maximum Vertices", 2000000,
            "Maximum number of vertices. If the largest error needs more, the mesh has a larger error and reports it",
            "geometry", "vertices", 1000, 100000000, (10000, 10000000)),
    Setting("seen", "Where Seen", "EVEN", "How fine a graded mesh is where the cameras see it", "geometry",
            choices=(("EVEN", "As Elsewhere", "One mesh for all headings. Waves of the ground shorter than two of its "
                      "edges are missing, so that ground under a low Sun looks smoother than stated"),
                     ("FINE", "Finer", "Triangles that the cameras see are cut into nine, and the ground has waves a "
                      "third as long there, in images and truth. Each heading has a mesh of its own"))),
    Setting("crests", "Crests", "ROUNDED", "What a graded mesh does with crests of penitentes and ridges and rims of "
            "pits", "geometry",
            choices=(("ROUNDED", "Rounded", "Crests are as round as the mesh is coarse, and show small teeth"),
                     ("CUT", "Cut", "Triangles are cut along the crests, which are then as sharp as the law"))),
    Setting("walls", "Walls", "FLUTED", "What a graded mesh does with walls of pits and of broken plates and cracks",
            "geometry",
            choices=(("FLUTED", "Fluted", "Walls have one shape from rim to foot, as a height field has"),
                     ("BROKEN", "Broken", "Where cameras see walls, their triangles are cut smaller, and chips that "
                      "differ from top to bottom are broken out of them"))),
))

RIDGES = Topic("ridges", "Ridges", "Double ridges with a trough between the crests; young ridges cross old ones", (
    _metres("height_m", "Height", 0.0, 0.0, 1000.0, (0.0, 5.0), "Height of the crests above the plain; 0 for no ridges",
            "geometry"),
    _metres("width_m", "Width", 4.0, 0.01, 1.0e4, (0.5, 50.0), "Width of a ridge from foot to foot", "geometry"),
    _metres("spacing_m", "Spacing", 9.0, 0.01, 1.0e5, (1.0, 100.0),
            "Mean distance between ridges of one set, at least 1.2 widths", "geometry"),
    _fraction("trough", "Trough", 0.5, "Depth of the trough between the crests as a share of the height; "
              "0 for a single, flat-topped ridge", "geometry"),
    Setting("sets", "Sets", 2, "Number of sets of parallel ridges. Each set crosses the sets before it", "geometry",
            "sets", 1, 6),
    _degrees("azimuth_deg", "Direction", 60.0, -360.0, 360.0,
             "Mean direction of the ridges, from north (+Y) over east (+X)", "geometry"),
    _degrees("spread_deg", "Spread", 50.0, 0.0, 90.0, "Largest deviation of a set's direction from the mean",
             "geometry"),
), LANDFORMS)

CRACKS = Topic("cracks", "Cracks", "Fractures along the edges of plates", (
    _metres("depth_m", "Depth", 0.0, 0.0, 1000.0, (0.0, 2.0), "Depth of the cracks below the ground; 0 for no cracks",
            "geometry"),
    _metres("width_m", "Width", 0.4, 1.0e-3, 1.0e4, (0.05, 5.0), "Width of a crack from edge to edge", "geometry"),
    _metres("rim_m", "Rim", 0.0, 0.0, 1000.0, (0.0, 1.0), "Height of the raised rims beside the cracks", "geometry"),
    _metres("plate_m", "Plate", 3.0, 0.01, 1.0e5, (0.5, 50.0), "Mean width of the plates between cracks", "geometry"),
    Setting("elongation", "Elongation", 1.0, "Length of a plate divided by its width: 1 for polygons, above 5 for the "
            "nearly parallel fractures beside a tiger stripe", "geometry", "1", 1.0, 100.0, (1.0, 15.0)),
    _degrees("azimuth_deg", "Direction", 0.0, -360.0, 360.0,
             "Direction of elongated cracks, from north (+Y) over east (+X)", "geometry"),
    Setting("edges", "Edges", "ROUNDED", "Shape of the walls of cracks, and what lies in them", "geometry",
            choices=(("ROUNDED", "Rounded", "Smooth walls that end in the middle of the crack"),
                     ("BROKEN", "Broken", "Steep, chipped walls, and fallen fragments of ice on the floor"))),
), LANDFORMS)

CHAOS = Topic("chaos", "Chaos", "Raised and tilted plates of broken crust in a lumpy matrix", (
    _metres("relief_m", "Relief", 0.0, 0.0, 1.0e4, (0.0, 10.0),
            "Height of the highest plates above the matrix. The lowest are half as high; 0 for no plates", "geometry"),
    _metres("plate_m", "Plate", 4.0, 0.01, 1.0e5, (0.5, 50.0), "Mean width of a plate", "geometry"),
    _fraction("plate_share", "Plate Share", 0.6, "Share of the plates that are preserved. The others are matrix",
              "geometry"),
    _metres("gap_m", "Gap", 0.3, 0.0, 1.0e4, (0.0, 5.0), "Width of the gap between neighbouring plates", "geometry"),
    _degrees("tilt_deg", "Tilt", 8.0, 0.0, 60.0, "Largest slope of the top of a plate toward east or north", "geometry",
             (0.0, 30.0)),
    _metres("matrix_m", "Matrix Relief", 0.0, 0.0, 1000.0, (0.0, 2.0), "RMS height of the lumps between the plates",
            "geometry"),
    Setting("edges", "Edges", "ROUNDED", "Shape of the edges of plates, and what lies between them", "geometry",
            choices=(("ROUNDED", "Rounded", "Bent edges, scarps of 60 degrees with smooth rims, and lumps between"),
                     ("BROKEN", "Broken", "Straight, chipped edges, scarps of 80 degrees with sharp rims, and tilted "
                      "fragments of ice between"))),
), LANDFORMS)

CRATERS = Topic("craters", "Craters", "Small bowl-shaped craters with a power law of sizes", (
    _fraction("coverage", "Coverage", 0.0, "Total area of the craters divided by the area of the ground; 0 for none",
              "geometry", high=2.0),
    _metres("smallest_m", "Smallest", 0.4, 1.0e-3, 1.0e4, (0.1, 10.0), "Diameter of the smallest craters", "geometry"),
    _metres("largest_m", "Largest", 5.0, 1.0e-3, 1.0e4, (0.5, 50.0), "Diameter of the largest craters", "geometry"),
    Setting("power_index", "Size Index", 3.0,
            "Exponent of the cumulative power law N(>D) ~ D^-index: about 2 for primary craters, 4 for secondaries",
            "geometry", "1", 0.5, 6.0, (1.0, 5.0)),
    _fraction("depth_ratio", "Depth", 0.2, "Depth of a fresh crater, from rim to floor, divided by its diameter",
              "geometry"),
    _fraction("rim_ratio", "Rim", 0.04, "Height of the rim of a fresh crater divided by its diameter", "geometry"),
    _fraction("freshness", "Freshness", 0.3,
              "Depth of the oldest crater as a share of the depth when fresh; 1 if all craters are fresh", "geometry"),
    Setting("most", "Maximum Craters", 5000, "Maximum number of craters. Build Scene refuses settings that need more",
            "geometry", "craters", 0, 50000, (0, 10000)),
), LANDFORMS)

HOLLOWS = Topic("hollows", "Hollows", "Cups with sharp rims, formed by sublimation without wind", (
    _metres("depth_m", "Depth", 0.0, 0.0, 100.0, (0.0, 1.0), "Depth of the deepest hollow below its rim. The "
            "shallowest has 0.6 of it; 0 for no hollows", "geometry"),
    _metres("diameter_m", "Diameter", 0.6, 1.0e-3, 1.0e4, (0.1, 5.0), "Mean diameter of a hollow", "geometry"),
    Setting("elongation", "Elongation", 1.0, "Length of a hollow divided by its width. Sastrugi, which need wind, have "
            "about 5", "geometry", "1", 1.0, 100.0, (1.0, 10.0)),
    _degrees("azimuth_deg", "Direction", 0.0, -360.0, 360.0,
             "Direction of the long axis of the hollows, from north (+Y) over east (+X)", "geometry"),
    _metres("crest_m", "Crest Width", 0.0, 0.0, 100.0, (0.0, 0.2), "Width over which the crests between hollows are "
            "round; 0 for edges, which a mesh shows as teeth", "geometry"),
), LANDFORMS)

PENITENTES = Topic("penitentes", "Penitentes", "Rows of ice blades that lean toward the noon Sun", (
    _metres("height_m", "Height", 0.0, 0.0, 100.0, (0.0, 6.0),
            "Height of the tallest blades above the troughs; 0 for none", "geometry"),
    _metres("spacing_m", "Spacing", 1.5, 0.01, 1000.0, (0.2, 10.0), "Mean distance between rows of blades", "geometry"),
    _fraction("sharpness", "Sharpness", 0.8, "0 gives rounded ridges, 1 sharp edges between concave walls", "geometry"),
    Setting("elongation", "Elongation", 1.5, "Length of a blade divided by the spacing of rows", "geometry", "1",
            0.5, 100.0, (0.5, 10.0)),
    _fraction("variation", "Variation", 0.6, "Variation of the heights of blades and of the saddles between them; "
              "0 for unbroken rows of one height", "geometry"),
    _fraction("disorder", "Disorder", 0.0, "How much groups of blades differ in height, and blades in spacing and "
              "lean; 0 for rows that are alike everywhere", "geometry"),
    _degrees("noon_azimuth_deg", "Noon Sun", 0.0, -360.0, 360.0,
             "Azimuth of the noon Sun. Blades lean toward it, and rows run at right angles to it", "geometry"),
    _degrees("lean_deg", "Lean", 0.0, 0.0, 60.0, "Angle by which blades lean from the vertical: the zenith distance of "
             "the noon Sun. Limited to what a height field can contain", "geometry", (0.0, 30.0)),
), LANDFORMS)

PITS = Topic("pits", "Pits", "Pits with flat floors and steep walls, which grow sideways by sublimation", (
    _metres("depth_m", "Depth", 0.0, 0.0, 100.0, (0.0, 2.0), "Depth of the floors below the ground; 0 for no pits",
            "geometry"),
    _metres("diameter_m", "Diameter", 2.0, 1.0e-2, 1.0e4, (0.2, 20.0), "Mean diameter of a pit. They have from half to "
            "one and a half times that", "geometry"),
    Setting("coverage", "Coverage", 0.3, "Share of the ground that is in pits. Above about 0.3 many grow together",
            "geometry", "1", 0.0, 0.8, (0.0, 0.7)),
    _degrees("wall_deg", "Wall Slope", 60.0, 10.0, 85.0, "Slope of the walls", "geometry"),
    Setting("talus", "Talus", 0.0, "Mean height of the talus at the foot of the walls, as a share of the depth; 0 for "
            "none", "geometry", "1", 0.0, 0.5, (0.0, 0.5)),
), LANDFORMS)

HILLS = Topic("hills", "Distant Hills", "Hills and ranges from the patch of ground to the horizon", (
    _degrees("rms_slope_deg", "RMS Slope", 0.0, 0.0, 45.0,
             "Root-mean-square slope between points that are one slope baseline apart; 0 for no hills. Europa's ridged "
             "plains have 10 to 15 at 10 to 100 m, its smooth bands about 5", "geometry", (0.0, 20.0)),
    _metres("slope_baseline_m", "Slope Baseline", 30.0, 0.1, 1.0e5, (1.0, 1000.0),
            "Distance between the points whose slope is stated", "geometry"),
    Setting("hurst", "Hurst Exponent", 0.75, "How roughness changes with scale: the height of hills grows as their "
            "width to this power", "geometry", "1", 0.05, 1.0, (0.3, 1.0)),
    _metres("largest_m", "Largest", 2000.0, 1.0, 1.0e5, (100.0, 1.0e4), "Width of the widest hills", "geometry"),
    _metres("smallest_m", "Smallest", 10.0, 0.1, 1.0e5, (5.0, 100.0),
            "Width of the narrowest hills; what is smaller is the roughness of the ground", "geometry"),
    Setting("fractal", "Kind", "FBM", "Shape of the hills", "geometry",
            choices=(("FBM", "Rolling", "Rounded hills, equally rough everywhere"),
                     ("CRESTS", "Ridged", "Ranges with sharp crests"),
                     ("HETERO", "Plains and Hills", "Rough hills beside smooth low ground"))),
))

MANTLE = Topic("mantle", "Mantle", "Snow that fills hollows and smooths the ground", (
    _metres("thickness_m", "Thickness", 0.0, 0.0, 1000.0, (0.0, 1.0),
            "Thickness of the snow in deep hollows; 0 for none. Raised ground keeps its shape", "geometry"),
    _metres("length_m", "Smoothing Length", 1.5, 1.0e-3, 1.0e5, (0.1, 10.0),
            "Wavelength below which the surface of the snow is smooth", "geometry"),
), LANDFORMS)

SOURCE = Topic("source", "Ground from a File", "Source of the ground: generated, or your own mesh or height map", (
    Setting("kind", "Source", "PROCEDURAL", "What the ground is made from", "geometry",
            choices=(("PROCEDURAL", "Procedural", "A random surface with the statistics under Ground"),
                     ("MESH", "Mesh File", "A reconstructed mesh: OBJ, PLY, STL, glTF, USD or FBX"),
                     ("STAND_IN", "Stand-In Mesh", "A mesh made by code in place of one of the GUISS paper's"),
                     ("HEIGHT_MAP", "Height Map", "A digital elevation model: GeoTIFF, NPY, EXR or grey PNG"))),
    _stand_in("The mesh made by code that is the ground", "geometry", stand_ins.MESHES),
    Setting("file", "File", "", "Mesh or height map that is the ground. ~ is your home folder, // the folder of the "
            ".blend file. Ids of pairs depend on the content of the file, not on its path", "geometry",
            subtype="FILE_PATH", trust="read"),
    Setting("scale", "Metres per Unit", 1.0,
            "Metres per unit of a mesh file: 1 for metres, 0.001 for millimetres. It multiplies the unit that glTF, "
            "USD and FBX files contain", "geometry", "m/unit", 1.0e-6, 1.0e6, (0.001, 1000.0), precision=6),
    Setting("up_axis", "Up Axis", "AUTO", "Axis of the mesh file that points up. For USD and FBX it is an axis of the "
            "scene that Blender imports", "geometry",
            choices=(("AUTO", "Automatic", "The usual axis of the format: Y for OBJ and glTF, Z for PLY and STL, the "
                      "one that the file states for USD and FBX"),
                     ("X", "X", "+X points up"), ("Y", "Y", "+Y points up"), ("Z", "Z", "+Z points up"),
                     ("-X", "-X", "-X points up"), ("-Y", "-Y", "-Y points up"), ("-Z", "-Z", "-Z points up"))),
    Setting("centre", "Centre", True, "Put the origin at the centre of the ground and at its median height. "
            "Otherwise the coordinates of the file are kept", "geometry"),
    _metres("origin_x_m", "Origin East", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0),
            "Distance of the origin of the site east of the ground's centre, or of the file's origin", "geometry"),
    _metres("origin_y_m", "Origin North", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0),
            "Distance of the origin of the site north of the ground's centre, or of the file's origin", "geometry"),
    _metres("metres_per_pixel", "Metres per Pixel", 0.0, 0.0, 1.0e5, (0.0, 100.0),
            "Size of a pixel of the height map; 0 for the size that a GeoTIFF contains", "geometry",
            zero="file's"),
    Setting("missing", "Missing Height", "", "Value of the height map, before its scale and unit, that means that a "
            "height is missing, such as -9999, beside those that the file marks. If it is empty, values far from all "
            "others are taken for missing; with none they are heights", "geometry", trust="mark"),
    Setting("height_scale_m", "Metres per Value", 1.0,
            "Metres per unit of the values of the height map; for PNG, metres per grey level. It multiplies the unit "
            "and scale that a GeoTIFF contains", "geometry", "m",
            1.0e-9, 1.0e6, (1.0e-3, 10.0), precision=6),
    Setting("detail", "Add Roughness", False,
            "Add roughness from Ground at wavelengths that the file does not resolve", "geometry"),
    Setting("repair", "Repair", True,
            "Remove broken faces, merge duplicate vertices and turn the upper side of a mesh up", "geometry"),
))

EXCAVATION = Topic("excavation", "Excavation", "A trench that a scoop digs, and the heap beside it", (
    Setting("path", "Scoop's Path", "NONE", "Path of the scoop's blade", "geometry",
            choices=(("NONE", "None", "The ground is not dug"),
                     ("LINE", "Line", "Straight and parallel to the ground, with upright ends, one bite deeper in each "
                      "state"),
                     ("ARC", "Arc", "The blade swings into the ground, goes along the line and swings out again"),
                     ("RECORDED", "Recorded", "Places of the blade from a CSV file"),
                     ("JOINTS", "Recorded Joints", "Places of the scoop's tip, from joint angles of the arm in a CSV "
                      "file"))),
    Setting("state", "State Shown", 2,
            "State of the excavation that is built: 0 is untouched ground. A sweep of it makes a series",
            "geometry", "states", 0, 99, (0, 7)),
    Setting("states", "Number of States", 3,
            "Number of states of the excavation, the untouched ground included. All of them have the same fine mesh",
            "geometry", "states", 1, 100, (1, 12)),
    Setting("file", "Recorded Path", "", "CSV file whose first line names the columns state (from 1), x_m, y_m (east "
            "and north of the origin) and depth_m (of the blade's edge below the plane of the untouched ground); for "
            "recorded joints state, yaw_deg, shoulder_deg, elbow_deg, wrist_deg and roll_deg. // is the folder of the "
            ".blend file", "geometry", subtype="FILE_PATH", trust="read"),
    _metres("start_x_m", "Start East", 0.0, -1.0e4, 1.0e4, (-3.0, 3.0), "Where the blade starts, east of the origin",
            "geometry"),
    _metres("start_y_m", "Start North", 2.0, -1.0e4, 1.0e4, (0.0, 4.0), "Where the blade starts, north of the origin",
            "geometry"),
    _degrees("heading_deg", "Heading", 180.0, -360.0, 360.0, "Direction of the pull, from north (+Y) over east (+X)",
             "geometry"),
    _metres("length_m", "Length", 0.3, 0.0, 10.0, (0.0, 1.0), "Length of the pull at its full depth", "geometry"),
    _metres("width_m", "Blade Width", 0.08, 1.0e-3, 2.0, (0.02, 0.2), "Width of the blade", "geometry"),
    _metres("bite_m", "Bite", 0.05, 0.0, 1.0, (0.0, 0.15), "How much deeper the blade goes in each state; 0 digs "
            "nothing, as a series without change needs", "geometry"),
    _metres("radius_m", "Arc Radius", 0.25, 0.01, 10.0, (0.05, 1.0), "Radius on which the blade swings", "geometry"),
    Setting("cohesion_pa", "Cohesion (Pa)", 100.0, "Cohesion of the ground. Walls lower than a critical height, by "
            "cohesion, friction, density and gravity, stand upright; others slide to the angle of friction", "geometry",
            "Pa", 0.0, 1.0e8, (0.0, 1000.0), precision=1),
    _degrees("friction_deg", "Friction", 38.0, 5.0, 60.0, "Angle of internal friction, and of repose of what is loose",
             "geometry", (25.0, 45.0)),
    Setting("density_kg_m3", "Density (kg/m³)", 500.0, "Density of the ground", "geometry", "kg/m³", 10.0, 2000.0,
            (100.0, 917.0), precision=0),
    Setting("bulking", "Bulking", 1.4, "Volume of spoil over the volume that it had in the ground: the ratio of both "
            "densities", "geometry", "1", 1.0, 3.0, (1.0, 2.0)),
    Setting("gravity_m_s2", "Gravity (m/s²)", 0.0, "Gravity, which decides whether walls stand; 0 for that of the moon",
            "geometry", "m/s²", 0.0, 100.0, (0.0, 2.0), zero="the moon's"),
    _metres("chips_m", "Chipped Rims", 0.005, 0.0, 0.1, (0.0, 0.02), "Largest chip that breaks off the rims of walls "
            "that stand", "geometry"),
    _fraction("heaped_share", "Heaped Share", 1.0, "Share of what is dug that is heaped beside the trench. The scoop "
              "keeps the rest", "geometry"),
    Setting("heap_side", "Heap", "RIGHT", "Side of the heap, seen along the pull", "geometry",
            choices=(("LEFT", "Left", "Left of the trench"), ("RIGHT", "Right", "Right of the trench"))),
    _metres("heap_gap_m", "Gap", 0.05, 0.0, 10.0, (0.0, 0.3), "Distance from the trench to the foot of the heap in the "
            "last state", "geometry"),
    _metres("clods_m", "Clods", 0.0, 0.0, 0.05, (0.0, 0.02), "Height of the clods on spoil, or width of the largest if "
            "they have many sizes; 0 for none", "geometry"),
    Setting("clod_sizes", "Clod Sizes", "ONE", "Whether clods are of one size or of many", "geometry",
            choices=(("ONE", "One Size", "Lumps of one size in the surface of the heap"),
                     ("MANY", "Many Sizes", "Single clods, few large and many small ones, each where it came to rest: "
                      "large ones have rolled to the foot of the heap and beyond"))),
    _metres("cell_m", "Cell", 0.0025, 2.0e-4, 0.1, (0.001, 0.01), "Distance of the vertices of trench and heap",
            "geometry"),
    _fraction("fresh_albedo", "Fresh Albedo", 1.0, "Albedo of ground that was dug open, and of spoil, relative to the "
              "surface", "material"),
    _metres("layer_thickness_m", "Layer Thickness", 0.0, 0.0, 10.0, (0.0, 0.05), "Thickness of layers of another "
            "albedo in the ground, parallel to its surface; 0 for none", "material"),
    _metres("layer_depth_m", "Layer Depth", 0.03, 0.0, 10.0, (0.0, 0.3), "Depth of the top of the first layer below "
            "the untouched surface", "material"),
    _metres("layer_spacing_m", "Layer Spacing", 0.0, 0.0, 10.0, (0.0, 0.2), "Distance from the top of a layer to that "
            "of the next; 0 for a single layer", "material"),
    _fraction("layer_albedo", "Layer Albedo", 0.6, "Albedo of the layers relative to the surface", "material"),
    _metres("jitter_m", "Camera Jitter", 0.0, 0.0, 1.0, (0.0, 0.01), "Standard deviation of the camera's position, on "
            "each axis, from state to state", "camera"),
    _degrees("jitter_deg", "Camera Turn", 0.0, 0.0, 10.0, "Standard deviation of the camera's heading and of its "
             "pitch, from state to state", "camera", (0.0, 0.5), precision=3),
))

SURFACE = Topic("surface", "Ice", "Snow or ice that the ground is made of", (
    Setting("model", "Model", "PRINCIPLED", "Reflectance law of the surface", "material",
            choices=(("PRINCIPLED", "Snow (Principled)", "Like snow and ice on Earth, with gloss and light below the "
                      "surface. No opposition surge; costs 1.4 times Lambert, or 7 times if all light is subsurface"),
                     ("LAMBERT", "Lambert", "Equally bright from every direction; the cheapest law. No opposition "
                      "surge and no phase function: up to 18 % error in the mean of a sunlit scene of ice"),
                     ("LOMMEL_SEELIGER", "Lommel-Seeliger", "Single scattering, as in dark dust. Ice reflects mostly "
                      "multiply scattered light, which this law omits; costs little more than Lambert"),
                     ("LUNAR_LAMBERT", "Lunar-Lambert", "Lommel-Seeliger and Lambert mixed, as used for mosaics of "
                      "moons. No phase function and no opposition surge; costs little more than Lambert"),
                     ("HAPKE", "Hapke", "Ice of grains, as moons are modelled; no gloss. Phase function, opposition "
                      "surge and roughness are in the Hapke panel; costs 1.2 times Lambert, 1.8 times without OSL"),
                     ("SNOW", "Snow (Measured)", "Snow on Earth as measured, brighter against the light; no "
                      "gloss. Within about 5 % for a Sun at least 20 degrees high, seen at most 60 degrees from "
                      "the normal; no opposition surge; costs little more than Lambert"))),
    _fraction("albedo", "Albedo (Brightness)", 0.9,
              "Share of the light that clean, flat ice reflects under uniform light from all directions",
              "material"),
    _fraction("lommel_seeliger_share", "Lommel-Seeliger Share", 0.7, "Share of Lommel-Seeliger in the lunar-Lambert "
              "law. The albedo does not depend on it", "material"),
    Setting("ice_colour", "Ice Colour", "GREY", "Colour of clean ice. The albedo stays its mean over red, green and "
            "blue", "material",
            choices=(("GREY", "Grey", "The same in all bands"),
                     ("SNOW", "Snow", "Pure snow, by its grains: bluer the coarser it is (Warren and Brandt 2008)"),
                     ("EUROPA_PLAINS", "Europa's Plains", "Slightly yellow; assumed"),
                     ("ENCELADUS_PLAINS", "Enceladus' Plains", "Nearly grey (Buratti 1984)"))),
    _metres("snow_grain_m", "Snow Grain Radius", 0.0001, 1.0e-6, 0.01, (2.5e-5, 0.002),
            "Optical radius of the grains of snow, which sets its colour: 25 µm for frost, 1 mm for old snow",
            "material"),
    _fraction("albedo_variation", "Albedo Variation", 0.0,
              "Depth of the random dark patches as a share of the albedo", "material"),
    _fraction("face_variation", "Face Variation", 0.0, "How much the faces of rocks differ: a face is darker by up to "
              "this share of the albedo, and its roughness is up to this much higher or lower", "material"),
    _metres("albedo_patch_m", "Albedo Patch", 0.5, 1.0e-4, 1.0e4, (0.01, 10.0),
            "Wavelength of the dark patches", "material"),
    _signed("trough_dirt", "Dirt in Troughs",
            "Darkening of low ground. Compares heights one standard deviation below and above the mean plane; "
            "negative to darken high ground", "material"),
    _signed("slope_dirt", "Dirt on Slopes",
            "Darkening of slopes of 45 degrees and more, compared with level ground; negative to darken level ground",
            "material"),
    Setting("dirt", "Dirt", "BLACK", "What lies in troughs and on slopes, and covers the share of their area that is "
            "stated above", "material",
            choices=(("BLACK", "Black", "Reflects nothing, so the ice is darker and keeps its colour"),
                     ("EUROPA_DARK", "Dark Material", "Europa's, brown: 0.17 in green (Helfenstein et al. 1998), 1.25 "
                      "of that in red and 0.6 in blue, assumed"),
                     ("SULPHUR", "Sulphur", "Yellow-brown products of radiolysis; a guess"),
                     ("THOLIN", "Red Organics", "Tholin, not found on either moon; assumed"))),
    _metres("dirt_patch_m", "Dirt Patch", 0.0, 0.0, 1.0e4, (0.0, 5.0),
            "Wavelength of patches that dirt covers wholly, with clean ice between them; 0 for an even mixture. Black "
            "dirt is always even", "material"),
    _fraction("salt_share", "Salt Share", 0.0, "Share of the ground that is stained by salts", "material"),
    _metres("salt_patch_m", "Salt Patch", 1.0, 1.0e-4, 1.0e4, (0.05, 20.0), "Wavelength of the stains", "material"),
    Setting("salt", "Salt", "OWN", "What the stains are", "material",
            choices=(("OWN", "Own Colour", "By the reflectances relative to clean ice that are stated below. Of a "
                      "small share that is asked for, about 0.6 is covered"),
                     ("EUROPA_SALT", "Europa's Salt", "Table salt with the faint band that Europa shows near 450 nm "
                      "(Trumbo et al. 2019)"),
                     ("IRRADIATED_SALT", "Irradiated Salt", "Table salt after irradiation in the laboratory: yellow"),
                     ("SULPHATE_SALTS", "Hydrated Sulphates", "Hydrates of magnesium and sodium sulphate: white"),
                     ("ACID_HYDRATE", "Acid Hydrate", "Hydrate of sulphuric acid: white"),
                     ("SULPHUR", "Sulphur", "Yellow-brown products of radiolysis; a guess"),
                     ("EUROPA_DARK", "Dark Material", "Europa's, brown, as for Dirt"))),
    _fraction("salt_red", "Salt Red", 1.0, "Reflectance of stained ice relative to clean ice, in red", "material"),
    _fraction("salt_green", "Salt Green", 0.85, "Reflectance of stained ice relative to clean ice, in green",
              "material"),
    _fraction("salt_blue", "Salt Blue", 0.6, "Reflectance of stained ice relative to clean ice, in blue. Irradiated "
              "salt absorbs near 0.45 µm", "material"),
    _fraction("subsurface_weight", "Subsurface Weight", 0.0,
              "Share of the light that enters the snow and leaves it elsewhere (random walk). "
              "A render with 1 takes about five times as long as with 0", "material"),
    _metres("subsurface_radius_m", "Subsurface Radius", 0.005, 0.0, 10.0, (0.0, 0.1),
            "Mean free path of light in the snow", "material"),
    Setting("subsurface_method", "Subsurface Law", "RANDOM_WALK", "How light that enters the snow is followed",
            "material", choices=(
                ("RANDOM_WALK", "Random Walk", "From one scattering to the next, through the shape of the ground"),
                ("BURLEY", "Burley", "By a profile that was fitted to flat surfaces. It takes a third of the time, but "
                 "matchers err on 4 % more pixels"))),
    _fraction("transmission", "Transmission", 0.0,
              "Share of the light that enters clear ice, see Transmitted Light", "material"),
    Setting("transmitted", "Transmitted Light", "LOST", "Where the light goes that enters clear ice", "material",
            choices=(("LOST", "Lost", "Deep ice: what enters it does not come back. The surface becomes darker"),
                     ("THROUGH", "Through Rocks", "Passes through rocks and lights what is behind them along straight "
                      "lines, less what pure ice absorbs on its way. In the ground it is lost; the albedo is that of "
                      "the rest"))),
    _fraction("roughness", "Roughness", 0.6, "Microfacet roughness of the specular reflection", "material"),
    _fraction("specular", "Specular Level", 0.5,
              "Strength of the specular reflection; 0.5 is the value of the refractive index", "material"),
    Setting("refractive_index", "Refractive Index", 1.31, "Refractive index of the ice; 1.31 for water ice in visible "
            "light", "material", "1", 1.0, 3.0, (1.0, 2.0)),
    _fraction("bubble_share", "Bubbles", 0.0,
              "Share of the ice's volume that is air bubbles, which make it white: 0.05 is whitish, 0.001 deep blue. "
              "Its albedo in red, green and blue then follows from the bubbles; 0 for the albedo above", "material",
              high=0.5),
    _metres("bubble_radius_m", "Bubble Radius", 5.0e-4, 1.0e-6, 0.1, (1.0e-5, 0.005),
            "Radius of the bubbles. Larger ones scatter less, so that the ice is bluer", "material"),
    _metres("bubble_band_m", "Bubble Bands", 0.0, 0.0, 1.0e3, (0.0, 2.0),
            "Mean distance between bands of clearer and whiter ice, with a quarter to four times the bubbles; each "
            "rock has its own. 0 for even ice", "material"),
    _fraction("fracture_share", "Fractures Within", 0.0,
              "Share of the fracture planes inside the ice that is open, as white veils where one looks along them. "
              "They are seen as deep as bubbles, transmission or the subsurface radius let light in", "material"),
    _metres("fracture_spacing_m", "Fracture Spacing", 0.15, 1.0e-3, 1.0e3, (0.02, 1.0),
            "Mean distance between the planes of each of three sets of fractures; each rock has its own", "material"),
    _fraction("frost_share", "Frost", 0.0,
              "Share of the ice that is under thin frost where it is level. Faces steeper than 65 degrees have none",
              "material"),
    _metres("frost_patch_m", "Frost Patch", 0.15, 1.0e-4, 1.0e4, (0.01, 5.0), "Wavelength of the patches of frost",
            "material"),
    _fraction("patch_raggedness", "Ragged Patches", 0.0, "How ragged the edges of patches of frost and of dirt are: "
              "the share of their variance that has an eighth of their wavelength and less", "material"),
    _fraction("frost_albedo", "Frost Albedo", 0.9, "Albedo of the frost", "material"),
    _fraction("crust_share", "Crust", 0.0,
              "Share of the snow with a crust: a smooth, slightly glossy skin, broken into patches", "material"),
    _metres("crust_patch_m", "Crust Patch", 0.8, 1.0e-3, 1.0e4, (0.05, 10.0), "Wavelength of the patches of crust",
            "material"),
    _metres("crust_height_m", "Crust Thickness", 0.006, 0.0, 1.0, (0.0, 0.03),
            "Height of the step at the edge of the crust, which is shaded and not in the true depth", "material"),
    _fraction("crust_roughness", "Crust Roughness", 0.55, "Microfacet roughness of the crust", "material"),
    _fraction("glint_share", "Glints", 0.0,
              "Share of the light that leaves the snow by facets of grains, which glint in the Sun, near ones to "
              "one eye only; 0 for none. A guess: 0.03 for fresh snow", "material", high=0.5),
    _metres("glint_size_m", "Glint Size", 0.001, 1.0e-5, 0.1, (1.0e-4, 0.01),
            "Size of a grain that glints. Where a pixel is larger, it has one facet for all of its grains", "material"),
    _metres("grain_size_m", "Grain Size", 0.03, 1.0e-4, 1.0e3, (0.001, 1.0),
            "Wavelength of the fine relief, which is finer than the mesh", "material"),
    _metres("grain_amplitude_m", "Grain Relief", 0.004, 0.0, 1.0, (0.0, 0.05),
            "Height of the fine relief, from its lowest to its highest point", "material"),
    _fraction("grain_patchiness", "Patchy Grain", 0.0, "How much the height of the fine relief differs from place to "
              "place, at the same RMS height: 0 is equally rough everywhere, 1 has smooth places beside rough ones",
              "material"),
    Setting("relief", "Fine Relief", "REAL", "How the fine relief is made", "material",
            choices=(("BUMP", "Bump", "Changes only the shading: the true depth is that of the mesh. Costs no time"),
                     ("DISPLACEMENT", "Displacement",
                      "Moves the vertices of the mesh, and so depth and shadows. Wavelengths below two vertex spacings "
                      "are lost, and Build Scene reports how much"),
                     ("REAL", "Real", "Moves the vertices where the relief is over half a pixel high, with a mesh as "
                      "fine as the image there. Below that, on rocks and on ground from a file it is bump"))),
))

TEXTURES = Topic("textures", "Textures", "Images on the ground and on rocks", (
    Setting("set", "Texture", "NONE", "Images on the ground and on rocks", "material",
            choices=(("NONE", "None", "Procedural ice only"),
                     ("FROST", "Frost", "Generated: crystals of hoar with bright tips"),
                     ("GRAINS", "Grains", "Generated: rounded grains with dark gaps"),
                     ("CRACKS", "Cracks", "Generated: plates of crust with dark cracks between them"),
                     ("STAND_IN", "Stand-In", "Made by code in place of a texture of the GUISS paper, with the images "
                      "that the paper's has"),
                     ("OWN", "Own Images", "The files below. Empty ones are not used"),
                     ("MESH", "From Mesh", "Albedo, roughness and normals from the OBJ, glTF or PLY file of the ground,"
                      " mapped by its UV coordinates"))),
    _stand_in("The texture made by code", "material", stand_ins.TEXTURES),
    Setting("mapping", "Mapping", "OBJECT", "How the images are mapped. Images from the mesh always use its UV "
            "coordinates", "material",
            choices=(("OBJECT", "By Position", "Projected from above, and from the side on steep slopes"),
                     ("UV", "By UV", "By the UV coordinates of the mesh file; Image Width and Repeats have no effect. "
                      "Rocks have no UV coordinates and get the mean of the images"),
                     ("PATCH", "Over the Patch", "Once over the square of the patch around the origin, seen from "
                      "above, with north up. Image Width and Repeats have no effect"))),
    _metres("width_m", "Image Width", 0.5, 1.0e-3, 1.0e4, (0.05, 10.0), "Width of an image that is mapped by position",
            "material"),
    Setting("repeat", "Repeats", "TURNED", "How an image that is mapped by position continues beyond its edges",
            "material",
            choices=(("TURNED", "Shifted and Turned", "Hexagons from random places of the image, at random angles. "
                      "Repeats are not visible"),
                     ("SHIFTED", "Shifted", "Hexagons from random places of the image, for images with a direction"),
                     ("PLAIN", "Plain", "The whole image, side by side"))),
    _metres("height_m", "Relief Height", 0.005, -10.0, 10.0, (-0.05, 0.05),
            "Height of white above black in the height image. It is bump, unless Fine Relief of the surface is "
            "Displacement", "material"),
    _file("albedo_file", "Albedo", "Image that multiplies the albedo, relative to the mean of the image"),
    _file("roughness_file", "Roughness", "Image of the roughness, 0 to 1"),
    _file("normal_file", "Normal", "Image of normals (OpenGL: green is up)"),
    _file("transmission_file", "Transmission", "Image of the share of light that enters clear ice, 0 to 1"),
    _file("height_file", "Height", "Image of heights, see Relief Height"),
))

ROCK_SURFACE = Topic("rock_surface", "Rock Ice", "Snow or ice of rocks that have their own surface",
                     SURFACE.settings)

HAPKE = Topic("hapke", "Hapke", "Parameters of Hapke's law, for every surface that uses it", (
    _fraction("w", "Albedo w (Brightness)", 0.964,
              "Single-scattering albedo: share of the light on a grain that the grain scatters (w). Clean ice "
              "is above 0.95", "material"),
    Setting("b", "Lobe Width b", 0.429, "Asymmetry of both lobes of the phase function. 0 scatters evenly, near 1 the "
            "lobes are narrow; negative values reverse them", "material", "1", -0.99, 0.99, (0.0, 0.9)),
    Setting("c", "Lobe Share c", 0.113, "Balance of the lobes as in Hapke (2012): 1 is all backward, -1 all forward. "
            "McGuire and ISIS use (1 + c)/2", "material", "1", -1.0, 1.0),
    Setting("b_s0", "Shadow-Hiding Amplitude", 0.5, "Height of the opposition surge by shadow hiding (BS0). Values "
            "above 1 include coherent backscatter", "material", "1", 0.0, 3.0, (0.0, 1.0)),
    Setting("h_s", "Shadow-Hiding Width", 0.0016, "Tangent of half the phase angle at which shadow hiding has half its "
            "height; 0 for no surge", "material", "1", 0.0, 10.0, (0.0, 0.1), precision=5),
    _fraction("b_c0", "Backscatter Amplitude", 0.0, "Height of the opposition surge by coherent backscatter (BC0), as "
              "a share of all light", "material"),
    Setting("h_c", "Backscatter Width", 0.0, "Half-width of coherent backscatter, as tangent of half the phase angle; "
            "0 for no surge", "material", "1", 0.0, 10.0, (0.0, 0.1), precision=5),
    _degrees("theta_bar_deg", "Roughness", 10.0, 0.0, 60.0, "Mean slope angle of relief that is finer than mesh and "
             "grains. With the Nodes shader, 0 halves the cost of the surface", "material", (0.0, 40.0)),
    _degrees("theta_bar_range_deg", "Roughness Range", 0.0, -60.0, 60.0, "Difference in roughness between white and "
             "black of the roughness image, whose mean has the roughness above. The result is limited to 0 to 60; 0 "
             "ignores the image", "material", (-30.0, 30.0)),
    _fraction("filling_factor", "Filling Factor", 0.0, "Share of the volume that grains fill, at most 0.75. 0 gives "
              "the model of 1993, without porosity", "material", high=0.75),
    Setting("h_function", "H Function", "1981", "Approximation of multiple scattering. Use the one that the parameters "
            "were fitted with", "material",
            choices=(("1981", "1981", "Up to 4 % error. All fits of the Voyager era use it"),
                     ("1993", "1993", "Up to 0.8 % error"),
                     ("2002", "2002", "Up to 1 % error. Eradiate and Hapke's later book use it"))),
    Setting("accuracy", "Accuracy", "FAST", "Accuracy of light that other ground reflects. Direct sunlight is always "
            "exact", "material",
            choices=(("FAST", "Fast", "Reflected light is 2 to 4 % too dark in the mean. It is weighted like sunlight, "
                      "and up to 10 % too dark in shadows"),
                     ("ACCURATE", "Accurate", "Reflected light is within 1 % in the mean, 8 % in shadows. The Sun's "
                      "disc blurs the surges exactly; needs OSL and the CPU"),
                     ("REFERENCE", "Reference", "Reflected light is within 0.1 % in the mean, 1 % in shadows. Hapke's "
                      "law for three interreflections, approximate where dirt or images vary the ice; needs OSL and "
                      "the CPU; your own objects receive no sunlight from ice"))),
    Setting("backend", "Shader", "AUTO", "How the law is implemented in Cycles. Snow (measured) is of "
            "nodes unless this is OSL", "material",
            choices=(("AUTO", "Automatic", "OSL if it is available, otherwise nodes. Warns if this lowers the "
                      "accuracy"),
                     ("OSL", "OSL", "Open Shading Language. Build Scene refuses it without OSL and on the GPU"),
                     ("NODES", "Nodes", "Available in every Blender and on every device, with fast accuracy only"))),
))

ROCKS = Topic("rocks", "Rocks", "Rocks on the ground", (
    Setting("law", "Size Law", "POWER", "Distribution of the sizes of rocks", "geometry",
            choices=(("POWER", "Power Law", "N(>D) ~ D^-index, as fitted to block counts on Enceladus"),
                     ("GOLOMBEK", "Golombek", "Covered share k exp(-q D), q = 1.79 + 0.152/k per m, k the coverage: "
                                              "fitted to rocks on Mars, an analogue"),
                     ("TABLE", "From a Table", "Places and diameters are those of the file below. Coverage only turns "
                                               "rocks on, and sizes and clusters have no effect"))),
    Setting("file", "Table of Rocks", "", "CSV file whose first line names the columns x_m, y_m (east and north of the "
            "origin) and diameter_m. // is the folder of the .blend file", "geometry", subtype="FILE_PATH",
            trust="read"),
    _fraction("coverage", "Coverage", 0.0,
              "Share of the ground under rocks, counting overlaps twice; 0 for none. Golombek's law counts rocks of "
              "all sizes, also those that are not made", "geometry", high=0.5),
    _metres("smallest_m", "Smallest", 0.1, 1.0e-3, 100.0, (0.02, 1.0), "Diameter of the smallest rocks", "geometry"),
    _metres("largest_m", "Largest", 0.8, 1.0e-3, 100.0, (0.05, 5.0), "Diameter of the largest rocks", "geometry"),
    Setting("power_index", "Size Index", 3.0,
            "Exponent of the cumulative power law N(>D) ~ D^-index. A higher index gives more small rocks", "geometry",
            "1", 0.5, 6.0, (1.0, 5.0)),
    Setting("family", "Shapes", "MIXED", "What the rocks look like", "geometry",
            choices=(("MIXED", "Mixed", "Fragments, boulders and slabs in equal numbers"),
                     ("FRAGMENTS", "Fragments", "Broken polyhedra"),
                     ("BOULDERS", "Boulders", "Worn and lumpy"),
                     ("SLABS", "Slabs", "Flat plates with broken sides"),
                     ("BROKEN_ICE", "Broken Ice", "Cleaved rocks with stepped faces and chipped corners"))),
    _fraction("angularity", "Angularity", 0.7,
              "0 for worn, round rocks, 1 for fresh fragments with sharp edges. Boulders are always half worn",
              "geometry"),
    Setting("elongation", "Elongation", 1.4, "Median of a rock's length divided by its width, seen from above",
            "geometry", "1", 1.0, 5.0, (1.0, 3.0)),
    Setting("height_ratio", "Height over Width", 0.6,
            "Median of a rock's height divided by its mean width. Slabs have 0.45 of it", "geometry", "1",
            0.05, 3.0, (0.2, 1.5)),
    _degrees("tilt_deg", "Tilt", 15.0, 0.0, 180.0,
             "RMS tilt of rocks against the ground, about each of two axes", "geometry", (0.0, 60.0)),
    _fraction("burial", "Burial", 0.25, "Mean share of a rock's height that is below the ground", "geometry",
              high=0.9),
    _fraction("clustering", "Clustering", 0.0, "Share of the rocks that are in clusters. The others are anywhere",
              "geometry"),
    Setting("cluster_blocks", "Rocks per Cluster", 20.0, "Mean number of rocks in a cluster", "geometry", "rocks",
            1.0, 1.0e5, (2.0, 200.0)),
    _metres("cluster_radius_m", "Cluster Radius", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0),
            "Standard deviation of the distances of rocks, east and north, from the centre of their cluster",
            "geometry"),
    _metres("clear_radius_m", "Clear Radius", 0.0, 0.0, 1.0e4, (0.0, 5.0),
            "Radius around the site of the camera that is free of rocks, such as for a lander", "geometry"),
    Setting("most", "Maximum Rocks", 20000,
            "Maximum number of rocks. Above it the smallest rocks are left out, with a warning",
            "geometry", "rocks", 0, 200000, (0, 50000)),
    Setting("beyond_px", "Smallest Beyond the Patch", 0.0,
            "Rocks lie beyond the patch too, to the horizon, wherever they are at least this wide in the image; 0 for "
            "none there. The maximum number of rocks holds there once more", "geometry", "px", 0.0, 1000.0, (0.0, 10.0),
            subtype="PIXEL"),
    Setting("own_surface", "Own Surface", False,
            "Make rocks from the settings of Rock Surface instead of those of the ground", "material"),
))

LIGHT = Topic("light", "Light", "The Sun and the planet, which are the only light on the ground", (
    Setting("directions_from", "Sky Positions", "ANGLES", "How the positions of the Sun and the planet are given",
            "light", choices=(
                ("ANGLES", "Angles", "By the angles below"),
                ("DATE", "Date", "By body, date and site: orbital elements, within 0.25° from 2000 to 2060"),
                ("KERNELS", "SPICE Kernels", "By body, date and site, exactly. Needs SPICE kernels and SpiceyPy"))),
    Setting("body", "Moon's Name", "ENCELADUS", "Moon of the site: ENCELADUS or EUROPA. SPICE kernels allow others",
            "light", trust="name"),
    Setting("parent", "Planet's Name", "SATURN", "Planet that the moon orbits, by its name in the kernels", "light",
            trust="name"),
    Setting("date_utc", "Date (UTC)", "2038-06-01T12:00:00", "Date and time of the scene, such as 2038-06-01T12:00:00",
            "light", trust="name"),
    _degrees("latitude_deg", "Latitude", -80.0, -90.0, 90.0,
             "Planetocentric latitude of the site. It sets the elevation of the poles; a Sun given by angles does not "
             "depend on it", "light"),
    _degrees("longitude_deg", "Longitude", 0.0, -360.0, 360.0,
             "East longitude of the site; at a pole, of the meridian whose north is north. The planet is above "
             "longitude -4 on Enceladus and -1.5 on Europa", "light"),
    Setting("kernels", "Kernels", "", "A meta-kernel, or a folder from which all kernels are loaded", "light",
            subtype="FILE_PATH", trust="read"),
    Setting("sun_irradiance_wm2", "Sun Irradiance (W/m²)", 14.82,
            "Solar irradiance of a surface that faces the Sun. Over all wavelengths: 14.82 at Saturn, 50.26 at Jupiter "
            "(1361 W/m² / distance² in au)", "light", "W/m²", 0.0, 1.0e5, (0.0, 100.0)),
    _degrees("sun_angular_diameter_deg", "Sun Diameter", 0.0556, 0.0, 90.0,
             "Apparent diameter of the Sun: 0.0556 at Saturn, 0.1024 at Jupiter. It sets the softness of shadows",
             "light", (0.0, 1.0), precision=4),
    Setting("irradiance_band", "Irradiance Band", "BOLOMETRIC",
            "Wavelengths that the irradiance includes. The camera response uses the part in the band of the camera",
            "response",
            choices=(("BOLOMETRIC", "All Wavelengths", "The solar constant, scaled to the distance"),
                     ("CAMERA", "Camera Band", "Only the wavelengths that the camera detects"))),
    Setting("sun_scale", "Sun Factor", 1.0, "Factor on the Sun's light when images are evaluated", "response", "1",
            0.0, 1.0e6, (0.0, 10.0)),
    Setting("planet_scale", "Planet Factor", 1.0, "Factor on the planet's light when images are evaluated", "response",
            "1", 0.0, 1.0e6, (0.0, 10.0)),
    Setting("sun_temperature_k", "Sun Temperature (K)", 5772.0,
            "Colour temperature of the Sun. It sets the share of the camera's band and the balance of R, G and B, "
            "which are equal at 5772", "light", "K", 500.0, 50000.0, (3000.0, 10000.0), precision=0),
    _degrees("sun_elevation_deg", "Sun Elevation", 20.0, -90.0, 90.0,
             "Angle of the Sun's centre above the horizon; night below 0", "light"),
    _degrees("sun_azimuth_deg", "Sun Azimuth", 60.0, -360.0, 360.0,
             "Direction of the Sun from north (+Y) over east (+X)", "light"),
    _metres("sun_distance_m", "Sun Distance", 0.0, 0.0, 1.0e4, (0.0, 10.0),
            "Distance of a lamp in place of the Sun from the origin of the site, as in a laboratory: a sphere with the "
            "Sun's diameter and irradiance as seen from there. 0 for the real Sun", "light", zero="real Sun"),
    Setting("planet", "Planet", False,
            "Show the planet that the moon orbits in the sky, lit by the Sun, and light the ground by it",
            "light"),
    _degrees("planet_elevation_deg", "Planet Elevation", 10.0, -90.0, 90.0,
             "Angle of the planet's centre above the horizon. It gives no light if all of it is below the horizon",
             "light"),
    _degrees("planet_azimuth_deg", "Planet Azimuth", 0.0, -360.0, 360.0,
             "Direction of the planet from north (+Y) over east (+X)", "light"),
    _degrees("planet_angular_diameter_deg", "Planet Diameter", 29.33, 0.0, 120.0,
             "Apparent diameter of the equator: 29.33 for Saturn from Enceladus, 12.23 for Jupiter from Europa",
             "light", (0.0, 40.0)),
    _fraction("planet_flattening", "Planet Flattening", 0.0,
              "1 - polar radius / equatorial radius: 0.098 for Saturn, 0.065 for Jupiter", "light", high=0.5),
    _fraction("planet_albedo", "Planet Albedo", 0.499,
              "Geometric albedo: brightness at full phase relative to a white disc of the same size", "light",
              high=2.0),
    Setting("planet_phase_law", "Planet Phase Law", "LAMBERT", "How the planet's brightness falls with its phase",
            "light",
            choices=(("LAMBERT", "Lambert", "A matt sphere"),
                     ("SATURN", "Saturn", "Published curve of Saturn's globe (Mallama and Hilton 2018)"),
                     ("JUPITER", "Jupiter", "Published curve of Jupiter (Mallama and Hilton 2018)"))),
    Setting("planet_least", "Minimum Planet Light", 1.0e-4,
            "Ratio of the planet's light to the Sun's below which the planet does not light the ground by day: camera "
            "noise would hide it. 0 to always light it", "light",
            "1", 0.0, 1.0, (0.0, 0.01), precision=6),
    Setting("planet_rings", "Planet Rings", False,
            "Saturn's rings A, B and C with the Cassini Division, and their shadow, which takes up to 20 % of the "
            "planet's light. Enceladus sees them edge-on; raise Planet Elevation to open them", "light"),
    Setting("planet_face", "Planet Face", "PLAIN",
            "Pattern of the planet's clouds. It changes the planet in the images and the colour of its light, not how "
            "much light it gives", "light",
            choices=(("PLAIN", "Plain", "A matt globe without a pattern"),
                     ("SATURN", "Saturn", "Saturn's bands, limb darkening and colour"),
                     ("JUPITER", "Jupiter", "Jupiter's belts and zones, Great Red Spot, limb darkening and colour"))),
    _degrees("planet_spot_longitude_deg", "Red Spot Longitude", 0.0, -360.0, 360.0,
             "Longitude of Jupiter's Great Red Spot, east of the meridian that faces the moon", "light"),
    Setting("stars", "Stars", False, "Show stars in the sky at their true brightness. They do not light the ground",
            "light"),
    Setting("stars_faintest_mag", "Faintest Star (mag)", 2.5,
            "Faintest V magnitude of the stars. Stars down to 2.5 are real; fainter ones are random, in their true "
            "number", "light", "mag", -2.0, 8.0, (0.0, 6.5), precision=1),
))

LANDER = Topic("lander", "Lander", "A lander whose mast carries the cameras, with an arm in front of them", (
    Setting("kind", "Lander", "NONE", "The lander in the picture", "lander",
            choices=(("NONE", "None", "No lander"),
                     ("PARAMETRIC", "Parametric", "Deck, two legs, mast and arm of the sizes that are stated here"),
                     ("OWN", "Own Arm", "Deck, two legs and mast as Parametric, with an arm from a URDF file"))),
    Setting("file", "Arm's File", "", "URDF file of your own arm, with meshes as STL, OBJ or Collada beside it. "
            "Its first link stands at the place of the shoulder. // is the folder of the .blend file", "lander",
            subtype="FILE_PATH", trust="read"),
    Setting("joints", "Joints", "", "Angles of the joints of your own arm, as name=value in degrees (metres for one "
            "that slides), with spaces between; 0 for those that are not named", "lander", trust="name"),
    _degrees("turn_deg", "Turn of the Deck", 0.0, -180.0, 180.0,
             "Direction of the lander to the right of the rig's heading", "lander"),
    _metres("deck_front_m", "Deck Front", 0.4, 0.15, 5.0, (0.2, 1.0),
            "Distance of the deck's front edge ahead of the mast", "lander"),
    _metres("deck_width_m", "Deck Width", 1.3, 0.2, 10.0, (0.5, 3.0), "Width of the deck at its front edge", "lander"),
    _metres("deck_height_m", "Deck Height", 0.6, 0.15, 10.0, (0.3, 2.0), "Height of the deck's top above the ground "
            "under the mast", "lander"),
    _metres("pad_ahead_m", "Pads Ahead", 1.05, 0.1, 10.0, (0.3, 3.0), "Distance of the two pads ahead of the mast",
            "lander"),
    _metres("pad_apart_m", "Pads Apart", 2.0, 0.2, 20.0, (0.5, 5.0), "Distance between the centres of the two pads",
            "lander"),
    _metres("pad_diameter_m", "Pad Diameter", 0.32, 0.05, 5.0, (0.1, 1.0), "Diameter of a pad", "lander"),
    _metres("pad_sink_m", "Pad Sinkage", 0.02, 0.0, 1.0, (0.0, 0.1), "Depth to which each pad is pressed into the "
            "ground under its centre", "lander"),
    _fraction("frost_share", "Frost Share", 0.1, "Share of upward surfaces of the lander that frost covers, in patches",
              "lander"),
))

#: Joints of the arm: key, label, what its angle is, default, lowest and highest angle in degrees.
_JOINTS = (
    ("yaw", "Yaw", "turn of the whole arm to the left", 30.0, -105.0, 105.0),
    ("shoulder", "Shoulder", "angle of the upper arm above the horizontal", 30.0, -30.0, 120.0),
    ("elbow", "Elbow", "angle of the forearm upward from the line of the upper arm", -75.0, -165.0, 165.0),
    ("wrist", "Wrist", "angle of the hand upward from the line of the forearm", -45.0, -150.0, 150.0),
    ("roll", "Roll", "turn of the scoop about the line of the hand", 0.0, -180.0, 180.0),
)

ARM = Topic("arm", "Arm", "The lander's arm: angles of its joints, their faults and limits, and its sizes", (
    *(_degrees(f"{key}_deg", label, angle, -360.0, 360.0, f"Commanded {text}", "lander", (-180.0, 180.0))
      for key, label, text, angle, _, _ in _JOINTS),
    *(_degrees(f"{key}_offset_deg", f"{label} Fault", 0.0, -90.0, 90.0, f"Fault of the joint {key}: its real angle is "
               "the commanded angle plus this", "lander", (-5.0, 5.0), 3) for key, label, *_ in _JOINTS),
    *(_degrees(f"{key}_{end}_deg", f"{label} {title}", at, -360.0, 360.0, f"{title} angle of the joint {key}", "lander",
               (-180.0, 180.0))
      for key, label, _, _, low, high in _JOINTS for end, title, at in (("low", "Lowest", low),
                                                                        ("high", "Highest", high))),
    _metres("shoulder_x_m", "Shoulder Ahead", 0.8, -5.0, 5.0, (0.0, 2.0), "Distance of the yaw axis ahead of the mast",
            "lander"),
    _metres("shoulder_y_m", "Shoulder Left", 0.0, -5.0, 5.0, (-1.0, 1.0), "Distance of the yaw axis left of the mast",
            "lander"),
    _metres("shoulder_z_m", "Shoulder Height", 0.6, 0.1, 10.0, (0.3, 2.0), "Height of the shoulder's axis above the "
            "ground under the mast", "lander"),
    _metres("offset_m", "Shoulder Offset", 0.1, 0.0, 2.0, (0.0, 0.3), "Distance of the shoulder's axis from the yaw "
            "axis", "lander"),
    _metres("upper_m", "Upper Arm", 1.0, 0.1, 10.0, (0.3, 2.0), "Length from shoulder to elbow", "lander"),
    _metres("fore_m", "Forearm", 0.9, 0.1, 10.0, (0.3, 2.0), "Length from elbow to wrist", "lander"),
    _metres("hand_m", "Hand", 0.15, 0.03, 2.0, (0.05, 0.5), "Length from wrist to scoop", "lander"),
    _metres("scoop_length_m", "Scoop Length", 0.1, 0.01, 2.0, (0.03, 0.3), "Length of the scoop", "lander"),
    _metres("scoop_width_m", "Scoop Width", 0.08, 0.01, 2.0, (0.03, 0.3), "Width of the scoop", "lander"),
    _metres("scoop_depth_m", "Scoop Depth", 0.06, 0.01, 2.0, (0.02, 0.2), "Depth of the scoop", "lander"),
))

RIG = Topic("rig", "Stereo Camera", "Two identical cameras, parallel unless toed in. The left one is the reference", (
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
            "Distance of the optical axis to the right of the image centre", "camera", "px", -8192.0, 8192.0,
            (-50.0, 50.0), subtype="PIXEL"),
    Setting("principal_y_px", "Principal Point Down", 0.0,
            "Distance of the optical axis below the image centre", "camera", "px", -8192.0, 8192.0,
            (-50.0, 50.0), subtype="PIXEL"),
    *(Setting(f"distortion_{name}", f"Distortion {name}", 0.0, text, "response", "1", -10.0, 10.0, (-0.5, 0.5),
              precision=5) for name, text in (
        ("k1", "Radial distortion, r² term, in OpenCV's Brown-Conrady model. Negative values give barrel distortion"),
        ("k2", "Radial distortion, r⁴ term"), ("p1", "Tangential distortion, vertical decentring"),
        ("p2", "Tangential distortion, horizontal decentring"), ("k3", "Radial distortion, r⁶ term"))),
    _fraction("overscan", "Overscan", 0.0, "Margin that is rendered beyond each border, as a share of width and "
              "height. Lens distortion and toe-in need it", "camera", high=2.0),
    _degrees("toe_in_deg", "Toe-in", 0.0, 0.0, 45.0, "Angle by which each eye turns toward the other, about its own "
             "vertical; 0 for parallel eyes", "camera", (0.0, 10.0), 3),
    _metres("focus_distance_m", "Focus Distance", 0.0, 0.0, 1.0e5, (0.0, 10.0),
            "Depth that is in focus; 0 if everything is in focus. The f-number sets the blur, and the truth is always "
            "sharp", "camera", zero="all sharp"),
    *(Setting(key, label, 0.0, f"{text} during the exposure. It blurs the images; the truth is of the middle "
              "of the exposure", "camera", unit, -1.0e4, 1.0e4, (-soft, soft)) for key, label, unit, soft, text in (
        ("speed_right_m_s", "Speed Right (m/s)", "m/s", 1.0, "Motion of both eyes to the right"),
        ("speed_down_m_s", "Speed Down (m/s)", "m/s", 1.0, "Motion of both eyes along the image's columns"),
        ("speed_forward_m_s", "Speed Forward (m/s)", "m/s", 1.0, "Motion of both eyes along the optical axis"),
        ("turn_right_deg_s", "Turn Right (°/s)", "deg/s", 30.0, "Rotation of the rig to the right about the left eye"),
        ("turn_down_deg_s", "Turn Down (°/s)", "deg/s", 30.0, "Rotation of the rig downward about the left eye"),
        ("roll_deg_s", "Roll (°/s)", "deg/s", 30.0, "Rotation of the rig clockwise about the left eye's optical "
         "axis"))),
    Setting("motion_exposure_s", "Exposure (s)", 0.0, "Exposure time for motion blur. 0 uses the exposure time "
            "of the camera response, which then must not be automatic", "camera", "s", 0.0, 1.0e5, (0.0, 1.0),
            precision=6, zero="camera's"),
    _metres("x_m", "Site East", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "East coordinate of the left camera", "camera"),
    _metres("y_m", "Site North", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "North coordinate of the left camera",
            "camera"),
))

SENSOR = Topic("sensor", "Exposure and Sensor",
               "From radiance to digital numbers (EMVA 1288). Changes need no new render", (
    Setting("auto_exposure", "Auto Exposure", True,
            "Set the exposure of both eyes from the brightest part of the left image", "response"),
    _fraction("auto_percentile", "Auto Percentile", 0.99,
              "Share of the pixels that are at or below the exposure target", "response"),
    _fraction("auto_target", "Auto Target", 0.8,
              "Exposure target as a share of the full well, divided by the gain if that is above 1",
              "response", low=0.01),
    Setting("exposure_s", "Exposure (s)", 0.001, "Exposure time when auto exposure is off", "response", "s",
            1.0e-7, 1.0e5, (1.0e-5, 1.0), precision=6),
    Setting("brackets", "Merged Exposures", 1, "Number of exposures that are merged into one image (HDR); 1 for no "
            "merging", "response", "exposures", 1, 9),
    Setting("bracket_stops", "Exposure Step (stops)", 2.0,
            "Step between successive exposures, as a power of two. They are centred on the exposure", "response",
            "stops", 0.1, 8.0, (0.5, 4.0)),
    Setting("encoding", "8-bit Encoding", "LINEAR", "How images of more than 8 bits are reduced to 8 bits for matchers",
            "response",
            choices=(("LINEAR", "Linear", "Keep the top bits"),
                     ("SQUARE_ROOT", "Square Root", "Equal steps of shot noise, as in images that rovers send"))),
    Setting("f_number", "f-Number", 8.0, "Focal length divided by the diameter of the aperture", "response", "1",
            0.5, 256.0, (1.0, 32.0)),
    Setting("pixel_pitch_um", "Pixel Pitch (µm)", 0.0, "Side of a pixel, which sets how much light and how many "
            "particles it receives; 0 for sensor width / columns", "response", "µm", 0.0, 1000.0, (0.0, 30.0),
            precision=2, zero="by sensor"),
    _fraction("transmission", "Transmission", 0.9, "Share of the light that lens and filter transmit", "response"),
    Setting("band_centre_nm", "Band Centre (nm)", 600.0, "Centre of the band that a monochrome sensor detects",
            "response", "nm", 100.0, 20000.0, (300.0, 1100.0), precision=0),
    Setting("band_width_nm", "Band Width (nm)", 200.0, "Width of the band that a monochrome sensor detects",
            "response", "nm", 0.1, 20000.0, (5.0, 700.0), precision=0),
    _fraction("quantum_efficiency", "Quantum Efficiency", 0.5, "Mean number of electrons per photon in the band, of a "
              "monochrome sensor", "response"),
    Setting("band_weights", "Weights of R, G, B", "EQUAL", "How a monochrome camera adds up the bands of the pair. "
            "Grey ground looks the same with both", "response",
            choices=(("EQUAL", "Equal", "The mean of R, G and B"),
                     ("BAND", "By the Band", "By how much of the camera's band and of the Sun's photons is theirs: "
                      "brown ground is brighter to a red camera"))),
    Setting("colour", "Camera", "MONO", "Whether the camera sees colour. Both need the same render", "response",
            choices=(("MONO", "Monochrome", "Each pixel detects the whole band"),
                     ("BAYER", "Colour (Bayer)", "Each pixel is behind a red, green or blue filter, and the other two "
                      "colours come from its neighbours. Matchers get a grey image of all three"))),
    Setting("bayer_pattern", "Bayer Pattern", "RGGB", "Colours of the first two pixels of the first two rows",
            "response", choices=tuple((name, name, f"First row {name[:2]}, second row {name[2:]}")
                                      for name in ("RGGB", "BGGR", "GRBG", "GBRG"))),
    Setting("demosaicing", "Demosaicing", "MALVAR", "How the two missing colours of each pixel are found", "response",
            choices=(("BILINEAR", "Bilinear", "Mean of the nearest pixels of a colour. The softest"),
                     ("MALVAR", "Malvar", "Linear, with the detail of the pixel's own colour (Malvar, He and Cutler "
                      "2004), as on Mars rovers"),
                     ("EDGE_AWARE", "Edge-Aware", "Green along edges, not across them; red and blue as Bilinear "
                      "(OpenCV). The pair viewer shows Malvar instead"))),
    Setting("white_balance", "White Balance", "SUN", "Factors on red, green and blue after demosaicing", "response",
            choices=(("SUN", "Sunlight", "White ground in sunlight is grey; the weaker colours are multiplied"),
                     ("NONE", "None", "The numbers of the sensor"))),
    Setting("grey", "Grey for Matchers", "LUMINANCE", "How matchers get a colour image", "response",
            choices=(("LUMINANCE", "Luminance", "0.2126 red + 0.7152 green + 0.0722 blue (ITU-R BT.709), linear"),
                     ("MEAN", "Mean", "A third of each"))),
    *(setting for name, centre, half, peak in (("red", 615.0, 45.0, 0.46), ("green", 535.0, 46.0, 0.55),
                                               ("blue", 450.0, 50.0, 0.51)) for setting in (
        Setting(f"{name}_centre_nm", f"{name.title()} Centre (nm)", centre, f"Wavelength at which the {name} filter "
                "passes most, with a Gaussian around it", "response", "nm", 100.0, 20000.0, (380.0, 720.0),
                precision=0),
        Setting(f"{name}_half_width_nm", f"{name.title()} Half Width (nm)", half, f"Distance from the centre of the "
                f"{name} filter at which half is passed", "response", "nm", 0.1, 20000.0, (10.0, 100.0), precision=0),
        _fraction(f"{name}_efficiency", f"{name.title()} Efficiency", peak, f"Electrons per photon at the centre of "
                  f"the {name} filter, besides its leak", "response"))),
    _fraction("filter_leak", "Filter Leak", 0.04, "Electrons per photon that every colour filter adds at all "
              "wavelengths that reach it", "response"),
    Setting("cut_on_nm", "Cut-On (nm)", 400.0, "Shortest wavelength that reaches the colour filters", "response", "nm",
            100.0, 20000.0, (350.0, 450.0), precision=0),
    Setting("cut_off_nm", "Cut-Off (nm)", 700.0, "Longest wavelength that reaches the colour filters: that of an "
            "infrared cut-off filter", "response", "nm", 100.0, 20000.0, (620.0, 750.0), precision=0),
    Setting("full_well_e", "Full Well (e-)", 20000.0, "Electrons that a pixel can hold before it saturates",
            "response", "e-", 1.0, 1.0e7, (1000.0, 1.0e5), precision=0),
    Setting("gain", "Gain", 1.0, "Gain, relative to the one at which a full well gives the largest number",
            "response", "1", 0.01, 1000.0, (0.5, 16.0)),
    Setting("read_noise_e", "Read Noise (e-)", 15.0, "Standard deviation of the noise from reading a pixel",
            "response", "e-", 0.0, 1.0e5, (0.0, 100.0), precision=1),
    Setting("shot_noise", "Shot Noise", True, "Poisson noise of photo-electrons and dark current", "response"),
    Setting("dark_current_e_s", "Dark Current (e-/s)", 10.0, "Electrons per second without light at the reference "
            "temperature", "response", "e-/s", 0.0, 1.0e7, (0.0, 1000.0)),
    Setting("temperature_k", "Temperature (K)", 253.0, "Temperature of the sensor, which changes the dark current",
            "response", "K", 0.0, 500.0, (150.0, 330.0), precision=0),
    Setting("dark_reference_k", "Dark Reference (K)", 293.0, "Temperature for which the dark current is given",
            "response", "K", 1.0, 500.0, (200.0, 330.0), precision=0),
    Setting("dark_doubling_k", "Dark Doubling (K)", 8.0, "Rise in temperature that doubles the dark current",
            "response", "K", 1.0, 50.0, (4.0, 12.0), precision=1),
    _fraction("prnu", "PRNU", 0.0, "Photo-response non-uniformity: standard deviation of the pixels' sensitivity",
              "response"),
    Setting("dsnu_e", "DSNU (e-)", 0.0, "Dark-signal non-uniformity: standard deviation of the pixels' offsets",
            "response", "e-", 0.0, 1.0e5, (0.0, 100.0), precision=1),
    _fraction("blooming", "Blooming", 0.0, "Share of a full well's overflow that spreads along the column. The rest is "
              "drained", "response"),
    _fraction("black_level", "Black Level", 0.0, "Number that is read without light, as a share of the converter's "
              "range", "response", high=0.5),
    Setting("bits", "Bits", 8, "Bits of the analogue-to-digital converter", "response", "bits", 8, 16),
    Setting("psf_sigma_px", "Point Spread (px)", 0.0, "Standard deviation of the lens's Gaussian point spread",
            "response", "px", 0.0, 50.0, (0.0, 3.0), precision=2),
    _fraction("veiling_glare", "Veiling Glare", 0.0, "Share of the light that is spread evenly over the image "
              "(ISO 9358)", "response"),
    _fraction("deposit_share", "Lens Deposits", 0.0, "Share of the window before each lens that dust or frost covers",
              "response", high=0.95),
    Setting("deposit_mm", "Grain (mm)", 0.5, "Diameter of a grain or flake on the window", "response", "mm", 0.01, 50.0,
            (0.05, 5.0)),
    Setting("deposit_window_mm", "Window (mm)", 20.0, "Distance of the window from the entrance pupil of the lens. The "
            "nearer, the wider and fainter are the spots", "response", "mm", 0.1, 1000.0, (5.0, 100.0)),
    _fraction("deposit_scatter", "Scattered", 0.3, "Share of the light that deposits block which they scatter evenly "
              "over the image", "response"),
    Setting("deposit_seed", "Deposit Seed", 0, "Seed of the deposits. Another seed puts them elsewhere", "response",
            "1", 0, 1000000, (0, 100)),
    Setting("deposits_alike", "Alike in Both Eyes", False, "Put deposits on the same places before both lenses",
            "response"),
    Setting("radiation_flux_cm2_s", "Particles (1/cm² s)", 0.0, "Charged particles that reach the sensor, per cm² and "
            "second", "response", "1/(cm² s)", 0.0, 1.0e12, (0.0, 1.0e6), precision=0),
    Setting("radiation_depth_um", "Sensitive Depth (µm)", 10.0, "Depth of silicon in which particles release electrons",
            "response", "µm", 0.1, 1000.0, (2.0, 50.0), precision=1),
    Setting("radiation_e_per_um", "Ionisation (e-/µm)", 80.0, "Electrons that a particle releases per micrometre",
            "response", "e-/µm", 0.0, 1.0e6, (50.0, 500.0), precision=0),
    Setting("noise_seed", "Noise Seed", 0, "Seed of the noise. Another seed gives other noise of the same sensor",
            "response", "1", 0, 2147483647, (0, 100)),
))

QUALITY = Topic("quality", "Quality and Speed", "Noise, bias and speed of a render", (
    Setting("samples", "Samples", 32, "Light paths per pixel and eye", "sampling", "samples", 1, 65536, (1, 1024)),
    Setting("denoiser", "Denoiser", "NONE",
            "Denoiser of the images of both eyes. The truth has no noise", "sampling",
            choices=(("NONE", "None", "Keep the noise of the render in the images"),
                     ("OIDN", "OpenImageDenoise",
                      "Remove the noise at low cost. The noise-free albedo and normals that guide the denoiser make "
                      "stereo matching easier than it is"),
                     ("OIDN_COLOUR", "OIDN, Colour Only",
                      "Remove the noise without albedo and normals. This smooths fine texture away"))),
    Setting("noise_threshold", "Noise Threshold", 0.0,
            "Relative noise at which a pixel gets no more samples, after 16 threshold^-0.3 of them at least; 0 gives "
            "all pixels the same number. It saves time but makes the noise uneven", "sampling", "1",
            0.0, 1.0, (0.0, 0.1), zero="off"),
    Setting("diffuse_bounces", "Bounces", 4,
            "Maximum number of diffuse bounces. With 4, even ice of albedo 1 has more than 99 % of its light",
            "sampling", "bounces", 0, 128, (0, 16)),
    Setting("walk_px", "Subsurface Cutoff (px)", 0.1,
            "Mean free path of subsurface light, in pixels of the nearest level ground, below which light leaves "
            "where it enters. This changes its amount by at most 3 %; 0 for no cutoff",
            "material", "px", 0.0, 100.0, (0.0, 1.0), zero="off"),
    Setting("fine_relief", "Light on Relief", "ALL", "Light that bump and normal images shade. Only Lambert "
            "and Principled ice without subsurface scattering use this setting", "material",
            choices=(("ALL", "All Light", "Also light that other ground reflects"),
                     ("CAMERA", "Camera Rays Only", "Other ground reflects light as if it were smooth, which saves a "
                      "tenth of the time. Under a low Sun, shadows are 2 to 5 % brighter and the mean up to 0.3 %"))),
    Setting("indirect", "Indirect Light", "TRACED", "How light that other ground reflects is computed. Only Lambert "
            "ground and rocks can be baked; other scenes are traced, and pair.json contains why", "material",
            choices=(("TRACED", "Traced", "Followed through every pixel, with quality.samples"),
                     ("BAKED", "Baked", "Computed once at the vertices of the ground. Images then take direct light "
                      "only, with few samples and no denoiser"),
                     ("AUTO", "Automatic", "Baked where the data set has enough images of a ground under one Sun to "
                      "save time, else traced"))),
    Setting("direct_samples", "Direct Samples", 4,
            "Light paths per pixel and eye where indirect light is baked. There is no denoiser then",
            "sampling", "samples", 1, 65536, (1, 64)),
    Setting("bake_area", "Bake Area", "GROUND", "Ground whose light is baked", "sampling",
            choices=(("GROUND", "Whole Ground", "Images in all directions share it"),
                     ("VIEW", "Seen Ground", "What the cameras see. Takes a part of the time, but only images from one "
                      "place in one direction share it, so for few images"))),
    Setting("bake_samples", "Bake Samples", 256,
            "Maximum number of light paths per corner of the ground's mesh for baked light, unless "
            "quality.bake_noise is reached before. With less than 64, matchers look better than they are",
            "sampling", "samples", 4, 65536, (64, 1024)),
    Setting("bake_noise", "Bake Noise", 0.01,
            "Noise of baked light over all light at which it gets no more samples, and above which an image is traced "
            "after all. It passes for texture, so keep it under the noise of the sensor. 0 for no limit",
            "sampling", "1", 0.0, 1.0, (0.0, 0.05)),
    Setting("files", "Files", "COMPACT", "How values are stored. Depth, labels and hidden pixels are exact in any case",
            "run",
            choices=(("COMPACT", "Compact", "Radiance and normals in 16 bits: light is rounded by at most 0.05 %, far "
                      "below its noise, normals by at most 0.03°. The image is not stored beside the lights that it is "
                      "the sum of"),
                     ("FULL", "Full", "All values in 32 bits as rendered, but for what half_floats states. Files are "
                      "about twice as large"))),
    Setting("half_floats", "Half Floats", "NONE", "What full files store in 16 instead of 32 bits. It counts in the "
            "names of pairs, unlike files", "sampling",
            choices=(("NONE", "Nothing", "All values as rendered"),
                     ("RADIANCE", "Radiance", "Rounded by at most 0.05 %. Files are a quarter smaller with the whole "
                      "truth, and half with depth alone"),
                     ("RADIANCE_NORMALS", "With Normals", "Radiance as well as normals, which are off by "
                      "at most 0.03°. Files are half as large"))),
    Setting("truth", "Truth", "FULL", "Truth that is rendered with the images", "sampling",
            choices=(("FULL", "Full", "Depth, normals and labels, in a separate render with one sample per pixel"),
                     ("SEMANTIC", "No Normals", "Depth and what a pixel shows (ground, rock, lander, "
                      "planet), both from the render of the images, without normals and labels of single rocks"),
                     ("DEPTH", "Depth Only", "Depth from the render of the images. This saves the separate render "
                      "unless the images are blurred or toed in"))),
    Setting("truth_by", "Truth By", "RAYS", "What finds truth that does not come with the images", "run",
            choices=(("RAYS", "Rays", "Rays through the triangles that are rendered. Cycles renders the truth of "
                      "scenes that rays would not meet as they are shown, and the pair states why"),
                     ("CYCLES", "Cycles", "Four more renders, with shading normals beside those of facets"))),
    Setting("device", "Device", "CPU", "Processor that renders", "run",
            choices=(("CPU", "CPU", "All processor cores"),
                     ("GPU", "GPU", "The graphics cards that Cycles can use. Render Stereo Pair refuses it if there "
                      "are none"))),
    Setting("threads", "Threads", 0, "Number of processor threads; 0 for all", "run", "threads", 0, 1024, (0, 64),
            zero="all"),
))

WORKSPACE = Topic("workspace", "Workspace", "Ground in reach of an arm, with its exact heights", (
    _metres("cell_m", "Cell", 0.0, 0.0, 1.0, (0.0, 0.05),
            "Side of a cell of the true elevation model that is written with each pair; 0 writes none", "sampling",
            zero="off"),
    _metres("east_m", "Centre East", 0.0, -5.0e4, 5.0e4, (-5.0, 5.0), "East coordinate of the centre of the workspace",
            "sampling"),
    _metres("north_m", "Centre North", 1.6, -5.0e4, 5.0e4, (-5.0, 5.0),
            "North coordinate of the centre of the workspace", "sampling"),
    _metres("size_m", "Size", 2.0, 0.01, 100.0, (0.2, 5.0), "Side of the workspace, which is a square", "sampling"),
))

DATASET = Topic("dataset", "Data Set", "Folder and plan of a data set", (
    Setting("folder", "Folder", "~/icymoon",
            "Folder that the data set is written to. ~ is your home folder, // the folder of the .blend file",
            "run", subtype="DIR_PATH", trust="written"),
    Setting("seed", "Seed", 1,
            "The seed of everything random: terrain, rocks, grains, render noise and sensor noise",
            "geometry", "1", 0, 2147483647, (0, 100)),
    Setting("headings", "Headings", 1,
            "Number of pairs at the site. The rig turns by equal steps between them; 4 for a panorama", "run",
            "pairs", 1, 360, (1, 12)),
    Setting("plan", "Plan", "datasets/guiss_smoke",
            "Plan of a data set: a TOML file, or the name of a shipped plan. A plan does not use the present scene",
            "run", trust="read"),
    Setting("workers", "Workers", 0, "Number of processes that render a data set at the same time; 0 for the number in "
            "the preferences, or one for each four processors", "run", "processes", 0, 1024, (0, 16), zero="automatic"),
    Setting("evaluate", "Evaluate Afterwards", False,
            "Evaluate the whole data set after all pairs are rendered", "run"),
    Setting("leave_running", "Leave Running", False, "Continue to render the data set after Blender is closed or "
            "another file is opened. The next Blender shows it again", "run"),
    Setting("methods", "Matchers", "bm,sgbm", "Stereo matchers that Evaluate runs, separated by commas: bm, sgbm, "
            "sgbm_wls, jplv, igev, dsmnet. Options are written as in sgbm:window=7; own:NAME is a matcher that you set "
            "up in the preferences", "run", trust="matchers"),
))

TOPICS: dict[str, Topic] = {t.key: t for t in (
    SOURCE, TERRAIN, MESH, RIDGES, CRACKS, CHAOS, CRATERS, HOLLOWS, PENITENTES, PITS, HILLS, MANTLE, EXCAVATION,
    SURFACE, HAPKE, TEXTURES, ROCKS, ROCK_SURFACE, LIGHT, RIG, LANDER, ARM, WORKSPACE, SENSOR, QUALITY, DATASET)}


def _topic_of(landform: PluginLandform) -> Topic:
    """The topic of a plug-in's landform: its numbers, and the release that made it."""
    settings = []
    for n in landform.settings:
        label = f"{n.label} (°)" if n.unit == "deg" else n.label
        kind: dict[str, Any] = ({"subtype": "DISTANCE", "precision": 4} if n.unit == "m" else
                                {"precision": 2} if n.unit == "deg" else {})
        settings.append(Setting(n.key, label, n.default, n.doc, "geometry", n.unit, n.minimum, n.maximum, **kind))
    settings.append(Setting(RELEASE, "Made By", "", "Package and version that make the landform. Empty for what is "
                            "installed", "geometry", trust="name"))
    return Topic(landform.topic, landform.label, landform.doc, tuple(settings), LANDFORMS, landform.plugin.release)


#: Topics that are ours, of which types and pages are made; the others are of plug-ins, in whatever Python has them.
OUR_TOPICS = dict(TOPICS)
TOPICS |= {landform.topic: _topic_of(landform) for landform in landform_plugins()[0].values()}


def all_settings() -> list[tuple[str, Setting]]:
    """All (topic key, setting) in the order of the sidebar."""
    return [(topic.key, setting) for topic in TOPICS.values() for setting in topic.settings]


def ground_settings() -> dict[str, tuple[str, str]]:
    """(topic, key) of the seed, of each number of a patch of ground and of all of its landforms, by a keyword.

    The radius of the body is none of them: a patch is flat.
    """
    ground = {s.key: ("terrain", s.key) for s in TERRAIN.settings
              if s.kind in ("int", "float") and s.key != "body_radius_m"}
    return {**ground, "seed": ("dataset", "seed"),
            **{f"{topic.key}_{s.key}": (topic.key, s.key) for topic in TOPICS.values() if topic.parent == LANDFORMS
               for s in topic.settings if s.kind != "text"}}
