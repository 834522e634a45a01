"""Photometry of the ice and of the rocks."""

from __future__ import annotations

from typing import Literal

from . import stand_ins
from .declaration import (
    ADVANCED,
    ELSEWHERE,
    Section,
    Table,
    choice,
    degrees,
    fraction,
    image_file,
    mask_file,
    metres,
    number,
    signed,
    text,
)
from .relevance import chosen, nonzero, of_topic, positive, ticked

PRINCIPLED = chosen("model", "PRINCIPLED")
DIRTY = ~chosen("dirt", "BLACK")
FALLEN = positive("frost_share") & chosen("frost_from", "FALL")
EMITTING = PRINCIPLED | chosen("model", "LAMBERT")
HOLLOW_LIGHT = EMITTING & positive("emitted_w_m2_sr") & chosen("emitted_from", "HOLLOWS")
#: Dirt that follows the relief. Rocks have no troughs.
SOILED = nonzero("slope_dirt") | (nonzero("trough_dirt") & of_topic("surface"))
#: Images that lie on the ground by its UV coordinates; a mesh's own images always do.
BY_UV = chosen("set", "MESH") | (~chosen("set", "NONE") & chosen("mapping", "UV"))
COLOUR = Section("colour", "Colour", "Colour of clean ice, and how its albedo differs from place to place")
DIRT = Section("dirt", "Dirt", "Darker or redder ground in troughs and on slopes")
SALTS = Section("salts", "Salts", "Stains of salts")
GRAIN = Section("grain", "Grains", "Relief that is finer than the mesh, and glints")
INTERIOR = Section("interior", "Bubbles and Fractures", "Bubbles and fractures inside the ice")
COVER = Section("cover", "Frost and Crust", "Frost and crust on the ice")
FALL = Section("fall", "Falling Frost", "Origin of frost that falls, and the slopes that hold it")


