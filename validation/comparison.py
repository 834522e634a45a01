"""Comparisons: their rows, the bench that they use, and the way to add your own.

A comparison gives rows. Each row has a number of Icy Moon, an independent number, the largest difference that counts as
agreement, and the source. The numbers alone decide whether a row passes or fails: a stated cause changes no verdict. A
row that cannot be decided is not judged, for a reason that does not depend on the difference.
"""

from __future__ import annotations

import importlib.util
import math
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import Any

from ..formats.png import encode_png
from ..render.pairs.pair_folder import Pair, is_complete, read_pair
from ..render.plans.planned_pair import expand_headings
from ..render.workers.job_commands import Job, render_job
from ..settings.topics.scene import Settings
from ..settings.user_files import hash_content
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.files import write_bytes

#: Verdict of a row that agrees.
PASSES = "passes"
#: Verdict of a row that differs too much.
FAILS = "fails"
#: Verdict of a row that cannot be decided.
NOT_JUDGED = "not judged"
#: The options of the command that name a folder of data, which are fields of a bench too.
DATA_OPTIONS = ("polar", "frost")
#: Why a row is not judged if our number was fitted to the other one and both agree.
_WHY_FITTED = "ours was fitted to it"


@dataclass(frozen=True)
class Row:
    """A number of Icy Moon beside its independent reference value.

    ``allowed`` is the largest difference with which the row passes, in the unit of both. ``fitted`` marks a reference
    to which our number was fitted: agreement then shows only the fit and is not judged, and a larger difference fails.
    ``why`` states the known cause of a difference, for the reader. It begins with ``Likely cause`` if the cause was not
    tested. ``unjudged`` is the reason for which the row is not judged at all.
    """

    quantity: str
    ours: float
    theirs: float
    allowed: float
    source: str
    unit: str = ""
    fitted: bool = False
    why: str = ""
    unjudged: str = ""

    @property
    def difference(self) -> float:
        """Our number minus the independent one."""
        return self.ours - self.theirs

    @property
    def verdict(self) -> str:
        """The verdict ``PASSES``, ``FAILS`` or ``NOT_JUDGED``. A judged number that is not finite fails."""
        if self.unjudged:
            return NOT_JUDGED
        if not abs(self.difference) <= self.allowed:
            return FAILS
        return NOT_JUDGED if self.fitted else PASSES

    @property
    def note(self) -> str:
        """The known cause if the row fails, the reason if it is not judged; otherwise empty."""
        if self.verdict == NOT_JUDGED:
            return f"Not judged: {self.unjudged or _WHY_FITTED}"
        return self.why if self.verdict == FAILS else ""

    def to_json(self) -> dict[str, Any]:
        """Return the row as plain values, null for numbers that are not finite."""
        ours, theirs = (value if math.isfinite(value) else None for value in (self.ours, self.theirs))
        return {
            "quantity": self.quantity,
            "ours": ours,
            "theirs": theirs,
            "allowed": self.allowed,
            "unit": self.unit,
            "fitted": self.fitted,
            "verdict": self.verdict,
            "source": self.source,
            "why": self.why,
            "unjudged": self.note.removeprefix("Not judged: ") if self.verdict == NOT_JUDGED else "",
        }


Say = Callable[[dict[str, Any]], None]


@dataclass(frozen=True)
class Bench:
    """The resources of a comparison: a folder for its files, a Blender, and whether it should be ``quick``.

    ``polar`` and ``frost`` are the user's folders of the POLAR data and of the FROST scans, None without these data.
    """

    folder: Path
    blender: str = sys.executable
    quick: bool = False
    say: Say = field(default=lambda message: None)
    polar: Path | None = None
    frost: Path | None = None

    def render(self, described: Sequence[Settings]) -> list[Pair]:
        """Render the first pair of each complete description in one worker, and return the pairs.

        Pairs that are already in the folder are not rendered again. Raises IcyMoonError if one cannot be rendered.
        """
        dataset = self.folder / "renders"
        planned = [expand_headings(settings, hash_content(settings))[0] for settings in described]
        if not all(is_complete(pair.folder(dataset)) for pair in planned):
            render_job(Job(dataset, pairs=planned), self.blender, self.say)
        return [read_pair(pair.folder(dataset)) for pair in planned]

    def draw(self, name: str, picture: Array) -> None:
        """Write a picture (H, W, 3), uint8, to ``pictures/<name>.png`` in the folder."""
        data = encode_png(picture)

        write_bytes(self.folder / "pictures" / f"{name}.png", data)


