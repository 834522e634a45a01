"""The verb ``camera``: calibrations as settings of a rig, shown, or written in another format."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..formats.cahvor import FIT_LIMIT_PX, Lens, find_nearest_lens, read_model
from ..formats.calibrations.colmap import COLMAP_FILES
from ..formats.calibrations.options import LENSES, UNITS_M, Reading, Stated, convert_to_brown
from ..formats.calibrations.registry import FORMATS, format_of, read_calibration, write_calibration
from ..formats.calibrations.ros import find_position_m, make_ros_pair
from ..formats.ros_camera import RosCamera, read_ros_camera
from ..physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ..physics.camera.lens_distortion import COEFFICIENTS
from ..physics.camera.lens_models import Brown
from ..settings.description import check
from ..settings.toml_text import to_toml
from ..settings.topics.scene import Settings
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from ..support.file_schemas import PIXELS
from ..support.files import quote
from ..support.foreign_bytes import explain_errors
from ..support.printer import say
from ..support.suggestions import suggest_nearest
from ..support.terminal import as_path
from .calibrated_eyes import (
    ALIKE_PX,
    MAX_OFFSET_SHARE,
    MAX_TURN_RAD,
    SQUARE_PIXEL_TOLERANCE,
    find_why_calibrated,
    make_calibrated_settings,
    make_rig_of_calibration,
    make_rig_table,
)
from .calibration_advice import (
    check_baseline,
    check_eye_order,
    check_focal_length,
    describe_exchanged,
    selects_by_name,
)
from .calibration_text import describe_rig

#: Largest differences of two eyes that are averaged to one lens: of focal length and distortion as shares of the
#: focal length, and of the principal point as a share of the width.
_MAX_FOCAL, _MAX_CENTRE = 0.05, 0.05
#: Smaller coefficients of distortion come from rounding in the file.
_NO_DISTORTION = 1e-9


@dataclass(frozen=True)
class _Eye:
    """A camera: its file, its lens, the rotation (3, 3) from world axes into its own, its position (3,) in metres, the
    size of its images, and its name if it was selected by name."""

    path: Path
    lens: Lens
    rotation: Array
    centre_m: Array
    size_px: tuple[int, int]
    name: str = ""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``camera``."""
    parser.add_argument(
        "files",
        type=as_path,
        nargs="+",
        metavar="FILE",
        help="a calibration: one file with all cameras, or one for each camera, the left one first",
    )
    add_calibration_options(parser)
    parser.add_argument(
        "--alike",
        action="store_true",
        help="print one camera for both eyes: the mean of both, or the camera of the rectified images",
    )
    parser.add_argument("--show", action="store_true", help="print the cameras instead of settings")
    parser.add_argument("--to", choices=FORMATS, help="write the cameras in this format instead")
    parser.add_argument(
        "--out", type=as_path, nargs="+", default=[], metavar="FILE", help="the files to write, or COLMAP's folder"
    )
    parser.add_argument(
        "--most-px",
        type=float,
        default=FIT_LIMIT_PX,
        metavar="PX",
        help="largest error of a lens that can only be fitted (%(default)s)",
    )
    parser.set_defaults(run=_run_camera)


def add_calibration_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for facts about the files of a calibration, see ``read_stated_facts``."""
    parser.add_argument("--format", choices=FORMATS, help="the format of the files (default: detected)")
    parser.add_argument("--unit", choices=UNITS_M, help="the unit of lengths in the files, where they leave it open")
    parser.add_argument(
        "--size",
        type=parse_sizes,
        default=(),
        metavar="WxH",
        help="width and height of the images in px, for two sizes as WxH,WxH",
    )
    parser.add_argument("--lens", choices=LENSES, help="the lens of four coefficients in files of OpenCV")
    parser.add_argument("--cameras", metavar="NAME,NAME", help="two cameras of a file that has more")


def read_stated_facts(options: argparse.Namespace) -> Stated:
    """Read the user's options about the files of a calibration."""
    return Stated(options.unit, options.size, options.lens)


