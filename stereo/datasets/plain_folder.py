"""Reads a plain folder of pairs: ``pairs.toml`` names the images, the truth and the camera.

    [images]
    left = "left/{pair}.png"
    right = "right/{pair}.png"
    [truth]
    depth = "depth/{pair}.npy"
    [camera]
    focal_px = 341.3333
    baseline_m = 0.25

``{pair}`` stands for the name of a pair. ``images`` may have ``linear`` (true: the images are proportional to light).
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
from ...support.files import list_user_files
from ...support.foreign_bytes import make_path_hint, parse_toml
from ...support.suggestions import suggest_nearest
from .data_files import MapFile, read_text, resolve_inside
from .foreign_pair import ForeignPair, UnusablePair, make_safe_name, open_foreign_pair
from .visibility import Mask

PAIRS_FILE = "pairs.toml"
_NAME_PLACE = "{pair}"
_NONZERO = Kind("a number other than 0", lambda value: is_number(value) and value != 0)
_DEPTH_DIRECTION = Kind('"axis" or "ray"', lambda value: value in ("axis", "ray"))
#: A focal length (px) or a baseline (m). Outside these limits, the product of the two overflows or underflows.
_CAMERA_LENGTH = Kind("a number from 1e-9 to 1e9", lambda value: POSITIVE.fits(value) and 1e-9 <= value <= 1e9)
_FILE_SHAPE: dict[str, dict[str, Any]] = {
    "images": {"left": TEXT, "right": TEXT, "linear": Maybe(FLAG)},
    "truth": {
        "disparity": Maybe(TEXT),
        "depth": Maybe(TEXT),
        "steps": Maybe(_NONZERO),
        "right": Maybe(TEXT),
        "visible": Maybe(TEXT),
        "along": Maybe(_DEPTH_DIRECTION),
        "channel": Maybe(TEXT),
    },
    "camera": {
        "focal_px": _CAMERA_LENGTH,
        "baseline_m": _CAMERA_LENGTH,
        "cx_px": Maybe(NUMBER),
        "cy_px": Maybe(NUMBER),
        "doffs_px": Maybe(NUMBER),
    },
}
#: The tables and keys of the patterns of files.
_PATTERN_KEYS = {
    "left": ("images", "left"),
    "right": ("images", "right"),
    "disparity": ("truth", "disparity"),
    "depth": ("truth", "depth"),
    "visible": ("truth", "visible"),
    "truth_right": ("truth", "right"),
}
_WRITE_AS_IN_MANUAL = "write it as the manual's page on foreign data shows"


def find_plain_pairs(root: Path) -> list[ForeignPair | UnusablePair]:
    """Find the pairs that a folder's ``pairs.toml`` names; empty without this file.

    Raises IcyMoonError if the file is wrong, if no left image exists, or if a named file exists for no pair.
    """
    if not (root / PAIRS_FILE).exists():
        return []
    path = resolve_inside(root, PAIRS_FILE)
    data = parse_pairs_toml(path)
    patterns = {
        name: _check_pattern(path, key, data[table][key])
        for name, (table, key) in _PATTERN_KEYS.items()
        if key in data[table]
    }
    kind = _find_truth_kind(path, patterns)
    names = _list_pair_names(root, patterns["left"])
    if not names:
        raise IcyMoonError(f"{path}: there is no file {patterns['left']}; correct images.left.")
    for key, pattern in patterns.items():  # a missing file of a single pair costs only that pair
        if not any(os.path.lexists(root / pattern.replace(_NAME_PLACE, name)) for name in names):
            raise IcyMoonError(
                f"{path}: there is no file {pattern} of any pair, such as "
                f"{pattern.replace(_NAME_PLACE, names[0])}; correct {'.'.join(_PATTERN_KEYS[key])}."
            )
    return [
        open_foreign_pair(
            make_safe_name(name),
            root,
            root / patterns["left"].replace(_NAME_PLACE, name),
            partial(_make_pair, root, path, name, kind, patterns, data),
        )
        for name in names
    ]


def _find_truth_kind(path: Path, patterns: dict[str, str]) -> str:
    """Return whether the truth is ``disparity`` or ``depth``. Raises IcyMoonError unless exactly one is named."""
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
    """Parse the content of a ``pairs.toml``. Raises IcyMoonError for an unknown, missing or wrong key."""
    try:
        data = parse_toml(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise IcyMoonError(f"{path} is not TOML ({error}){make_path_hint(error)}; {_WRITE_AS_IN_MANUAL}.") from None
    check_record(data, _FILE_SHAPE, path, _WRITE_AS_IN_MANUAL)
    for table, keys in data.items():
        if table not in _FILE_SHAPE:
            raise IcyMoonError(f"{path}: unknown table {table}, {suggest_nearest(table, _FILE_SHAPE)}")
        for key in keys:
            if key not in _FILE_SHAPE[table]:
                raise IcyMoonError(f"{path}: unknown key {table}.{key}, {suggest_nearest(key, _FILE_SHAPE[table])}")
    return data


def _check_pattern(path: Path, key: str, pattern: str) -> str:
    parts = PurePosixPath(pattern).parts
    if not pattern or ".." in parts or PurePosixPath(pattern).is_absolute() or any(each in pattern for each in "\\:\0"):
        raise IcyMoonError(
            f"{path}: {key} is {pattern[:60]!r}, and only files in this folder are read; write a path "
            "in it, with / between folders."
        )
    if _NAME_PLACE not in pattern:
        raise IcyMoonError(
            f"{path}: {key} is {pattern[:60]!r}, the same file for all pairs; write {_NAME_PLACE} where the "
            "name of the pair stands."
        )
    if _NAME_PLACE * 2 in pattern:
        raise IcyMoonError(f"{path}: {key} is {pattern[:60]!r}, with {_NAME_PLACE} twice in a row; write it once.")
    return pattern


def _list_pair_names(root: Path, pattern: str) -> list[str]:
    """List the names of all pairs with a left image, sorted."""
    wildcard = "*".join(glob.escape(part) for part in pattern.split(_NAME_PLACE))
    first, *rest = (re.escape(part) for part in pattern.split(_NAME_PLACE))
    matching = re.compile(first + r"(?P<pair>[^/]+?)" + "(?P=pair)".join(rest))
    found = (matching.fullmatch(file.relative_to(root).as_posix()) for file in list_user_files(root, wildcard))
    return sorted({match["pair"] for match in found if match})


def _make_pair(
    root: Path, path: Path, name: str, kind: str, patterns: dict[str, str], data: dict[str, Any]
) -> ForeignPair:
    def resolve_file(key: str) -> Path:
        return resolve_inside(root, patterns[key].replace(_NAME_PLACE, name))

    steps, along_ray = data["truth"].get("steps"), data["truth"].get("along") == "ray"
    channel = data["truth"].get("channel")
    if along_ray and kind != "depth":
        raise IcyMoonError(f"{path}: truth.along applies to depths, but the truth has disparities; leave it out.")
    return ForeignPair(
        make_safe_name(name),
        root,
        "Plain folder",
        name,
        resolve_file("left"),
        resolve_file("right"),
        MapFile(resolve_file(kind), kind, steps, along_ray, channel=channel),
        partial(_make_camera, data["camera"]),
        (path,),
        MapFile(resolve_file("truth_right"), kind, steps, along_ray, channel=channel)
        if "truth_right" in patterns
        else None,
        Mask("seen", (resolve_file("visible"),)) if "visible" in patterns else None,
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
