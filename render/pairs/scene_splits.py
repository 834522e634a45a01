"""Names the scene and chooses the split of each pair in a data set. All pairs of one ground are in the same split."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path

from ...settings import pair_ids
from ...settings.table import TOPICS
from ...support.errors import IcyMoonError
from ...support.files import quote
from ...support.foreign_bytes import ForeignBytes, parse_json, parse_toml, read
from .pair_folder import Pair

_SPLIT_NAME = re.compile(r"[A-Za-z0-9_-]+")
#: Settings of the place of a ground in a file.
_PLACE_KEYS = (
    "site",
    "site_longitude_deg",
    "site_latitude_deg",
    "site_easting",
    "site_northing",
    "origin_x_m",
    "origin_y_m",
)
#: Default shares of the scenes in each split.
DEFAULT_SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1}


def name_scene(pair: Pair) -> str:
    """Name the ground and the rocks of a pair by twelve hexadecimal digits of all settings on which their shape
    depends.

    The seed counts. Surfaces, light, cameras and qualities do not: another Sun does not make another scene.
    """
    own = pair.id if pair.data.get("edited_by_hand") else pair.data.get("own_files_sha256", "")
    # As with ids of pairs: a setting that a later version adds leaves each scene in its split.
    shape = [
        [name, value]
        for part in pair_ids.list_counted_values(pair.settings)
        for name, value in part
        if _changes_shape(name)
    ]
    return _make_name([shape, own])


def name_independent_ground(pair: Pair) -> str:
    """Name the random numbers of a pair's ground, or the file and the place in it, by twelve hexadecimal digits.

    Grounds of different names are independent, as far as settings tell. Grounds of one name are not: terrain of a seed
    has one shape, which its settings scale, and ground from a file is the same for all seeds.
    """
    source = pair.settings.source
    if source.kind == "PROCEDURAL":
        return _make_name([source.kind, int(pair.settings.dataset.seed)])
    place = [getattr(source, key) for key in _PLACE_KEYS]
    return _make_name([source.kind, source.stand_in, pair.data.get("own_files_sha256", ""), place])


def _make_name(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


def _changes_shape(name: str) -> bool:
    """Return whether the shape of ground and rocks depends on a setting, or on an entry of its list."""
    topic, key, *_ = re.split(r"[. ]", pair_ids.find_present_name(name))
    return topic in TOPICS and any(s.key == key and s.effect == "geometry" for s in TOPICS[topic].settings)


def check_splits(splits: object) -> dict[str, float]:
    """Check the shares of a data set's splits by name; their sum must be 1. Raises IcyMoonError for other shares."""
    if not isinstance(splits, Mapping) or any(
        isinstance(share, bool) or not isinstance(share, int | float) for share in splits.values()
    ):
        raise IcyMoonError(f"The splits are {quote(splits)}; give each a share of the scenes, such as train = 0.9.")
    if bad := next((name for name in splits if not _SPLIT_NAME.fullmatch(name)), None):
        raise IcyMoonError(
            f"A split is called {quote(bad)}; use only letters, digits, - and _, because files get this name."
        )
    if not splits or min(splits.values()) < 0 or abs(sum(splits.values()) - 1) > 1e-6:
        shown = ", ".join(f"{name} {share:g}" for name, share in splits.items())
        raise IcyMoonError(f"The splits are {shown or 'none'}; give each a share of the scenes, with the sum 1.")
    return dict(splits)


def read_splits(dataset: Path) -> dict[str, float]:
    """Read the shares of splits in the plan of a data set; ``DEFAULT_SPLITS`` without a plan or without shares in it.

    Raises IcyMoonError for a plan with invalid shares.
    """
    try:
        text = read(dataset / "plan.jsonl", _parse_plan, "a list of planned pairs", "")
        stated = parse_toml(text).get("plan", {}).get("splits")
    except (IcyMoonError, ValueError, AttributeError):
        return DEFAULT_SPLITS
    try:
        return DEFAULT_SPLITS if stated is None else check_splits(stated)
    except IcyMoonError as error:
        raise IcyMoonError(f"{dataset / 'plan.jsonl'}: {error}") from None


def _parse_plan(foreign: ForeignBytes) -> str:
    """Parse the text of the plan from the first line of a frozen plan."""
    for most in (2**16, 2**21, 2**26):  # The plan is read for each pair, and the list may be long.
        first, end, _ = foreign.part(0, min(most, foreign.size)).partition(b"\n")
        if end or foreign.size <= most:
            return str(parse_json(first)["plan"])
    raise ValueError("its first line has no end")


def find_split_of_pair(pair: Pair) -> str:
    """Find the split of a pair, by the shares in the plan of its data set."""
    return choose_split(name_scene(pair), read_splits(pair.folder.parent.parent))


def choose_split(scene: str, splits: Mapping[str, float]) -> str:
    """Choose the split of a scene. It is drawn by the scene's name, so that it is independent of the rest of the data
    set.

    The shares hold for many scenes; with a few scenes, a split may stay empty.
    """
    drawn = int(hashlib.sha256(f"split {scene}".encode()).hexdigest()[:12], 16) / 16**12
    end = 0.0
    for name, share in splits.items():
        end += share
        if drawn < end:
            return name
    return next(name for name, share in reversed(list(splits.items())) if share > 0)