def parse_sizes(text: str) -> tuple[tuple[int, int], ...]:
    """Parse sizes such as 640x480,1280x960. Raises ArgumentTypeError."""
    found = []
    for size in text.split(","):
        words = size.strip().lower().split("x")
        if len(words) != 2 or not all(word.isascii() and word.isdecimal() and len(word) < 9 for word in words):
            raise argparse.ArgumentTypeError(f"{size!r} is not a size; write it as 640x480")
        width, height = map(int, words)
        if not (PIXELS.fits(width) and PIXELS.fits(height)):
            raise argparse.ArgumentTypeError(f"{size!r} is not a size of an image")
        found.append((width, height))
    return tuple(found)


def _run_camera(options: argparse.Namespace) -> int:
    stated = read_stated_facts(options)
    if options.out and not options.to:
        raise IcyMoonError("--out names files to write, but no format is stated; add --to with a format.")
    if options.to and not options.out:
        raise IcyMoonError(f"--to {options.to} needs files to write; add --out with their names.")
    if options.show or options.to:
        _check_out(options.files, options.out, options.to)
        reading = choose_cameras(read_calibration(options.files, stated, options.format), options.cameras)
        for line in describe_rig(reading.rig) if options.show else []:
            say(line)
        kind = options.format or format_of(options.files[0])
        for note in (*reading.notes, *check_eye_order(reading.rig, selects_by_name(kind, options.cameras))):
            say(f"# {note}")
        if options.to:
            write_calibration(reading.rig, options.out, options.to)
            say(f"# {FORMATS[options.to].title}: {', '.join(map(str, options.out))}")
        return 0
    read = read_rig if options.alike else read_eyes
    settings, notes = read(*options.files, most_px=options.most_px, stated=stated, kind=options.format,
                           names=options.cameras)  # fmt: skip
    for note in notes:
        say(f"# {note}")
    say(to_toml(settings).removesuffix("\n"))
    return 0


def _check_out(files: list[Path], out: list[Path], name: str | None) -> None:
    """Raise IcyMoonError if an output file is also an input, or is named twice."""
    written = [path / each for path in out for each in COLMAP_FILES] if name == "colmap" else out
    read = [path / each for path in files for each in (COLMAP_FILES if path.is_dir() else ("",))]
    inputs = {path.resolve() for path in read}
    places = [path.resolve() for path in written]
    for path, place in zip(written, places, strict=True):
        if place in inputs:
            raise IcyMoonError(f"--out: {path} is also an input and would be overwritten; name another file.")
        if places.count(place) > 1:
            raise IcyMoonError(f"--out names {path} twice; name a file for each camera.")


def choose_cameras(reading: Reading, names: str | None) -> Reading:
    """Select the cameras with these names, or all without names. Raises IcyMoonError for an unknown name."""
    if names is None:
        return reading
    known = {camera.name: camera for camera in reading.rig.cameras}
    wanted = [name.strip() for name in names.split(",")]
    for name in wanted:
        if wanted.count(name) > 1 or [camera.name for camera in reading.rig.cameras].count(name) > 1:
            raise IcyMoonError(f"--cameras: {quote(name)} occurs more than once; give each camera a unique name.")
        if name not in known:
            guess = suggest_nearest(name, list(known), otherwise=f"the first ones are {', '.join(list(known)[:6])}.")
            raise IcyMoonError(f"--cameras: {quote(name)} is not in the calibration; {guess}")
    return Reading(CalibratedRig(tuple(known[name] for name in wanted)), reading.notes)


def read_eyes(
    *paths: Path,
    most_px: float = FIT_LIMIT_PX,
    stated: Stated = Stated(),  # noqa: B008
    kind: str | None = None,
    names: str | None = None,
) -> tuple[Settings, list[str]]:
    """Read the settings of two calibrated cameras without averaging, and sentences on assumptions and dark pixels.

    Eyes that are alike, parallel and side by side give the ``rig`` of ``read_rig``; others give it as their rectified
    pair, with ``left_eye`` and ``right_eye`` beside it. Raises IcyMoonError.
    """
    where = " and ".join(map(str, paths))
    kinds = {kind or format_of(path) for path in paths}
    for path in paths if kinds == {"ros"} and len(paths) == 2 else ():
        _refuse_no_focal_length(path, read_ros_camera(path))
    reading = choose_cameras(read_calibration(paths, stated, kind), names)
    rig = make_rig_of_calibration(reading, where)
    why = find_why_calibrated(rig)
    if not why:
        return _read_alike(paths, most_px, stated, kind, names, reading)
    found, notes = make_calibrated_settings(rig, why, paths, min(kinds), stated, names)
    return found, [*reading.notes, *notes]


