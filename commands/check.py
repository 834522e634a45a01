"""The verb ``check``: whether Blender, OpenEXR and OpenCV work together here, tested on a small pair with known truth.

A level plane of Lambert's law is rendered and measured: its depth must be the depth of the plane, its light must follow
Lambert's law, and a matcher must find its disparity.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ..physics.light.directions import camera_axes
from ..render.workers.job_commands import Job, render_job
from ..settings.description import check, defaults, merged
from ..settings.topics.declaration import Parts
from ..support.errors import IcyMoonError
from ..support.printer import say
from ..support.temporary_folders import open_scratch_folder
from ..support.terminal import show_progress
from .renderer_options import add_blender_option

#: Level ground with patches of 8 cm that are up to a quarter darker, seen from 1.5 m by a small camera.
_GROUND_ALBEDO, _DARKEST_PATCH_SHARE = 0.7, 0.25
_TEST_SCENE: Parts = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 20.0, "resolution": 33},
    "mesh": {"kind": "GRID"},
    "surface": {
        "model": "LAMBERT",
        "grain_amplitude_m": 0.0,
        "albedo": _GROUND_ALBEDO,
        "albedo_variation": _DARKEST_PATCH_SHARE,
        "albedo_patch_m": 0.08,
    },
    "light": {"sun_elevation_deg": 35.0, "planet": False},
    "rocks": {"coverage": 0.0},
    "rig": {"width_px": 96, "height_px": 72, "height_m": 1.5, "pitch_deg": 50.0, "baseline_m": 0.25},
    "quality": {"samples": 16, "diffuse_bounces": 0, "denoiser": "NONE"},
}
#: Largest errors of a right installation: relative error of depth, from rounding to single precision; relative error of
#: the mean light, from noise of samples and of the texture's mean; mean error in px of SGBM on a texture it can match.
_MAX_ERRORS = {"depth": 1e-4, "light": 0.03, "sgbm": 0.3}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``check``."""
    add_blender_option(parser)
    parser.set_defaults(run=_run_check)


def _run_check(options: argparse.Namespace) -> int:
    before, start = _measure_processor_s(), time.perf_counter()
    with open_scratch_folder() as folder:
        job = Job(folder / "check", merged(defaults(), check(_TEST_SCENE, "check")))
        with show_progress("Starting Blender") as show:
            (pair,) = render_job(job, options.blender, show)
        faults = list(_measure(pair, folder / "evaluation"))
    if faults:
        raise IcyMoonError(
            f"The installation is faulty: {'; '.join(faults)}. Run icymoon doctor, and report this with what it prints."
        )
    say(
        f"The installation is right. This took {_measure_processor_s() - before:.0f} s of processor time, "
        f"{time.perf_counter() - start:.0f} s in all."
    )
    return 0


def _measure_processor_s() -> float:
    """Return the processor seconds of this process and of its ended child processes; on Windows without the child
    processes."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def _measure(folder: Path, out: Path) -> Iterator[str]:
    """Print each comparison of a rendered pair with its known truth. Yield a clause for each that fails."""
    from ..render.pairs.pair_folder import read_pair
    from ..stereo.evaluate import evaluate
    from ..stereo.images.exr import read_view
    from ..stereo.matchers.methods import parse_methods

    pair = read_pair(folder)
    view, camera = read_view(pair.image("left")), pair.camera
    row = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    fall = -(camera_axes(0.0, pair.settings.rig.pitch_deg)[2, 1:] @ np.stack([row, np.ones_like(row)]))
    known = fall > math.tan(math.radians(15.0))  # on the plane, not beyond it
    plane = pair.settings.rig.height_m / fall[known]
    lit = pair.sun.ground_irradiance_wm2 if pair.sun else math.nan
    light = math.pi * float(view.radiance[known].mean()) / (lit * _GROUND_ALBEDO * (1 - _DARKEST_PATCH_SHARE / 2))
    (row_of_sgbm,) = evaluate([folder], parse_methods("sgbm"), out)["rows"]
    found: dict[str, tuple[str, float, Callable[[float], str]]] = {
        "depth": (
            "largest relative error of the depth of a plane",
            float(np.abs(view.depth[known] / plane[:, None] - 1).max()),
            lambda value: f"{value:.1e}",
        ),
        "light": ("error of the mean light under Lambert's law", abs(light - 1), lambda value: f"{100 * value:.1f} %"),
        "sgbm": (
            "mean error of the disparity by SGBM",
            float(row_of_sgbm.get("epe_px") or math.nan),
            lambda value: f"{value:.3f} px",
        ),
    }
    for key, (text, value, show) in found.items():
        say(f"{text[0].upper()}{text[1:]}: {show(value)} (at most {show(_MAX_ERRORS[key])})")
        if not value <= _MAX_ERRORS[key]:
            yield f"the {text} is {show(value)}, above {show(_MAX_ERRORS[key])}"