@dataclass(frozen=True)
class Comparison:
    """A comparison: ``name`` on the command line, title and text for the page, and the function for its rows.

    Each line of the ``text`` is a paragraph or an item of a list. A quick run leaves out a comparison that is not
    ``quick``; the others may take fewer cases there. ``needs`` names the option that gives the folder of its data;
    without that option, a run of all comparisons leaves it out. ``figure`` is a picture of the page, in Markdown, that
    is made with the tables.
    """

    name: str
    title: str
    text: str
    compare: Callable[[Bench], list[Row]]
    quick: bool = True
    needs: str = ""
    figure: str = ""

    @property
    def command(self) -> str:
        """The command that runs the comparison."""
        data = f" --{self.needs} FOLDER" if self.needs else ""
        return f"python -m icymoon validate{data} --only {self.name}"


@dataclass(frozen=True)
class Result:
    """The rows of a comparison, and its run time in seconds; ``error`` is a sentence if it failed."""

    comparison: Comparison
    rows: tuple[Row, ...]
    seconds: float
    error: str = ""

    @property
    def passes(self) -> bool:
        """Whether the comparison ran, at least one row was judged, and every judged row passes."""
        verdicts = {row.verdict for row in self.rows}
        return not self.error and PASSES in verdicts and FAILS not in verdicts

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "name": self.comparison.name,
            "title": self.comparison.title,
            "passes": self.passes,
            "seconds": round(self.seconds, 1),
            "error": self.error,
            "rows": [row.to_json() for row in self.rows],
        }


def run_comparison(comparison: Comparison, bench: Bench) -> Result:
    """Run a comparison in its own folder below the folder of the bench. A failure is stored in ``Result.error``."""
    start = time.perf_counter()
    rows: tuple[Row, ...] = ()
    error = ""
    try:
        rows = tuple(comparison.compare(replace(bench, folder=bench.folder / comparison.name)))
        if not rows:
            error = "It compared nothing."
    except IcyMoonError as failure:
        error = " ".join(str(failure).split())
    return Result(comparison, rows, time.perf_counter() - start, error)


def load_own_comparison(path: Path) -> Comparison:
    """Run a user's Python file and return its ``COMPARISON``. The path may come from the command line only.

    Raises IcyMoonError if the file is missing, cannot be run or has no comparison. Later failures in it also become
    IcyMoonError.
    """
    fix = "write COMPARISON = Comparison(...) into it, see Validation in the manual"
    if not path.is_file():
        raise IcyMoonError(f"There is no comparison {path}; give the path of a Python file.")
    spec = importlib.util.spec_from_file_location(f"icymoon_own_comparison_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise IcyMoonError(f"{path} is not a Python file; its name must end in .py.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses of the file look for their module there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise IcyMoonError(f"{path} cannot be run ({type(error).__name__}: {error}); fix it.") from None
    found = getattr(module, "COMPARISON", None)
    if not isinstance(found, Comparison):
        raise IcyMoonError(f"{path} has no comparison; {fix}.")
    if found.needs not in ("", *DATA_OPTIONS):
        raise IcyMoonError(
            f"{path}: no option gives the folder of needs={found.needs!r}; write "
            f"{' or '.join(map(repr, DATA_OPTIONS))}, or "
            "leave it out and let the file find its data."
        )
    return replace(found, compare=partial(_compare_by_file, path, found.compare))


def _compare_by_file(path: Path, compare: Callable[[Bench], list[Row]], bench: Bench) -> list[Row]:
    """Compute the rows by a user's function. Any exception or other result becomes an IcyMoonError with its line."""
    try:
        rows = compare(bench)
    except IcyMoonError:
        raise
    except Exception as error:
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if Path(frame.filename) == path.absolute()
        ]
        at = f", line {lines[-1]}" if lines else ""
        raise IcyMoonError(f"{path}{at}: the comparison fails ({type(error).__name__}: {error}); fix it.") from error
    if not isinstance(rows, list | tuple) or not all(isinstance(row, Row) for row in rows):
        raise IcyMoonError(f"{path}: the comparison returns {type(rows).__name__} and not a list of Row; return one.")
    for row in rows:
        if not all(isinstance(number, Real) for number in (row.ours, row.theirs, row.allowed)):
            raise IcyMoonError(
                f"{path}: ours, theirs and allowed of the row {row.quantity!r} are not all numbers; give numbers."
            )
    return list(rows)
