"""The lander, its arm and the ground in its reach."""

from __future__ import annotations

from typing import Literal

from .declaration import Section, Table, choice, degrees, fraction, metres, text, tick
from .relevance import chosen, positive

THERE = ~chosen("lander.kind", "NONE")
OURS = THERE & ~chosen("lander.kind", "OWN")
BODY_SIZES = Section("body", "Deck and Legs", "Sizes of the lander, and frost on it", shown=~chosen("kind", "NONE"))
JOINT_FAULTS = Section("faults", "Faults", "Difference of each joint's real angle from the commanded angle", shown=OURS)
JOINT_LIMITS = Section("limits", "Limits", "Angles between which each joint can turn", shown=OURS)
ARM_SIZES = Section("sizes", "Sizes", "Lengths of the arm, and its scoop", shown=OURS)


class LanderSettings(Table, label="Lander", since="0.3"):
    """A lander whose mast carries the cameras, with an arm in front of them."""

    __slots__ = ()
    kind: Literal["NONE", "PARAMETRIC", "OWN"] = choice("Lander", "NONE", "The lander in the picture", "lander",
        ("NONE", "None", "No lander"),
        ("PARAMETRIC", "Built-in Lander", "Deck, two legs, mast and arm with the sizes below"),
        ("OWN", "Own Arm", "Deck, two legs and mast as for Built-in Lander, with an arm from a URDF file"))
    file: str = text(
        "Arm's File", "", "URDF file of your own arm, with meshes as STL, OBJ or Collada beside it. Its first link "
        "stands at the place of the shoulder. // is the folder of the .blend file", "lander", "read",
        subtype="FILE_PATH", shown=chosen("kind", "OWN"))
    joints: str = text(
        "Joints", "", "Values of your arm's joints, as name=value separated by spaces, in degrees, or in metres for a "
        "sliding joint. A joint that is not named is at 0", "lander", "name", shown=chosen("kind", "OWN"))
    turn_deg: float = degrees(
        "Turn of the Deck", 0.0, -180.0, 180.0, "Direction of the lander to the right of the rig's heading", "lander",
        section=BODY_SIZES)
    deck_front_m: float = metres(
        "Deck Front", 0.4, 0.15, 5.0, (0.2, 1.0), "Distance of the deck's front edge ahead of the mast", "lander",
        section=BODY_SIZES)
    deck_width_m: float = metres(
        "Deck Width", 1.3, 0.2, 10.0, (0.5, 3.0), "Width of the deck at its front edge", "lander", section=BODY_SIZES)
    deck_height_m: float = metres(
        "Deck Height", 0.6, 0.15, 10.0, (0.3, 2.0), "Height of the deck's top above the ground under the mast",
        "lander", section=BODY_SIZES)
    pad_ahead_m: float = metres(
        "Pads Ahead", 1.05, 0.1, 10.0, (0.3, 3.0), "Distance of the two pads ahead of the mast", "lander",
        section=BODY_SIZES)
    pad_apart_m: float = metres(
        "Pads Apart", 2.0, 0.2, 20.0, (0.5, 5.0), "Distance between the centres of the two pads", "lander",
        section=BODY_SIZES)
    pad_diameter_m: float = metres(
        "Pad Diameter", 0.32, 0.05, 5.0, (0.1, 1.0), "Diameter of a pad", "lander", section=BODY_SIZES)
    pad_sink_m: float = metres(
        "Pad Sinkage", 0.02, 0.0, 1.0, (0.0, 0.1), "Depth to which each pad is pressed into the ground under its "
        "centre", "lander", section=BODY_SIZES)
    frost_share: float = fraction(
        "Frost Share", 0.1, "Share of upward surfaces of the lander that frost covers, in patches", "lander",
        section=BODY_SIZES)