def read_rig(
    *paths: Path,
    most_px: float = FIT_LIMIT_PX,
    stated: Stated = Stated(),  # noqa: B008
    kind: str | None = None,
    names: str | None = None,
) -> tuple[Settings, list[str]]:
    """Read ``rig`` settings in which both eyes share one camera, and sentences on fitted, averaged and omitted values.

    The sensor has the default width, since a calibration states lengths in pixels only. Both eyes have one lens, the
    mean of both lenses if they differ. If the eyes are not parallel or not alike, or have lenses that a rig lacks, the
    rig is the rig of their rectified images. Raises IcyMoonError if camera models of JPL are not parallel and side by
    side, if the lenses differ by more than a twentieth, or if the fitted lens is off by more than ``most_px``.
    """
    return _read_alike(paths, most_px, stated, kind, names)


def _read_alike(
    paths: tuple[Path, ...],
    most_px: float,
    stated: Stated,
    kind: str | None,
    names: str | None,
    reading: Reading | None = None,
) -> tuple[Settings, list[str]]:
    """Do the work of ``read_rig``, with the cameras that were read before, if given."""
    where = " and ".join(map(str, paths))
    kinds = {kind or format_of(path) for path in paths}
    stated_in = "the translation is"
    taken: list[str] = []
    if reading is None and (stated != Stated() or not _is_read_as_it_is(kinds, paths, names)):
        # Files that contradict the options are refused here.
        reading = choose_cameras(read_calibration(paths, stated, kind), names)
    if kinds == {"cahv"} and _is_read_as_it_is(kinds, paths, names):
        first, second = _read_eye(paths[0], most_px), _read_eye(paths[1], most_px)
        fix, stated_in = _describe_rectification(first, second), "the vector C is"
    elif reading is None or _is_read_as_it_is(kinds, paths, names):
        cameras = read_ros_camera(paths[0]), read_ros_camera(paths[1])
        first, second, taken = _read_ros_eyes((paths[0], paths[1]), cameras, "of projection_matrix")
        fix = "calibrate both eyes as a stereo pair"
        stated_in = "the fourth number of projection_matrix is -fx times the baseline"
    else:
        first, second, taken = _find_any_eyes(reading, paths, where, kind, names)
        fix = "rectify their images first"
    _check_one_size(first, second, where)
    _check_parallel(first, second, where, fix)
    baseline_m = float(np.linalg.norm(second.centre_m - first.centre_m))
    doubt = check_baseline(baseline_m, where, stated_in, min(kinds), stated)
    lens, averaged = _average_lenses(first.lens, second.lens, first.size_px[0], where)
    fitted = [f"The lens is fitted, off by up to {lens.residual_px:.2g} px."] if lens.residual_px else []
    return _make_rig_settings(lens, first.size_px, baseline_m, where), [*taken, *fitted, *averaged, *doubt]


