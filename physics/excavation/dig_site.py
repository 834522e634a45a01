"""The site of an excavation: the grid that holds trench and heap in every state, refusals and advice."""

from __future__ import annotations

import functools
import json
import math
from dataclasses import dataclass, replace

from ...settings.topics.excavation import ExcavationSettings
from ...settings.topics.scene import Settings, typed
from ...support.errors import IcyMoonError
from ...support.files import absolute_path
from ..arm.lander_arm import is_users_arm
from ..gravity.standing_slopes import critical_height_m, find_gravity_m_s2
from .dig_grid import ExcavationGrid, make_covering_grid
from .dust_apron import find_reach_m
from .heap import SpoilHeap, ridge_height_m
from .joint_paths import make_joint_pulls
from .scoop_cut import Pull, find_bounds_m
from .scoop_marks import TEETH, ScoopMarks, make_marks
from .scoop_paths import ARC, JOINTS, LINE, NONE, RECORDED, make_pulls
from .wall_slump import find_retreat_m

REFUSED_FILE = "Ground from a file cannot be dug; set source.kind to PROCEDURAL, or excavation.path to NONE."
#: Maximum number of vertices along a side of the grid.
MAX_GRID_SIDE = 1500
#: Margin of the grid around trench and heap, in metres,
_MARGIN_M = 0.03
#: and in cells.
_MARGIN_CELLS = 4
#: Least width of a blade in cells; a narrower blade digs a crude trench.
_FEWEST_CELLS_ACROSS = 8
#: Least distance in cells between the grooves of two teeth.
_FEWEST_CELLS_PER_GROOVE = 4


def is_dug(settings: Settings) -> bool:
    """Return whether the ground has an excavation, even if this state is the untouched ground."""
    return settings.excavation.path != NONE


def gravity_m_s2(settings: Settings) -> float:
    """Return gravity in m/s² from the settings, else from their moon. Raises IcyMoonError if it is unknown."""
    return find_gravity_m_s2(
        float(settings.excavation.gravity_m_s2), str(settings.light.body), "excavation.gravity_m_s2"
    )


@dataclass(frozen=True)
class ExcavationSite:
    """The pulls of each state after the first, the heap, the grid, and the greatest height ``stands_m`` of a standing
    wall. ``trench_m`` are the west, south, east and north limits of the trench in its last state. ``deepest_m`` is the
    greatest depth in metres of the blade below the untouched ground.
    """

    pulls: tuple[tuple[Pull, ...], ...]
    heap: SpoilHeap
    grid: ExcavationGrid
    stands_m: float
    trench_m: tuple[float, float, float, float]
    deepest_m: float


def make_site(settings: Settings) -> ExcavationSite:
    """Make the site of complete ``settings`` that are ``is_dug``; it is the same for all states of an excavation.

    Raises IcyMoonError for an excavation that cannot be dug.
    """
    excavation, gravity = settings.excavation, gravity_m_s2(settings)
    if excavation.path == JOINTS:
        arm_file = _file_state(settings.lander.file, "lander.file") if is_users_arm(settings) else None
        return _make_joint_site(
            json.dumps(settings | {"excavation": excavation | {"state": 0}}),
            gravity,
            (_file_state(excavation.file, "excavation.file"), arm_file),
        )
    return _make_path_site(
        json.dumps({key: excavation[key] for key in _SITE_SETTINGS}),
        gravity,
        _file_state(excavation.file, "excavation.file") if excavation.path == RECORDED else None,
    )


#: Settings on which the site depends.
_SITE_SETTINGS = (
    "path",
    "file",
    "start_x_m",
    "start_y_m",
    "heading_deg",
    "length_m",
    "width_m",
    "bite_m",
    "radius_m",
    "states",
    "cohesion_pa",
    "friction_deg",
    "density_kg_m3",
    "bulking",
    "chips_m",
    "heaped_share",
    "dust_share",
    "drop_m",
    "heap_side",
    "heap_gap_m",
    "cell_m",
    "marks",
    "slump",
)


def _file_state(file: str, setting: str) -> tuple[int, int] | None:
    """Return the size and the modification time of a setting's file, which the user may edit; None if it cannot be
    read.
    """
    try:
        there = absolute_path(file, setting).stat()
    except OSError:
        return None  # reading it says why
    return there.st_size, there.st_mtime_ns


@functools.lru_cache(maxsize=4)
def _make_joint_site(key: str, gravity: float, _states: tuple[tuple[int, int] | None, ...]) -> ExcavationSite:
    """Make the site of recorded joints. It depends on the arm and the ground, so ``key`` is JSON of all settings, with
    the excavation state set to 0.
    """
    settings = typed(json.loads(key))
    found, deepest = make_joint_pulls(settings)
    return _lay_out_site(
        settings.excavation, tuple(map(tuple, found)), [pull for each in found for pull in each], deepest, gravity
    )


