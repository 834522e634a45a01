"""A plan: a TOML file, and the pairs of the data set that it determines. Imports no Blender.

A plan is a settings file with ``[plan]`` for ``[preset]``, and ``[[sweep]]`` tables whose variations are
combined. It is checked as strictly as settings are, before anything is built: an error names the file,
the line and the fix. ``docs/datasets.md`` describes the format.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...formats.toml_lines import Place
from ...settings.description import check
from ...settings.preset_files import PLANS_FOLDER, plan_names
from ...settings.toml_text import read_toml, read_toml_and_text
from ...support.errors import IcyMoonError
from ...support.files import is_file, parse_path, quote
from ...support.foreign_bytes import parse_toml
from ...support.suggestions import suggest_nearest
from ..pairs.scene_splits import check_splits
from . import pose_sweeps, setting_sweeps, trajectory_sweeps
from .combine import MAX_CHECKED_GROUNDS, CombinedPairs, PlanDesign, Report, combine
from .planned_pair import PlannedPair
from .setting_sweeps import Sweep, Variation, check_keys, check_settings, load_included
from .stand_in_replacements import describe_stand_ins

HEADER = (
    "title",
    "description",
    "extends",
    "include",
    "seeds",
    "draw_again",
    "grounds",
    "splits",
    "at_most",
    "files",
    "without",
)
_MAX_SEEDS = 100000
#: Most designs of a plan with all plans that it extends, and most sweeps of one plan; each shipped plan has far fewer.
#: Plans that extend two plans each, twenty files deep, would have a million parents.
_MAX_DESIGNS, _MAX_SWEEPS = 100, 100
#: Fewest grounds on which each of several extended plans is checked.
_FEWEST_CHECKED_GROUNDS = 3


@dataclass(frozen=True)
class Plan:
    """A plan that was read from its file.

    ``text`` is its TOML. ``designs`` are its combinations, several if it extends several plans. ``splits`` are the
    shares of its scenes in each split, if stated.
    """

    path: Path
    title: str
    description: str
    text: str
    designs: tuple[PlanDesign, ...]
    splits: dict[str, float] | None = None

    def check(self, report: Report = lambda done, total: None) -> CombinedPairs:
        """Combine and check the pairs, once. ``report`` receives the number of checked pairs and of all pairs.

        Raises IcyMoonError as ``pairs`` does.
        """
        if "_combined" not in self.__dict__:
            self.__dict__["_combined"] = self._combine_designs(report)
        found: CombinedPairs = self.__dict__["_combined"]
        return found

    def _combine_designs(self, report: Report) -> CombinedPairs:
        found: dict[str, PlannedPair] = {}
        refused: dict[str, str] = {}
        checked: frozenset[str] = frozenset()
        unchecked: frozenset[str] = frozenset()
        before = 0

        def report_all(done: int, total: int) -> None:
            report(before + done, before + total)

        for design in self.designs:
            made = combine(design, max(_FEWEST_CHECKED_GROUNDS, MAX_CHECKED_GROUNDS // len(self.designs)), report_all)
            refused |= made.refused
            checked, unchecked, before = checked | made.checked, unchecked | made.unchecked, before + len(made.pairs)
            for pair in made.pairs:
                found.setdefault(pair.id, pair)
        return CombinedPairs(list(found.values()), refused, checked, unchecked - checked)

    def pairs(self) -> list[PlannedPair]:
        """List the pairs with complete settings, in the order of the plan, each once.

        Pairs of ``refused`` are included; a render sets them aside. Raises IcyMoonError if no pair can be rendered, or
        if a file is missing.
        """
        return list(self.check().pairs)

    def refused(self) -> dict[str, str]:
        """Return the reasons why some pairs cannot be rendered, by their ids. A reason is a sentence with the line at
        fault.

        Raises IcyMoonError as ``pairs`` does.
        """
        return dict(self.check().refused)

    def describe_unchecked(self) -> str:
        """Describe in a sentence the grounds on which no cameras were checked; empty if all grounds were checked."""
        found = self.check()
        if not found.unchecked:
            return ""
        return (
            f"{len(found.checked)} grounds were checked, {len(found.unchecked)} were not. If a camera cannot stand "
            "on one of the others, the render sets its pair aside."
        )

    def describe_draws(self) -> str:
        """Describe in a sentence the seeds that repeat the draws of the first seed; empty if all draws differ."""
        repeats = any(
            design.seeds is not None
            and not design.draw_again
            and _count_seeds(design.seeds[0]) > 1
            and any(sweep.kind in setting_sweeps.DRAWN_KINDS for sweep in design.sweeps)
            for design in self.designs
        )
        return (
            "Every seed has the same draws of its sweeps, on other ground; state draw_again = true under [plan] "
            "for draws of its own."
            if repeats
            else ""
        )

    def describe_trajectories(self) -> list[str]:
        """Describe in a sentence each trajectory that the plan follows. Raises IcyMoonError as ``pairs`` does."""
        found = [
            trajectory_sweeps.describe_trajectory(sweep)
            for design in self.designs
            for sweep in design.sweeps
            if sweep.kind == trajectory_sweeps.KIND
        ]
        return list(dict.fromkeys(found))

    def describe_splits(self) -> str:
        """Describe in a line the splits of the plan; empty without splits."""
        shown = ", ".join(f"{name} {100 * share:g} %" for name, share in (self.splits or {}).items())
        return f"Splits of the scenes: {shown}" if shown else ""

    def describe_stand_ins(self) -> list[str]:
        """Describe in sentences the stand-ins that replace files of the GUISS paper in the pairs; empty without
        stand-ins."""
        return describe_stand_ins(self.check().pairs, [each.files for each in self.designs if each.files])


def find_plan(name: str) -> Path:
    """Find the file of a plan by its name: a shipped one, with or without its folder, or a path.

    Raises IcyMoonError if there is no such plan.
    """
    shipped = PLANS_FOLDER / f"{name.removeprefix('datasets/')}.toml"
    if ".." not in name and is_file(shipped):
        return shipped
    path = parse_path(name, "The plan")
    if path.suffix == ".toml" or os.path.lexists(path):
        return path
    raise IcyMoonError(f"Unknown plan {quote(name)}, {suggest_nearest(name, plan_names())}")


def read_plan_header(path: Path) -> tuple[str, str]:
    """Read the title and the description of a plan; the rest of the plan is not read."""
    header = read_toml(path).get("plan", {})
    return str(header.get("title", path.stem)), str(header.get("description", ""))


def read_plan(path: Path) -> Plan:
    """Read and check a plan. Raises IcyMoonError that names the file, the line and the fix."""
    return _read_extended(path, ())


def parse_plan(path: Path, text: str) -> Plan:
    """Parse the plan of a file with this text. Raises IcyMoonError as ``read_plan`` does."""
    return _parse_plan(path, parse_toml(text), text, ())


def _read_extended(path: Path, readers: tuple[Path, ...]) -> Plan:
    return _parse_plan(path, *read_toml_and_text(path), readers)


def _parse_plan(path: Path, data: dict[str, Any], text: str, readers: tuple[Path, ...]) -> Plan:
    whole = Place(path, text)
    header = data.pop("plan", None)
    if not isinstance(header, Mapping):
        raise IcyMoonError(
            f"{path} has no [plan] table, so it is not a plan of a data set; add the table, with a title."
        )
    data.pop("sources", None)
    place = whole.at("plan")
    check_keys(header, HEADER, place, "[plan]")
    tables = data.pop("sweep", [])
    if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
        raise IcyMoonError(f"{whole.at('sweep')}: sweeps are a list of tables; write [[sweep]] with two brackets.")
    if len(tables) > _MAX_SWEEPS:
        raise IcyMoonError(
            f"{whole.at('sweep', _MAX_SWEEPS)}: a plan may have {_MAX_SWEEPS} sweeps, and this is one more; list "
            "the values of several sweeps in one."
        )
    designs = _read_parents(header, place, (*readers, path.resolve()))
    for k, table in enumerate(tables):
        designs = _add_sweep(designs, table, whole.at("sweep", k))
    return Plan(
        path,
        _read_text(header, "title", place) or path.stem,
        _read_text(header, "description", place),
        text,
        tuple(_apply_header(_add_settings(design, header, data, whole), header, place) for design in designs),
        _read_splits(header, place),
    )


def _read_splits(header: Mapping[str, Any], place: Place) -> dict[str, float] | None:
    if "splits" not in header:
        return None
    try:
        return check_splits(header["splits"])
    except IcyMoonError as error:
        raise IcyMoonError(f"{place.at('splits')}: {error}") from None


def _count_seeds(stated: int | list[int]) -> int:
    return len(stated) if isinstance(stated, list) else stated


def _read_text(header: Mapping[str, Any], key: str, place: Place) -> str:
    if not isinstance(header.get(key, ""), str):
        raise IcyMoonError(f"{place.at(key)}: {key} must be a text in quotes, not {quote(header[key])}.")
    return str(header.get(key, ""))


def _read_names(header: Mapping[str, Any], key: str, place: Place) -> list[tuple[str, Place]]:
    """Read the name or names of a key, each with its file position."""
    value = header.get(key, [])
    if not isinstance(value, list):
        value = [value]
    if not all(isinstance(name, str) for name in value):
        raise IcyMoonError(f"{place.at(key)}: {key} must be a name in quotes or a list of them, not {quote(value)}.")
    return [
        (name, place.at(key, k) if isinstance(header[key], list) else place.at(key)) for k, name in enumerate(value)
    ]


def _read_parents(header: Mapping[str, Any], place: Place, readers: tuple[Path, ...]) -> list[PlanDesign]:
    """Return the designs that a plan begins with: the designs of the plans that it extends, or one empty design."""
    designs: list[PlanDesign] = []
    for name, at in _read_names(header, "extends", place):
        try:
            path = at.file.parent / parse_path(name, "The plan") if name.endswith(".toml") else find_plan(name)
            if path.resolve() in readers:
                raise IcyMoonError(f"{path} extends this plan in turn; leave one of the two out.")
            designs += _read_extended(path, readers).designs
        except IcyMoonError as error:
            raise IcyMoonError(f"{at}: {error}") from None
        if len(designs) > _MAX_DESIGNS:
            raise IcyMoonError(f"{at}: the plan then extends more than {_MAX_DESIGNS} plans; name fewer, each once.")
    designs = designs or [PlanDesign()]
    for name, at in _read_names(header, "without", place):
        if not any(name == sweep.name for design in designs for sweep in design.sweeps):
            known = sorted({sweep.name for design in designs for sweep in design.sweeps})
            raise IcyMoonError(f"{at}: there is no sweep {quote(name)} to leave out, {suggest_nearest(name, known)}")
        designs = [replace(design, sweeps=tuple(b for b in design.sweeps if b.name != name)) for design in designs]
    return designs


def _add_settings(design: PlanDesign, header: Mapping[str, Any], data: Mapping[str, Any], whole: Place) -> PlanDesign:
    """Return a design whose base settings are overridden by the presets and settings of a plan."""
    place = whole.at("plan")
    parts = [Variation(load_included(name, at), at) for name, at in _read_names(header, "include", place)]
    return replace(design, base=(*design.base, *parts, Variation(check_settings(data, whole), whole)))


def _apply_header(design: PlanDesign, header: Mapping[str, Any], place: Place) -> PlanDesign:
    """Return a design with the seeds, the grounds, the limit of pairs and the folder of files that the header of a plan
    states."""
    if "seeds" in header:
        design = replace(design, seeds=_read_seeds(header["seeds"], place.at("seeds")))
    if "draw_again" in header:
        if not isinstance(header["draw_again"], bool):
            raise IcyMoonError(f"{place.at('draw_again')}: draw_again must be true or false.")
        design = replace(design, draw_again=header["draw_again"])
    if "grounds" in header:
        count = _read_count(header, "grounds", "grounds", place)
        design = replace(design, grounds=(count, place.at("grounds")))
    if "at_most" in header:
        design = replace(design, at_most=_read_count(header, "at_most", "pairs", place))
    if "files" in header:
        folder = parse_path(_read_text(header, "files", place), f"{place.at('files')}: files")
        design = replace(design, files=place.file.parent.absolute() / folder)
    return design


def _read_count(header: Mapping[str, Any], key: str, what: str, place: Place) -> int:
    """Read a whole number from the header. Raises IcyMoonError if it is not a whole number from 1 up."""
    value = header[key]
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise IcyMoonError(f"{place.at(key)}: {key} is {quote(value)}, but must be a whole number of {what} from 1 up.")
    return value


def _read_seeds(value: object, place: Place) -> tuple[int | list[int], Place]:
    """Read a number of seeds to draw, or the seeds themselves."""
    whole = [
        v for v in (value if isinstance(value, list) else [value]) if isinstance(v, int) and not isinstance(v, bool)
    ]
    if isinstance(value, list) and value and len(whole) == len(value):
        for seed in value:
            check({"dataset": {"seed": seed}}, str(place))
        return value, place
    if isinstance(value, list) or not whole or not 1 <= whole[0] <= _MAX_SEEDS:
        raise IcyMoonError(
            f"{place}: seeds is {quote(value)}, but must be a number from 1 to {_MAX_SEEDS} or a list of seeds."
        )
    return whole[0], place


def _add_sweep(designs: Sequence[PlanDesign], table: Mapping[str, Any], place: Place) -> list[PlanDesign]:
    """Return the designs with one more sweep, or with this sweep in place of the sweep that it replaces."""
    kinds = (*setting_sweeps.KINDS, *pose_sweeps.KINDS)
    kind, replaces = table.get("kind"), _read_text(table, "replaces", place) or None
    if kind not in kinds:
        problem = "lacks its kind" if kind is None else f"is of kind {quote(kind)}"
        raise IcyMoonError(f"{place.at('kind')}: this sweep {problem}, {suggest_nearest(str(kind), kinds)}")
    known = {sweep.name for design in designs for sweep in design.sweeps}
    if replaces is not None and replaces not in known:
        raise IcyMoonError(
            f"{place.at('replaces')}: there is no sweep {quote(replaces)} to replace, "
            f"{suggest_nearest(replaces, sorted(known))}"
        )
    # Random numbers depend on the name; an automatic name counts the sweeps of its kind in this file.
    name = replaces or _read_text(table, "name", place) or _find_free_name(kind, known)
    if replaces is None and name in known:
        raise IcyMoonError(
            f"{place.at('name')}: there is a sweep {quote(name)} already; write replaces = "
            f"{quote(name)} or choose another name."
        )
    sweep = Sweep(kind, name, {key: v for key, v in table.items() if key not in ("kind", "name", "replaces")}, place)
    if replaces is None:
        return [replace(design, sweeps=(*design.sweeps, sweep)) for design in designs]
    return [replace(design, sweeps=tuple(sweep if b.name == name else b for b in design.sweeps)) for design in designs]


def _find_free_name(kind: str, known: set[str]) -> str:
    return next(name for k in range(len(known) + 1) if (name := f"{kind} {k + 1}") not in known)
