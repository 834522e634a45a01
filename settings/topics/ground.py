"""Where the ground comes from, its shape and its mesh."""

from __future__ import annotations

from typing import Literal

from . import stand_ins
from .declaration import ADVANCED, TOP, Section, Table, choice, degrees, fraction, metres, number, tables, text, tick
from .relevance import chosen, positive, ticked

#: Ground that is made up, and its mesh.
PROCEDURAL = chosen("source.kind", "PROCEDURAL")
GRADED = PROCEDURAL & chosen("mesh.kind", "GRADED")
GRID = PROCEDURAL & ~chosen("mesh.kind", "GRADED")
#: Ground from a file, with random relief that is finer than the file.
FROM_FILE = ~chosen("source.kind", "PROCEDURAL")
DETAIL = FROM_FILE & ticked("source.detail")
MAP = chosen("source.kind", "HEIGHT_MAP")
RANDOM = PROCEDURAL | DETAIL
#: A height map whose site is stated by coordinates of one kind.
IN_DEGREES, ON_MAP = (MAP & chosen("source.site", kind) for kind in ("DEGREES", "MAP"))
#: A height map with ground beyond its patch.
SURROUNDED = MAP & positive("source.surroundings_m")
#: Heights above a map, to which landforms and layers of noise can be added; a mesh from a file has none.
ABOVE_A_MAP = PROCEDURAL | (MAP & ticked("source.detail"))
SITE = Section("site", "Site and Origin", "Place on the map or in the mesh that is the origin of the scene")
SURROUNDINGS = Section("surroundings", "Surroundings", "Ground of the map beyond its patch", shown=MAP)
NOISE = Section("noise", "Layers of Noise", "Fractal noise that is added to the random surface")


