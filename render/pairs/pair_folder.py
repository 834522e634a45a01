"""The pair folder: the interface between rendering and measurement.

``<dataset>/pairs/<id>/`` holds ``left.exr``, ``right.exr`` and ``pair.json``; if images are blurred, eyes are toed
in or a panorama shows them, the truth is in separate files, and so is the truth on the sensors of calibrated eyes. A
pair is written as ``<id>.part`` and renamed when ``pair.json`` is in it, so a folder without the suffix that has a
``pair.json`` is complete. Images are linear radiance in W/(m² sr) per band; truth is sampled at pixel centres and never
antialiased. Imports no Blender.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.blur import is_blurred
from ...physics.camera.eyes import add_calibrated_eyes, eyes_json, make_camera_with_eyes
from ...physics.camera.head_camera import HEAD_CAMERA_SHAPE, HeadCamera, camera_from_json, is_plain
from ...physics.camera.rolling_shutter import RollingShutter, find_rolling_shutter
from ...physics.camera.stereo_camera import CAMERA_SHAPE, StereoCamera
from ...physics.light.scene_sun import SceneSun, sun_from_json
from ...settings.description import Restorer, merged, restore_settings
from ...settings.rebuilt_parts import select_response
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.file_schemas import (
    COUNT,
    FILE_NAME,
    FLAG,
    MATRIX,
    NUMBER,
    POSITIVE,
    SHA256,
    TABLE,
    TEXT,
    WHOLE,
    Each,
    Kind,
    Maybe,
    check_record,
    find_fault,
)
from ...support.files import PART_SUFFIX, hash_file, quote, read_text, replace_if_unchanged, to_json_text
from ...support.foreign_bytes import describe_reason, parse_json
from .check_pair_record import find_contradictions
from .dataset_file_names import check_id, check_no_link, is_regular_file, pairs_folder
from .head_files import image_file, truth_file
from .workspace_cells import list_workspace_files

FORMAT = "icymoon-pair"
VERSION = 1
EYES = ("left", "right")
_IMAGE_FILES = tuple(f"{eye}.exr" for eye in EYES)
TRUTH_FILE, TOED_TRUTH_FILE, RAW_TRUTH_FILE = "{}_truth.exr", "{}_toed_truth.exr", "{}_raw_truth.exr"


@dataclass(frozen=True)
class Pair:
    """A complete pair on disk."""

    folder: Path
    id: str
    settings: Settings  # complete; ``data`` has them as written
    camera: StereoCamera
    data: dict[str, Any]  # the whole of pair.json
    head: tuple[HeadCamera, ...] = ()  # cameras beside the pair, in the world's axes

    @property
    def has_eyes(self) -> bool:
        """Whether the pair has the images of both eyes, besides the images of the head."""
        return _has_eyes(self.settings)

    def image(self, eye: str) -> Path:
        """Return the path of the radiance image, ``left.exr`` or ``right.exr``. Raises IcyMoonError if the pair has no
        images of eyes."""
        if not self.has_eyes:
            raise IcyMoonError(
                f"{self.folder} has no stereo pair, only cameras of a head (rig.images is HEAD); export it as head, "
                "or render it with rig.images PAIR."
            )
        return self.folder / f"{eye}.exr"

    def truth(self, eye: str) -> Path:
        """Return the file with the truth of an eye of the parallel rig: the image's file, unless the pair has a
        separate one."""
        return self._file_or_image(eye, TRUTH_FILE)

    def truth_of_image(self, eye: str) -> Path:
        """Return the file with the truth at the pixels of the rendered image; a separate file if the eyes are toed
        in."""
        return self._file_or_image(eye, TOED_TRUTH_FILE) if self.camera.toe_in_deg else self.truth(eye)

    def truth_of_sensor(self, eye: str) -> Path:
        """Return the file with the truth at the pixels of a calibrated eye's sensor: ``left_raw_truth.exr`` or
        ``right_raw_truth.exr``."""
        return self.folder / RAW_TRUTH_FILE.format(eye)

    @property
    def name(self) -> str:
        """The name of the pair in a data set and in results."""
        return self.folder.name

    @property
    def sun(self) -> SceneSun | None:
        """The Sun that lit the images; None if the pair does not state it."""
        return sun_from_json(self.data.get("light"))

    @property
    def rectified_poses(self) -> dict[str, Any] | None:
        """Camera-to-world matrices of the eyes of the parallel rig; None if the pair does not state them."""
        return self.data.get("poses_rectified_to_world") or self.data.get("poses_camera_to_world")

    def rectified_pose(self, eye: str) -> Array | None:
        """Return the matrix (4, 4) from an eye of the parallel rig, in OpenCV's axes, to the world; None without a
        pose."""
        try:
            pose = np.array((self.rectified_poses or {})[eye], np.float64)
        except (KeyError, TypeError, ValueError):
            return None
        return pose if pose.shape == (4, 4) and np.isfinite(pose).all() else None

    @property
    def rolling_shutter(self) -> RollingShutter | None:
        """The times and the motion of the rows; None if all rows have one pose."""
        return find_rolling_shutter(self.settings.rig)

    def row_poses(self, eye: str) -> Array | None:
        """Return the ``rectified_pose`` of an eye, (4, 4), or, with a rolling shutter, the poses of its rows,
        (H, 4, 4). None without a pose."""
        pose, shutter = self.rectified_pose(eye), self.rolling_shutter
        if pose is None or shutter is None:
            return pose
        return shutter.list_poses(pose, self.camera.find_offset_m(eye))

    def _file_or_image(self, eye: str, name: str) -> Path:
        return self.folder / name.format(eye) if name.format(eye) in self.data["files"] else self.image(eye)


def refuse_rolling_shutter(pair: Pair, why: str, fix: str) -> None:
    """Raise IcyMoonError if the rows of a pair have different poses. ``why`` and ``fix`` are parts of the error's
    sentence."""
    if pair.rolling_shutter is not None:
        raise IcyMoonError(f"{pair.folder} has a rolling shutter (rig.readout_s), and {why}; {fix}.")


def describe_rolling_shutter(pair: Pair) -> dict[str, Any]:
    """Return the entry ``rolling_shutter`` for the calibrations of exports; empty if all rows have one pose."""
    return {} if pair.rolling_shutter is None else {"rolling_shutter": pair.rolling_shutter.to_json()}


#: Makes complete settings of stored settings: ``description.restore_settings``, or a ``Restorer`` for many pairs.
Restore = Callable[[Mapping[str, Any], str, str], Settings]
_RENDER_AGAIN = "move the folder away and render the pair again"
#: The settings of a pair, and the versions of the programs that wrote them.
_SETTINGS_SHAPE = {"settings": Each(TABLE, TEXT), "versions": Maybe(Each(TEXT, TEXT))}
_FILES_SHAPE = {"files": Each({"bytes": COUNT, "sha256": SHA256}, FILE_NAME)}
_PAIR_FILES_SHAPE = {"files": Each(TABLE, FILE_NAME, _IMAGE_FILES)}
#: Settings of a data set without the pair's own images.
_HEAD_ONLY = {"settings": {"rig": {"images": Kind("HEAD", "HEAD".__eq__)}}}
_MATRIX_BY_EYE = Maybe(dict.fromkeys(EYES, MATRIX))
_NAMED_NUMBERS = Maybe(Each(NUMBER, TEXT))
#: Entries of ``pair.json`` that are read here; for the settings see ``settings.check``.
_PAIR_SHAPE = {
    "format": TEXT,
    "version": COUNT,
    "id": TEXT,
    **_SETTINGS_SHAPE,
    **_FILES_SHAPE,
    "camera": CAMERA_SHAPE,
    "poses_camera_to_world": _MATRIX_BY_EYE,
    "poses_rectified_to_world": _MATRIX_BY_EYE,
    "edited_by_hand": Maybe(FLAG),
    "own_files_sha256": Maybe(TEXT),
    "left_out": Maybe(Each(TEXT)),
    "seeds": Maybe(Each(WHOLE, TEXT)),
    "device": Maybe(TEXT),
    "denoiser": Maybe(TEXT),
    "platform": Maybe(TEXT),
    "osl": Maybe(FLAG),
    "workspace": Maybe(
        {
            "file": FILE_NAME,
            "cell_m": POSITIVE,
            "origin_m": Each(NUMBER),
            "shape": Each(COUNT),
            "materials": Maybe(FILE_NAME),
        }
    ),
    "head": Maybe(Each(HEAD_CAMERA_SHAPE)),
    "light": Maybe(TABLE),
    "blur": Maybe(TABLE, null=True),
    "seconds": _NAMED_NUMBERS,
    "cpu_seconds": _NAMED_NUMBERS,
    "peak_memory_mib": Maybe(NUMBER, null=True),
}


def _read_pair_json(path: Path) -> str:
    try:
        return read_text(path)
    except FileNotFoundError:
        if pairs_folder(path.parent).is_dir():
            raise IcyMoonError(
                f"{path.parent} is a data set, not a pair; give the folder of one of its pairs, in "
                f"{pairs_folder(path.parent)}."
            ) from None
        raise IcyMoonError(f"{path.parent} is not a complete stereo pair (no pair.json); render it again.") from None
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_RENDER_AGAIN}.") from None


def _parse_pair_json(path: Path, text: str) -> Any:
    try:
        return parse_json(text)
    except ValueError as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_RENDER_AGAIN}.") from None


def read_pair(folder: Path, restore: Restore = restore_settings) -> Pair:
    """Read a pair from its ``pair.json``. Raises IcyMoonError if it is missing, foreign or incomplete.

    ``restore`` is a ``Restorer`` for many pairs.
    """
    path = folder / "pair.json"
    return check_pair(folder, _parse_pair_json(path, _read_pair_json(path)), restore)


def check_pair(folder: Path, data: object, restore: Restore = restore_settings) -> Pair:
    """Make the pair of a ``pair.json`` with this content. For ``restore`` and the errors see ``read_pair``."""
    path = folder / "pair.json"
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise IcyMoonError(f"{path} is not an Icy Moon pair; choose a folder that Render Stereo Pair wrote.")
    if data.get("version") != VERSION:
        raise IcyMoonError(
            f"{path} has format version {quote(data.get('version'))}, but this Icy Moon reads {VERSION}; use the "
            "version that wrote it."
        )
    check_record(data, _PAIR_SHAPE, path, _RENDER_AGAIN)
    check_record(data, _make_file_schema(data), path, _RENDER_AGAIN)
    settings = restore(data["settings"], str(path), data.get("versions", {}).get("icymoon", ""))
    camera, head = _make_camera(data["camera"], settings, path), _read_head(data.get("head", []), path)
    pair = Pair(folder, check_id(data["id"], path), settings, camera, data, head)
    _check_statements(pair, path)
    for eye in EYES if pair.has_eyes else ():
        if not pair.image(eye).is_file():
            raise IcyMoonError(f"{pair.image(eye)} is missing; {_RENDER_AGAIN}.")
    return pair


def _make_camera(stated: dict[str, Any], settings: Settings, path: Path) -> StereoCamera:
    """Make the camera of a ``pair.json``, with the calibrated eyes of its settings."""
    try:
        return add_calibrated_eyes(StereoCamera.from_json(stated), settings)
    except ValueError as error:
        raise IcyMoonError(f"{path}: no camera follows from its settings ({error}); {_RENDER_AGAIN}.") from None


def _read_head(stated: list[dict[str, Any]], path: Path) -> tuple[HeadCamera, ...]:
    """Read the cameras of a head from a ``pair.json``."""
    try:
        return tuple(map(camera_from_json, stated))
    except ValueError as error:
        raise IcyMoonError(f"{path}: its head gives no camera ({error}); {_RENDER_AGAIN}.") from None


def _has_eyes(settings: Settings) -> bool:
    return bool(settings.rig.images == "PAIR")


def _make_file_schema(data: dict[str, Any]) -> Mapping[str, Any]:
    """Make the required shape of the files in a ``pair.json``, in addition to the shape that all files have."""
    return {} if not find_fault(data, _HEAD_ONLY) else _PAIR_FILES_SHAPE


def _check_statements(pair: Pair, path: Path) -> None:
    """Raise IcyMoonError if the entries of a pair's ``pair.json`` contradict its settings."""
    try:
        clause = next(_find_contradictions(pair), "")
    except (ValueError, ArithmeticError) as error:
        clause = f"no pair follows from its settings ({error})"
    if clause:
        raise IcyMoonError(f"{path}: {clause}; {_RENDER_AGAIN}.")


