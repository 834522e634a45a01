"""The trench and the heap."""

from __future__ import annotations

from typing import Literal

from .declaration import ADVANCED, Section, Table, choice, degrees, fraction, metres, number, text
from .relevance import chosen, positive

DUG = ~chosen("path", "NONE")
WALLS = Section("walls", "Ground and Walls", "Strength of the ground, and standing or sliding walls", shown=DUG)
HEAP = Section("heap", "Heap", "Place and shape of the spoil", shown=DUG)
LAYERS = Section("layers", "Fresh Ground, Layers", "Albedo of ground that is dug open, and of its layers", shown=DUG)


class ExcavationSettings(Table, label="Excavation", inside="terrain", since="0.3"):
    """A trench that a scoop digs, and the heap beside it."""

    __slots__ = ()
    path: Literal["NONE", "LINE", "ARC", "RECORDED", "JOINTS"] = choice(
        "Scoop's Path", "NONE", "Path of the scoop's blade", "geometry",
        ("NONE", "None", "The ground is not dug"),
        ("LINE", "Line", "Straight and parallel to the ground, with upright ends, one bite deeper in each state"),
        ("ARC", "Arc", "The blade swings into the ground, goes along the line and swings out again"),
        ("RECORDED", "Recorded", "Positions of the blade from a CSV file"),
        ("JOINTS", "Recorded Joints", "Positions of the scoop's tip, computed from the arm's joint angles in a CSV "
         "file"))
    state: int = number(
        "State Shown", 2, 0, 99, (0, 7), "State of the excavation that is built: 0 is untouched ground. A sweep of it "
        "makes a series", "geometry", "states", shown=DUG)
    states: int = number(
        "Number of States", 3, 1, 100, (1, 12), "Number of states of the excavation, the untouched ground included. "
        "All of them have the same fine mesh", "geometry", "states", shown=DUG)
    file: str = text(
        "Recorded Path", "", "CSV file with the columns state (from 1), x_m, y_m (east and north of the origin) and "
        "depth_m (of the blade's edge below the plane of the untouched ground), or for recorded joints state, "
        "yaw_deg, shoulder_deg, elbow_deg, wrist_deg and roll_deg. // is the folder of the .blend file",
        "geometry", "read", subtype="FILE_PATH", shown=chosen("path", "RECORDED", "JOINTS"))
    start_x_m: float = metres(
        "Start East", 0.0, -1.0e4, 1.0e4, (-3.0, 3.0), "Distance of the blade's start east of the origin", "geometry",
        shown=chosen("path", "LINE", "ARC"))
    start_y_m: float = metres(
        "Start North", 2.0, -1.0e4, 1.0e4, (0.0, 4.0), "Distance of the blade's start north of the origin", "geometry",
        shown=chosen("path", "LINE", "ARC"))
    heading_deg: float = degrees(
        "Heading", 180.0, -360.0, 360.0, "Direction of the pull, from north (+Y) over east (+X)", "geometry",
        shown=chosen("path", "LINE", "ARC"))
    length_m: float = metres(
        "Length", 0.3, 0.0, 10.0, (0.0, 1.0), "Length of the pull at its full depth", "geometry",
        shown=chosen("path", "LINE", "ARC"))
    width_m: float = metres(
        "Blade Width", 0.08, 1.0e-3, 2.0, (0.02, 0.2), "Width of the blade", "geometry", shown=DUG)
    bite_m: float = metres(
        "Bite", 0.05, 0.0, 1.0, (0.0, 0.15),
        "Depth that the blade digs in each further state; 0 for no change between states",
        "geometry", shown=chosen("path", "LINE", "ARC"))
    radius_m: float = metres(
        "Arc Radius", 0.25, 0.01, 10.0, (0.05, 1.0), "Radius on which the blade swings", "geometry",
        shown=chosen("path", "ARC"))
    marks: float = fraction(
        "Scoop Marks", 0.0, "Depth of the grooves of the blade's six teeth, over the depth at which their flanks are "
        "as steep as friction holds them. A step twice as high ends each pass, which is as long as the blade is wide",
        "geometry", section=WALLS, since="0.4")
    cohesion_pa: float = number(
        "Cohesion (Pa)", 100.0, 0.0, 1.0e8, (0.0, 1000.0),
        "Shear strength of the ground without load; loose sand has 0. Cohesion, friction, density and gravity set "
        "a critical height: lower walls stand upright, higher walls slide to the angle of friction",
        "geometry", "Pa", precision=1, section=WALLS)
    friction_deg: float = degrees(
        "Friction", 38.0, 5.0, 60.0, "Angle of internal friction, and angle of repose of loose ground", "geometry",
        (25.0, 45.0), section=WALLS)
    density_kg_m3: float = number(
        "Density (kg/m³)", 500.0, 10.0, 2000.0, (100.0, 917.0), "Density of the ground", "geometry", "kg/m³",
        precision=0, section=WALLS)
    bulking: float = number(
        "Bulking", 1.4, 1.0, 3.0, (1.0, 2.0),
        "Volume of spoil divided by its volume in the ground: the ratio of the two densities", "geometry", section=HEAP)
    gravity_m_s2: float = number(
        "Gravity (m/s²)", 0.0, 0.0, 100.0, (0.0, 2.0),
        "Gravity, which decides whether walls stand; 0 for the gravity of the moon",
        "geometry", "m/s²", zero="the moon's", section=WALLS)
    chips_m: float = metres(
        "Chipped Rims", 5.0e-3, 0.0, 0.1, (0.0, 0.02), "Largest chip that breaks off the rims of walls that stand",
        "geometry", section=WALLS)
    slump: float = fraction(
        "Wall Slumps", 0.0, "Share of the cohesion that the weakest places of the walls lack. A wall breaks off above "
        "the height up to which it stands there, and lies as an apron at its foot", "geometry", section=WALLS,
        active=positive("cohesion_pa"), since="0.4")
    heaped_share: float = fraction(
        "Heaped Share", 1.0, "Share of the dug ground that is heaped beside the trench. The scoop keeps the rest",
        "geometry", section=HEAP)
    heap_side: Literal["LEFT", "RIGHT"] = choice("Heap", "RIGHT", "Side of the heap, seen along the pull", "geometry",
        ("LEFT", "Left", "Left of the trench"),
        ("RIGHT", "Right", "Right of the trench"),
        section=HEAP)
    heap_gap_m: float = metres(
        "Heap Gap", 0.05, 0.0, 10.0, (0.0, 0.3), "Distance from the trench to the foot of the heap in the last state",
        "geometry", section=HEAP)
    clods_m: float = metres(
        "Clods", 0.0, 0.0, 0.05, (0.0, 0.02), "Height of the clods on spoil, or width of the largest if they have "
        "many sizes; 0 for none", "geometry", section=HEAP)
    clod_sizes: Literal["ONE", "MANY"] = choice(
        "Clod Sizes", "ONE", "Whether clods are of one size or of many", "geometry",
        ("ONE", "One Size", "Lumps of one size in the surface of the heap"),
        ("MANY", "Many Sizes", "Single clods, a few large and many small, each where it came to rest: large clods "
         "have rolled to the foot of the heap and beyond"),
        section=HEAP, active=positive("clods_m"))
    sorting: float = fraction(
        "Sorting", 0.0, "Share of the clods of many sizes that rolled down the heap, the larger the "
        "farther; the rest of the heap is fine", "geometry", section=HEAP,
        active=positive("clods_m") & chosen("clod_sizes", "MANY"), since="0.4")
    dust_share: float = fraction(
        "Dust", 0.0, "Share of the heaped ground that is dust. It rebounds where it lands and lies as an apron round "
        "the heap", "geometry", section=HEAP, since="0.4")
    drop_m: float = metres(
        "Drop Height", 0.2, 1.0e-3, 2.0, (0.05, 0.5), "Height from which the scoop drops spoil. The jumps of dust are "
        "half as long on average, on any moon", "geometry", section=HEAP, active=positive("dust_share"), since="0.4")
    cell_m: float = metres(
        "Cell Size", 2.5e-3, 2.0e-4, 0.1, (1.0e-3, 0.01), "Distance between the vertices of trench and heap",
        "geometry", section=ADVANCED, shown=DUG)
    fresh_albedo: float = fraction(
        "Fresh Albedo", 1.0, "Albedo of ground that was dug open, and of spoil, relative to the surface", "material",
        section=LAYERS)
    layer_thickness_m: float = metres(
        "Layer Thickness", 0.0, 0.0, 10.0, (0.0, 0.05), "Thickness of layers of another albedo in the ground, "
        "parallel to its surface; 0 for none", "material", section=LAYERS)
    layer_depth_m: float = metres(
        "Layer Depth", 0.03, 0.0, 10.0, (0.0, 0.3), "Depth of the top of the first layer below the untouched surface",
        "material", section=LAYERS, active=positive("layer_thickness_m"))
    layer_spacing_m: float = metres(
        "Layer Spacing", 0.0, 0.0, 10.0, (0.0, 0.2),
        "Distance between the tops of neighbouring layers; 0 for a single layer",
        "material", section=LAYERS, active=positive("layer_thickness_m"))
    layer_albedo: float = fraction(
        "Layer Albedo", 0.6, "Albedo of the layers relative to the surface", "material", section=LAYERS,
        active=positive("layer_thickness_m"))
    jitter_m: float = metres(
        "Camera Jitter", 0.0, 0.0, 1.0, (0.0, 0.01), "Standard deviation of the camera's position, on each axis, from "
        "state to state", "camera", section=ADVANCED, shown=DUG)
    jitter_deg: float = degrees(
        "Camera Turn", 0.0, 0.0, 10.0, "Standard deviation of the camera's heading and of its pitch, from state to "
        "state", "camera", (0.0, 0.5), 3, section=ADVANCED, shown=DUG)
