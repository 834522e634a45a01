"""The formats of calibrations: one reader and one writer each, and which format a file has."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import ForeignBytes, read
from .cahv import read_cahv, why_not_cahv, write_cahv
from .colmap import read_colmap, why_not_colmap, write_colmap
from .kalibr import read_kalibr, why_not_kalibr, write_kalibr
from .mrcal import read_mrcal, why_not_mrcal, write_mrcal
from .opencv import read_opencv, why_not_opencv, write_opencv
from .options import Reading, Stated
from .ros import read_ros, why_not_ros, write_ros
from .transforms import read_transforms, why_not_transforms, write_transforms

#: Bytes at the beginning of a file from which its format is detected.
_HEAD_BYTES = 2**16
#: Largest offset of a real lens's principal point from the image's middle, as a share of the image's size.
_OFF_MIDDLE = 0.1
#: Ratios of the probable size of the calibration's images to the stated size, if images were binned or scaled.
_RESIZED = (0.5, 2.0, 0.25)
_KALIBR_PATTERN = re.compile(r"^cam0:", re.MULTILINE)
_ROS_PATTERN = re.compile(
    r"\b(?:image_width|image_height|camera_name|camera_matrix|distortion_\w+|rectification_matrix|projection_matrix)"
    r"[\"']?\s*:|^[dkrpDKRP]\s*:",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Format:
    """A format of calibrations. ``read`` takes the files and the user's options. ``write`` takes a rig and the files:
    one for each camera if ``each``, else one for all, or a folder if ``suffix`` is empty. ``why_not`` returns why the
    format cannot store a camera. ``in_metres`` is true if its lengths are always metres."""

    title: str
    each: bool
    suffix: str
    read: Callable[[Sequence[Path], Stated], Reading]
    write: Callable[[CalibratedRig, Sequence[Path]], None]
    why_not: Callable[[CalibratedCamera], str]
    most_read: int = 1
    most_written: int = 1000
    in_metres: bool = False


FORMATS = {
    "opencv": Format("OpenCV", False, ".yaml", read_opencv, write_opencv, why_not_opencv, 2, 2),
    "ros": Format("ROS", True, ".yaml", read_ros, write_ros, why_not_ros, 2, 2, in_metres=True),
    "kalibr": Format("Kalibr", False, ".yaml", read_kalibr, write_kalibr, why_not_kalibr, in_metres=True),
    "mrcal": Format("mrcal", True, ".cameramodel", read_mrcal, write_mrcal, why_not_mrcal, 1000, in_metres=True),
    "cahv": Format("CAHVORE", True, ".cahvor", read_cahv, write_cahv, why_not_cahv, 1000, in_metres=True),
    "colmap": Format("COLMAP", False, "", read_colmap, write_colmap, why_not_colmap),
    "transforms": Format("transforms.json", False, ".json", read_transforms, write_transforms, why_not_transforms),
}


def format_of(path: Path) -> str:
    """Detect the format of a file or folder by its content; an unknown text counts as JPL's. Raises IcyMoonError for an
    empty file, and for YAML of no known format."""
    suffix = path.suffix.lower()
    if path.is_dir() or path.name in ("cameras.txt", "images.txt", "cameras.bin", "images.bin"):
        return "colmap"
    head = read(path, _decode_head, "a calibration", "give another file")
    if not head.strip():
        raise IcyMoonError(f"{path}: is empty; give a calibration.")
    if suffix in (".npz", ".xml"):
        return "opencv"
    if suffix == ".cameramodel":
        return "mrcal"
    if suffix not in (".yaml", ".yml", ".json"):
        return "cahv"
    if suffix == ".json":
        return "transforms" if '"frames"' in head else "opencv"
    if head.startswith("%YAML:1.0") or "opencv-matrix" in head:
        return "opencv"
    if _KALIBR_PATTERN.search(head):
        return "kalibr"
    if _ROS_PATTERN.search(head):
        return "ros"
    raise IcyMoonError(
        f"{path}: is not a known calibration: it has no %YAML:1.0 (OpenCV), no camera_matrix (ROS) and no cam0 "
        "(Kalibr); give another file, or state its format by --format."
    )


def _decode_head(foreign: ForeignBytes) -> str:
    return foreign.part(0, min(foreign.size, _HEAD_BYTES)).decode("utf-8", "replace").lstrip("\ufeff")


def read_calibration(paths: Sequence[Path], stated: Stated = Stated(), name: str | None = None) -> Reading:  # noqa: B008
    """Read the cameras of a calibration, from one file or several of one format, and sentences on the assumptions made.
    ``name`` is a format's name; without it the format is detected.

    Raises IcyMoonError for a file that is damaged, incomplete or in an unsupported format.
    """
    kinds = [name or format_of(path) for path in paths]
    where = " and ".join(map(str, paths))
    if len(set(kinds)) > 1:
        raise IcyMoonError(f"{where} are calibrations of several kinds, {', '.join(kinds)}; give files of one kind.")
    kind = FORMATS[kinds[0]]
    if len(paths) > kind.most_read:
        raise IcyMoonError(
            f"{where}: a calibration of {kind.title} has {_count(kind.most_read, 'file')} at most; give no more."
        )
    if kind.in_metres and stated.unit not in (None, "m"):
        raise IcyMoonError(
            f"{where}: a calibration of {kind.title} states metres; leave out --unit {stated.unit}, or write metres "
            "into the file."
        )
    if stated.lens and kinds[0] != "opencv":
        raise IcyMoonError(f"{where}: a calibration of {kind.title} states its lens; leave out --lens {stated.lens}.")
    found = kind.read(paths, stated)
    _check_sizes(where, found.rig, stated)
    return replace(found, notes=(*found.notes, *_find_doubts(found.rig)))


def _check_sizes(where: str, rig: CalibratedRig, stated: Stated) -> None:
    """Raise IcyMoonError if the images of the files differ in size from the stated size, or if there are fewer cameras
    than sizes."""
    if len(stated.sizes) > len(rig.cameras):
        raise IcyMoonError(
            f"{where}: --size states {_count(len(stated.sizes), 'size')}, and there "
            f"{_describe_camera_count(len(rig.cameras))}; state one for each, or one for all."
        )
    for number, camera in enumerate(rig.cameras):
        if stated.size(number) not in (None, camera.size_px):
            raise IcyMoonError(
                f"{where}: images have {camera.width_px} x {camera.height_px} px in the file; leave out --size."
            )


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _describe_camera_count(count: int) -> str:
    return f"{'is' if count == 1 else 'are'} {_count(count, 'camera')}"


def _find_doubts(rig: CalibratedRig) -> list[str]:
    """Return sentences on likely faults of a calibration."""
    found = []
    for camera in rig.cameras:
        if not (0 <= camera.cx_px < camera.width_px and 0 <= camera.cy_px < camera.height_px):
            found.append(
                f"The principal point of {camera.name}, ({camera.cx_px:g}, {camera.cy_px:g}) px, is outside its images "
                f"of {camera.width_px} x {camera.height_px} px."
            )
        elif doubt := _find_size_doubt(camera):
            found.append(doubt)
        if dark := camera.dark_share():
            found.append(
                f"{dark:.1%} of the pixels of {camera.name} see nothing: the polynomial of its lens turns back "
                "before them."
            )
    return found


def _find_size_doubt(camera: CalibratedCamera) -> str:
    """Return a sentence if the principal point fits images of another size; empty if not."""
    at, size = (camera.cx_px, camera.cy_px), (camera.width_px, camera.height_px)
    if _is_near_middle(at, size):
        return ""
    others = [size[::-1], *((round(size[0] * share), round(size[1] * share)) for share in _RESIZED)]
    likely = next((other for other in others if _is_near_middle(at, other)), None)
    if likely is None:
        return ""
    return (
        f"The principal point of {camera.name}, ({at[0]:g}, {at[1]:g}) px, is far from the middle of its images of "
        f"{size[0]} x {size[1]} px, but near the middle of images of {likely[0]} x {likely[1]} px; is the size right?"
    )


def _is_near_middle(at: tuple[float, float], size: tuple[int, int]) -> bool:
    """Return whether a principal point is as near the middle as in real lenses."""
    return all(abs(at[k] - (size[k] - 1) / 2) <= _OFF_MIDDLE * size[k] for k in range(2))


def write_calibration(rig: CalibratedRig, paths: Sequence[Path], name: str) -> None:
    """Write the cameras of a rig in a format. Raises IcyMoonError, without writing, if the format cannot store them."""
    kind = FORMATS[name]
    for camera in rig.cameras:
        if lacks := kind.why_not(camera):
            raise IcyMoonError(
                f"{kind.title} has {lacks} (camera {camera.name or 'without a name'}); {_list_other_formats(rig)}."
            )
    if len(rig.cameras) > kind.most_written:
        raise IcyMoonError(
            f"{kind.title} holds {kind.most_written} cameras, not {len(rig.cameras)}; choose them by --cameras."
        )
    wanted = len(rig.cameras) if kind.each else 1
    if len(paths) != wanted:
        raise IcyMoonError(
            f"{kind.title} needs {_count(wanted, 'file')} for these cameras, not {len(paths)}; name as many by --out."
        )
    kind.write(rig, paths)


def _list_other_formats(rig: CalibratedRig) -> str:
    """Return a clause with other formats that can store the rig."""
    able = [
        name
        for name, kind in FORMATS.items()
        if not any(map(kind.why_not, rig.cameras)) and len(rig.cameras) <= kind.most_written
    ]
    return f"choose {' or '.join(able)}" if able else "choose another format for each of its cameras"
