"""The pulls of a scoop that each state of an excavation adds: along a line, along an arc, or as recorded."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...settings.topics.excavation import ExcavationSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import read_number_lines
from ...support.files import absolute_path
from .scoop_cut import Pull

NONE, LINE, ARC, RECORDED, JOINTS = "NONE", "LINE", "ARC", "RECORDED", "JOINTS"
#: Columns that a recorded path must have.
PATH_COLUMNS = ("state", "x_m", "y_m", "depth_m")
#: Maximum number of places of a recorded path.
MAX_PLACES = 20_000
#: Largest distance of a place from the origin, in metres.
_FARTHEST_M = 1.0e4
#: Largest depth of a place, in metres.
_DEEPEST_M = 100.0
#: Number of points of an arc; straight lines between them stay within 1e-5 of its radius.
_ARC_POINTS = 181


def make_pulls(excavation: ExcavationSettings) -> list[list[Pull]]:
    """Make the pulls of each state after the first, in which the ground is untouched.

    Raises IcyMoonError if a recorded path cannot be read.
    """
    if excavation.path == RECORDED:
        return _read_recorded_pulls(excavation)
    return [[_make_pull(excavation, k * excavation.bite_m)] for k in range(1, int(excavation.states))]


def _make_pull(excavation: ExcavationSettings, depth_m: float) -> Pull:
    """Make the pull to a depth in metres. On an arc the blade swings into the ground, follows the line, and swings
    out.
    """
    length = float(excavation.length_m)
    along, depth = np.array([0.0, length]), np.array([depth_m, depth_m])
    if excavation.path == ARC:
        radius = float(excavation.radius_m)
        deepest = min(depth_m, radius)  # beyond, an arc would cut under the ground
        half = math.acos(1.0 - deepest / radius)
        turn = np.linspace(0.0, half, _ARC_POINTS)
        out, rise = radius * np.sin(turn), radius * (1.0 - np.cos(turn))
        along = np.concatenate([-out[::-1], length + out])
        depth = depth_m - np.concatenate([rise[::-1], rise])
    return Pull(excavation.start_x_m, excavation.start_y_m, excavation.heading_deg, excavation.width_m, along, depth)


def _read_recorded_pulls(excavation: ExcavationSettings) -> list[list[Pull]]:
    """Read the straight pulls between the recorded places of the blade's middle, by state."""
    path = absolute_path(excavation.file, "excavation.file")
    table = read_path(path)
    states = int(excavation.states)
    if (beyond := table[:, 0].max()) >= states:
        raise IcyMoonError(
            f"{path}: has a state {beyond:g}, but excavation.states is {states}, so the last state is "
            f"{states - 1}; raise excavation.states."
        )
    made: list[list[Pull]] = []
    for state in range(1, states):
        points = table[table[:, 0] == state, 1:]
        made.append(make_pulls_through(points, float(excavation.width_m)))
    if not any(made):
        raise IcyMoonError(f"{path}: has no state from 1 with two places that differ; give the path of the blade.")
    return made


def make_pull_between(a: Array, b: Array, width_m: float) -> Pull | None:
    """Make the straight pull between two positions (east, north, depth) in metres; None for a vertical move."""
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    if length == 0.0:
        return None
    heading = math.degrees(math.atan2(b[0] - a[0], b[1] - a[1]))
    return Pull(float(a[0]), float(a[1]), heading, width_m, np.array([0.0, length]), np.array([a[2], b[2]]))


def make_pulls_through(points: Iterable[Array], width_m: float) -> list[Pull]:
    """Make straight pulls through positions (east, north, depth) in metres; coinciding positions make no pull."""
    pulls: list[Pull] = []
    for a, b in itertools.pairwise(points):
        if (pull := make_pull_between(a, b, width_m)) is not None:
            pulls.append(_turn_blade(pull, pulls[-1]) if pulls else pull)
    return pulls


def _turn_blade(pull: Pull, before: Pull) -> Pull:
    """Add to a pull the blade's rotation from the heading of the pull ``before`` it. A rotation of a right angle or
    more is left out, because the blade is then more likely lifted and set down again.
    """
    turn = math.radians(pull.heading_deg - before.heading_deg)
    return replace(pull, from_deg=before.heading_deg) if math.cos(turn) > 1e-9 else pull


def read_path(path: Path) -> Array:
    """Read state, east, north and depth (n, 4) of a CSV file, in metres; depth is below the plane of the untouched
    ground. The first line names the columns; only ``PATH_COLUMNS`` are read. Raises IcyMoonError for a missing file,
    column or number, for a number out of range, and for too many lines.
    """
    rows = []
    for number, row in read_number_lines(path, PATH_COLUMNS, "excavation.file", MAX_PLACES):
        if row is None or not all(map(math.isfinite, row)) or row[0] < 1 or row[0] != int(row[0]):
            raise IcyMoonError(
                f"{path}: line {number} is not a place of the blade; give a whole state from 1, and "
                "x_m, y_m and depth_m in metres."
            )
        if max(abs(row[1]), abs(row[2])) > _FARTHEST_M or abs(row[3]) > _DEEPEST_M:
            raise IcyMoonError(
                f"{path}: line {number} is more than {_FARTHEST_M:g} m from the origin, or more than "
                f"{_DEEPEST_M:g} m deep; give metres."
            )
        rows.append(row)
    if not rows:
        raise IcyMoonError(f"{path}: has no line of numbers; give the path of the blade.")
    return np.array(rows)