@functools.lru_cache(maxsize=16)
def _make_path_site(key: str, gravity: float, _state: tuple[int, int] | None) -> ExcavationSite:
    excavation = ExcavationSettings.from_values(json.loads(key))
    pulls = tuple(map(tuple, make_pulls(excavation)))
    every = [pull for each in pulls for pull in each]
    if not every:  # one state only: lay the site out for the first bite
        every = [pull for each in make_pulls(excavation | {"states": 2}) for pull in each]
    deepest = max((float(pull.depth_m.max()) for pull in every), default=0.0)
    return _lay_out_site(excavation, pulls, every, deepest, gravity)


def _lay_out_site(
    excavation: ExcavationSettings,
    pulls: tuple[tuple[Pull, ...], ...],
    every: list[Pull],
    deepest: float,
    gravity: float,
) -> ExcavationSite:
    """Make the site of pulls. ``every`` are the pulls that decide its size; ``deepest`` is in metres below the
    ground.
    """
    _refuse_narrow_blade(excavation)
    stands = critical_height_m(excavation.cohesion_pa, excavation.friction_deg, excavation.density_kg_m3, gravity)
    slope = math.tan(math.radians(excavation.friction_deg))
    marks = make_marks(excavation.width_m, excavation.marks, excavation.friction_deg)
    lowest = deepest + (min(marks.height_m, max(deepest, 0.0)) if marks else 0.0)
    slumped = 0.5 * max(lowest, 0.0) / slope if lowest > stands else 0.0
    heap, reach = _place_heap(excavation, every, deepest, slumped)
    cell = float(excavation.cell_m)
    broken = float(excavation.chips_m)
    if excavation.slump > 0.0 and stands >= lowest > (1.0 - excavation.slump) * stands:
        broken += find_retreat_m(lowest, excavation.friction_deg)
    margin = max(_MARGIN_M, _MARGIN_CELLS * cell) + broken
    trench = find_bounds_m(every, slumped + broken + 2 * cell)
    ends = [
        find_bounds_m(every, 2 * slumped + margin),
        (
            min(heap.start_m[0], heap.end_m[0]) - reach,
            min(heap.start_m[1], heap.end_m[1]) - reach,
            max(heap.start_m[0], heap.end_m[0]) + reach,
            max(heap.start_m[1], heap.end_m[1]) + reach,
        ),
    ]
    grid = make_covering_grid(
        min(e[0] for e in ends), min(e[1] for e in ends), max(e[2] for e in ends), max(e[3] for e in ends), cell
    )
    if max(grid.rows, grid.columns) > MAX_GRID_SIDE:
        raise IcyMoonError(
            f"Trench and heap cover {grid.columns * cell:.3g} x {grid.rows * cell:.3g} m, which is "
            f"{grid.columns:.4g} x {grid.rows:.4g} cells of {cell:g} m, more than {MAX_GRID_SIDE} along a "
            f"side; raise excavation.cell_m, {'lower excavation.drop_m, ' if excavation.dust_share > 0.0 else ''}"
            "or dig less."
        )
    return ExcavationSite(tuple(_mark(each, marks) for each in pulls), heap, grid, stands, trench, lowest)


def _mark(pulls: tuple[Pull, ...], marks: ScoopMarks | None) -> tuple[Pull, ...]:
    return tuple(replace(pull, marks=marks) for pull in pulls)


def _refuse_narrow_blade(excavation: ExcavationSettings) -> None:
    """Raise IcyMoonError if the blade, or the line that it digs, is shorter than a cell of the grid."""
    cell = float(excavation.cell_m)
    if excavation.width_m < cell:
        raise IcyMoonError(
            f"The blade's excavation.width_m of {excavation.width_m:g} m is less than a cell, "
            f"excavation.cell_m of {cell:g} m, so that it would pass between the vertices; lower "
            "excavation.cell_m."
        )
    if excavation.path == LINE and excavation.length_m < cell and excavation.bite_m > 0:
        raise IcyMoonError(
            f"A line of excavation.length_m {excavation.length_m:g} m, less than a cell of {cell:g} m, "
            "digs nothing; raise excavation.length_m, or set excavation.path to ARC."
        )


def _place_heap(
    excavation: ExcavationSettings, pulls: list[Pull], deepest: float, slumped: float
) -> tuple[SpoilHeap, float]:
    """Place the heap so that its foot in the last state is as far from the trench as the settings ask. Return the heap,
    and its reach in metres.
    """
    first = pulls[0]
    ends = [(first.place(*pull.point(float(along), 0.0))) for pull in pulls for along in pull.along_m[[0, -1]]]
    start, end = min(float(a) for a, _ in ends), max(float(a) for a, _ in ends)
    half = excavation.width_m / 2 + max(abs(float(right)) for _, right in ends)
    length = (end - start) if excavation.path in (RECORDED, JOINTS) else float(excavation.length_m)
    low, high = (start, end) if excavation.path in (RECORDED, JOINTS) else (0.0, length)
    area = (end - start + 2 * slumped) * (2 * half + 2 * slumped)
    # Dust counts too, because most of it lands on the heap.
    volume = excavation.heaped_share * excavation.bulking * area * max(deepest, 0.0)
    height = ridge_height_m(max(volume, 1e-9), length, excavation.friction_deg)
    foot = height / math.tan(math.radians(excavation.friction_deg))
    away = half + slumped + excavation.heap_gap_m + foot
    side = away if excavation.heap_side == "RIGHT" else -away
    heap = SpoilHeap(first.point(low, side), first.point(high, side), excavation.friction_deg)
    apron = find_reach_m(float(excavation.drop_m)) if excavation.dust_share > 0.0 else 0.0
    return heap, 1.4 * foot + apron + _MARGIN_M