class SourceSettings(Table, label="Ground from a File", inside="terrain"):
    """Source of the ground: generated, or your own mesh or height map."""

    __slots__ = ()
    kind: Literal["PROCEDURAL", "MESH", "STAND_IN", "HEIGHT_MAP"] = choice(
        "Source", "PROCEDURAL", "Origin of the ground", "geometry",
        ("PROCEDURAL", "Procedural", "A random surface with the statistics under Ground"),
        ("MESH", "Mesh File", "A reconstructed mesh: OBJ, PLY, STL, glTF, USD or FBX"),
        ("STAND_IN", "Stand-In Mesh", "A mesh made by code in place of one of the GUISS paper's"),
        ("HEIGHT_MAP", "Height Map", "A digital elevation model: GeoTIFF, NPY, EXR or grey PNG"))
    stand_in: Literal[
        "ATHABASCA", "GLACIER_42M", "BLOODFALLS", "SEAICE1", "MATANUSKA_A1", "MATANUSKA_C1", "SVALBARD1",
        "GAEA_RIDGY", "GAEA_ROCKY_PERLIN", "GAEA_ROCKY", "MATANUSKA_PLAYGROUND"
    ] = choice("Stand-In", "ATHABASCA", "Computed mesh that serves as the ground", "geometry",
        *stand_ins.make_choices(stand_ins.MESHES),
        shown=chosen("kind", "STAND_IN"), since="0.3")
    file: str = text(
        "File", "", "Mesh or height map that is the ground. ~ is your home folder, // the folder of the .blend file. "
        "Ids of pairs depend on the content of the file, not on its path", "geometry", "read", subtype="FILE_PATH",
        shown=chosen("kind", "MESH", "HEIGHT_MAP"))
    scale: float = number(
        "Metres per Unit", 1.0, 1.0e-6, 1.0e6, (1.0e-3, 1000.0), "Metres per unit of a mesh file: 1 for metres, 0.001 "
        "for millimetres. It multiplies the unit that glTF, USD and FBX files contain", "geometry", "m/unit",
        precision=6, shown=chosen("kind", "MESH", "STAND_IN"))
    up_axis: Literal["AUTO", "X", "Y", "Z", "-X", "-Y", "-Z"] = choice(
        "Up Axis", "AUTO", "Axis of the mesh file that points up. For USD and FBX it is an axis of the scene that "
        "Blender imports", "geometry",
        ("AUTO", "Automatic", "The usual axis of the format: Y for OBJ and glTF, Z for PLY and STL, the one that the "
         "file states for USD and FBX"),
        ("X", "X", "+X points up"),
        ("Y", "Y", "+Y points up"),
        ("Z", "Z", "+Z points up"),
        ("-X", "-X", "-X points up"),
        ("-Y", "-Y", "-Y points up"),
        ("-Z", "-Z", "-Z points up"),
        shown=chosen("kind", "MESH", "STAND_IN"))
    flat_faces: bool = tick(
        "Flat Faces", False, "Shade each triangle of the mesh flat. Otherwise shading is smooth across edges, which "
        "suits dense meshes", "geometry", shown=chosen("kind", "MESH", "STAND_IN"), since="0.4")
    centre: bool = tick(
        "Origin at Centre", True, "Put the origin at the centre of the ground and at its median height. Otherwise the "
        "coordinates of the file are kept", "geometry", section=SITE, shown=FROM_FILE)
    site: Literal["OFFSET", "DEGREES", "MAP"] = choice(
        "Site", "OFFSET",
        "How the position of the site on the map is stated. Origin East and Origin North are distances from "
        "it", "geometry",
        ("OFFSET", "Centre or Origin", "The centre of the map, or the origin of its coordinates"),
        ("DEGREES", "Degrees", "By planetocentric longitude and latitude, east and north positive"),
        ("MAP", "Map Coordinates", "By easting and northing, in the unit of the file's coordinate system"),
        section=SITE, shown=chosen("kind", "HEIGHT_MAP"), since="0.4")
    site_longitude_deg: str = text(
        "Site Longitude", "", "East longitude of the site in degrees, with all of its digits", "geometry", "coordinate",
        section=SITE, shown=IN_DEGREES, since="0.4")
    site_latitude_deg: str = text(
        "Site Latitude", "", "Planetocentric latitude of the site in degrees, with all of its digits", "geometry",
        "coordinate", section=SITE, shown=IN_DEGREES, since="0.4")
    site_easting: str = text(
        "Site Easting", "",
        "Easting of the site in the unit of the file's coordinate system; for a map in degrees, its longitude",
        "geometry", "coordinate", section=SITE, shown=ON_MAP, since="0.4")
    site_northing: str = text(
        "Site Northing", "", "Northing of the site in the unit of the file's coordinate system", "geometry",
        "coordinate", section=SITE, shown=ON_MAP, since="0.4")
    origin_x_m: float = metres(
        "Origin East", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0), "Distance of the origin of the site east of the ground's "
        "centre, or of the file's origin", "geometry", section=SITE, shown=FROM_FILE)
    origin_y_m: float = metres(
        "Origin North", 0.0, -1.0e7, 1.0e7, (-100.0, 100.0), "Distance of the origin of the site north of the "
        "ground's centre, or of the file's origin", "geometry", section=SITE, shown=FROM_FILE)
    metres_per_pixel: float = metres(
        "Metres per Pixel", 0.0, 0.0, 1.0e5, (0.0, 100.0), "Size of a pixel of the height map; 0 for the size that a "
        "GeoTIFF contains", "geometry", zero="file's", shown=chosen("kind", "HEIGHT_MAP"))
    surroundings_m: float = metres(
        "Surroundings", 0.0, 0.0, 3.0e5, (0.0, 3.0e4), "Distance from the site, in each direction, to which the "
        "ground continues beyond its patch, with ever coarser cells and the curvature of the body; 0 for the patch "
        "alone", "geometry", zero="none", section=SURROUNDINGS, shown=MAP, since="0.4")
    surroundings_file: str = text(
        "Surroundings File", "", "GeoTIFF with a coarser height map of the same body that reaches beyond the first "
        "one. If it is empty, the ground ends at the edge of the first one", "geometry", "read", subtype="FILE_PATH",
        section=SURROUNDINGS, shown=SURROUNDED, since="0.4")
    missing: str = text(
        "No-Data Value", "",
        "Value, before scale and unit, that marks a missing height, such as -9999, besides the marks in the file. "
        "If it is empty, values far from all others count as missing; write none to keep them as heights",
        "geometry", "mark", shown=chosen("kind", "HEIGHT_MAP"),
        since="0.3")
    height_scale_m: float = number(
        "Metres per Value", 1.0, 1.0e-9, 1.0e6, (1.0e-3, 10.0), "Metres per unit of the values of the height map; for "
        "PNG, metres per grey level. It multiplies the unit and scale that a GeoTIFF contains", "geometry", "m",
        precision=6, shown=chosen("kind", "HEIGHT_MAP"))
    detail: bool = tick(
        "Add Roughness", False, "Add roughness from Ground at wavelengths that the file does not resolve", "geometry",
        shown=FROM_FILE)
    repair: bool = tick(
        "Repair", True, "Remove broken faces, merge duplicate vertices and turn the upper side of a mesh up",
        "geometry", shown=chosen("kind", "MESH", "STAND_IN"))