def read_rectified_rig(
    *paths: Path,
    stated: Stated = Stated(),  # noqa: B008
    kind: str | None = None,
    names: str | None = None,
) -> tuple[Settings, CalibratedRig, list[str]]:
    """Read the ``rig`` settings of already rectified images, their two cameras, and sentences on assumptions.

    In ROS' files, ``projection_matrix`` is the camera of the rectified images. Other calibrations must belong to the
    rectified images themselves. Raises IcyMoonError for one with distortion, or with eyes that are not parallel.
    """
    where = " and ".join(map(str, paths))
    if {kind or format_of(path) for path in paths} == {"ros"} and len(paths) == 2 and not stated.sizes:
        ros = [read_ros_camera(path) for path in paths]
        lenses = [_make_ros_lens(camera, True) for camera in ros]
        eyes = [_make_ros_eye(path, camera, True) for path, camera in zip(paths, ros, strict=True)]
        notes: list[str] = []
    else:
        reading = choose_cameras(read_calibration(paths, stated, kind), names)
        notes = [*reading.notes]
        eyes = [_make_pinhole_eye(camera, paths, where) for camera in make_rig_of_calibration(reading, where).cameras]
        lenses = [eye.lens for eye in eyes]
    left, right = eyes
    fix = "give the calibration of the rectified images, or leave out --rectified for photographs as they were taken"
    _check_one_size(left, right, where)
    _check_parallel(left, right, where, fix)
    if max(abs(lenses[0].focal_px - lenses[1].focal_px), abs(lenses[0].cy_px - lenses[1].cy_px)) > ALIKE_PX:
        raise IcyMoonError(
            f"{where}: rectified images need the same focal length and the same principal row in both eyes; {fix}."
        )
    baseline_m = float(np.linalg.norm(right.centre_m - left.centre_m))
    doubt = check_baseline(baseline_m, where, "the translation is", kind or format_of(paths[0]), stated)
    cameras = [
        CalibratedCamera(*left.size_px, lens.focal_px, lens.focal_px, lens.cx_px, lens.cy_px,
                         translation_m=np.array([-along, 0.0, 0.0]))
        for lens, along in zip(lenses, (0.0, baseline_m), strict=True)
    ]  # fmt: skip
    return (
        _make_rig_settings(lenses[0], left.size_px, baseline_m, where),
        CalibratedRig(tuple(cameras)),
        [*notes, *doubt],
    )


def _make_pinhole_eye(camera: CalibratedCamera, paths: tuple[Path, ...], where: str) -> _Eye:
    """Make a camera of rectified images. Raises IcyMoonError if it has distortion, or pixels that are not square."""
    plain = convert_to_brown(camera)
    lens = plain.lens if plain else None
    if plain is None or not isinstance(lens, Brown) or any(lens.coefficients) or not _has_square_pixels(plain.matrix):
        raise IcyMoonError(
            f"{where}: {camera.name or 'a camera'} has distortion or pixels that are not square, so its images are not "
            "rectified; leave out --rectified, or give a calibration with K, R = 1 and T of the rectified pair."
        )
    path = paths[-1] if camera.name == "right" else paths[0]
    pinhole = Lens(plain.fx_px, plain.cx_px, plain.cy_px, (0.0,) * len(COEFFICIENTS), 0.0)
    return _Eye(path, pinhole, camera.rotation, camera.centre_m, camera.size_px)


def _check_one_size(first: _Eye, second: _Eye, where: str) -> None:
    if first.size_px != second.size_px:
        sizes = " and ".join(f"{eye.size_px[0]} x {eye.size_px[1]} px" for eye in (first, second))
        raise IcyMoonError(
            f"{where} have images of {sizes}, but both eyes of a rig need one size; rectify their images first."
        )


def _make_rig_settings(lens: Lens, size_px: tuple[int, int], baseline_m: float, where: str) -> Settings:
    """Make the ``rig`` settings of two eyes with this lens. Raises IcyMoonError for a lens that folds the image, and
    for a focal length that is not in pixels."""
    check_focal_length(lens.focal_px, size_px, where)
    camera = CalibratedCamera(*size_px, lens.focal_px, lens.focal_px, lens.cx_px, lens.cy_px, Brown(lens.k))
    if dark := camera.dark_share():
        stated = ", ".join(f"{name} = {value:g}" for name, value in zip(COEFFICIENTS, lens.k, strict=True))
        raise IcyMoonError(
            f"{where}: the distortion ({stated}) folds the image over itself, so {dark:.1%} of the pixels see nothing; "
            "calibrate again with points up to the borders of the image, or with fewer coefficients."
        )
    rig = {
        **make_rig_table(size_px, lens.focal_px, (lens.cx_px, lens.cy_px), baseline_m),
        **{f"distortion_{name}": value for name, value in zip(COEFFICIENTS, lens.k, strict=True)},
    }
    return check({"rig": rig}, where)