def _find_contradictions(pair: Pair) -> Iterator[str]:
    """Yield a clause for each entry of a pair's ``pair.json`` that contradicts its settings."""
    camera = make_camera_with_eyes(pair.settings)
    stated = {**pair.data, "camera": {**pair.data["camera"], **_numbers_of(pair.camera)}}
    yield from find_contradictions(
        stated, pair.settings, {**_numbers_of(camera), **camera.to_json()}, eyes_json(camera, pair.settings.rig)
    )
    if bool(pair.head) != bool(pair.settings.rig.head_file):
        yield f"head has {len(pair.head)} cameras, and rig.head_file is {quote(pair.settings.rig.head_file)}"
    if len({each.name.lower() for each in pair.head}) < len(pair.head):
        yield "head has two cameras of one name"
    wanted, there = _list_file_names(pair.settings, camera) | _list_head_files(pair), pair.data["files"].keys()
    yield from (f"files lacks {name}, which its settings require" for name in sorted(wanted - there))
    yield from (f"files has {name}, which its settings exclude" for name in sorted(there - wanted))


def _numbers_of(camera: StereoCamera) -> dict[str, Any]:
    return asdict(replace(camera, eyes=None, panorama=None))


def _list_file_names(settings: Settings, camera: StereoCamera) -> set[str]:
    """List the names of the files of a pair with these settings, besides ``pair.json``."""
    kinds = [
        "{}.exr",
        *([TRUTH_FILE] if camera.toe_in_deg or camera.panorama or is_blurred(settings.rig) else []),
        *([TOED_TRUTH_FILE] if camera.toe_in_deg else []),
        *([RAW_TRUTH_FILE] if camera.eyes else []),
    ]
    seen = {kind.format(eye) for kind in kinds for eye in EYES} if _has_eyes(settings) else set[str]()
    return seen | {*list_workspace_files(settings.workspace)}


