"""The settings of landforms. The first number of each landform turns it on."""

from __future__ import annotations

from typing import Literal

from .declaration import LANDFORMS, Table, choice, degrees, fraction, metres, number
from .ground import ABOVE_A_MAP, PROCEDURAL
from .relevance import positive


class RidgesSettings(Table, label="Ridges", parent=LANDFORMS, turned_on_by="height_m", shown=ABOVE_A_MAP):
    """Double ridges with a trough between the crests; young ridges cross old ones."""

    __slots__ = ()
    height_m: float = metres(
        "Height", 0.0, 0.0, 1000.0, (0.0, 5.0), "Height of the crests above the plain; 0 for no ridges", "geometry")
    width_m: float = metres("Width", 4.0, 0.01, 1.0e4, (0.5, 50.0), "Width of a ridge from foot to foot", "geometry")
    spacing_m: float = metres(
        "Spacing", 9.0, 0.01, 1.0e5, (1.0, 100.0), "Mean distance between ridges of one set, at least 1.2 widths",
        "geometry")
    trough: float = fraction(
        "Trough", 0.5, "Depth of the trough between the crests as a share of the height; 0 for a single, flat-topped "
        "ridge", "geometry")
    sets: int = number(
        "Sets", 2, 1, 6, None, "Number of sets of parallel ridges. Each set crosses the sets before it", "geometry",
        "sets")
    azimuth_deg: float = degrees(
        "Direction", 60.0, -360.0, 360.0, "Mean direction of the ridges, from north (+Y) over east (+X)", "geometry")
    spread_deg: float = degrees(
        "Spread", 50.0, 0.0, 90.0, "Largest deviation of a set's direction from the mean", "geometry")


class CracksSettings(Table, label="Cracks", parent=LANDFORMS, turned_on_by="depth_m", shown=ABOVE_A_MAP):
    """Fractures along the edges of plates."""

    __slots__ = ()
    depth_m: float = metres(
        "Depth", 0.0, 0.0, 1000.0, (0.0, 2.0), "Depth of the cracks below the ground; 0 for no cracks", "geometry")
    width_m: float = metres("Width", 0.4, 1.0e-3, 1.0e4, (0.05, 5.0), "Width of a crack from edge to edge", "geometry")
    rim_m: float = metres(
        "Rim", 0.0, 0.0, 1000.0, (0.0, 1.0), "Height of the raised rims beside the cracks", "geometry")
    plate_m: float = metres(
        "Plate", 3.0, 0.01, 1.0e5, (0.5, 50.0), "Mean width of the plates between cracks", "geometry")
    elongation: float = number(
        "Elongation", 1.0, 1.0, 100.0, (1.0, 15.0), "Length of a plate divided by its width: 1 for polygons, above 5 "
        "for the nearly parallel fractures beside a tiger stripe", "geometry")
    azimuth_deg: float = degrees(
        "Direction", 0.0, -360.0, 360.0, "Direction of elongated cracks, from north (+Y) over east (+X)", "geometry")
    edges: Literal["ROUNDED", "BROKEN", "JOINTED"] = choice(
        "Edges", "ROUNDED", "Shape of the walls of cracks, and the fragments in them", "geometry",
        ("ROUNDED", "Rounded", "Smooth walls that end in the middle of the crack"),
        ("BROKEN", "Broken", "Steep, chipped walls, and fallen fragments of ice on the floor"),
        ("JOINTED", "Jointed", "Straight cracks with steep walls of plane faces that meet at corners, and fallen "
         "fragments of ice on the floor"),
        since="0.3")


class ChaosSettings(Table, label="Chaos", parent=LANDFORMS, turned_on_by="relief_m", shown=ABOVE_A_MAP):
    """Raised and tilted plates of broken crust in a lumpy matrix."""

    __slots__ = ()
    relief_m: float = metres(
        "Relief", 0.0, 0.0, 1.0e4, (0.0, 10.0), "Height of the highest plates above the matrix. The lowest are half "
        "as high; 0 for no plates", "geometry")
    plate_m: float = metres("Plate", 4.0, 0.01, 1.0e5, (0.5, 50.0), "Mean width of a plate", "geometry")
    plate_share: float = fraction(
        "Plate Share", 0.6, "Share of the plates that are preserved. The others are matrix", "geometry")
    gap_m: float = metres(
        "Gap", 0.3, 0.0, 1.0e4, (0.0, 5.0), "Width of the gap between neighbouring plates", "geometry")
    tilt_deg: float = degrees(
        "Tilt", 8.0, 0.0, 60.0, "Largest slope of the top of a plate toward east or north", "geometry", (0.0, 30.0))
    matrix_m: float = metres(
        "Matrix Relief", 0.0, 0.0, 1000.0, (0.0, 2.0), "RMS height of the lumps between the plates", "geometry")
    edges: Literal["ROUNDED", "BROKEN", "JOINTED"] = choice(
        "Edges", "ROUNDED", "Shape of the edges of plates, and the ice between them", "geometry",
        ("ROUNDED", "Rounded", "Bent edges, scarps of 60 degrees with smooth rims, and lumps between"),
        ("BROKEN", "Broken", "Straight, chipped edges, scarps of 80 degrees with sharp rims, and tilted fragments of "
         "ice between"),
        ("JOINTED", "Jointed", "As Broken, but scarps are plane faces that meet at corners, with pieces spalled off "
         "the rims"),
        since="0.3")


