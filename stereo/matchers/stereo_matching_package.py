"""The networks of the package ``stereo-matching`` from PyPI, in the Python that has the package.

``python`` is that Python, and ``model`` one of the package's names, such as raft-stereo, crestereo, igev-stereo,
foundation-stereo, s2m2 or unimatch. The package downloads the parameters of a model at its first use. It resizes images
to the height that a model expects, often 384 px, and enlarges the disparities again; the report states the size, and
``height`` changes it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...physics.camera.stereo_camera import StereoCamera
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.files import parse_path
from .options import Option
from .resident import TIME_LIMITS
from .resident_process import ADAPTERS, Program, match_with_resident, start_resident
from .result import Result
from .user_programs import require_program

SET_UP = (3, "python", "stereo-matching", "A network of the package stereo-matching from PyPI")
COLOUR = True

OPTIONS = (
    Option("python", "", "The Python that has the package stereo-matching"),
    Option("model", "", "Name that the package has for a network, such as raft-stereo"),
    Option("checkpoint", "", "File with other parameters of this network, instead of those that are downloaded"),
    Option("height", 0, "Height that images are resized to, px; 0 for the one that the network expects", 0, 8192, 8),
    Option(
        "device",
        "auto",
        "Where the network runs; auto takes a GPU if there is one",
        choices=("auto", "cpu", "cuda", "mps"),
    ),
    *TIME_LIMITS,
)

PRESETS: dict[str, dict[str, Any]] = {}


def check(options: dict[str, Any]) -> None:
    """Raise IcyMoonError unless the Python exists, and the checkpoint too if one is named."""
    for key, example in (("python", "/path/to/python"), ("model", "raft-stereo")):
        if not options[key]:
            raise IcyMoonError(f"stereo_matching.{key} is empty; give it, as in {key}={example}.")
    require_program("stereo_matching.python", options["python"])
    if options["checkpoint"] and not _checkpoint_path(options).is_file():
        raise IcyMoonError(
            f"stereo_matching.checkpoint names {_checkpoint_path(options)}, which is not a file; correct it."
        )


def load(options: dict[str, Any]) -> None:
    """Start the program if it is not running."""
    start_resident(_make_program(options))


def compute(left: Array, right: Array, options: dict[str, Any], camera: StereoCamera | None) -> Result:
    """Compute the disparity of uint8 RGB (H, W, 3) images, everywhere."""
    return match_with_resident(_make_program(options), left, right, camera)


def _checkpoint_path(options: dict[str, Any]) -> Path:
    return parse_path(options["checkpoint"], "stereo_matching.checkpoint")


def _make_program(options: dict[str, Any]) -> Program:
    command = [options["python"], str(ADAPTERS / "run_stereo_matching.py"), options["model"]]
    command += ["--checkpoint", str(_checkpoint_path(options))] if options["checkpoint"] else []
    command += ["--height", str(options["height"])] if options["height"] else []
    command += ["--device", options["device"]] if options["device"] != "auto" else []
    return Program(
        f"stereo_matching.model {options['model']}", tuple(command), options["start_s"], options["timeout_s"]
    )
