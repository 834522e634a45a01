"""The pair folder: the contract between rendering and everything that measures.

``<dataset>/pairs/<id>/`` holds ``left.exr``, ``right.exr`` and ``pair.json``; if images are blurred or eyes are toed
in, the truth is in separate files, and so is the truth on the sensors of calibrated eyes. A pair is written as
``<id>.part`` and renamed when ``pair.json`` is in it, so a folder without the suffix that has a ``pair.json`` is
complete. Images are linear radiance in W/(m² sr) per band; truth is sampled at pixel centres and never antialiased.
Imports no Blender.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.blur import is_blurred
from ...physics.camera.eyes import camera_of, eyes_json, eyes_of
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
    Maybe,
    check_record,
    find_fault,
)
from ...support.files import PART_SUFFIX, hash_file, quote, read_text, replace_if_unchanged, to_json_text
from ...support.foreign_bytes import describe_reason, parse_json
from .check_pair_record import find_contradictions
from .dataset_file_names import check_id, check_no_link, is_regular_file, pairs_folder
from .workspace_cells import workspace_files

FORMAT = "icymoon-pair"
VERSION = 1
EYES = ("left", "right")
_IMAGES = tuple(f"{eye}.exr" for eye in EYES)
TRUTH_FILE, TOED_TRUTH_FILE, RAW_TRUTH_FILE = "{}_truth.exr", "{}_toed_truth.exr", "{}_raw_truth.exr"


@dataclass(frozen=True)
class Pair:
    """A complete pair on disk."""

    folder: Path
    id: str
    settings: Settings  # complete; ``data`` has them as they were written
    camera: StereoCamera
    data: dict[str, Any]  # the whole of pair.json

    def image(self, eye: str) -> Path:
        """Path of ``left.exr`` or ``right.exr``, the light."""
        return self.folder / f"{eye}.exr"

    def truth(self, eye: str) -> Path:
        """The file with the truth of the parallel rig's eye: the image's file, unless the pair has a separate one."""
        return self._file_or_image(eye, TRUTH_FILE)

    def truth_of_image(self, eye: str) -> Path:
        """The file with the truth on the pixels of the rendered image, which differs if the eyes are toed in."""
        return self._file_or_image(eye, TOED_TRUTH_FILE) if self.camera.toe_in_deg else self.truth(eye)

    def truth_of_sensor(self, eye: str) -> Path:
        """The file with the truth on the pixels of a calibrated eye's sensor: ``left_raw_truth.exr`` or
        ``right_raw_truth.exr``."""
        return self.folder / RAW_TRUTH_FILE.format(eye)

    @property
    def name(self) -> str:
        """Its name in a data set and in results."""
        return self.folder.name

    @property
    def sun(self) -> SceneSun | None:
        """The Sun that lit its images; None if the pair does not contain it."""
        return sun_from_json(self.data.get("light"))

    @property
    def rectified_poses(self) -> dict[str, Any] | None:
        """Camera-to-world matrices of the eyes of the parallel rig; None if the pair does not contain them."""
        return self.data.get("poses_rectified_to_world") or self.data.get("poses_camera_to_world")

    def rectified_pose(self, eye: str) -> Array | None:
        """The matrix (4, 4) from an eye of the parallel rig, in OpenCV's axes, to the world; None without a pose."""
        try:
            pose = np.array((self.rectified_poses or {})[eye], np.float64)
        except (KeyError, TypeError, ValueError):
            return None
        return pose if pose.shape == (4, 4) and np.isfinite(pose).all() else None

    def _file_or_image(self, eye: str, name: str) -> Path:
        return self.folder / name.format(eye) if name.format(eye) in self.data["files"] else self.image(eye)


#: Makes complete settings of stored ones: ``description.restore_settings``, or a ``Restorer`` for many.
Restore = Callable[[Mapping[str, Any], str, str], Settings]
_FIX = "move the folder away and render the pair again"
#: The settings of a pair, and the version that wrote them.
_SETTINGS_SHAPE = {"settings": Each(TABLE, TEXT), "versions": Maybe(Each(TEXT, TEXT))}
_FILES_SHAPE = {"files": Each({"bytes": COUNT, "sha256": SHA256}, FILE_NAME, _IMAGES)}
_BOTH_EYES = Maybe(dict.fromkeys(EYES, MATRIX))
_NUMBERS = Maybe(Each(NUMBER, TEXT))
#: What ``pair.json`` contains, as far as anything here reads it; of the settings see ``description.check``.
_SHAPE = {
    "format": TEXT,
    "version": COUNT,
    "id": TEXT,
    **_SETTINGS_SHAPE,
    **_FILES_SHAPE,
    "camera": CAMERA_SHAPE,
    "poses_camera_to_world": _BOTH_EYES,
    "poses_rectified_to_world": _BOTH_EYES,
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
    "light": Maybe(TABLE),
    "blur": Maybe(TABLE, null=True),
    "seconds": _NUMBERS,
    "cpu_seconds": _NUMBERS,
    "peak_memory_mib": Maybe(NUMBER, null=True),
}