class CratersSettings(Table, label="Craters", parent=LANDFORMS, turned_on_by="coverage", shown=ABOVE_A_MAP):
    """Small bowl-shaped craters with a power law of sizes."""

    __slots__ = ()
    coverage: float = fraction(
        "Coverage", 0.0, "Total area of the craters divided by the area of the ground; 0 for none", "geometry",
        high=2.0)
    smallest_m: float = metres(
        "Smallest", 0.4, 1.0e-3, 1.0e4, (0.1, 10.0), "Diameter of the smallest craters", "geometry")
    largest_m: float = metres("Largest", 5.0, 1.0e-3, 1.0e4, (0.5, 50.0), "Diameter of the largest craters", "geometry")
    power_index: float = number(
        "Size Index", 3.0, 0.5, 6.0, (1.0, 5.0), "Exponent of the cumulative power law N(>D) ~ D^-index: about 2 for "
        "primary craters, 4 for secondaries", "geometry")
    depth_ratio: float = fraction(
        "Depth", 0.2, "Depth of a fresh crater, from rim to floor, divided by its diameter", "geometry")
    rim_ratio: float = fraction("Rim", 0.04, "Height of the rim of a fresh crater divided by its diameter", "geometry")
    freshness: float = fraction(
        "Freshness", 0.3, "Depth of the oldest crater as a share of the depth when fresh; 1 if all craters are fresh",
        "geometry")
    most: int = number(
        "Maximum Craters", 5000, 0, 50000, (0, 10000), "Maximum number of craters. Build Scene refuses settings that "
        "need more", "geometry", "craters")


class HollowsSettings(Table, label="Hollows", parent=LANDFORMS, turned_on_by="depth_m", shown=ABOVE_A_MAP):
    """Cups with sharp rims, formed by sublimation without wind."""

    __slots__ = ()
    depth_m: float = metres(
        "Depth", 0.0, 0.0, 100.0, (0.0, 1.0), "Depth of the deepest hollow below its rim. The shallowest has 0.6 of "
        "it; 0 for no hollows", "geometry")
    diameter_m: float = metres("Diameter", 0.6, 1.0e-3, 1.0e4, (0.1, 5.0), "Mean diameter of a hollow", "geometry")
    elongation: float = number(
        "Elongation", 1.0, 1.0, 100.0, (1.0, 10.0), "Length of a hollow divided by its width. Sastrugi, which need "
        "wind, have about 5", "geometry")
    azimuth_deg: float = degrees(
        "Direction", 0.0, -360.0, 360.0, "Direction of the long axis of the hollows, from north (+Y) over east (+X)",
        "geometry")
    crest_m: float = metres(
        "Crest Width", 0.0, 0.0, 100.0, (0.0, 0.2), "Width over which the crests between hollows are round; 0 for "
        "edges, which a mesh shows as teeth", "geometry", since="0.3")


class PenitentesSettings(Table, label="Penitentes", parent=LANDFORMS, turned_on_by="height_m", shown=ABOVE_A_MAP):
    """Rows of ice blades that lean toward the noon Sun."""

    __slots__ = ()
    height_m: float = metres(
        "Height", 0.0, 0.0, 100.0, (0.0, 6.0), "Height of the tallest blades above the troughs; 0 for none", "geometry")
    spacing_m: float = metres(
        "Spacing", 1.5, 0.01, 1000.0, (0.2, 10.0), "Mean distance between rows of blades", "geometry")
    sharpness: float = fraction(
        "Sharpness", 0.8, "0 gives rounded ridges, 1 sharp edges between concave walls", "geometry")
    elongation: float = number(
        "Elongation", 1.5, 0.5, 100.0, (0.5, 10.0), "Length of a blade divided by the spacing of rows", "geometry")
    variation: float = fraction(
        "Variation", 0.6, "Variation of the heights of blades and of the saddles between them; 0 for unbroken rows of "
        "one height", "geometry")
    disorder: float = fraction(
        "Disorder", 0.0, "Variation of height between groups of blades, and of spacing and lean between blades; 0 for "
        "rows that are alike everywhere", "geometry", since="0.3")
    wander: float = number(
        "Wander", 0.5, 0.0, 2.0, (0.0, 1.0), "Sideways wandering of the rows, in spacings; 0 for parallel "
        "rows in planes through the path of the Sun", "geometry", "spacings", since="0.4")
    noon_azimuth_deg: float = degrees(
        "Noon Sun", 0.0, -360.0, 360.0, "Azimuth of the noon Sun. Blades lean toward it, and rows run at right angles "
        "to it", "geometry")
    lean_deg: float = degrees(
        "Lean", 0.0, 0.0, 60.0, "Angle by which blades lean from the vertical: the zenith distance of the noon Sun. "
        "Limited to what a height field can contain", "geometry", (0.0, 30.0))