class TerrainLayer(Table):
    """An entry of ``terrain.layers``."""

    __slots__ = ()
    basis: Literal[
        "GRADIENT", "MIDPOINT", "CELLS", "VORONOI_F1", "VORONOI_F2", "VORONOI_F2_F1", "CRACKLE", "BROKEN"
    ] = choice("Basis", "GRADIENT", "Type of noise that the layer is made of", "geometry",
        ("GRADIENT", "Gradient Noise", "Rounded hills (Perlin)"),
        ("MIDPOINT", "Mid-Point", "Midpoint displacement: straight slopes between random points"),
        ("CELLS", "Cells", "Square steps of random height"),
        ("VORONOI_F1", "Voronoi F1", "Distance to the nearest random point: cones"),
        ("VORONOI_F2", "Voronoi F2", "Distance to the second nearest random point"),
        ("VORONOI_F2_F1", "Voronoi F2-F1", "Zero on the edges between cells, highest at their points"),
        ("CRACKLE", "Crackle", "Flat plates separated by narrow cracks"),
        ("BROKEN", "Broken Ice", "Convex pieces with plane faces that meet at edges"))
    fractal: Literal[
        "FBM", "MULTIFRACTAL", "HYBRID", "RIDGED", "HETERO", "TURBULENCE", "CRESTS"
    ] = choice("Fractal", "FBM", "How the octaves are combined", "geometry",
        ("FBM", "fBm", "Plain sum: equally rough everywhere"),
        ("MULTIFRACTAL", "Multifractal", "Product: smooth plains between rough heights"),
        ("HYBRID", "Hybrid", "Each octave scaled by the previous one: smooth valleys"),
        ("RIDGED", "Ridged", "Sharp crests with rough flanks"),
        ("HETERO", "Hetero Terrain", "Each octave scaled by the height so far: smooth low ground"),
        ("TURBULENCE", "Turbulence", "Sum of magnitudes: rounded lumps with creases"),
        ("CRESTS", "Crests", "Sum of sharp crests: equally rough everywhere"))
    amplitude_m: float = metres(
        "Amplitude", 0.1, -1.0e4, 1.0e4, (-2.0, 2.0), "RMS height of the layer. A negative value inverts the map",
        "geometry")
    scale_m: float = metres(
        "Scale", 2.0, 1.0e-3, 1.0e5, (0.1, 20.0), "Wavelength of the layer's first octave", "geometry")
    octaves: int = number(
        "Octaves", 6, 1, 16, (1, 10), "Number of octaves. Octaves that are too fine for the mesh are left out",
        "geometry", "octaves")
    lacunarity: float = number(
        "Lacunarity", 2.0, 1.2, 4.0, (1.5, 3.0), "Ratio of wavelengths of successive octaves", "geometry")
    roughness: float = fraction("Roughness", 0.5, "Ratio of the amplitudes of successive octaves", "geometry")
    warp_m: float = metres(
        "Warp", 0.0, 0.0, 1.0e4, (0.0, 2.0), "RMS horizontal displacement of the layer, by noise of the same scale",
        "geometry")