class SurfaceSettings(Table, label="Ice"):
    """Snow or ice that the ground is made of."""

    __slots__ = ()
    model: Literal[
        "PRINCIPLED", "LAMBERT", "LOMMEL_SEELIGER", "LUNAR_LAMBERT", "HAPKE", "SNOW"
    ] = choice("Model", "PRINCIPLED", "Reflectance law of the surface", "material",
        ("PRINCIPLED", "Snow (Principled)", "Snow and ice as on Earth, with gloss and subsurface scattering. No "
         "opposition surge; costs 1.4 times Lambert, or 7 times if all light is scattered below the surface"),
        ("LAMBERT", "Lambert", "Equally bright from every direction; the cheapest law. No opposition surge and no "
         "phase function: up to 18 % error in the mean of a sunlit scene of ice"),
        ("LOMMEL_SEELIGER", "Lommel-Seeliger", "Single scattering, as in dark dust. Ice reflects mostly multiply "
         "scattered light, which this law omits; costs little more than Lambert"),
        ("LUNAR_LAMBERT", "Lunar-Lambert", "Lommel-Seeliger and Lambert mixed, as used for mosaics of moons. No "
         "phase function and no opposition surge; costs little more than Lambert"),
        ("HAPKE", "Hapke", "Granular ice, the usual model for moons; no gloss. Phase function, opposition surge and "
         "roughness are in the Hapke panel; costs 1.2 times Lambert, 1.8 times without OSL"),
        ("SNOW", "Snow (Measured)", "Measured snow on Earth, brighter against the light; no gloss. Within about 5 % "
         "for a Sun at least 20 degrees high, seen at most 60 degrees from the normal; no opposition surge; costs "
         "little more than Lambert"))
    albedo: float = fraction(
        "Albedo (Brightness)", 0.9, "Share of the light that clean, flat ice reflects under uniform light from all "
        "directions", "material", shown=~chosen("model", "HAPKE"), active=~(PRINCIPLED & positive("bubble_share")))
    lommel_seeliger_share: float = fraction(
        "Lommel-Seeliger Share", 0.7, "Share of Lommel-Seeliger in the lunar-Lambert law. The albedo does not depend "
        "on it", "material", section=ADVANCED, shown=chosen("model", "LUNAR_LAMBERT"))
    ice_colour: Literal["GREY", "SNOW", "EUROPA_PLAINS", "ENCELADUS_PLAINS"] = choice(
        "Ice Colour", "GREY", "Colour of clean ice. The albedo stays its mean over red, green and blue", "material",
        ("GREY", "Grey", "The same in all bands"),
        ("SNOW", "Snow", "Pure snow; coarser grains make it bluer (Warren and Brandt 2008)"),
        ("EUROPA_PLAINS", "Europa's Plains", "Slightly yellow; assumed"),
        ("ENCELADUS_PLAINS", "Enceladus' Plains", "Nearly grey (Buratti 1984)"),
        section=COLOUR, active=~(PRINCIPLED & positive("bubble_share")), since="0.3")
    snow_grain_m: float = metres(
        "Snow Grain Radius", 1.0e-4, 1.0e-6, 0.01, (2.5e-5, 2.0e-3), "Optical radius of the grains of snow, which "
        "sets its colour: 25 µm for frost, 1 mm for old snow", "material", section=COLOUR,
        shown=chosen("ice_colour", "SNOW"), active=~(PRINCIPLED & positive("bubble_share")), since="0.3")
    albedo_variation: float = fraction(
        "Albedo Variation", 0.0, "Largest darkening by random patches, as a share of the albedo", "material",
        section=COLOUR)
    face_variation: float = fraction(
        "Face Variation", 0.0, "Variation between the faces of rocks: a face is darker by up to this share of the "
        "albedo, and its roughness is higher or lower by up to this amount", "material", section=COLOUR, since="0.3")
    albedo_group: str = text(
        "Own Node Group", "", "Group of shader nodes in this .blend file. Its output Albedo Factor, from 0.02 to 1, "
        "multiplies the albedo", "material", "name", section=COLOUR, since="0.4")
    albedo_patch_m: float = metres(
        "Albedo Patch", 0.5, 1.0e-4, 1.0e4, (0.01, 10.0), "Wavelength of the dark patches", "material", section=COLOUR,
        active=positive("albedo_variation"))
    trough_dirt: float = signed(
        "Dirt in Troughs", "Darkening of low ground. Compares heights one standard deviation below and above the mean "
        "plane; negative to darken high ground", "material", section=DIRT)
    trough_width_m: float = metres(
        "Width of Troughs", 0.0, 0.0, 1.0e4, (0.0, 10.0), "Width of the square around each place whose mean height "
        "tells low ground, so that fines gather in each hollow and tops are clean; 0 for the mean plane of all ground",
        "material", zero="all ground", section=DIRT,
        active=of_topic("surface") & (nonzero("trough_dirt") | HOLLOW_LIGHT), since="0.4")
    slope_dirt: float = signed(
        "Dirt on Slopes", "Darkening of slopes of 45 degrees and more, compared with level ground; negative to darken "
        "level ground", "material", section=DIRT)
    dirt: Literal["BLACK", "EUROPA_DARK", "SULPHUR", "THOLIN"] = choice(
        "Dirt", "BLACK", "Material of the dirt in troughs and on slopes, whose shares are stated above",
        "material",
        ("BLACK", "Black", "Reflects nothing, so the ice is darker and keeps its colour"),
        ("EUROPA_DARK", "Dark Material", "Europa's, brown: 0.17 in green (Helfenstein et al. 1998), 1.25 of that in "
         "red and 0.6 in blue, assumed"),
        ("SULPHUR", "Sulphur", "Yellow-brown products of radiolysis; a guess"),
        ("THOLIN", "Red Organics", "Tholin, an assumption: it was not found on either moon"),
        section=DIRT, active=SOILED, since="0.3")
    dirt_patch_m: float = metres(
        "Dirt Patch", 0.0, 0.0, 1.0e4, (0.0, 5.0), "Wavelength of patches that dirt covers wholly, with clean ice "
        "between them; 0 for an even mixture. Black dirt is always even", "material", section=DIRT,
        active=SOILED & DIRTY, since="0.3")
    dirt_mask_file: str = mask_file(
        "dirt lies", "material", section=DIRT, active=SOILED, since="0.4")
    salt_share: float = fraction(
        "Salt Share", 0.0, "Share of the ground that is stained by salts", "material", section=SALTS)
    salt_patch_m: float = metres(
        "Salt Patch", 1.0, 1.0e-4, 1.0e4, (0.05, 20.0), "Wavelength of the stains", "material", section=SALTS,
        active=positive("salt_share"))
    salt: Literal[
        "OWN", "EUROPA_SALT", "IRRADIATED_SALT", "SULPHATE_SALTS", "ACID_HYDRATE", "SULPHUR", "EUROPA_DARK"
    ] = choice("Salt", "OWN", "Material of the stains", "material",
        ("OWN", "Own Colour",
            "The reflectances relative to clean ice that are stated below. If Salt Share is small, stains cover "
            "about 0.6 of it"),
        ("EUROPA_SALT", "Europa's Salt", "Table salt with the faint band that Europa shows near 450 nm (Trumbo et "
         "al. 2019)"),
        ("IRRADIATED_SALT", "Irradiated Salt", "Table salt after irradiation in the laboratory: yellow"),
        ("SULPHATE_SALTS", "Hydrated Sulphates", "Hydrates of magnesium and sodium sulphate: white"),
        ("ACID_HYDRATE", "Acid Hydrate", "Hydrate of sulphuric acid: white"),
        ("SULPHUR", "Sulphur", "Yellow-brown products of radiolysis; a guess"),
        ("EUROPA_DARK", "Dark Material", "Europa's, brown, as for Dirt"),
        section=SALTS, active=positive("salt_share"), since="0.3")
    salt_red: float = fraction(
        "Salt Red", 1.0, "Reflectance of stained ice relative to clean ice, in red", "material", section=SALTS,
        shown=chosen("salt", "OWN"), active=positive("salt_share"))
    salt_green: float = fraction(
        "Salt Green", 0.85, "Reflectance of stained ice relative to clean ice, in green", "material", section=SALTS,
        shown=chosen("salt", "OWN"), active=positive("salt_share"))
    salt_blue: float = fraction(
        "Salt Blue", 0.6, "Reflectance of stained ice relative to clean ice, in blue. Irradiated salt absorbs near "
        "0.45 µm", "material", section=SALTS, shown=chosen("salt", "OWN"), active=positive("salt_share"))
    subsurface_weight: float = fraction(
        "Subsurface Weight", 0.0, "Share of the light that enters the snow and leaves it elsewhere (random walk). A "
        "render with 1 takes about five times as long as with 0", "material", shown=PRINCIPLED)
    subsurface_radius_m: float = metres(
        "Subsurface Radius", 5.0e-3, 0.0, 10.0, (0.0, 0.1),
        "Radius of Blender's random walk; the mean free path of light in the snow is 0.08 of it. Light in white "
        "snow falls by a factor e over a depth of about this radius, in darker snow over less", "material",
        section=ADVANCED, shown=PRINCIPLED, active=positive("subsurface_weight"))
    subsurface_method: Literal["RANDOM_WALK", "BURLEY"] = choice(
        "Subsurface Law", "RANDOM_WALK", "Model of the path of light in the snow", "material",
        ("RANDOM_WALK", "Random Walk", "Follows light from one scattering to the next inside the ground's shape"),
        ("BURLEY", "Burley", "Uses a profile that was fitted to flat surfaces. It takes a third of the time, but "
         "matchers are wrong at 4 % more pixels"),
        section=ADVANCED, shown=PRINCIPLED, active=positive("subsurface_weight"), since="0.3")
    transmission: float = fraction(
        "Transmission", 0.0, "Share of the light that enters clear ice, see Transmitted Light", "material",
        section=ADVANCED, shown=PRINCIPLED)
    transmitted: Literal["LOST", "THROUGH"] = choice(
        "Transmitted Light", "LOST", "Path of the light that enters clear ice", "material",
        ("LOST", "Lost", "Light that enters the deep ice does not come back, so the surface is darker"),
        ("THROUGH", "Through Rocks",
            "Light passes straight through rocks, weakened by the absorption of pure ice, and lights the objects "
            "behind. Light that enters the ground is lost; the albedo applies to the rest"),
        section=ADVANCED, shown=PRINCIPLED, active=positive("transmission"), since="0.3")
    roughness: float = fraction(
        "Roughness", 0.6, "Microfacet roughness of the specular reflection", "material", shown=PRINCIPLED)
    specular: float = fraction(
        "Specular Level", 0.5, "Strength of the specular reflection; 0.5 is the strength that follows from the "
        "refractive index",
        "material", section=ADVANCED, shown=PRINCIPLED)
    refractive_index: float = number(
        "Refractive Index", 1.31, 1.0, 3.0, (1.0, 2.0), "Refractive index of the ice; 1.31 for water ice in visible "
        "light", "material", section=ADVANCED, shown=PRINCIPLED)
    emitted_w_m2_sr: float = number(
        "Emitted Light (W/m² sr)", 0.0, 0.0, 1.0e5, (0.0, 1.0),
        "Radiance that the ice itself emits, equal in all directions and bands. The default is 0: warm ice "
        "emits no visible light, and the glow of irradiated ice was seen only in the laboratory (Gudipati et "
        "al. 2021)", "material", "W/m² sr", section=ADVANCED,
        shown=EMITTING, since="0.3")
    emitted_from: Literal["EVERYWHERE", "HOLLOWS"] = choice(
        "Emitting Ice", "EVERYWHERE", "Where the ice emits light", "material",
        ("EVERYWHERE", "Everywhere", "The ground, and rocks that have its surface"),
        ("HOLLOWS", "Hollows", "Only low ground, such as the floors of fractures. Rocks emit no light"),
        section=ADVANCED, shown=EMITTING, active=of_topic("surface") & positive("emitted_w_m2_sr"), since="0.4")
    emitted_below: float = number(
        "Emitting Below (SD)", -1.0, -2.9, 2.9, (-2.5, 0.0),
        "Height below which hollows emit, above the mean plane of the ground, in standard deviations of its "
        "heights; -1 is a guess. Heights beyond 3 deviations count as 3", "material", section=ADVANCED,
        shown=EMITTING, active=of_topic("surface") & positive("emitted_w_m2_sr") & chosen("emitted_from", "HOLLOWS"),
        since="0.4")
    bubble_share: float = fraction(
        "Bubbles", 0.0, "Share of the ice's volume that is air bubbles, which make it white: 0.05 is whitish, 0.001 "
        "deep blue. Its albedo in red, green and blue then follows from the bubbles; 0 for the albedo above",
        "material", high=0.5, section=INTERIOR, shown=PRINCIPLED, since="0.3")
    bubble_radius_m: float = metres(
        "Bubble Radius", 5.0e-4, 1.0e-6, 0.1, (1.0e-5, 5.0e-3), "Radius of the bubbles. Larger ones scatter less, so "
        "that the ice is bluer", "material", section=INTERIOR, shown=PRINCIPLED, active=positive("bubble_share"),
        since="0.3")
    bubble_band_m: float = metres(
        "Bubble Bands", 0.0, 0.0, 1000.0, (0.0, 2.0), "Mean distance between bands of clearer and whiter ice, which "
        "have a quarter to four times the bubbles. Each rock has its own bands; 0 for even ice", "material",
        section=INTERIOR,
        shown=PRINCIPLED, active=positive("bubble_share"), since="0.3")
    fracture_share: float = fraction(
        "Internal Fractures", 0.0,
        "Open share of the fracture planes inside the ice, which look like white veils along the line of "
        "sight. Bubbles, transmission or the subsurface radius set the depth to which they are visible",
        "material", section=INTERIOR, shown=PRINCIPLED, since="0.3")
    fracture_spacing_m: float = metres(
        "Fracture Spacing", 0.15, 1.0e-3, 1000.0, (0.02, 1.0), "Mean distance between the planes of each of three "
        "sets of fractures; each rock has its own", "material", section=INTERIOR, shown=PRINCIPLED,
        active=positive("fracture_share"), since="0.3")
    frost_share: float = fraction(
        "Frost", 0.0, "Share of level ice that thin frost covers. Faces steeper than 65 degrees have none, unless "
        "Steepest Frost states another limit", "material", section=COVER, shown=PRINCIPLED, since="0.3")
    frost_from: Literal["VAPOUR", "FALL"] = choice(
        "Frost From", "VAPOUR", "Origin of the frost, which sets where it lies", "geometry",
        ("VAPOUR", "Vapour", "It forms in place, on level ice and on gentle slopes of all directions"),
        ("FALL", "Falling Grains", "Grains of a plume fall on parallel paths. Faces toward their origin get most, tops "
         "get caps, and walls and overhangs get none"),
        section=FALL, shown=PRINCIPLED, active=positive("frost_share"), since="0.4")
    frost_tilt_deg: float = degrees(
        "Tilt of Fall", 0.0, 0.0, 80.0, "Angle between the vertical and the direction that the grains come from; at 0 "
        "they fall straight down. A grain comes down as steeply as it left its vent", "geometry", (0.0, 60.0),
        section=FALL, shown=PRINCIPLED, active=FALLEN, since="0.4")
    frost_azimuth_deg: float = degrees(
        "Origin of Fall", 0.0, -360.0, 360.0, "Direction that the grains come from, such as that of a vent, from north "
        "(+Y) over east (+X)", "geometry", section=FALL, shown=PRINCIPLED, active=FALLEN & positive("frost_tilt_deg"),
        since="0.4")
    frost_spread_deg: float = degrees(
        "Spread of Fall", 15.0, 0.0, 60.0, "Half of the width of the cone that the grains come from, which softens the "
        "edge of what rocks and relief shelter. A guess: vents are many, and their jets are wide", "geometry",
        (0.0, 45.0), section=FALL, shown=PRINCIPLED, active=FALLEN, since="0.4")
    frost_hold_deg: float = degrees(
        "Steepest Frost", 50.0, 15.0, 90.0, "Slope in the middle of those that hold a part of the grains; "
        "slopes 15 degrees steeper hold none, and 15 degrees gentler all. A guess: no slope of frost is known at "
        "0.01 g", "material", (30.0, 75.0), section=FALL, shown=PRINCIPLED, active=FALLEN, since="0.4")
    frost_patch_m: float = metres(
        "Frost Patch", 0.15, 1.0e-4, 1.0e4, (0.01, 5.0), "Wavelength of the patches of frost", "material",
        section=COVER, shown=PRINCIPLED, active=positive("frost_share"), since="0.3")
    patch_raggedness: float = fraction(
        "Ragged Patches", 0.0,
        "Raggedness of the edges of frost and dirt patches: share of the pattern's variance at an eighth of its "
        "wavelength or less", "material", section=COVER, shown=PRINCIPLED | DIRTY,
        active=(PRINCIPLED & positive("frost_share")) | (DIRTY & positive("dirt_patch_m")), since="0.3")
    frost_albedo: float = fraction(
        "Frost Albedo", 0.9, "Albedo of the frost", "material", section=COVER, shown=PRINCIPLED,
        active=positive("frost_share"), since="0.3")
    frost_mask_file: str = mask_file(
        "frost lies", "material", section=COVER, shown=PRINCIPLED, active=positive("frost_share"),
        since="0.4")
    crust_share: float = fraction(
        "Crust", 0.0, "Share of the snow with a crust: a smooth, slightly glossy skin, broken into patches", "material",
        section=COVER, shown=PRINCIPLED, since="0.3")
    crust_patch_m: float = metres(
        "Crust Patch", 0.8, 1.0e-3, 1.0e4, (0.05, 10.0), "Wavelength of the patches of crust", "material",
        section=COVER, shown=PRINCIPLED, active=positive("crust_share"), since="0.3")
    crust_height_m: float = metres(
        "Crust Thickness", 6.0e-3, 0.0, 1.0, (0.0, 0.03),
        "Height of the step at the edge of the crust. It changes the shading, not the true depth",
        "material", section=COVER, shown=PRINCIPLED,
        active=positive("crust_share"), since="0.3")
    crust_roughness: float = fraction(
        "Crust Roughness", 0.55, "Microfacet roughness of the crust", "material", section=COVER, shown=PRINCIPLED,
        active=positive("crust_share"), since="0.3")
    glint_share: float = fraction(
        "Glints", 0.0,
        "Share of the reflected light that facets of grains mirror; only one of the eyes sees a near glint. 0 for "
        "no glints; 0.03 is a guess for fresh snow", "material", high=0.5, section=GRAIN,
        shown=PRINCIPLED, since="0.3")
    glint_size_m: float = metres(
        "Glint Size", 1.0e-3, 1.0e-5, 0.1, (1.0e-4, 0.01),
        "Size of a glinting grain. A pixel that shows several grains has one facet for all of them",
        "material", section=GRAIN, shown=PRINCIPLED,
        active=positive("glint_share"), since="0.3")
    grain_size_m: float = metres(
        "Grain Size", 0.03, 1.0e-4, 1000.0, (1.0e-3, 1.0), "Wavelength of the fine relief, which is finer than the "
        "mesh", "material", section=GRAIN, active=positive("grain_amplitude_m"))
    grain_amplitude_m: float = metres(
        "Grain Relief", 4.0e-3, 0.0, 1.0, (0.0, 0.05), "Height of the fine relief, from its lowest to its highest "
        "point", "material", section=GRAIN)
    grain_patchiness: float = fraction(
        "Patchy Grain", 0.0, "Variation of the fine relief's height from place to place, at the same RMS height: 0 is "
        "equally rough everywhere, 1 has smooth places beside rough places", "material", section=GRAIN,
        active=positive("grain_amplitude_m"), since="0.3")
    grain_patch_limit: float = number(
        "Patch Limit", 0.0, 0.0, 6.0, (0.0, 3.0), "Largest deviation of a patch of grain from the usual roughness, in "
        "standard deviations; 0 for no limit", "material", "σ", zero="none", section=GRAIN,
        active=positive("grain_amplitude_m") & positive("grain_patchiness"), since="0.4")
    relief: Literal["BUMP", "DISPLACEMENT", "REAL"] = choice(
        "Fine Relief", "REAL", "Method that makes the fine relief", "material",
        ("BUMP", "Bump", "Changes only the shading: the true depth is that of the mesh. Costs no time"),
        ("DISPLACEMENT", "Displacement", "Moves the vertices of the mesh, and so depth and shadows. Wavelengths "
         "below two vertex spacings are lost, and Build Scene reports how much"),
        ("REAL", "Real",
            "Where the relief is more than half a pixel high, the mesh is as fine as the image and its vertices move. "
            "Lower relief, rocks and ground from a file get bump"),
        section=GRAIN, active=positive("grain_amplitude_m"))


