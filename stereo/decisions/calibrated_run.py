"""The calibration that a run of ``decide`` makes or uses: checked before the decisions, applied after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ...render.pairs.pair_folder import read_pair
from ...settings.description import Restorer
from ...support.errors import IcyMoonError
from .calibration import Goal, calibrate_matchers, check_ground_counts, make_sentences
from .calibration_file import (
    Calibration,
    Conditions,
    check_target,
    check_use,
    read_calibration,
    write_calibration,
)
from .calibration_pairs import StatedPair, check_group_settings, join_statements, state_pair
from .guarantee import apply_calibration, make_guarantee_sentences


@dataclass(frozen=True)
class CalibrationOrder:
    """A calibration to make: the file to write, and the goal."""

    file: Path
    goal: Goal = field(default_factory=Goal)


@dataclass(frozen=True)
class Verdicts:
    """A run's conclusions with their confidence: sentences, and entries of ``decisions.json``.

    ``entries`` are the entries of a new calibration by matcher. ``refusal`` is the reason if no calibration could be
    made, else empty.
    """

    sentences: Sequence[str] = ()
    guarantee: Mapping[str, Any] | None = None
    entries: Mapping[str, Mapping[str, Any]] | None = None
    refusal: str = ""


@dataclass(frozen=True)
class CalibratedRun:
    """A run of ``decide`` with the calibration that it makes (``order``) or uses (``used``), or with neither."""

    stated: Mapping[str, StatedPair]  # by the name of the pair
    conditions: Conditions
    inputs: Mapping[str, str]  # digests of the methods by label
    order: CalibrationOrder | None = None
    used: Calibration | None = None

    def judge(self, rows: Sequence[Mapping[str, Any]]) -> tuple[list[dict[str, Any]], Verdicts]:
        """Return the rows and the verdicts of the run.

        If a calibration is used, each row has the entry ``guarantee``.
        """
        plain = [dict(row) for row in rows]
        if self.used is not None:
            marked, guarantee = apply_calibration(self.used, plain, self.stated)
            return marked, Verdicts(make_guarantee_sentences(guarantee), guarantee)
        if self.order is None:
            return plain, Verdicts()
        try:
            entries = calibrate_matchers(plain, self.stated, self.inputs, self.order.goal)
        except IcyMoonError as error:
            return plain, Verdicts(refusal=str(error))
        return plain, Verdicts(make_sentences(entries, self.order.goal), entries=entries)

    def write(self, verdicts: Verdicts) -> None:
        """Write the calibration if one is made. Raises IcyMoonError with the reason if the grounds do not allow one."""
        if verdicts.refusal:
            raise IcyMoonError(verdicts.refusal)
        if self.order is not None and verdicts.entries is not None:
            stated = list(self.stated.values())
            write_calibration(self.order.file, self.order.goal, self.conditions, stated, verdicts.entries)


def prepare_calibrated_run(
    folders: Mapping[str, Sequence[Path]],
    response: Mapping[str, Mapping[str, Any]],
    cell_m: float,
    run: CalibratedRun,
    file: Path | None,
) -> CalibratedRun:
    """Return the run with the statements of the pairs in ``folders``, by name, and the calibration in ``file``, if
    given.

    A site that several pairs show has several folders. ``cell_m`` is the side of a cell of pairs that state none.
    Raises IcyMoonError if these pairs cannot give the calibration, or if it does not hold for them. A pair that cannot
    be read is left out here and reported when its turn comes.
    """
    order = run.order
    if order is None and file is None:
        return run
    if order is not None and file is not None:
        raise IcyMoonError("--calibrate and --calibration exclude each other; calibrate first, then use the file.")
    used = None if file is None else read_calibration(file)
    goal = order.goal if order is not None else used.goal if used is not None else Goal()
    if order is not None:
        goal.check()
        check_target(order.file)
    check_group_settings(goal.group_by)
    stated, restore = {}, Restorer()
    for name, own in folders.items():
        with suppress(IcyMoonError):
            pairs = [state_pair(read_pair(folder, restore), response, goal.group_by, cell_m) for folder in own]
            stated[name] = join_statements(pairs)
    if used is not None:
        check_use(used, run.conditions, stated, run.inputs)
    else:
        check_ground_counts(list(stated.values()), goal)
    return replace(run, stated=stated, used=used)