class PitsSettings(Table, label="Pits", parent=LANDFORMS, turned_on_by="depth_m", shown=ABOVE_A_MAP, since="0.3"):
    """Pits with flat floors and steep walls, which grow sideways by sublimation."""

    __slots__ = ()
    depth_m: float = metres(
        "Depth", 0.0, 0.0, 100.0, (0.0, 2.0), "Depth of the floors below the ground; 0 for no pits", "geometry")
    diameter_m: float = metres(
        "Diameter", 2.0, 0.01, 1.0e4, (0.2, 20.0), "Mean diameter of a pit. They have from half to one and a half "
        "times that", "geometry")
    coverage: float = number(
        "Coverage", 0.3, 0.0, 0.8, (0.0, 0.7), "Share of the ground that is in pits. Above about 0.3 many grow "
        "together", "geometry")
    wall_deg: float = degrees("Wall Slope", 60.0, 10.0, 85.0, "Slope of the walls", "geometry")
    talus: float = number(
        "Talus", 0.0, 0.0, 0.5, (0.0, 0.5), "Mean height of the talus at the foot of the walls, as a share of the "
        "depth; 0 for none", "geometry")


class MantleSettings(Table, label="Mantle", parent=LANDFORMS, turned_on_by="thickness_m", shown=ABOVE_A_MAP):
    """Snow that fills hollows and smooths the ground."""

    __slots__ = ()
    thickness_m: float = metres(
        "Thickness", 0.0, 0.0, 1000.0, (0.0, 1.0), "Thickness of the snow in deep hollows; 0 for none. Raised ground "
        "keeps its shape", "geometry")
    length_m: float = metres(
        "Smoothing Length", 1.5, 1.0e-3, 1.0e5, (0.1, 10.0), "Wavelength below which the surface of the snow is smooth",
        "geometry")
    feather_m: float = metres(
        "Feather", 0.0, 0.0, 100.0, (0.0, 0.3), "Height over which the snow thins out: ground up to this far above the "
        "snow has a thin cover, and ground as far below shows through softened; 0 for none: the snow ends at an edge",
        "geometry", active=positive("thickness_m"), since="0.4")


class TalusSettings(Table, label="Talus", parent=LANDFORMS, turned_on_by="share", shown=PROCEDURAL, since="0.4"):
    """Ground that was too steep for its strength, and lies at rest below."""

    __slots__ = ()
    share: float = fraction(
        "Kept Share", 0.0, "Share of the ground that breaks off which lies below as talus; the rest is gone, as if it "
        "had sublimed. 1 keeps all of it, 0 is for ground that does not fail", "geometry")
    cohesion_pa: float = number(
        "Cohesion (Pa)", 50.0, 0.0, 1.0e8, (0.0, 1000.0), "Shear strength of the ground without load. With friction, "
        "density and gravity it decides how high faces of each slope stand; without it no slope is steeper than "
        "friction", "geometry", "Pa", precision=1)
    friction_deg: float = degrees(
        "Friction", 35.0, 5.0, 60.0, "Angle of internal friction of the ground, and angle of repose of talus",
        "geometry", (25.0, 45.0))
    density_kg_m3: float = number(
        "Density (kg/m³)", 600.0, 10.0, 2000.0, (100.0, 917.0), "Density of the ground", "geometry", "kg/m³",
        precision=0)
    gravity_m_s2: float = number(
        "Gravity (m/s²)", 0.0, 0.0, 100.0, (0.0, 2.0), "Gravity, which decides how high ground stands; 0 for the "
        "gravity of the moon", "geometry", "m/s²", zero="the moon's")
    weakness: float = fraction(
        "Weak Places", 0.5, "Share of the cohesion that the weakest places lack", "geometry",
        active=positive("cohesion_pa"))
    bulking: float = number(
        "Bulking", 1.4, 1.0, 3.0, (1.0, 2.0), "Volume of talus divided by its volume in the ground: the ratio of the "
        "two densities", "geometry")
    roughness: float = fraction(
        "Roughness", 0.5, "Height of the short waves of the ground on talus, as a share of their height elsewhere",
        "geometry")
