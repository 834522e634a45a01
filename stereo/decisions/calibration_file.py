"""The file of a calibration: written by ``decide --calibrate``, read by ``decide --calibration``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...support.errors import IcyMoonError
from ...support.file_schemas import COUNT, NUMBER, POSITIVE, TEXT, Each, Kind, Maybe, check_record, is_number
from ...support.files import is_file, make_json_digest, quote, write_json
from ...support.foreign_bytes import ForeignBytes, parse_json, read
from ...support.number_text import format_count
from ...support.version import version
from .calibration import CHOICE, MAP, MAX_RISK, MIN_RISK, PROCEDURES, Goal, count_fewest_pairs, name_matcher
from .calibration_pairs import StatedPair
from .height_errors import QUANTITIES
from .rules import Rules
from .scores import THRESHOLDS
from .workspace import FEATURES

FORMAT, VERSION = "icymoon-decision-calibration", 2
#: Most bytes of a file, enough for some ten thousand grounds.
_MAX_BYTES = 2**24
_CALIBRATE_AGAIN = "write it again with decide --calibrate"
_RISK = Kind(
    f"a number from {MIN_RISK:g} to {MAX_RISK:g}",
    lambda value: is_number(value) and MIN_RISK <= value <= MAX_RISK,
)
_PROCEDURE = Kind(" or ".join(PROCEDURES), lambda value: value in PROCEDURES)
_THRESHOLD = Kind("a margin of the fixed list", lambda value: value in THRESHOLDS)
_FEATURES = Kind(
    f"a list of {len(FEATURES)} numbers",
    lambda value: isinstance(value, list) and len(value) == len(FEATURES) and all(map(is_number, value)),
)
#: The conditions that decisions must share with a calibration, and their names in a sentence.
_CONDITIONS = {
    "decisions": "version of the decisions",
    "rules": "rules",
    "pose_error": "errors of poses",
    "min_confidence": "least confidence",
}
_ENTRY_OF_RISK = {
    "threshold": Maybe(_THRESHOLD, null=True),
    "by_group": Each(Maybe(_THRESHOLD, null=True)),
    "loss": NUMBER,
    "acted": COUNT,
    "could_act": COUNT,
}
_SHAPE = {
    "decisions": COUNT,
    "goal": {"alpha": _RISK, "delta": _RISK, "procedure": _PROCEDURE, "group_by": Each(TEXT)},
    "features": Each(TEXT),
    "rules": Each(Each(NUMBER, TEXT), TEXT),
    "pose_error": {"mm": NUMBER, "deg": NUMBER},
    "min_confidence": NUMBER,
    "suns": Maybe(COUNT),
    "devices": Each(Each(TEXT), TEXT),
    "grounds": Each(TEXT),
    "pairs_of_a_ground": COUNT,
    "matchers": Each(
        {
            "inputs": TEXT,
            "left_out": COUNT,
            "scales": {name: Maybe(POSITIVE, null=True) for name in QUANTITIES},
            CHOICE: _ENTRY_OF_RISK,
            MAP: _ENTRY_OF_RISK,
            "groups": Each({"group": TEXT, "grounds": COUNT, "features": Each(_FEATURES)}),
        },
        TEXT,
    ),
}


@dataclass(frozen=True)
class Conditions:
    """The conditions, besides devices, that a calibration and the decisions by it must share."""

    decisions: int  # version of the decisions
    rules: Rules
    pose_error_mm: float
    pose_error_deg: float
    min_confidence: float = 0.0
    suns: int = 1  # of each site, whose disparities are joined

    def to_json(self) -> dict[str, Any]:
        """Return the entries of the file."""
        return {
            "decisions": self.decisions,
            "rules": self.rules.to_json(),
            "pose_error": {"mm": self.pose_error_mm, "deg": self.pose_error_deg},
            "min_confidence": self.min_confidence,
            **({"suns": self.suns} if self.suns > 1 else {}),
        }


@dataclass(frozen=True)
class Calibration:
    """A calibration that was read. ``entries`` by label come from ``calibration.calibrate_matchers``."""

    path: Path
    goal: Goal
    conditions: Mapping[str, Any]
    devices: Mapping[str, Sequence[str]]
    grounds: frozenset[str]
    pairs_of_a_ground: int  # the fewest
    entries: Mapping[str, Mapping[str, Any]]


def check_target(path: Path) -> None:
    """Raise IcyMoonError if ``path`` is a folder, or a file that is not a calibration of this version."""
    if path.is_dir():
        raise IcyMoonError(f"--calibrate: {path} is a folder; give the path of a file.")
    if is_file(path):
        try:
            read_calibration(path)
        except IcyMoonError:
            raise IcyMoonError(
                f"--calibrate: {path} is not a calibration that this version can replace; give another path."
            ) from None


def write_calibration(
    path: Path,
    goal: Goal,
    conditions: Conditions,
    stated: Sequence[StatedPair],
    entries: Mapping[str, Mapping[str, Any]],
) -> None:
    """Write a calibration made from these pairs, with a digest of its content."""
    devices = {name: sorted({pair.devices[name] for pair in stated}) for name in stated[0].devices}
    content: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "icymoon": version(),
        "created": datetime.now(UTC).isoformat(" ", "seconds"),
        "goal": asdict(goal) | {"group_by": list(goal.group_by)},
        **conditions.to_json(),
        "devices": devices,
        "grounds": sorted({pair.ground for pair in stated}),
        "pairs_of_a_ground": count_fewest_pairs(stated),
        "features": list(FEATURES),
        "matchers": dict(entries),
    }
    write_json(path, content | {"digest": make_json_digest(content)})


def read_calibration(path: Path) -> Calibration:
    """Read a calibration. Raises IcyMoonError if the file is missing, damaged, changed or of another version."""
    data = read(path, _parse, "a calibration of decisions", _CALIBRATE_AGAIN, most=_MAX_BYTES)
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise IcyMoonError(f"{path} is not a calibration of decisions; give a file that decide --calibrate wrote.")
    if data.get("version") != VERSION:
        raise IcyMoonError(
            f"{path} has format version {quote(data.get('version'))}, but this Icy Moon reads {VERSION}; "
            f"{_CALIBRATE_AGAIN}."
        )
    digest = data.pop("digest", None)
    if digest != make_json_digest(data):
        raise IcyMoonError(f"{path} was changed after it was written; {_CALIBRATE_AGAIN}.")
    check_record(data, _SHAPE, path, _CALIBRATE_AGAIN)
    _check_content(data, path)
    return Calibration(
        path,
        _read_goal(data["goal"]),
        {key: data[key] for key in (*_CONDITIONS, "suns") if key in data},
        data["devices"],
        frozenset(data["grounds"]),
        data["pairs_of_a_ground"],
        data["matchers"],
    )


def _parse(foreign: ForeignBytes) -> Any:
    return parse_json(foreign.part(0, foreign.size))


def _check_content(data: Mapping[str, Any], path: Path) -> None:
    """Raise IcyMoonError if the file states numbers that no calibration can have."""
    entries = data["matchers"].values()
    groups = [group for entry in entries for group in entry["groups"]]
    fewest = Goal(data["goal"]["alpha"], data["goal"]["delta"], data["goal"]["procedure"]).fewest_grounds
    if data["features"] != list(FEATURES):
        raise IcyMoonError(f"{path} compares grounds by other numbers than this version; {_CALIBRATE_AGAIN}.")
    if not all(entry["groups"] for entry in entries):
        raise IcyMoonError(f"{path} has a matcher without grounds; {_CALIBRATE_AGAIN}.")
    for group in groups:
        if not fewest <= group["grounds"] == len(group["features"]) <= len(data["grounds"]):
            raise IcyMoonError(f"{path} states other numbers of grounds than it has; {_CALIBRATE_AGAIN}.")
    goal = _read_goal(data["goal"])
    for entry in entries:
        if not all(_can_follow(entry[risk], entry["groups"], goal) for risk in (CHOICE, MAP)):
            raise IcyMoonError(f"{path} states a margin that does not follow from its losses; {_CALIBRATE_AGAIN}.")


def _can_follow(risk: Mapping[str, Any], groups: Sequence[Mapping[str, Any]], goal: Goal) -> bool:
    """Return whether the margin of a risk with this sum of losses can be the strictest of its groups."""
    grounds, by_group = sum(group["grounds"] for group in groups), risk["by_group"]
    strictest = None if None in by_group else max(by_group, default=None)
    if len(by_group) != len(groups) or risk["threshold"] != strictest or risk["acted"] > grounds:
        return False
    return strictest is None or 0 <= risk["loss"] <= goal.alpha * grounds


def _read_goal(stated: Mapping[str, Any]) -> Goal:
    return Goal(stated["alpha"], stated["delta"], stated["procedure"], tuple(stated["group_by"]))


def _describe_suns(suns: int) -> str:
    return "one Sun for each decision" if suns == 1 else f"{suns} fused Suns for each decision"


def check_use(
    calibration: Calibration,
    conditions: Conditions,
    stated: Mapping[str, StatedPair],
    inputs: Mapping[str, str],
) -> None:
    """Raise IcyMoonError unless the calibration holds for these decisions.

    It holds for the same version, rules, matchers and devices, and for no ground of the calibration itself. ``stated``
    are the statements of pairs by name, ``inputs`` digests of the matchers by label.
    """
    refused = f"{calibration.path} gives no guarantee here:"
    own = conditions.to_json()
    for key, what in _CONDITIONS.items():
        if own[key] != calibration.conditions[key]:
            raise IcyMoonError(f"{refused} it was made with other {what}; calibrate again with these.")
    if conditions.suns != (suns := calibration.conditions.get("suns", 1)):
        raise IcyMoonError(
            f"{refused} it was made with {_describe_suns(suns)}, and these decisions are with "
            f"{_describe_suns(conditions.suns)}; decide on as many, or calibrate again with these."
        )
    for label, digest in inputs.items():
        if label not in calibration.entries:
            raise IcyMoonError(
                f"{refused} it was made without {name_matcher(label)}; calibrate again with this matcher."
            )
        if digest != calibration.entries[label]["inputs"]:
            raise IcyMoonError(
                f"{refused} it was made with other options, files or packages of {name_matcher(label)}; calibrate "
                "again with these."
            )
    most, numbers = calibration.pairs_of_a_ground, Counter((pair.ground, pair.group) for pair in stated.values())
    for name, pair in stated.items():
        if numbers[pair.ground, pair.group] > most:
            raise IcyMoonError(
                f"{refused} it was made with {format_count(most, 'pair')} of a ground, and {name} is one of "
                f"{numbers[pair.ground, pair.group]}; give at most {most} of a ground, or calibrate again with more."
            )
        if pair.ground in calibration.grounds:
            raise IcyMoonError(f"{refused} it was made with the ground of {name}; give pairs of other seeds.")
        for device, digest in pair.devices.items():
            if digest not in calibration.devices.get(device, ()):
                raise IcyMoonError(
                    f"{refused} it was made with another {device} than {name} has; calibrate again "
                    "with pairs like these."
                )