def _read_pair_json(path: Path) -> str:
    try:
        return read_text(path)
    except FileNotFoundError:
        raise IcyMoonError(f"{path.parent} is not a complete stereo pair (no pair.json); render it again.") from None
    except (OSError, ValueError) as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_FIX}.") from None


def _parse_pair_json(path: Path, text: str) -> Any:
    try:
        return parse_json(text)
    except ValueError as error:
        raise IcyMoonError(f"{path} cannot be read ({describe_reason(error)}); {_FIX}.") from None


def read_pair(folder: Path, restore: Restore = restore_settings) -> Pair:
    """Read ``pair.json`` of one pair. Raises IcyMoonError if it is missing, foreign or incomplete.

    ``restore`` is a ``Restorer`` for many pairs.
    """
    path = folder / "pair.json"
    return check_pair(folder, _parse_pair_json(path, _read_pair_json(path)), restore)


def check_pair(folder: Path, data: object, restore: Restore = restore_settings) -> Pair:
    """The pair whose ``pair.json`` has this content, see ``read_pair``."""
    path = folder / "pair.json"
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise IcyMoonError(f"{path} is not an Icy Moon pair; choose a folder that Render Stereo Pair wrote.")
    if data.get("version") != VERSION:
        raise IcyMoonError(
            f"{path} has format version {quote(data.get('version'))}, this Icy Moon reads {VERSION}; "
            "use the version that wrote it."
        )
    check_record(data, _SHAPE, path, _FIX)
    settings = restore(data["settings"], str(path), data.get("versions", {}).get("icymoon", ""))
    pair = Pair(folder, check_id(data["id"], path), settings, _camera_of(data["camera"], settings, path), data)
    _check_statements(pair, path)
    for eye in EYES:
        if not pair.image(eye).is_file():
            raise IcyMoonError(f"{pair.image(eye)} is missing; {_FIX}.")
    return pair


def _camera_of(stated: dict[str, Any], settings: Settings, path: Path) -> StereoCamera:
    """The camera that a pair states, with the calibrated eyes of its settings."""
    try:
        return replace(StereoCamera.from_json(stated), eyes=eyes_of(settings))
    except ValueError as error:
        raise IcyMoonError(f"{path}: its settings give no camera ({error}); {_FIX}.") from None


def _check_statements(pair: Pair, path: Path) -> None:
    """Raise IcyMoonError if a pair's statements contradict its settings."""
    try:
        clause = next(_find_contradictions(pair), "")
    except (ValueError, ArithmeticError) as error:
        clause = f"its settings give no pair ({error})"
    if clause:
        raise IcyMoonError(f"{path}: {clause}; {_FIX}.")


def _find_contradictions(pair: Pair) -> Iterator[str]:
    """The statements of a pair that its settings contradict, in clauses."""
    camera = camera_of(pair.settings)
    stated = {**pair.data, "camera": {**pair.data["camera"], **_numbers_of(pair.camera)}}
    yield from find_contradictions(
        stated, pair.settings, {**_numbers_of(camera), **camera.to_json()}, eyes_json(camera, pair.settings.rig)
    )
    wanted, there = _list_file_names(pair.settings, camera), pair.data["files"].keys()
    yield from (f"files has no {name}, and its settings give it" for name in sorted(wanted - there))
    yield from (f"files has {name}, and its settings give no such file" for name in sorted(there - wanted))


def _numbers_of(camera: StereoCamera) -> dict[str, Any]:
    return asdict(replace(camera, eyes=None))


def _list_file_names(settings: Settings, camera: StereoCamera) -> set[str]:
    """The names of the files of a pair with these settings, besides ``pair.json``."""
    kinds = [
        "{}.exr",
        *([TRUTH_FILE] if camera.toe_in_deg or is_blurred(settings.rig) else []),
        *([TOED_TRUTH_FILE] if camera.toe_in_deg else []),
        *([RAW_TRUTH_FILE] if camera.eyes else []),
    ]
    return {kind.format(eye) for kind in kinds for eye in EYES} | {*workspace_files(settings.workspace)}