class HapkeSettings(Table, label="Hapke", inside="surface", shown=chosen("surface.model", "HAPKE") |
        (ticked("rocks.own_surface") & chosen("rock_surface.model", "HAPKE"))):
    """Parameters of Hapke's law, for every surface that uses it."""

    __slots__ = ()
    w: float = fraction(
        "Albedo w (Brightness)", 0.964, "Single-scattering albedo: share of the light on a grain that the grain "
        "scatters (w). Clean ice is above 0.95", "material", section=ELSEWHERE)
    b: float = number(
        "Lobe Width b", 0.429, -0.99, 0.99, (0.0, 0.9), "Asymmetry of both lobes of the phase function. 0 scatters "
        "evenly, near 1 the lobes are narrow; negative values reverse them", "material")
    c: float = number(
        "Lobe Share c", 0.113, -1.0, 1.0, None, "Balance of the lobes as in Hapke (2012): 1 is all backward, -1 all "
        "forward. McGuire and ISIS use (1 + c)/2", "material", active=nonzero("b"))
    b_s0: float = number(
        "Shadow-Hiding Amplitude", 0.5, 0.0, 3.0, (0.0, 1.0), "Height of the opposition surge by shadow hiding (BS0). "
        "Values above 1 include coherent backscatter", "material", section=ADVANCED)
    h_s: float = number(
        "Shadow-Hiding Width", 1.6e-3, 0.0, 10.0, (0.0, 0.1), "Tangent of half the phase angle at which shadow hiding "
        "has half its height; 0 for no surge", "material", precision=5, section=ADVANCED, active=nonzero("b_s0"))
    b_c0: float = fraction(
        "Backscatter Amplitude", 0.0, "Height of the opposition surge by coherent backscatter (BC0), as a share of "
        "all light", "material", section=ADVANCED)
    h_c: float = number(
        "Backscatter Width", 0.0, 0.0, 10.0, (0.0, 0.1), "Half-width of coherent backscatter, as tangent of half the "
        "phase angle; 0 for no surge", "material", precision=5, section=ADVANCED, active=nonzero("b_c0"))
    theta_bar_deg: float = degrees(
        "Roughness", 10.0, 0.0, 60.0, "Mean slope angle of relief that is finer than mesh and grains. With the Nodes "
        "shader, 0 halves the cost of the surface", "material", (0.0, 40.0))
    theta_bar_range_deg: float = degrees(
        "Roughness Range", 0.0, -60.0, 60.0, "Difference in roughness between white and black in the roughness image; "
        "its mean has the roughness above. The result is limited to 0 to 60; 0 ignores the image", "material",
        (-30.0, 30.0), section=ADVANCED)
    filling_factor: float = fraction(
        "Filling Factor", 0.0, "Share of the volume that grains fill, at most 0.75. 0 gives the model of 1993, "
        "without porosity", "material", high=0.75, section=ADVANCED)
    h_function: Literal["1981", "1993", "2002"] = choice(
        "H Function", "1981", "Approximation of multiple scattering. Use the one that the parameters were fitted with",
        "material",
        ("1981", "1981", "Up to 4 % error. All fits of the Voyager era use it"),
        ("1993", "1993", "Up to 0.8 % error"),
        ("2002", "2002", "Up to 1 % error. Eradiate and Hapke's later book use it"),
        section=ADVANCED)
    accuracy: Literal["FAST", "ACCURATE", "REFERENCE"] = choice(
        "Accuracy", "FAST", "Accuracy of light that other ground reflects. Direct sunlight is always exact", "material",
        ("FAST", "Fast", "Reflected light is weighted like sunlight. It is 2 to 4 % too dark in the mean, and up to "
         "10 % in shadows"),
        ("ACCURATE", "Accurate", "Reflected light is within 1 % in the mean, 8 % in shadows. The Sun's disc blurs "
         "the surges exactly; needs OSL and the CPU"),
        ("REFERENCE", "Reference", "Reflected light is within 0.1 % in the mean, 1 % in shadows. Hapke's law for "
         "three interreflections, approximate where dirt or images vary the ice; needs OSL and the CPU; your own "
         "objects receive no sunlight from ice"),
        section=ADVANCED, active=~chosen("backend", "NODES"))
    backend: Literal["AUTO", "OSL", "NODES"] = choice(
        "Shader", "AUTO", "Implementation of the law in Cycles. Measured snow uses nodes unless OSL is chosen",
        "material",
        ("AUTO", "Automatic", "OSL if it is available, otherwise nodes. Warns if this lowers the accuracy"),
        ("OSL", "OSL", "Open Shading Language. Build Scene refuses it without OSL and on the GPU"),
        ("NODES", "Nodes", "Available in every Blender and on every device, with fast accuracy only"),
        section=ADVANCED)