class TerrainSettings(Table, label="Ground"):
    """Shape of the ground: a random surface with given statistics, and its landforms."""

    __slots__ = ()
    size_m: float = metres(
        "Size", 20.0, 0.01, 1.0e5, (1.0, 100.0), "Side of the square patch of ground, centred on the origin",
        "geometry", section=TOP, shown=RANDOM | MAP)
    resolution: int = number(
        "Vertices per Side", 1025, 2, 4097, (65, 2049), "Vertices along each side of the patch; their spacing is size "
        "/ (vertices - 1)", "geometry", "vertices", section=ADVANCED, shown=GRID | DETAIL | MAP)
    rms_slope_deg: float = degrees(
        "Roughness, RMS Slope", 12.0, 0.0, 75.0, "Root-mean-square slope between points at a distance of the slope "
        "baseline. Smooth plains have about 5, ridged plains 10 to 15, broken ground above 25", "geometry", (0.0, 45.0),
        section=TOP, shown=RANDOM)
    slope_baseline_m: float = metres(
        "Slope Baseline", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0), "Distance between the two points of each slope that the "
        "roughness measures",
        "geometry", section=ADVANCED, shown=RANDOM)
    hurst: float = number(
        "Hurst Exponent", 0.8, 0.05, 1.0, (0.3, 1.0), "How roughness changes with scale: the RMS deviation grows as "
        "distance to this power. Below 0.5, slopes over centimetres are unrealistically steep", "geometry",
        section=ADVANCED, shown=RANDOM)
    multifractality: float = fraction(
        "Multifractality", 0.5, "0 is equally rough everywhere (fractional Brownian motion). 1 has smooth hollows and "
        "rough heights", "geometry", section=ADVANCED, shown=RANDOM)
    outer_scale_m: float = metres(
        "Largest Feature", 8.0, 1.0e-3, 1.0e5, (0.5, 50.0), "Longest wavelength of the ground. The roughness law "
        "holds up to 0.3 of it", "geometry", section=ADVANCED, shown=RANDOM)
    inner_scale_m: float = metres(
        "Smallest Feature", 0.02, 1.0e-4, 1.0e4, (5.0e-3, 1.0), "Shortest wavelength of the ground; the roughness law "
        "holds down to half of it. Wavelengths below two vertex spacings are left out of the mesh", "geometry",
        section=ADVANCED, shown=RANDOM)
    lacunarity: float = number(
        "Lacunarity", 2.0, 1.2, 4.0, (1.5, 3.0), "Largest ratio of the wavelengths of successive octaves, which are "
        "spaced evenly. Above 2.5 the roughness law shows steps", "geometry", section=ADVANCED, shown=RANDOM)
    regional_slope_deg: float = degrees(
        "Regional Slope", 0.0, 0.0, 60.0, "Slope of the whole patch, as on the flank of a ridge. The roughness does "
        "not include it", "geometry", (0.0, 30.0), shown=RANDOM)
    regional_slope_azimuth_deg: float = degrees(
        "Downslope Direction", 180.0, -360.0, 360.0, "Direction in which the whole patch slopes down, from north (+Y) "
        "over east (+X)", "geometry", section=ADVANCED, shown=RANDOM)
    body_radius_m: float = metres(
        "Moon Radius", 2.521e5, 1.0e4, 1.0e8, (1.0e5, 3.0e6), "Mean radius of the moon, which sets the distance of "
        "the horizon: 252.1 km for Enceladus, 1560.8 km for Europa. Ground on a uniform grid is flat; a height map's "
        "coordinate system states its own radius", "geometry", section=ADVANCED, shown=GRADED | SURROUNDED)
    variant: int = number(
        "Variant", 0, 0, 2147483647, (0, 100),
        "Number of the ground. Another number changes relief, layers and landforms, but not the rocks; terrain "
        "presets have different numbers, so one seed gives each its own hills",
        "geometry", section=ADVANCED, shown=RANDOM, since="0.3")
    layers: list[TerrainLayer] = tables(
        "Layers of Noise", TerrainLayer, "Fractal noise that is added to the ground, one table per layer", "geometry",
        section=NOISE, shown=ABOVE_A_MAP)