def is_complete(folder: Path) -> bool:
    """Whether a pair is there and can be read, see ``is_whole``."""
    return read_complete(folder) is not None


def read_complete(folder: Path) -> dict[str, Any] | None:
    """The content of the ``pair.json`` of a pair that is there and can be read, see ``read_whole``; else None."""
    try:
        return read_whole(folder)
    except OSError:
        return None


def is_whole(folder: Path) -> bool:
    """Whether a pair is there: ``pair.json``, which is written last, and images of the sizes that it states.

    Raises OSError where that cannot be told.
    """
    return read_whole(folder) is not None


def read_whole(folder: Path) -> dict[str, Any] | None:
    """The content of the ``pair.json`` of a pair that is there, see ``is_whole``; None if there is no such pair.

    A link may lead to anyone's files, so a pair that is a link, or has one, counts as absent. Raises OSError where that
    cannot be told.
    """
    try:
        path = folder / "pair.json"
        # A pipe would be waited for.
        if folder.is_symlink() or not is_regular_file(path):
            return None
        data = parse_json(read_text(path))
        return dict(data) if has_stated_files(folder, data) else None
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return None


def has_stated_files(folder: Path, data: Any) -> bool:
    """Whether the files that the content of a ``pair.json`` states are there, of their sizes.

    Raises OSError where that cannot be told.
    """
    return not find_fault(data, _FILES_SHAPE) and all(
        is_regular_file(folder / name) and (folder / name).stat().st_size == fact["bytes"]
        for name, fact in data["files"].items()
    )


def has_response(
    folder: Path, data: Mapping[str, Any], settings: Settings, restore: Restore = restore_settings
) -> bool:
    """Whether a pair, with this content of its ``pair.json``, states the camera response of these settings."""
    path = folder / "pair.json"
    check_record(data, _SETTINGS_SHAPE, path, _FIX)
    stated = restore(data["settings"], str(path), data.get("versions", {}).get("icymoon", ""))
    return select_response(stated) == select_response(settings)


def update_response(folder: Path, settings: Settings) -> None:
    """Write the camera response of these settings into a complete pair, which needs no new render.

    If another pair takes its place meanwhile, that one gets them. Raises IcyMoonError when the disk refuses.
    """
    path = folder / "pair.json"
    check_no_link(folder, path)
    before = _read_pair_json(path)
    data = _parse_pair_json(path, before)
    # Compared as they are read: a setting that is newer than the file is no difference.
    if has_response(folder, data, settings):
        return
    now = to_json_text({**data, "settings": merged(data["settings"], select_response(settings))})
    if not replace_if_unchanged(path, before, now):
        update_response(folder, settings)


def find_pair_folders(path: Path) -> list[Path]:
    """Folders of the complete pairs at ``path``: a pair folder, a ``pairs`` folder or a data set.

    Raises IcyMoonError if it has no complete pair.
    """
    folders = [path.resolve()] if os.path.lexists(path / "pair.json") else sorted(_find_pairs_in(path))
    if not folders:
        raise IcyMoonError(f"{path} contains no complete stereo pair; render one first or choose another folder.")
    return folders


def _find_pairs_in(path: Path) -> Iterator[Path]:
    root = pairs_folder(path) if pairs_folder(path).is_dir() else path
    return (p.parent for p in root.glob("*/pair.json") if not p.parent.name.endswith(PART_SUFFIX))


def has_pairs(path: Path) -> bool:
    """Whether there is a complete pair at ``path``, see ``find_pair_folders``."""
    return os.path.lexists(path / "pair.json") or next(_find_pairs_in(path), None) is not None


def find_pairs(path: Path) -> list[Pair]:
    """The complete pairs at ``path``, read; see ``find_pair_folders`` and ``read_pair``."""
    restore = Restorer()
    return [read_pair(folder, restore) for folder in find_pair_folders(path)]


def find_changed_files(pair: Pair) -> list[str]:
    """Names of the pair's files whose content has changed since the render."""
    return [
        name
        for name, fact in pair.data["files"].items()
        if not (pair.folder / name).is_file() or hash_file(pair.folder / name) != fact["sha256"]
    ]


def read_unchanged_pair(folder: Path) -> Pair:
    """Read a pair, see ``read_pair``. Raises IcyMoonError also if a file has changed since it was rendered."""
    pair = read_pair(folder)
    changed = find_changed_files(pair)
    if changed:
        raise IcyMoonError(f"{folder / changed[0]} is not the file that was rendered (its checksum differs); {_FIX}.")
    return pair
