"""A plain folder of pairs: ``pairs.toml`` names the images, the truth and the camera.

    [images]
    left = "left/{pair}.png"
    right = "right/{pair}.png"
    [truth]
    depth = "depth/{pair}.npy"
    [camera]
    focal_px = 341.3333
    baseline_m = 0.25

``{pair}`` stands for the name of a pair. ``images`` may have ``linear`` (true: the images are in proportion to light).
``truth`` has ``disparity`` (px) or ``depth`` (m), and may have ``steps`` (counts of the file per px or metre),
``channel`` (the name of the channel of an EXR file, or of the array of an npz, that holds the map),
``along`` ("ray" for distances from the eye, "axis" for depths along the optical axis),
``right`` (the same map of the right eye) and ``visible`` (an image that is 255 where the right eye sees the point too).
``camera`` may have ``cx_px`` and ``cy_px``, from the corner of the first pixel, and ``doffs_px``, the column of the
right principal point minus the column of the left one.
"""

from __future__ import annotations

import glob
import os
import re
import tomllib
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from ...physics.camera.stereo_camera import StereoCamera
from ...support.errors import IcyMoonError
from ...support.file_schemas import FLAG, NUMBER, POSITIVE, TEXT, Kind, Maybe, check_record, is_number
from ...support.files import list_put_there
from ...support.foreign_bytes import hint_on_paths, parse_toml
from ...support.suggestions import suggest_nearest
from .data_files import MapFile, find_inside, read_text
from .foreign_pair import ForeignPair, UnusablePair, open_foreign_pair, safe_name
from .visibility import Mask

FILE = "pairs.toml"
_PLACE = "{pair}"
_NOT_ZERO = Kind("a number other than 0", lambda value: is_number(value) and value != 0)
_ALONG = Kind('"axis" or "ray"', lambda value: value in ("axis", "ray"))
#: Of a focal length (px) or a baseline (m): beyond these no product of two is one of a camera.
_SIZE = Kind("a number from 1e-9 to 1e9", lambda value: POSITIVE.fits(value) and 1e-9 <= value <= 1e9)
_SHAPE: dict[str, dict[str, Any]] = {
    "images": {"left": TEXT, "right": TEXT, "linear": Maybe(FLAG)},
    "truth": {
        "disparity": Maybe(TEXT),
        "depth": Maybe(TEXT),
        "steps": Maybe(_NOT_ZERO),
        "right": Maybe(TEXT),
        "visible": Maybe(TEXT),
        "along": Maybe(_ALONG),
        "channel": Maybe(TEXT),
    },
    "camera": {
        "focal_px": _SIZE,
        "baseline_m": _SIZE,
        "cx_px": Maybe(NUMBER),
        "cy_px": Maybe(NUMBER),
        "doffs_px": Maybe(NUMBER),
    },
}
#: The tables and keys of the patterns of files.
_KEYS = {
    "left": ("images", "left"),
    "right": ("images", "right"),
    "disparity": ("truth", "disparity"),
    "depth": ("truth", "depth"),
    "visible": ("truth", "visible"),
    "truth_right": ("truth", "right"),
}
_FIX = "write it as the manual's page on foreign data shows"


def find_plain_pairs(root: Path) -> list[ForeignPair | UnusablePair]:
    """The pairs that ``pairs.toml`` in a folder names; empty if there is no such file.

    Raises IcyMoonError if it is wrong, or names no left image, or a file that no pair has.
    """
    if not (root / FILE).exists():
        return []
    path = find_inside(root, FILE)
    data = parse_pairs_toml(path)
    patterns = {
        name: _check_pattern(path, key, data[table][key]) for name, (table, key) in _KEYS.items() if key in data[table]
    }
    kind = _truth_kind(path, patterns)
    names = _list_pair_names(root, patterns["left"])
    if not names:
        raise IcyMoonError(f"{path}: there is no file {patterns['left']}; correct images.left.")
    for key, pattern in patterns.items():  # files of single pairs may be missing, which costs these only
        if not any(os.path.lexists(root / pattern.replace(_PLACE, name)) for name in names):
            raise IcyMoonError(
                f"{path}: there is no file {pattern} of any pair, such as "
                f"{pattern.replace(_PLACE, names[0])}; correct {'.'.join(_KEYS[key])}."
            )
    return [
        open_foreign_pair(
            safe_name(name),
            root,
            root / patterns["left"].replace(_PLACE, name),
            partial(_make_pair, root, path, name, kind, patterns, data),
        )
        for name in names
    ]