def _read_eye(path: Path, most_px: float) -> _Eye:
    model = read_model(path)
    return _Eye(path, find_nearest_lens(model, most_px), model.pinhole()[1], model.c, (model.width_px, model.height_px))


def _is_read_as_it_is(kinds: set[str], paths: tuple[Path, ...], names: str | None) -> bool:
    """Return whether content that only JPL's or ROS' files have is used: the vectors of two models, or a rectified
    pair."""
    return kinds in ({"cahv"}, {"ros"}) and len(paths) == 2 and names is None


def _find_any_eyes(
    reading: Reading, paths: tuple[Path, ...], where: str, kind: str | None, names: str | None
) -> tuple[_Eye, _Eye, list[str]]:
    """Find two cameras in a calibration of any format, in the form of ``_read_ros_eyes``."""
    rig = make_rig_of_calibration(reading, where)
    with explain_errors(
        " with ".join(map(str, paths)), "a calibration of two eyes side by side", "calibrate two eyes side by side"
    ):
        cameras = make_ros_pair(rig)
    first, second, notes = _read_ros_eyes((paths[0], paths[-1]), cameras, "of the mean of both eyes")
    by_name = selects_by_name(kind or format_of(paths[0]), names)
    left, right = (camera.name if by_name else "" for camera in reading.rig.cameras)
    return replace(first, name=left), replace(second, name=right), [*reading.notes, *notes]


def _read_ros_eyes(
    paths: tuple[Path, Path], pair: tuple[RosCamera, RosCamera], rectified_by: str
) -> tuple[_Eye, _Eye, list[str]]:
    """Read the left and the right camera in the axes of the rectified left camera. Also return sentences if they are of
    the rectified images, or of a part of the calibrated images. ``rectified_by`` names the source of the rectified
    camera."""
    left, right = paths
    cameras = list(zip(paths, pair, strict=True))
    for path, camera in cameras:
        _refuse_no_focal_length(path, camera)
    reason = _find_why_rectified(*(camera for _, camera in cameras))
    notes = []
    if reason is not None:
        notes.append(
            "This is the rig of the rectified images, with the focal length and the principal point "
            f"{rectified_by} and no distortion: {reason}."
        )
    of_left, of_right = (camera for _, camera in cameras)
    if (of_left.window, of_left.binning) != (of_right.window, of_right.binning):
        raise IcyMoonError(
            f"{left} and {right} have different binning or roi, but both eyes of a rig need the same; "
            "write the same binning_x, binning_y and roi into both."
        )
    if of_left.window or of_left.binning != (1, 1):
        notes.append(
            f"The binning and the roi of the calibration are applied: images have {of_left.width_px} x "
            f"{of_left.height_px} px."
        )
    first, second = (_make_ros_eye(path, camera, reason is not None) for path, camera in cameras)
    apart_px = max(abs(first.lens.focal_px - second.lens.focal_px), abs(first.lens.cy_px - second.lens.cy_px))
    if reason is not None and apart_px > ALIKE_PX:
        raise IcyMoonError(
            f"{left} and {right}: {reason}, and their projection_matrix does not make a rectified pair: focal "
            f"lengths of {first.lens.focal_px:.2f} and "
            f"{second.lens.focal_px:.2f} px, rows of the principal point {first.lens.cy_px:.2f} and "
            f"{second.lens.cy_px:.2f} px; calibrate both eyes as a stereo pair."
        )
    if not np.linalg.norm(second.centre_m - first.centre_m) > 0:
        raise IcyMoonError(
            f"{right}: projection_matrix states no baseline (-f B, its fourth number); calibrate both "
            "eyes as a stereo pair."
        )
    return first, second, notes


def _refuse_no_focal_length(path: Path, camera: RosCamera) -> None:
    for name, matrix in (("camera_matrix", camera.matrix), ("projection_matrix", camera.projection)):
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise IcyMoonError(f"{path}: {name} has no focal length; calibrate both eyes as a stereo pair.")