def _list_head_files(pair: Pair) -> set[str]:
    """List the required names of the files of the cameras beside a pair."""
    return {image_file(each.name) for each in pair.head} | {
        truth_file(each.name) for each in pair.head if not is_plain(each.projection)
    }


def is_complete(folder: Path) -> bool:
    """Return whether a pair exists and can be read, see ``is_whole``. False if the system refuses."""
    return read_complete(folder) is not None


def read_complete(folder: Path) -> dict[str, Any] | None:
    """Read the content of the ``pair.json`` of a whole, readable pair, see ``read_whole``; None for any other pair."""
    try:
        return read_whole(folder)
    except OSError:
        return None


def is_whole(folder: Path) -> bool:
    """Return whether a pair exists: ``pair.json``, which is written last, and images of the sizes in it.

    Raises OSError if the system refuses to tell.
    """
    return read_whole(folder) is not None


def read_whole(folder: Path) -> dict[str, Any] | None:
    """Read the ``pair.json`` of a complete pair, see ``is_whole``; None without a complete pair.

    A link may lead to anyone's files, so a pair that is a link, or has one, counts as absent. Raises OSError if the
    system refuses to tell.
    """
    try:
        path = folder / "pair.json"
        # Reading a pipe would block.
        if folder.is_symlink() or not is_regular_file(path):
            return None
        data = parse_json(read_text(path))
        return dict(data) if has_stated_files(folder, data) else None
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None


