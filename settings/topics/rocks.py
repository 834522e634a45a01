"""Rocks on the ground."""

from __future__ import annotations

from typing import Literal

from .declaration import (
    ADVANCED,
    ELSEWHERE,
    Section,
    Table,
    choice,
    degrees,
    fraction,
    mask_file,
    metres,
    number,
    text,
    tick,
)
from .ground import GRADED, PROCEDURAL
from .relevance import chosen, positive, ticked

SHAPE = Section("shape", "Shape", "Shape, tilt and burial of each rock")
PLACE = Section("place", "Placement", "Clusters, clear ground, rocks beyond the patch and maximum number")
DEBRIS = Section("debris", "Debris", "Fragments around each rock")
REST = Section("rest", "At Rest", "Rocks that have rolled down slopes and lie in contact with the ground")
SKIRTS = Section("skirts", "Skirts", "Loose material at the feet of rocks", shown=PROCEDURAL)


class RocksSettings(Table, label="Rocks", turned_on_by="coverage"):
    """Rocks on the ground."""

    __slots__ = ()
    law: Literal["POWER", "GOLOMBEK", "TABLE"] = choice(
        "Size Law", "POWER", "Distribution of the sizes of rocks", "geometry",
        ("POWER", "Power Law", "N(>D) ~ D^-index, as fitted to block counts on Enceladus"),
        ("GOLOMBEK", "Golombek", "Covered share k exp(-q D), q = 1.79 + 0.152/k per m, k the coverage: fitted to "
         "rocks on Mars, an analogue"),
        ("TABLE", "From a Table", "Positions and diameters from the file below. Coverage above 0 turns rocks on; "
         "sizes and clusters have no effect"),
        section=ADVANCED)
    file: str = text(
        "Table of Rocks", "", "CSV file with the columns x_m, y_m (east and north of the origin) and diameter_m. // "
        "is the folder of the .blend file", "geometry", "read", subtype="FILE_PATH",
        section=ADVANCED, shown=chosen("law", "TABLE"), since="0.3")
    coverage: float = fraction(
        "Coverage", 0.0, "Share of the ground under rocks, counting overlaps twice; 0 for none. Golombek's law counts "
        "rocks of all sizes, also those that are not made", "geometry", high=0.5)
    smallest_m: float = metres(
        "Smallest", 0.1, 1.0e-3, 100.0, (0.02, 1.0), "Diameter of the smallest rocks", "geometry",
        shown=chosen("law", "POWER", "GOLOMBEK"))
    largest_m: float = metres(
        "Largest", 0.8, 1.0e-3, 100.0, (0.05, 5.0), "Diameter of the largest rocks", "geometry",
        shown=chosen("law", "POWER", "GOLOMBEK"))
    power_index: float = number(
        "Size Index", 3.0, 0.5, 6.0, (1.0, 5.0), "Exponent of the cumulative power law N(>D) ~ D^-index. A higher "
        "index gives more small rocks", "geometry", section=ADVANCED, shown=chosen("law", "POWER"))
    family: Literal["MIXED", "FRAGMENTS", "BOULDERS", "SLABS", "BROKEN_ICE", "OWN"] = choice(
        "Shapes", "MIXED", "Kind of shape of the rocks", "geometry",
        ("MIXED", "Mixed", "Fragments, boulders and slabs in equal numbers"),
        ("FRAGMENTS", "Fragments", "Broken polyhedra"),
        ("BOULDERS", "Boulders", "Worn and lumpy"),
        ("SLABS", "Slabs", "Flat plates with broken sides"),
        ("BROKEN_ICE", "Broken Ice", "Cleaved rocks with stepped faces and chipped corners"),
        ("OWN", "Own Mesh", "Your mesh, stretched and rotated differently for each rock"),
        section=SHAPE)
    shape_file: str = text(
        "Rock's Mesh", "", "STL or OBJ file of a closed mesh, z up: the shape of all rocks, in any size. // is the "
        "folder of the .blend file", "geometry", "read", subtype="FILE_PATH", section=SHAPE,
        shown=chosen("family", "OWN"), since="0.4")
    angularity: float = fraction(
        "Angularity", 0.7, "0 for worn, round rocks, 1 for fresh fragments with sharp edges. Boulders are always half "
        "worn", "geometry", section=SHAPE, shown=~chosen("family", "OWN"))
    elongation: float = number(
        "Elongation", 1.4, 1.0, 5.0, (1.0, 3.0), "Median of a rock's length divided by its width, seen from above",
        "geometry", section=SHAPE)
    height_ratio: float = number(
        "Height over Width", 0.6, 0.05, 3.0, (0.2, 1.5), "Median of a rock's height divided by its mean width. Slabs "
        "have 0.45 times this ratio", "geometry", section=SHAPE)
    tilt_deg: float = degrees(
        "Tilt", 15.0, 0.0, 180.0, "RMS tilt of rocks against the ground, about each of two axes", "geometry",
        (0.0, 60.0), section=SHAPE)
    burial: float = fraction(
        "Burial", 0.25, "Mean share of a rock's height that is below the ground", "geometry", high=0.9, section=SHAPE)
    clustering: float = fraction(
        "Clustering", 0.0, "Share of the rocks that are in clusters. The others lie at random", "geometry",
        section=PLACE, shown=chosen("law", "POWER", "GOLOMBEK"))
    cluster_blocks: float = number(
        "Rocks per Cluster", 20.0, 1.0, 1.0e5, (2.0, 200.0), "Mean number of rocks in a cluster", "geometry", "rocks",
        section=PLACE, shown=chosen("law", "POWER", "GOLOMBEK"), active=positive("clustering"))
    cluster_radius_m: float = metres(
        "Cluster Radius", 1.0, 1.0e-3, 1.0e4, (0.1, 10.0), "Standard deviation of the distances of rocks, east and "
        "north, from the centre of their cluster", "geometry", section=PLACE, shown=chosen("law", "POWER", "GOLOMBEK"),
        active=positive("clustering"))
    clear_radius_m: float = metres(
        "Clear Radius", 0.0, 0.0, 1.0e4, (0.0, 5.0), "Radius of the area without rocks around the camera's site, such "
        "as for a lander", "geometry", section=PLACE)
    most: int = number(
        "Maximum Rocks", 20000, 0, 200000, (0, 50000), "Maximum number of rocks. Above it the smallest rocks are left "
        "out, with a warning", "geometry", "rocks", section=PLACE)
    beyond_px: float = number(
        "Smallest Distant Rock", 0.0, 0.0, 1000.0, (0.0, 10.0), "Least width in the image of rocks beyond the patch, "
        "out to the horizon; 0 for no rocks there. The maximum number of rocks applies to them separately", "geometry",
        "px", subtype="PIXEL", section=PLACE, shown=GRADED & ~chosen("law", "TABLE"),
        since="0.3")
    beyond_largest: float = number(
        "Largest Distant Rock", 1.0, 1.0, 100.0, (1.0, 20.0), "Diameter of the largest rocks beyond the patch over "
        "that of the largest ones on it. The law of sizes goes on there, with rocks that a site for a lander does not "
        "have", "geometry", "x", section=PLACE, shown=GRADED & ~chosen("law", "TABLE"), active=positive("beyond_px"),
        since="0.4")
    mask_file: str = mask_file(
        "rocks lie", "geometry", section=PLACE, shown=chosen("law", "POWER", "GOLOMBEK"), since="0.4")
    low_ground_m: float = metres(
        "Low Ground", 0.0, 0.0, 1000.0, (0.0, 10.0), "Rocks and fragments lie only where the ground is lower than its "
        "mean height within this radius, and slopes hold them, as between plates; 0 for rocks anywhere", "geometry",
        zero="all", section=PLACE, since="0.4")
    at_rest: bool = tick(
        "At Rest", False, "Let rocks roll down slopes that do not hold them, settle on three points of the ground, and "
        "lie beside each other. Otherwise each lies where it was drawn, along the slope there", "geometry",
        section=REST, since="0.4")
    rolling_deg: float = degrees(
        "Rolling Slope", 25.0, 1.0, 60.0, "Steepest slope that holds a rock, over its footprint", "geometry",
        (15.0, 40.0), section=REST, active=ticked("at_rest") | positive("low_ground_m"), since="0.4")
    skirt: float = fraction(
        "Height", 0.0, "Height of the loose material around each rock at its outline, as a share of the height of the "
        "rock above the ground; 0 for none", "geometry", high=0.5, section=SKIRTS, since="0.4")
    skirt_repose_deg: float = degrees(
        "Angle of Repose", 35.0, 5.0, 60.0, "Largest slope of the skirts against the ground. Angular grains rest at "
        "about 40, rounded ones at 25, at 0.1 g as at 1 g; grains that sinter rest more steeply", "geometry",
        (20.0, 45.0), section=SKIRTS, active=positive("skirt"), since="0.4")
    skirt_drift: float = number(
        "Drift", 1.0, 1.0, 10.0, (1.0, 5.0), "Length of a skirt behind its rock over its width beside the rock, as "
        "for a drift; 1 for skirts that are equally wide all around", "geometry", section=SKIRTS,
        active=positive("skirt"), since="0.4")
    skirt_azimuth_deg: float = degrees(
        "Drift's Origin", 0.0, -360.0, 360.0, "Direction from which the material came, from north (+Y) over east "
        "(+X). Drifts lie on the other side of each rock", "geometry", section=SKIRTS, active=positive("skirt"),
        since="0.4")
    debris: float = fraction(
        "Share", 0.0, "Volume of the fragments around each rock as a share of the volume of the rock, if all have one "
        "shape; 0 for none", "geometry", high=0.5, section=DEBRIS, since="0.4")
    debris_smallest_m: float = metres(
        "Smallest Fragment", 0.02, 1.0e-3, 10.0, (0.005, 0.2), "Diameter of the smallest fragments. The largest ones "
        "have 0.3 times the diameter of their rock", "geometry", section=DEBRIS, active=positive("debris"),
        since="0.4")
    debris_index: float = number(
        "Fragment Index", 2.5, 0.5, 6.0, (1.5, 3.5), "Exponent of the cumulative power law N(>d) ~ d^-index of the "
        "fragments of a rock. Broken rocks have about 2.5", "geometry", section=DEBRIS, active=positive("debris"),
        since="0.4")
    debris_reach: float = number(
        "Reach", 1.0, 0.0, 10.0, (0.2, 3.0), "Mean distance of the coarsest fragments from the outline of their rock "
        "over half the diameter of the rock. Fines stay closer", "geometry", section=DEBRIS,
        active=positive("debris"), since="0.4")
    debris_most: int = number(
        "Maximum Fragments", 100000, 0, 1000000, (0, 200000), "Maximum number of fragments on the patch, and again "
        "beyond it. Above it the smallest ones are left out, with a warning", "geometry", "rocks", section=DEBRIS,
        active=positive("debris"), since="0.4")
    own_surface: bool = tick(
        "Own Surface", False, "Make rocks from the settings of Rock Ice instead of the ground's", "material",
        section=ELSEWHERE)