def _find_why_rectified(left: RosCamera, right: RosCamera) -> str | None:
    """Find why a rig needs the rectified images of two cameras. Returns a clause, or None if the rig can use the
    cameras' own images.

    Each eye states its rotation into the axes of the rectified pair.
    """
    for camera in (left, right):
        if not _has_square_pixels(camera.matrix):
            return f"pixels are not square ({_describe_focal_lengths(camera.matrix)})"
        if camera.k is None:
            return f"the lens model is {camera.model}"
    if differ := _describe_unlike(_make_ros_lens(left, False), _make_ros_lens(right, False), left.width_px):
        return f"the lenses differ by {differ}"
    turned = _measure_angle_between(left.rectification, right.rectification)
    if turned > MAX_TURN_RAD:
        return f"the eyes are rotated relative to each other by {np.degrees(turned):.3g} degrees"
    x, y, z = map(float, left.rectification.T @ (find_position_m(right) - find_position_m(left)))
    if max(abs(y), abs(z)) > MAX_OFFSET_SHARE * abs(x):
        return (
            f"the right eye is {x:.4g} m to the right of the left one, {y:.4g} m below and {z:.4g} m before it, so "
            "they are not side by side"
        )
    return None


def _make_ros_eye(path: Path, camera: RosCamera, rectified: bool) -> _Eye:
    """Make the camera of an eye, or of its rectified images. Raises IcyMoonError if their pixels are not square."""
    if rectified and not _has_square_pixels(camera.projection):
        fix = (
            "calibrate both eyes as a stereo pair, which gives projection_matrix one focal length"
            if camera.binning[0] == camera.binning[1]
            else "bin as many pixels along x as along y, and set binning_x and binning_y to that"
        )
        raise IcyMoonError(
            f"{path}: its pixels are not square, also in projection_matrix "
            f"({_describe_focal_lengths(camera.projection)}), which Icy Moon's cameras do not support; {fix}."
        )
    lens = _make_ros_lens(camera, rectified)
    return _Eye(
        path,
        lens,
        np.eye(3) if rectified else camera.rectification.T,
        find_position_m(camera),
        (camera.width_px, camera.height_px),
    )


def _make_ros_lens(camera: RosCamera, rectified: bool) -> Lens:
    """Make the lens of a camera, or of its rectified images; without distortion unless its model is plumb_bob."""
    matrix = camera.projection if rectified else camera.matrix
    k = None if rectified else camera.k
    return Lens((matrix[0, 0] + matrix[1, 1]) / 2, matrix[0, 2], matrix[1, 2], k or (0.0,) * len(COEFFICIENTS), 0.0)


def _measure_angle_between(first: Array, second: Array) -> float:
    """Measure the angle, rad, between two rotations (3, 3)."""
    return float(np.arccos(np.clip(((first @ second.T).trace() - 1) / 2, -1, 1)))


def _has_square_pixels(matrix: Array) -> bool:
    return bool(abs(matrix[0, 0] / matrix[1, 1] - 1) < SQUARE_PIXEL_TOLERANCE and matrix[0, 1] == 0)


def _describe_focal_lengths(matrix: Array) -> str:
    return f"fx {matrix[0, 0]:g}, fy {matrix[1, 1]:g} px"


def _name_eye(eye: _Eye, where: str) -> str:
    """Name an eye for the beginning of a sentence: by its file, or by its name in the files."""
    return f"{where}: {eye.name}" if eye.name else str(eye.path)