def find_refusals(settings: Settings) -> list[str]:
    """List a sentence for each reason why an excavation cannot be dug; empty without an excavation."""
    if not is_dug(settings):
        return []
    excavation = settings.excavation
    if settings.source.kind != "PROCEDURAL":
        return [REFUSED_FILE]
    if excavation.state >= excavation.states:
        return [
            f"excavation.state is {excavation.state}, but the last of {excavation.states} states "
            f"(excavation.states) is {excavation.states - 1}; lower it or raise excavation.states."
        ]
    try:
        grid = make_site(settings).grid
    except IcyMoonError as error:
        return [str(error)]
    west, south, east, north = grid.bounds_m
    reach = max(abs(west), abs(south), abs(east), abs(north)) + 3 * grid.cell_m
    if settings.mesh.kind == "GRID" and reach > settings.terrain.size_m / 2:
        return [
            f"Trench and heap reach {reach:.3g} m from the origin, beyond the {settings.terrain.size_m:g} m patch "
            "of ground; move excavation.start_x_m and excavation.start_y_m, or raise terrain.size_m."
        ]
    far = max(math.hypot(x - settings.rig.x_m, y - settings.rig.y_m) for x in (west, east) for y in (south, north))
    if settings.mesh.kind == "GRADED" and 2 * far > settings.mesh.farthest_m:
        return [
            f"Trench and heap reach {far:.3g} m from the camera, more than half of mesh.farthest_m "
            f"({settings.mesh.farthest_m:g} m); move excavation.start_x_m and excavation.start_y_m."
        ]
    return []


def advise_on_excavation(settings: Settings) -> list[str]:
    """List sentences about an excavation that can be dug but may not be as the user expects."""
    if not is_dug(settings) or find_refusals(settings):
        return []
    excavation, site, said = settings.excavation, make_site(settings), []
    deepest = site.deepest_m if any(site.pulls) else 0.0
    if deepest <= 0:
        fix = "give depth_m above 0 in excavation.file" if excavation.path == RECORDED else "raise excavation.bite_m"
        said.append(
            f"Nothing is dug in any state, because the blade never goes below the ground; {fix}, or keep it "
            "for a series of ground that does not change."
        )
    if excavation.path == ARC and deepest > excavation.radius_m:
        said.append(
            f"The arc's last bite is {deepest:.3g} m deep, more than its radius of {excavation.radius_m:g} m. "
            "A scoop would cut under the ground there; the trench has straight ends instead."
        )
    if site.grid.cell_m <= deepest <= site.stands_m:
        angle = math.degrees(math.atan(deepest / site.grid.cell_m))
        said.append(
            f"Walls up to {site.stands_m:.3g} m stand upright. The mesh makes them {angle:.1f} degrees steep, "
            f"because they are one cell of {excavation.cell_m:g} m wide."
        )
    said += _advise_on_cells(excavation)
    x, y = settings.rig.x_m, settings.rig.y_m
    west, south, east, north = site.grid.bounds_m
    if west < x < east and south < y < north:
        said.append(
            "The trench or the heap is under the camera, which keeps its height above the untouched ground; change "
            "excavation.start_x_m or excavation.start_y_m."
        )
    if settings.rocks.coverage > 0:
        said.append(
            "Rocks in the trench are not taken away. A rock that loses its support rolls to rest in the trench and "
            "pushes no other rock. Other rocks stay where they lay, also under spoil."
        )
    return said


def _advise_on_cells(excavation: ExcavationSettings) -> list[str]:
    """List sentences about cells that are too large for the blade or its teeth."""
    said = []
    if excavation.width_m < _FEWEST_CELLS_ACROSS * excavation.cell_m:
        said.append(
            f"The blade is {excavation.width_m / excavation.cell_m:.2g} cells wide, so that the trench is "
            "crude; lower excavation.cell_m."
        )
    apart = excavation.width_m / (TEETH * excavation.cell_m)
    if excavation.marks > 0.0 and apart < _FEWEST_CELLS_PER_GROOVE:
        said.append(f"The grooves of the scoop's teeth are {apart:.2g} cells apart and crude; lower excavation.cell_m.")
    return said