def _truth_kind(path: Path, patterns: dict[str, str]) -> str:
    """Whether the truth is ``disparity`` or ``depth``. Raises IcyMoonError unless one alone is named."""
    kinds = [kind for kind in ("disparity", "depth") if kind in patterns]
    if len(kinds) != 1:
        raise IcyMoonError(
            f"{path}: the table truth names {'disparity and depth' if kinds else 'no files'}; name "
            "either disparity or depth in it."
        )
    if patterns.get("truth_right") == patterns[kinds[0]]:
        raise IcyMoonError(
            f"{path}: truth.right names the files of truth.{kinds[0]}, which are of the left eye; name "
            "those of the right eye, or leave it out."
        )
    return kinds[0]


def parse_pairs_toml(path: Path) -> dict[str, Any]:
    """The content of a ``pairs.toml``. Raises IcyMoonError for an unknown, missing or wrong key."""
    try:
        data = parse_toml(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise IcyMoonError(f"{path} is not TOML ({error}){hint_on_paths(error)}; {_FIX}.") from None
    check_record(data, _SHAPE, path, _FIX)
    for table, keys in data.items():
        if table not in _SHAPE:
            raise IcyMoonError(f"{path}: unknown table {table}, {suggest_nearest(table, _SHAPE)}")
        for key in keys:
            if key not in _SHAPE[table]:
                raise IcyMoonError(f"{path}: unknown key {table}.{key}, {suggest_nearest(key, _SHAPE[table])}")
    return data


def _check_pattern(path: Path, key: str, pattern: str) -> str:
    parts = PurePosixPath(pattern).parts
    if not pattern or ".." in parts or PurePosixPath(pattern).is_absolute() or any(each in pattern for each in "\\:\0"):
        raise IcyMoonError(
            f"{path}: {key} is {pattern[:60]!r}, and only files in this folder are read; write a path "
            "in it, with / between folders."
        )
    if _PLACE not in pattern:
        raise IcyMoonError(
            f"{path}: {key} is {pattern[:60]!r}, the same file for all pairs; write {_PLACE} where the "
            "name of the pair stands."
        )
    if _PLACE * 2 in pattern:
        raise IcyMoonError(
            f"{path}: {key} is {pattern[:60]!r}, with {_PLACE} twice without anything between; write it once there."
        )
    return pattern


def _list_pair_names(root: Path, pattern: str) -> list[str]:
    """The names of all pairs for which there is a left image, sorted."""
    wildcard = "*".join(glob.escape(part) for part in pattern.split(_PLACE))
    first, *rest = (re.escape(part) for part in pattern.split(_PLACE))
    matching = re.compile(first + r"(?P<pair>[^/]+?)" + "(?P=pair)".join(rest))
    found = (matching.fullmatch(file.relative_to(root).as_posix()) for file in list_put_there(root, wildcard))
    return sorted({match["pair"] for match in found if match})


def _make_pair(
    root: Path, path: Path, name: str, kind: str, patterns: dict[str, str], data: dict[str, Any]
) -> ForeignPair:
    def file(key: str) -> Path:
        return find_inside(root, patterns[key].replace(_PLACE, name))

    steps, along_ray = data["truth"].get("steps"), data["truth"].get("along") == "ray"
    channel = data["truth"].get("channel")
    if along_ray and kind != "depth":
        raise IcyMoonError(f"{path}: truth.along is of depths, and there are disparities; leave it out.")
    return ForeignPair(
        safe_name(name),
        root,
        "Plain folder",
        name,
        file("left"),
        file("right"),
        MapFile(file(kind), kind, steps, along_ray, channel=channel),
        partial(_make_camera, data["camera"]),
        (path,),
        MapFile(file("truth_right"), kind, steps, along_ray, channel=channel) if "truth_right" in patterns else None,
        Mask("seen", (file("visible"),)) if "visible" in patterns else None,
        linear=data["images"].get("linear", False),
    )


def _make_camera(stated: dict[str, float], width: int, height: int) -> StereoCamera:
    return StereoCamera(
        width,
        height,
        stated["focal_px"],
        stated.get("cx_px", width / 2),
        stated.get("cy_px", height / 2),
        stated["baseline_m"],
        doffs_px=stated.get("doffs_px", 0.0),
    )
