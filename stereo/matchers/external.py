"""Any other program that reads two images and writes a disparity map.

``command`` is the command line, with fields in braces, such as

    external.command='python run.py --left {left} --right {right} --K {calibration} --out {out}'

It is split into arguments as a shell does, and run without a shell in the current folder. ``left`` and ``right`` are
8-bit RGB PNG. ``out`` is the file to write: the disparity of the left image in px, as pfm, npy or 16-bit PNG. A pixel
without measurement is 0 in a PNG and anything but a positive number in the others. ``calibration`` is a text file: the
nine numbers of K (principal point in pixel-corner coordinates) on one line, the baseline in metres on the next.
A program that states a confidence also writes the npy file ``confidence``, from 0 to 1, or ``error_px``, its expected
error.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.suggestions import suggest_nearest
from ...support.system import kill_all, start
from ...support.temporary_folders import open_scratch_folder
from ..adapters.icymoon_serve import to_disparity_map
from ..images.image_files import read_pfm, read_png, write_png
from .options import Option
from .result import CONFIDENCE, ERROR_PX, Confidence, Result
from .user_programs import read_array, read_last_line, read_written_array, require_program, split_arguments

SET_UP = (
    0,
    "command",
    "Program",
    "A program that is started for each pair, reads two images and writes a disparity map",
)
COLOUR = True

OPTIONS = (
    Option(
        "command",
        "",
        "The program and its arguments, with {left}, {right} and {out} and, if it needs them, "
        "{calibration}, {focal_px}, {cx_px}, {cy_px} and {baseline_m}; {confidence} or {error_px} if it writes one",
    ),
    Option("format", "npy", "Format of the file that it writes", choices=("npy", "pfm", "png")),
    Option("png_scale", 256, "Steps of a PNG per px of disparity", 1, 65535),
    Option("timeout_s", 600, "Seconds after which it is stopped", 1, 86400),
)

PRESETS: dict[str, dict[str, Any]] = {}

_IMAGES = ("left", "right", "out")
_CAMERA = ("focal_px", "cx_px", "cy_px", "baseline_m")
_STATED = (CONFIDENCE, ERROR_PX)
_FIELD = re.compile(r"\{(\w+)\}")


def check(options: dict[str, Any]) -> None:
    """Raise IcyMoonError unless the command can be run."""
    arguments = _split_command(options)
    fields = {field for argument in arguments for field in _FIELD.findall(argument)}
    known = (*_IMAGES, "calibration", *_CAMERA, *_STATED)
    for field in sorted(fields - set(known)):
        raise IcyMoonError(f"external.command has the field {{{field}}}, {suggest_nearest(field, known)}")
    missing = [f"{{{field}}}" for field in _IMAGES if field not in fields]
    if missing:
        raise IcyMoonError(
            f"external.command lacks {' and '.join(missing)}; write it as "
            "external.command='PROGRAM {left} {right} {out}'."
        )
    require_program("external.command", arguments[0])


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 RGB (H, W, 3) images with the program."""
    with open_scratch_folder() as folder:
        values = {eye: str(folder / f"{eye}.png") for eye in ("left", "right")}
        values["out"] = str(folder / f"disparity.{options['format']}")
        values |= {kind: str(folder / f"{kind}.npy") for kind in _STATED}
        for eye, image in (("left", left), ("right", right)):
            write_png(Path(values[eye]), image[..., ::-1])
        if camera is not None:
            values |= {key: repr(float(getattr(camera, key))) for key in _CAMERA}
            values["calibration"] = str(folder / "calibration.txt")
            numbers = " ".join(repr(float(number)) for row in camera.matrix for number in row)
            Path(values["calibration"]).write_text(
                f"{numbers}\n{values['baseline_m']}\n", encoding="ascii", newline="\n"
            )
        arguments = _split_command(options)
        if camera is None and any(field not in values for argument in arguments for field in _FIELD.findall(argument)):
            raise IcyMoonError("external.command asks for the camera, which is not known; give --camera PAIR.")
        _run_program(
            [_FIELD.sub(lambda field: values[field[1]], argument) for argument in arguments],
            options["timeout_s"],
            folder / "errors.txt",
        )
        shape = left.shape[:2]
        stated = next((kind for kind in _STATED if any(f"{{{kind}}}" in argument for argument in arguments)), None)
        confidence = (
            Confidence(read_written_array("external.command", stated, Path(values[stated]), shape), stated)
            if stated
            else None
        )
        return Result(_read_disparity(Path(values["out"]), shape, options), confidence=confidence)


def files(options: dict[str, Any]) -> list[str]:
    """List the paths on which the result may depend: the program and its arguments."""
    return _split_command(options)


def _split_command(options: dict[str, Any]) -> list[str]:
    return split_arguments("external.command", options["command"], "external.command='PROGRAM {left} {right} {out}'")


def _run_program(arguments: list[str], timeout_s: int, errors: Path) -> None:
    """Run a program within its time limit, and then end all processes that it started. Raises IcyMoonError if the
    program fails.
    """
    try:
        with errors.open("wb") as stream:
            process = start(arguments, stdout=subprocess.DEVNULL, stderr=stream)
    except OSError as error:
        raise IcyMoonError(f"external.command cannot be run ({error.strerror}); check {arguments[0]}.") from None
    try:
        status = process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        raise IcyMoonError(
            f"external.command took more than {timeout_s} s and was stopped; raise external.timeout_s "
            "or make it faster."
        ) from None
    finally:
        kill_all(process)  # also when interrupted: Ctrl-C does not reach a process in another session
    if status:
        raise IcyMoonError(
            f"external.command ended with status {status} ({read_last_line(errors) or 'no message'}); run "
            "it by hand on two images."
        )


def _read_disparity(path: Path, shape: tuple[int, ...], options: dict[str, Any]) -> Array:
    if not path.is_file():
        raise IcyMoonError(
            f"external.command ended without an error but wrote no {path.name} at {{out}}; make it "
            f"write there, or change external.format, {options['format']}."
        )
    if options["format"] == "png":
        image = read_png(path)
        disparity = np.where(image > 0, image / np.float64(options["png_scale"]), np.nan)
    else:
        disparity = read_pfm(path) if options["format"] == "pfm" else _read_npy(path, shape)
    try:
        return to_disparity_map(disparity, shape)
    except ValueError as error:
        raise IcyMoonError(f"external.command wrote a disparity map that cannot be used: {error}.") from None


def _read_npy(path: Path, shape: tuple[int, ...]) -> Array:
    try:
        array = read_array(path, shape)
    except (OSError, ValueError, IcyMoonError) as error:
        raise IcyMoonError(
            f"external.command wrote a {path.name} that cannot be read ({str(error).rstrip('.')}); make "
            "it write an array of disparities."
        ) from None
    if array.dtype.kind not in "fiu":
        raise IcyMoonError(
            f"external.command wrote a {path.name} without numbers; make it write an array of disparities."
        )
    return array.astype(np.float64)