def has_stated_files(folder: Path, data: Any) -> bool:
    """Return whether all files listed in ``data``, the content of a ``pair.json``, exist with the sizes listed there.

    Raises OSError if the system refuses to tell.
    """
    return (
        not find_fault(data, _FILES_SHAPE)
        and not find_fault(data, _make_file_schema(data))
        and all(
            is_regular_file(folder / name) and (folder / name).stat().st_size == fact["bytes"]
            for name, fact in data["files"].items()
        )
    )


def has_response(
    folder: Path, data: Mapping[str, Any], settings: Settings, restore: Restore = restore_settings
) -> bool:
    """Return whether a pair has the camera response of these settings. ``data`` is the content of its ``pair.json``."""
    path = folder / "pair.json"
    check_record(data, _SETTINGS_SHAPE, path, _RENDER_AGAIN)
    stated = restore(data["settings"], str(path), data.get("versions", {}).get("icymoon", ""))
    return select_response(stated) == select_response(settings)


def update_response(folder: Path, settings: Settings) -> None:
    """Write the camera response of these settings into a complete pair, without a new render.

    If another pair takes its place meanwhile, that pair gets the response. Raises IcyMoonError if the disk refuses.
    """
    path = folder / "pair.json"
    check_no_link(folder, path)
    before = _read_pair_json(path)
    data = _parse_pair_json(path, before)
    # Settings are compared as read, so a setting that is newer than the file makes no difference.
    if has_response(folder, data, settings):
        return
    now = to_json_text({**data, "settings": merged(data["settings"], select_response(settings))})
    if not replace_if_unchanged(path, before, now):
        update_response(folder, settings)