class TexturesSettings(Table, label="Textures", inside="surface"):
    """Images on the ground and on rocks."""

    __slots__ = ()
    set: Literal["NONE", "FROST", "GRAINS", "CRACKS", "STAND_IN", "OWN", "MESH"] = choice(
        "Texture", "NONE", "Images on the ground and on rocks", "material",
        ("NONE", "None", "Procedural ice only"),
        ("FROST", "Frost", "Generated: crystals of hoar with bright tips"),
        ("GRAINS", "Grains", "Generated: rounded grains with dark gaps"),
        ("CRACKS", "Cracks", "Generated: plates of crust with dark cracks between them"),
        ("STAND_IN", "Stand-In", "A computed texture that replaces one of the GUISS paper, with the same kinds of "
         "images"),
        ("OWN", "Own Images", "The files below. Empty ones are not used"),
        ("MESH", "From Mesh", "Albedo, roughness and normals from the OBJ, glTF or PLY file of the ground, mapped by "
         "its UV coordinates"))
    stand_in: Literal[
        "SNOW_CRYSTALS", "HOAR_FROST", "SNOW_DRIFT", "CRUSTED_SNOW", "CRACKED_ICE", "POWDER_SNOW",
        "GROUND_SNOW", "LUMPY_SNOW", "FIRN", "GLACIER_ICE", "MIXED_SNOW", "SETTLED_SNOW", "SUNCUPS", "SASTRUGI"
    ] = choice("Stand-In", "SNOW_CRYSTALS", "Computed texture of snow or ice", "material",
        *stand_ins.make_choices(stand_ins.TEXTURES),
        shown=chosen("set", "STAND_IN"), active=~chosen("set", "MESH"), since="0.3")
    mapping: Literal["OBJECT", "UV", "PATCH", "MAP"] = choice(
        "Mapping", "OBJECT", "How the images are mapped. Images from the mesh always use its UV coordinates",
        "material",
        ("OBJECT", "By Position", "Projected from above, and from the side on steep slopes"),
        ("UV", "By UV", "By the UV coordinates of the mesh file; Image Width and Repeats have no effect. Rocks have "
         "no UV coordinates and get the mean of the images"),
        ("PATCH", "Over the Patch", "Once over the square of the patch around the origin, seen from above, with "
         "north up. Image Width and Repeats have no effect"),
        ("MAP", "By Map Coordinates", "An albedo GeoTIFF is placed on the map of the ground by its coordinate system. "
         "Image Width and Repeats have no effect"),
        shown=~chosen("set", "NONE"), active=~chosen("set", "MESH"))
    width_m: float = metres(
        "Image Width", 0.5, 1.0e-3, 1.0e4, (0.05, 10.0), "Width of an image that is mapped by position", "material",
        shown=~chosen("set", "NONE"), active=~chosen("mapping", "PATCH", "MAP") & ~BY_UV)
    repeat: Literal["TURNED", "SHIFTED", "PLAIN"] = choice(
        "Repeats", "TURNED", "How an image that is mapped by position continues beyond its edges", "material",
        ("TURNED", "Shifted and Turned", "Hexagons from random positions, at random angles. Repeats are not visible"),
        ("SHIFTED", "Shifted", "Hexagons from random positions in the image, not rotated, for images with a direction"),
        ("PLAIN", "Plain", "The whole image, side by side"),
        shown=~chosen("set", "NONE"), active=~chosen("mapping", "PATCH", "MAP") & ~BY_UV)
    height_m: float = metres(
        "Relief Height", 5.0e-3, -10.0, 10.0, (-0.05, 0.05), "Height of white above black in the height image. It is "
        "bump, unless Fine Relief of the surface is Displacement", "material", shown=~chosen("set", "NONE"),
        active=~chosen("set", "MESH"))
    albedo_file: str = image_file(
        "Albedo", "Image that multiplies the albedo, relative to the mean of the image", shown=chosen("set", "OWN"))
    roughness_file: str = image_file("Roughness", "Image of the roughness, 0 to 1", shown=chosen("set", "OWN"))
    normal_file: str = image_file("Normal", "Image of normals (OpenGL: green is up)", shown=chosen("set", "OWN"))
    transmission_file: str = image_file(
        "Transmission", "Image of the share of light that enters clear ice, 0 to 1", shown=chosen("set", "OWN"))
    height_file: str = image_file("Height", "Image of heights, see Relief Height", shown=chosen("set", "OWN"))


class RockSurfaceSettings(SurfaceSettings, label="Rock Ice", inside="rocks", turned_on_by="rocks.own_surface"):
    """Snow or ice of rocks that have their own surface."""

    __slots__ = ()
