"""Any other program that is started once and answers pair after pair, such as a network that is slow to load.

``command`` is the command line, without fields, such as

    --method 'mynet=resident:command=python mynet.py'

It is split into arguments as a shell does, and run without a shell in the current folder. A program in Python needs one
call, ``icymoon_serve.serve``; see ``resident_process`` for what other programs read and print.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from .options import Option
from .resident_process import Program, match_with_resident, start_resident
from .result import Result
from .search_range import AUTO, SearchRange
from .user_programs import require_program, split_arguments

SET_UP = (1, "command", "Resident Program", "A program that is started once and answers pair after pair")
COLOUR = True

#: Time limits of a program; matchers that start such programs share them.
TIME_LIMITS = (
    Option("timeout_s", 600, "Seconds that a pair may take", 1, 86400),
    Option("start_s", 300, "Seconds until the program is ready; the first pair may take these too", 1, 86400),
)

OPTIONS = (Option("command", "", "The program and its arguments"), *TIME_LIMITS)

PRESETS: dict[str, dict[str, Any]] = {}


def check(options: dict[str, Any]) -> None:
    """Raise IcyMoonError unless the command can be run."""
    require_program("resident.command", _split_command(options)[0])


def settle(
    options: dict[str, Any], ranges: Mapping[str, SearchRange], shape: tuple[int, ...]
) -> tuple[dict[str, Any], None]:
    """Return the options, with the range of disparities that the rig can see as ``range_px`` if it is known, and None.
    The program may ignore the range.
    """
    seen = ranges.get(AUTO)
    return options | ({"range_px": [seen.least_px, seen.most_px]} if seen else {}), None


def load(options: dict[str, Any]) -> None:
    """Start the program if it is not running."""
    start_resident(_make_program(options))


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 RGB (H, W, 3) images with the program."""
    return match_with_resident(_make_program(options), left, right, camera, options.get("range_px"))


def files(options: dict[str, Any]) -> list[str]:
    """List the paths on which the result may depend: the program and its arguments."""
    return _split_command(options)


def _make_program(options: dict[str, Any]) -> Program:
    return Program("resident.command", tuple(_split_command(options)), options["start_s"], options["timeout_s"])


def _split_command(options: dict[str, Any]) -> list[str]:
    return split_arguments("resident.command", options["command"], "--method 'NAME=resident:command=PROGRAM'")