def find_pair_folders(path: Path) -> list[Path]:
    """Find the folders of the complete pairs at ``path``: a pair folder, a ``pairs`` folder or a data set.

    Raises IcyMoonError if there is no complete pair at ``path``.
    """
    folders = [path.resolve()] if os.path.lexists(path / "pair.json") else sorted(_find_pairs_in(path))
    if not folders:
        raise IcyMoonError(f"{path} contains no complete stereo pair; render one first or choose another folder.")
    return folders


def _find_pairs_in(path: Path) -> Iterator[Path]:
    root = pairs_folder(path) if pairs_folder(path).is_dir() else path
    return (p.parent for p in root.glob("*/pair.json") if not p.parent.name.endswith(PART_SUFFIX))


def has_pairs(path: Path) -> bool:
    """Return whether there is a complete pair at ``path``, see ``find_pair_folders``."""
    return os.path.lexists(path / "pair.json") or next(_find_pairs_in(path), None) is not None


def find_pairs(path: Path) -> list[Pair]:
    """Find and read the complete pairs at ``path``; see ``find_pair_folders`` and ``read_pair``."""
    restore = Restorer()
    return [read_pair(folder, restore) for folder in find_pair_folders(path)]


def find_changed_files(pair: Pair) -> list[str]:
    """Find the names of the pair's files whose content has changed since the render."""
    return [
        name
        for name, fact in pair.data["files"].items()
        if not (pair.folder / name).is_file() or hash_file(pair.folder / name) != fact["sha256"]
    ]


def read_unchanged_pair(folder: Path) -> Pair:
    """Read a pair as ``read_pair`` does. Raises IcyMoonError also if a file has changed since the render."""
    pair = read_pair(folder)
    changed = find_changed_files(pair)
    if changed:
        raise IcyMoonError(
            f"{folder / changed[0]} is not the file that was rendered (its checksum differs); {_RENDER_AGAIN}."
        )
    return pair