class MeshSettings(Table, label="Mesh", inside="terrain", shown=chosen("source.kind", "PROCEDURAL")):
    """Resolution and extent of the mesh of procedural ground."""

    __slots__ = ()
    kind: Literal["GRADED", "GRID"] = choice(
        "Spacing", "GRADED", "How the vertices of procedural ground are spaced", "geometry",
        ("GRADED", "Graded", "Rings around the site, out to the horizon, with triangles as fine as the images resolve"),
        ("GRID", "Uniform Grid", "A square of Ground Size with equal spacing"))
    error_px: float = number(
        "Largest Error", 1.0, 1.0e-3, 100.0, (0.05, 5.0), "Distance between the mesh and the exact ground, in pixels "
        "of the nearer eye. 95 % of the pixels are within it, for every heading", "geometry", "px", subtype="PIXEL",
        shown=chosen("kind", "GRADED"))
    edge_px: float = number(
        "Longest Edge", 8.0, 0.1, 1000.0, (1.0, 20.0), "Longest edge of a triangle on level ground, in pixels of the "
        "nearer eye. It also limits triangles on smooth ground", "geometry", "px", subtype="PIXEL",
        shown=chosen("kind", "GRADED"))
    farthest_m: float = metres(
        "Maximum Distance", 1.0e5, 1.0, 1.0e6, (10.0, 1.0e5), "Distance at which the ground ends if the horizon is "
        "farther away", "geometry", shown=chosen("kind", "GRADED"))
    most: int = number(
        "Maximum Vertices", 2000000, 1000, 100000000, (10000, 10000000), "Maximum number of vertices. If the largest "
        "error needs more, the mesh has a larger error and reports it", "geometry", "vertices",
        shown=chosen("kind", "GRADED"))
    seen: Literal["EVEN", "FINE"] = choice(
        "Detail Where Seen", "EVEN", "Fineness of a graded mesh where the cameras see it", "geometry",
        ("EVEN", "As Elsewhere", "One mesh for all headings. Waves of the ground shorter than two of its edges are "
         "missing, so that ground under a low Sun looks smoother than stated"),
        ("FINE", "Finer", "Triangles that the cameras see are cut into nine, so images and truth show waves of the "
         "ground that are a third as long there. Each heading has its own mesh"),
        shown=chosen("kind", "GRADED"), since="0.3")
    crests: Literal["ROUNDED", "CUT"] = choice(
        "Crests", "ROUNDED", "Treatment of crests of penitentes and ridges, and of rims of pits, in a graded mesh",
        "geometry",
        ("ROUNDED", "Rounded", "Crests are as round as the mesh is coarse, and show small teeth"),
        ("CUT", "Cut", "Triangles are cut along the crests, which are then as sharp as the law"),
        shown=chosen("kind", "GRADED"), since="0.3")
    walls: Literal["FLUTED", "BROKEN"] = choice(
        "Walls", "FLUTED", "Treatment of walls of pits, broken plates and cracks in a graded mesh", "geometry",
        ("FLUTED", "Fluted", "Walls have one shape from rim to foot, as a height field has"),
        ("BROKEN", "Broken", "Where cameras see walls, their triangles are cut smaller, and chips that differ from "
         "top to bottom are broken out of them"),
        shown=chosen("kind", "GRADED"), since="0.3")


class HillsSettings(
    Table, label="Distant Hills", inside="terrain", turned_on_by="rms_slope_deg", shown=GRADED, since="0.3"
):
    """Hills and ranges from the patch of ground to the horizon."""

    __slots__ = ()
    rms_slope_deg: float = degrees(
        "RMS Slope", 0.0, 0.0, 45.0, "Root-mean-square slope between points at a distance of the slope baseline; 0 "
        "for no hills. Europa's ridged plains have 10 to 15 at 10 to 100 m, its smooth bands about 5", "geometry",
        (0.0, 20.0))
    slope_baseline_m: float = metres(
        "Slope Baseline", 30.0, 0.1, 1.0e5, (1.0, 1000.0), "Distance between the points whose slope is stated",
        "geometry", section=ADVANCED)
    hurst: float = number(
        "Hurst Exponent", 0.75, 0.05, 1.0, (0.3, 1.0), "How roughness changes with scale: the height of hills grows "
        "as their width to this power", "geometry", section=ADVANCED)
    largest_m: float = metres(
        "Largest", 2000.0, 1.0, 1.0e5, (100.0, 1.0e4), "Width of the widest hills", "geometry")
    smallest_m: float = metres(
        "Smallest", 10.0, 0.1, 1.0e5, (5.0, 100.0),
        "Width of the narrowest hills; smaller relief is the roughness of the ground", "geometry", section=ADVANCED)
    fractal: Literal["FBM", "CRESTS", "HETERO"] = choice("Shape", "FBM", "Shape of the hills", "geometry",
        ("FBM", "Rolling", "Rounded hills, equally rough everywhere"),
        ("CRESTS", "Ridged", "Ranges with sharp crests"),
        ("HETERO", "Plains and Hills", "Rough hills beside smooth low ground"))
    outcrops: float = fraction(
        "Outcrops", 0.0, "Share of the hills where broken ice stands out of smoother slopes, in places of all widths; "
        "0 for none", "geometry", section=ADVANCED, since="0.4")
    outcrop_m: float = metres(
        "Outcrop Width", 8.0, 0.1, 1.0e4, (1.0, 50.0), "Width of the widest pieces of ice in outcrops. Narrower ones "
        "follow the law of the hills", "geometry", section=ADVANCED, active=positive("outcrops"), since="0.4")
    patchiness: float = fraction(
        "Patchiness", 0.0, "How much the roughness of the ground beyond the patch varies in patches, from twice the "
        "largest feature of the ground to the widest hills: the standard deviation of its logarithm. Its mean square "
        "stays the same", "geometry", section=ADVANCED, since="0.4")
