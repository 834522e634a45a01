"""Reads the maps of decisions that ``icymoon decide`` wrote, for the window. Needs only NumPy, which Blender has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, FILE_NAME, FLAG, NUMBER, POSITIVE, TEXT, Each, Maybe, read_record
from .dem import Grid, read_cells

#: Kinds of maps: the margin of a site, the slope under its disc, and the height error of the elevation model.
SUITABILITY, SLOPE, HEIGHT_ERROR = "SUITABILITY", "SLOPE", "HEIGHT_ERROR"
#: The label of the true depth's row. This row shows the effect of the rules, the cells and hidden ground alone.
TRUE_DEPTH = "true depth"
#: The action of a lander on a pair: take the chosen site, abstain, or abstain on ground without a guarantee.
GUARANTEED, ABSTAINS, UNLIKE = "guaranteed", "abstains", "unlike"
_DECIDE_AGAIN = "press Decide Where to Dig again"
_REPORT_SHAPE = {
    "rules": {"site": {"slope_deg": POSITIVE, "disc_m": POSITIVE}},
    "rows": Each(
        {
            "pair": FILE_NAME,
            "method": TEXT,
            "images": Each(TEXT, TEXT),
            "guarantee": Maybe({"verdict": TEXT}, null=True),
            "numbers": Maybe({"sites": {"chosen": Maybe(Each(COUNT), null=True)}}, null=True),
        }
    ),
}
_FACTS_SHAPE = {
    "arm": FLAG,
    "cell_m": POSITIVE,
    "rows": COUNT,
    "columns": COUNT,
    "origin_m": Each(NUMBER),
    "images": Each(TEXT, TEXT),
}
#: Limits of files: bytes of ``decisions.json``, and the most cells along a side that ``icymoon decide`` writes.
_MAX_BYTES, _MAX_CELLS = 2**27, 4096


@dataclass(frozen=True)
class StoredMap:
    """A map (rows, columns) of one matcher on one pair, NaN where unknown, and the facts about it."""

    kind: str  # SUITABILITY, SLOPE or HEIGHT_ERROR
    grid: Grid
    values: Array  # float64: a margin, minus infinity where unknown; degrees; or metres
    height_m: Array  # the true heights
    reach: Array | None  # boolean: cells that the arm reaches; None without an arm
    chosen: tuple[int, int] | None  # row and column of the chosen site
    disc_m: float  # diameter of the footprint
    slope_deg: float  # the slope that the rules allow
    guarantee: str = ""  # the verdict of a calibration, see ``GUARANTEED``; empty without a calibration


def list_methods(folder: Path) -> list[str]:
    """List the labels of the matchers with decisions in a folder, the true depth last; empty without decisions."""
    try:
        rows = _read_report(folder)["rows"]
    except IcyMoonError:
        return []
    return sorted(dict.fromkeys(row["method"] for row in rows if row["images"]), key=TRUE_DEPTH.__eq__)


def list_pairs(folder: Path, method: str) -> list[str]:
    """List the pairs with decisions of a matcher. Raises IcyMoonError if the decisions cannot be read."""
    return [row["pair"] for row in _read_report(folder)["rows"] if row["method"] == method and row["images"]]


def read_map(folder: Path, pair: str, method: str, kind: str) -> StoredMap:
    """Read a map of ``kind`` by a matcher on a pair.

    Raises IcyMoonError if a file is missing, damaged, or of a different map.
    """
    report = _read_report(folder)
    row = next((each for each in report["rows"] if (each["pair"], each["method"]) == (pair, method)), None)
    path = folder / "pairs" / pair / "decisions.json"
    try:
        facts = read_record(path, _FACTS_SHAPE, _DECIDE_AGAIN)
    except FileNotFoundError:
        facts = None
    if row is None or facts is None or row["numbers"] is None:
        raise IcyMoonError(f"{folder} contains no decisions on pair {pair}; {_DECIDE_AGAIN}.")
    grid, site = _read_grid(facts, path), report["rules"]["site"]
    truth = _read_cells(folder, facts["images"], "truth_dem", grid)
    reach = _read_cells(folder, facts["images"], "reach", grid) > 0 if facts["arm"] else None
    return StoredMap(
        kind,
        grid,
        _read_values(folder, row["images"], kind, grid, truth),
        truth,
        reach,
        _find_chosen_cell(row["numbers"]["sites"].get("chosen"), grid),
        site["disc_m"],
        site["slope_deg"],
        (row.get("guarantee") or {}).get("verdict", ""),
    )


def _read_report(folder: Path) -> dict[str, Any]:
    path = folder / "decisions.json"
    try:
        facts = path.stat()
    except OSError:
        raise IcyMoonError(f"There are no decisions in {folder}; {_DECIDE_AGAIN}.") from None
    if facts.st_size > _MAX_BYTES:
        raise IcyMoonError(f"{path} is larger than {_MAX_BYTES >> 20} MiB; decide on fewer pairs.")
    return _read_cached_report(path, facts.st_mtime_ns)


@lru_cache(maxsize=4)
def _read_cached_report(path: Path, written_ns: int) -> dict[str, Any]:
    return dict(read_record(path, _REPORT_SHAPE, _DECIDE_AGAIN))


def _read_grid(facts: Mapping[str, Any], path: Path) -> Grid:
    rows, columns = facts["rows"], facts["columns"]
    if not (0 < rows <= _MAX_CELLS and 0 < columns <= _MAX_CELLS and len(facts["origin_m"]) == 2):
        raise IcyMoonError(f"{path} states no map of at most {_MAX_CELLS} cells a side; {_DECIDE_AGAIN}.")
    return Grid(float(facts["cell_m"]), rows, columns, *map(float, facts["origin_m"]))


def _read_values(folder: Path, files: Mapping[str, str], kind: str, grid: Grid, truth: Array) -> Array:
    if kind == HEIGHT_ERROR:
        return np.asarray(_read_cells(folder, files, "dem", grid) - truth)
    return _read_cells(folder, files, kind.lower(), grid)


def _read_cells(folder: Path, files: Mapping[str, str], name: str, grid: Grid) -> Array:
    """Read the values of all cells, float64. Raises IcyMoonError if there is no file of this name in the folder."""
    path = folder / files.get(name, "")
    if name not in files or "\0" in files[name] or not path.resolve().is_relative_to(folder.resolve()):
        raise IcyMoonError(f"The decisions in {folder} have no map of this kind; {_DECIDE_AGAIN}.")
    return read_cells(path, (grid.rows, grid.columns), _DECIDE_AGAIN)


def _find_chosen_cell(chosen: list[int] | None, grid: Grid) -> tuple[int, int] | None:
    fits = chosen is not None and len(chosen) == 2 and chosen[0] < grid.rows and chosen[1] < grid.columns
    return (chosen[0], chosen[1]) if fits and chosen else None


def trace_outlines(cells: Array) -> list[Array]:
    """Trace the closed outlines of the true cells (rows, columns).

    An outline is the corners (n, 2) of cells, row first, in order along it. Holes have outlines too.
    """
    padded = np.pad(cells, 1)
    inner = padded[1:-1, 1:-1]
    after: dict[tuple[int, int], list[tuple[int, int]]] = {}
    # A false neighbour, then both ends of the edge to it; the true cell is on the right of the edge.
    for other, start, end in (
        (padded[:-2, 1:-1], (0, 0), (0, 1)),
        (padded[1:-1, 2:], (0, 1), (1, 1)),
        (padded[2:, 1:-1], (1, 1), (1, 0)),
        (padded[1:-1, :-2], (1, 0), (0, 0)),
    ):
        for row, column in np.argwhere(inner & ~other).tolist():
            after.setdefault((row + start[0], column + start[1]), []).append((row + end[0], column + end[1]))
    found = []
    while after:  # at each corner as many edges end as start, so a way along them returns to its start
        way = [next(iter(after))]
        while len(way) == 1 or way[-1] != way[0]:
            ends = after[way[-1]]
            if len(ends) == 1:
                del after[way[-1]]
            way.append(ends.pop())
        found.append(np.array(way[:-1]))
    return found
