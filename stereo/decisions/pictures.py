"""Maps of decisions as pictures, north up."""

from __future__ import annotations

import cv2
import numpy as np

from ...support.arrays import Array
from .dug_volume import Detection
from .workspace import DecisionMaps, Workspace

#: Outcomes of a cell: name and RGB colour, distinct for colour-blind eyes.
OUTCOMES = (
    ("safe and taken for safe", (0, 158, 115)),
    ("unsafe, but classified as safe", (213, 60, 0)),
    ("safe, but lost", (240, 200, 66)),
    ("unsafe and known as that", (111, 127, 143)),
    ("out of reach or beyond the map", (205, 211, 218)),
)
#: Names and BGR colours of the cells of a single map: safe, or the first rule that fails.
RULE_COLOURS = (
    ("safe", (0, 158, 115)),
    ("not known", (60, 66, 74)),
    ("too steep", (192, 105, 160)),
    ("too rough", (213, 94, 0)),
    ("a rock too near", (120, 70, 40)),
    ("out of reach", (205, 211, 218)),
    ("in shadow", (42, 90, 160)),
    ("too dark", (86, 58, 110)),
    ("too bright", (240, 228, 66)),
    ("too little salt", (150, 190, 120)),
)
#: Height error, m, with the saturated colour: from blue (too low) over white to red (too high).
SATURATED_ERROR_M = 0.05
_LOW, _RIGHT, _HIGH, _UNKNOWN = (0x2B, 0x5F, 0xC4), (0xF4, 0xF4, 0xF4), (0xC4, 0x2B, 0x2B), (150, 150, 150)
#: Approximate side of a picture, px.
_SIDE_PX = 360


def draw_outcomes(workspace: Workspace, found: DecisionMaps) -> Array:
    """Draw a BGR picture of the outcome of each cell, with one colour for each of ``OUTCOMES``."""
    safe, taken = workspace.truth.sites.safe, found.sites.safe
    code = np.select([~(workspace.reached & workspace.truth.dem.known), safe & taken, taken, safe], [4, 0, 1, 2], 3)
    return _enlarge(_colour_classes(code, OUTCOMES))


def draw_failed_rules(maps: DecisionMaps, inside: Array) -> Array:
    """Draw a BGR picture of the safe cells and of the first failed rule of the others.

    Cells outside ``inside`` count as out of reach.
    """
    return _enlarge(_colour_classes(np.where(inside, maps.sites.failed, 5), RULE_COLOURS))


def draw_height_errors(workspace: Workspace, found: DecisionMaps) -> Array:
    """Draw a BGR picture of the height error of each cell: red too high, blue too low, grey unknown."""
    return _draw_signed(found.dem.height_m - workspace.truth.dem.height_m)


def draw_changes(found: Detection) -> Array:
    """Draw a BGR picture of the cells that changed beyond their level of detection.

    Blue cells are lower than before, red ones higher, white ones unchanged and grey ones unknown.
    """
    risen = -np.where(found.significant | np.isnan(found.changed_m), found.changed_m, 0.0)
    return _draw_signed(risen)


def _draw_signed(metres: Array) -> Array:
    amount = np.clip(np.abs(np.nan_to_num(metres)) / SATURATED_ERROR_M, 0, 1)[..., None]
    end = np.where((np.nan_to_num(metres) > 0)[..., None], _HIGH, _LOW)
    rgb = np.rint(_RIGHT + amount * (end - np.array(_RIGHT)))
    return _enlarge(np.where(np.isnan(metres)[..., None], _UNKNOWN, rgb).astype(np.uint8)[..., ::-1])


def add_ring(picture: Array, place: list[int] | None, shape: tuple[int, ...], disc_m: float, cell_m: float) -> Array:
    """Return the picture with a ring around the site at ``place`` (row, column) of a map of this ``shape``.

    Without a site, the picture is unchanged.
    """
    if place is None:
        return picture
    scale = picture.shape[0] / shape[0]
    centre = round((place[1] + 0.5) * scale), round((place[0] + 0.5) * scale)
    radius = max(4, round(disc_m / 2 / cell_m * scale))
    ringed = picture.copy()
    for colour, width in (((255, 255, 255), 5), ((20, 20, 20), 2)):
        cv2.circle(ringed, centre, radius, colour, width, cv2.LINE_AA)
    return ringed


def _colour_classes(code: Array, classes: tuple[tuple[str, tuple[int, int, int]], ...]) -> Array:
    return np.array([rgb[::-1] for _, rgb in classes], np.uint8)[code]


def _enlarge(picture: Array) -> Array:
    factor = max(1, _SIDE_PX // max(picture.shape[:2]))
    return np.repeat(np.repeat(picture, factor, axis=0), factor, axis=1)