class ArmSettings(Table, label="Arm", inside="lander", since="0.3"):
    """The lander's arm: angles of its joints, their faults and limits, and its sizes."""

    __slots__ = ()
    yaw_deg: float = degrees(
        "Yaw", 30.0, -360.0, 360.0, "Commanded turn of the whole arm to the left", "lander", (-180.0, 180.0),
        shown=OURS)
    shoulder_deg: float = degrees(
        "Shoulder", 30.0, -360.0, 360.0, "Commanded angle of the upper arm above the horizontal", "lander",
        (-180.0, 180.0), shown=OURS)
    elbow_deg: float = degrees(
        "Elbow", -75.0, -360.0, 360.0, "Commanded angle of the forearm upward from the line of the upper arm", "lander",
        (-180.0, 180.0), shown=OURS)
    wrist_deg: float = degrees(
        "Wrist", -45.0, -360.0, 360.0, "Commanded angle of the hand upward from the line of the forearm", "lander",
        (-180.0, 180.0), shown=OURS)
    roll_deg: float = degrees(
        "Roll", 0.0, -360.0, 360.0, "Commanded turn of the scoop about the line of the hand", "lander", (-180.0, 180.0),
        shown=OURS)
    yaw_offset_deg: float = degrees(
        "Yaw Fault", 0.0, -90.0, 90.0, "Fault of the joint yaw: its real angle is the commanded angle plus this",
        "lander", (-5.0, 5.0), 3, section=JOINT_FAULTS)
    shoulder_offset_deg: float = degrees(
        "Shoulder Fault", 0.0, -90.0, 90.0, "Fault of the joint shoulder: its real angle is the commanded angle plus "
        "this", "lander", (-5.0, 5.0), 3, section=JOINT_FAULTS)
    elbow_offset_deg: float = degrees(
        "Elbow Fault", 0.0, -90.0, 90.0, "Fault of the joint elbow: its real angle is the commanded angle plus this",
        "lander", (-5.0, 5.0), 3, section=JOINT_FAULTS)
    wrist_offset_deg: float = degrees(
        "Wrist Fault", 0.0, -90.0, 90.0, "Fault of the joint wrist: its real angle is the commanded angle plus this",
        "lander", (-5.0, 5.0), 3, section=JOINT_FAULTS)
    roll_offset_deg: float = degrees(
        "Roll Fault", 0.0, -90.0, 90.0, "Fault of the joint roll: its real angle is the commanded angle plus this",
        "lander", (-5.0, 5.0), 3, section=JOINT_FAULTS)
    yaw_low_deg: float = degrees(
        "Yaw Lowest", -105.0, -360.0, 360.0, "Lowest angle of the joint yaw", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    yaw_high_deg: float = degrees(
        "Yaw Highest", 105.0, -360.0, 360.0, "Highest angle of the joint yaw", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    shoulder_low_deg: float = degrees(
        "Shoulder Lowest", -30.0, -360.0, 360.0, "Lowest angle of the joint shoulder", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    shoulder_high_deg: float = degrees(
        "Shoulder Highest", 120.0, -360.0, 360.0, "Highest angle of the joint shoulder", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    elbow_low_deg: float = degrees(
        "Elbow Lowest", -165.0, -360.0, 360.0, "Lowest angle of the joint elbow", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    elbow_high_deg: float = degrees(
        "Elbow Highest", 165.0, -360.0, 360.0, "Highest angle of the joint elbow", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    wrist_low_deg: float = degrees(
        "Wrist Lowest", -150.0, -360.0, 360.0, "Lowest angle of the joint wrist", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    wrist_high_deg: float = degrees(
        "Wrist Highest", 150.0, -360.0, 360.0, "Highest angle of the joint wrist", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    roll_low_deg: float = degrees(
        "Roll Lowest", -180.0, -360.0, 360.0, "Lowest angle of the joint roll", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    roll_high_deg: float = degrees(
        "Roll Highest", 180.0, -360.0, 360.0, "Highest angle of the joint roll", "lander", (-180.0, 180.0),
        section=JOINT_LIMITS)
    shoulder_x_m: float = metres(
        "Shoulder Ahead", 0.8, -5.0, 5.0, (0.0, 2.0), "Distance of the yaw axis ahead of the mast", "lander",
        shown=THERE)
    shoulder_y_m: float = metres(
        "Shoulder Left", 0.0, -5.0, 5.0, (-1.0, 1.0), "Distance of the yaw axis left of the mast", "lander",
        shown=THERE)
    shoulder_z_m: float = metres(
        "Shoulder Height", 0.6, 0.1, 10.0, (0.3, 2.0), "Height of the shoulder's axis above the ground under the mast",
        "lander", shown=THERE)
    offset_m: float = metres(
        "Shoulder Offset", 0.1, 0.0, 2.0, (0.0, 0.3), "Distance of the shoulder's axis from the yaw axis", "lander",
        section=ARM_SIZES)
    upper_m: float = metres(
        "Upper Arm", 1.0, 0.1, 10.0, (0.3, 2.0), "Length from shoulder to elbow", "lander", section=ARM_SIZES)
    fore_m: float = metres(
        "Forearm", 0.9, 0.1, 10.0, (0.3, 2.0), "Length from elbow to wrist", "lander", section=ARM_SIZES)
    hand_m: float = metres(
        "Hand", 0.15, 0.03, 2.0, (0.05, 0.5), "Length from wrist to scoop", "lander", section=ARM_SIZES)
    scoop_length_m: float = metres(
        "Scoop Length", 0.1, 0.01, 2.0, (0.03, 0.3), "Length of the scoop", "lander", section=ARM_SIZES)
    scoop_width_m: float = metres(
        "Scoop Width", 0.08, 0.01, 2.0, (0.03, 0.3), "Width of the scoop", "lander", section=ARM_SIZES)
    scoop_depth_m: float = metres(
        "Scoop Depth", 0.06, 0.01, 2.0, (0.02, 0.2), "Depth of the scoop", "lander", section=ARM_SIZES)


class WorkspaceSettings(Table, label="Workspace", inside="lander", turned_on_by="cell_m", since="0.3"):
    """Ground in reach of an arm, with its exact heights."""

    __slots__ = ()
    cell_m: float = metres(
        "Cell Size", 0.0, 0.0, 1.0, (0.0, 0.05), "Side of a cell of the true elevation model that is written with each "
        "pair; 0 writes none", "sampling", zero="off")
    east_m: float = metres(
        "Centre East", 0.0, -5.0e4, 5.0e4, (-5.0, 5.0), "East coordinate of the centre of the workspace", "sampling")
    north_m: float = metres(
        "Centre North", 1.6, -5.0e4, 5.0e4, (-5.0, 5.0), "North coordinate of the centre of the workspace", "sampling")
    size_m: float = metres(
        "Size", 2.0, 0.01, 100.0, (0.2, 5.0), "Side of the workspace, which is a square", "sampling")
    materials: bool = tick(
        "Albedo and Salts", False, "Also write the true albedo and share of salt of each cell, for the rules that "
        "choose sites. A pair takes some seconds more", "sampling", active=positive("cell_m"))