def _average_lenses(left: Lens, right: Lens, width_px: int, where: str) -> tuple[Lens, list[str]]:
    """Average the lenses of both eyes; add a sentence if they differ by more than ``ALIKE_PX``. Raises IcyMoonError if
    they differ too much for one lens.
    """
    if differ := _describe_unlike(left, right, width_px):
        raise IcyMoonError(
            f"{where} differ by {differ}, but both eyes of a rig need one lens; rectify their images first."
        )
    focal, centre, bent = _measure_differences(left, right)
    if max(focal, centre, bent) <= ALIKE_PX:
        return left if left.residual_px >= right.residual_px else right, []
    mean = Lens(
        (left.focal_px + right.focal_px) / 2,
        (left.cx_px + right.cx_px) / 2,
        (left.cy_px + right.cy_px) / 2,
        tuple(map(float, np.mean([left.k, right.k], axis=0))),
        max(left.residual_px, right.residual_px),
    )
    return mean, [
        f"Both eyes have the mean of two lenses: focal lengths of {left.focal_px:.2f} and "
        f"{right.focal_px:.2f} px, principal points at ({left.cx_px:.2f}, {left.cy_px:.2f}) and "
        f"({right.cx_px:.2f}, {right.cy_px:.2f}) px, distortion that differs by up to {bent:.2g} px."
    ]


def _measure_differences(left: Lens, right: Lens) -> tuple[float, float, float]:
    """Measure the differences of two lenses in focal length, principal point and distortion, px."""
    return (
        abs(left.focal_px - right.focal_px),
        float(np.abs([left.cx_px - right.cx_px, left.cy_px - right.cy_px]).max()),
        float(np.abs(np.subtract(left.k, right.k)).max() * left.focal_px),
    )


def _describe_unlike(left: Lens, right: Lens, width_px: int) -> str:
    """Describe the differences of two lenses that prevent one mean lens, in words; empty if nothing prevents it."""
    focal, centre, bent = _measure_differences(left, right)
    if max(focal, bent) <= _MAX_FOCAL * left.focal_px and centre <= _MAX_CENTRE * width_px:
        return ""
    return f"{focal:.3g} px in focal length, {centre:.3g} px in principal point and {bent:.3g} px in distortion"


def _describe_rectification(left: _Eye, right: _Eye) -> str:
    """Return the fix for models of two eyes that are not parallel. Our own exports write the rectified models beside
    them."""
    paths = left.path, right.path
    beside = [path.with_name(path.name.replace("_sensor.", ".")) for path in paths]
    if all(other != path and other.is_file() for other, path in zip(beside, paths, strict=True)):
        bent = ", ".join(
            f"rig.distortion_{name} = {value:.6g}"
            for name, value in zip(("k1", "k2", "p1", "p2", "k3"), left.lens.k, strict=True)
            if abs(value) > _NO_DISTORTION
        )
        return (
            f"give {beside[0].name} and {beside[1].name} beside them, the models of the rectified images, and set "
            "rig.toe_in_deg, to half of that angle, for eyes that are turned toward each other"
            + (f", and {bent} for their lens" if bent else "")
        )
    return "rectify their images first"


def _check_parallel(left: _Eye, right: _Eye, where: str, fix: str) -> None:
    """Raise IcyMoonError unless the right eye is on the x axis of the left eye and has the same direction. ``fix`` is
    the remedy."""
    first, second = left.rotation, right.rotation
    turned = _measure_angle_between(first, second)
    x, y, z = map(float, first @ (right.centre_m - left.centre_m))
    if turned > MAX_TURN_RAD:
        raise IcyMoonError(
            f"{where}: the eyes are rotated relative to each other by {np.degrees(turned):.3g} degrees; {fix}."
        )
    aside = max(abs(y), abs(z)) > MAX_OFFSET_SHARE * abs(x)
    if x < 0 and not aside:
        raise IcyMoonError(
            describe_exchanged(_name_eye(right, where), left.name or str(left.path), -x, (left.name, right.name))
        )
    if abs(y) > abs(x):
        raise IcyMoonError(
            f"{where}: one eye is {abs(y):.4g} m above the other, but the eyes of a rig must be side by "
            "side; rotate the images of both eyes by 90 degrees and calibrate them again."
        )
    if aside:
        raise IcyMoonError(
            f"{where}: the right eye is {x:.4g} m to the right of the left one, {y:.4g} m below and "
            f"{z:.4g} m before it, so they are not side by side; {fix}."
        )
    if x == 0:
        raise IcyMoonError(f"{where}: both eyes have the same position; give the calibrations of two cameras.")
