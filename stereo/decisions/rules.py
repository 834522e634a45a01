"""The rules of safe sites and of landing pads: shipped with their sources, or from a user's TOML file."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.file_schemas import is_number
from ...support.files import quote, read_text, shorten
from ...support.foreign_bytes import describe_reason, parse_toml
from ...support.suggestions import suggest_nearest

SHIPPED_RULES = Path(__file__).with_suffix(".toml")


@dataclass(frozen=True)
class SiteRules:
    """Limits of a safe site, over a disc around it; lengths in metres."""

    disc_m: float
    slope_deg: float  # most slope of the plane under the disc
    roughness_m: float  # most root mean square distance from that plane
    rock_height_m: float  # height above the surrounding ground from which on an object is a rock
    rock_distance_m: float  # least distance to a rock
    joint_margin_deg: float  # least margin of each joint of the arm to its limit
    lit_share: float  # least share of the disc in sunlight; 0: not required
    lit_level: float  # share of the median level from which on a pixel is lit
    known_share: float  # least share of known cells in the disc
    tolerance: float  # an unsafe site that misses a limit by more than this share of it is dangerous, else marginal
    # Rules that apply only if a file states them.
    least_albedo: float | None = None  # albedo of the disc in even light, as the mean of the bands R, G, B
    most_albedo: float | None = None
    salt_share: float | None = None  # least share of the disc

    @property
    def needs_materials(self) -> bool:
        """Whether a rule limits albedo or salts."""
        return (self.least_albedo, self.most_albedo, self.salt_share) != (None, None, None)


@dataclass(frozen=True)
class PadRules:
    """Limits of a position for a landing pad. No part of the ground under it may be higher than ``rock_height_m``."""

    disc_m: float
    slope_deg: float
    rock_height_m: float
    known_share: float


@dataclass(frozen=True)
class CellRules:
    """How the points of a depth become heights of cells, and which errors of these heights are stated."""

    fewest_points: float  # points for a height of a cell
    gap_m: float  # widest gap between known cells that is filled; 0 fills none
    debias: float  # share of the stated error that is removed from roughness and slope; 0 removes none
    disparity_error_px: float  # standard deviation of a matcher's disparity; 0 if unknown
    error_width_px: float  # side of the square of pixels that share an error of a matcher


#: The rules of cells before version 0.4: three points, no filled gaps, roughness with the errors of the heights.
FIRST_CELLS = CellRules(3.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Rules:
    """The limits of a safe site (``site``) and of a landing pad (``pad``), and the heights of cells (``cells``)."""

    site: SiteRules
    pad: PadRules
    cells: CellRules = FIRST_CELLS

    def to_json(self) -> dict[str, dict[str, float]]:
        """Return the rules as JSON tables, without limits that do not apply."""
        tables: dict[str, dict[str, float | None]] = asdict(self)
        return {
            part: {key: value for key, value in table.items() if value is not None} for part, table in tables.items()
        }


_RULES_BY_TABLE = {"site": SiteRules, "pad": PadRules, "cells": CellRules}
_SHARE_RULES = ("lit_share", "known_share", "lit_level", "least_albedo", "most_albedo", "salt_share", "debias")
#: Rules whose value 0 switches a check or a step off.
_MAY_BE_ZERO = ("lit_share", "gap_m", "debias", "disparity_error_px", "tolerance")


def read_rules(path: Path | None = None) -> Rules:
    """Read the shipped rules, overridden by the rules of a TOML file. Raises IcyMoonError if the file is invalid."""
    tables = _read_rule_tables(SHIPPED_RULES)
    if path is not None:
        for part, own in _read_rule_tables(path).items():
            tables[part] |= own
    return Rules(**{part: kind(**tables[part]) for part, kind in _RULES_BY_TABLE.items()})


def _read_rule_tables(path: Path) -> dict[str, dict[str, float]]:
    try:
        data = parse_toml(read_text(path))
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read as rules ({describe_reason(error)}); give a TOML file.") from None
    data.pop("sources", None)
    found = {}
    for part, table in data.items():
        if part not in _RULES_BY_TABLE or not isinstance(table, dict):
            raise IcyMoonError(
                f"{path} states {shorten(part)}, which is not a table of rules; use [site], [pad] and [cells]."
            )
        found[part] = {key: _check_number(path, part, key, value) for key, value in table.items()}
    return found


def _check_number(path: Path, part: str, key: str, value: object) -> float:
    names = [field.name for field in fields(_RULES_BY_TABLE[part])]
    if key not in names:
        raise IcyMoonError(
            f"{path} states {shorten(f'{part}.{key}')}, which is not a rule; {suggest_nearest(key, names)}"
        )
    most = 1.0 if key in _SHARE_RULES else 90.0 if key.endswith("_deg") else math.inf
    zero = key in _MAY_BE_ZERO
    if not is_number(value) or not (0 < value <= most or (zero and value == 0)):
        raise IcyMoonError(
            f"{path}: {part}.{key} is {quote(value)}; give a number {'of 0 or more' if zero else 'above 0'}"
            f"{'' if most == math.inf else f' and at most {most:g}'}."
        )
    return float(value)
