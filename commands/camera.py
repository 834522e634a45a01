"""The verb ``camera``: the rig of two camera models, as settings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import IcyMoonError
from ..formats.cahvor import FIT_LIMIT_PX, Cahvor, nearest_lens, read_model
from ..physics.camera.lens_distortion import COEFFICIENTS
from ..settings.description import check, defaults
from ..settings.toml_text import to_toml
from ..support.printer import say
from ..terminal import as_path
from ..typed_settings import Settings

#: How far two eyes may be from parallel, rad, and from side by side, as a share of the baseline.
_PARALLEL_RAD, _ASIDE = 1e-4, 1e-3
#: How far two eyes may differ in focal length, principal point and distortion, px over the image.
_ALIKE_PX = 0.5


def add_verb(verbs: Any) -> None:
    """Add the verb to the command line's parser."""
    camera = verbs.add_parser("camera", help="print the rig of two camera models (CAHV, CAHVOR, CAHVORE) as settings")
    camera.add_argument("left", type=as_path, help="model of the left camera: a .cahvor file or a PDS3 label")
    camera.add_argument("right", type=as_path, help="model of the right camera")
    camera.add_argument("--most-px", type=float, default=FIT_LIMIT_PX, metavar="PX",
                        help="largest error of a lens that can only be fitted (%(default)s)")
    camera.set_defaults(run=_run_camera)


def _run_camera(options: argparse.Namespace) -> int:
    settings, residual = read_rig(options.left, options.right, options.most_px)
    if residual:
        say(f"# the lens is fitted, off by up to {residual:.2g} px")
    say(to_toml(settings).removesuffix("\n"))
    return 0


def read_rig(left: Path, right: Path, most_px: float = FIT_LIMIT_PX) -> tuple[Settings, float]:
    """The ``rig`` settings of two camera models, and the largest error in px of the lens that stands for theirs.

    The width of the sensor is that of the defaults, since a model states lengths in pixels only. Raises IcyMoonError if
    the eyes are not parallel, side by side and alike, or if the lens is off by more than ``most_px``.
    """
    models = read_model(left), read_model(right)
    first, second = (nearest_lens(model, most_px) for model in models)
    _check_parallel(*models, f"{left} and {right}")
    size = models[0].width_px, models[0].height_px
    differ = np.abs([first.focal_px - second.focal_px, first.cx_px - second.cx_px, first.cy_px - second.cy_px])
    bent = np.abs(np.subtract(first.k, second.k)).max() * first.focal_px
    if size != (models[1].width_px, models[1].height_px) or max(differ.max(), bent) > _ALIKE_PX:
        raise IcyMoonError(f"{left} and {right} are cameras that differ by more than {_ALIKE_PX:g} px, and both eyes "
                           "of a rig here are alike; rectify their images first.")
    width_mm = defaults().rig.sensor_width_mm
    rig = {"width_px": size[0], "height_px": size[1], "sensor_width_mm": width_mm,
           "focal_length_mm": first.focal_px / size[0] * width_mm,
           # Rounding of the model's vectors leaves 1e-14 px where the middle is meant; adding 0 makes -0 plain.
           "principal_x_px": round(first.cx_px + 0.5 - size[0] / 2, 9) + 0.0,
           "principal_y_px": round(first.cy_px + 0.5 - size[1] / 2, 9) + 0.0,
           "baseline_m": float(np.linalg.norm(models[1].c - models[0].c)),
           **{f"distortion_{name}": value for name, value in zip(COEFFICIENTS, first.k, strict=True)}}
    return check({"rig": rig}, f"{left} and {right}"), max(first.residual_px, second.residual_px)


def _check_parallel(left: Cahvor, right: Cahvor, where: str) -> None:
    """Raise IcyMoonError unless the right eye stands on the x axis of the left one, and looks where it looks."""
    (_, first), (_, second) = left.pinhole(), right.pinhole()
    turned = float(np.arccos(np.clip(((first @ second.T).trace() - 1) / 2, -1, 1)))
    along = first @ (right.c - left.c)
    if turned > _PARALLEL_RAD:
        raise IcyMoonError(f"{where}: the eyes are turned against each other by {np.degrees(turned):.3g} degrees; "
                           "rectify their images first.")
    if not along[0] > 0 or np.abs(along[1:]).max() > _ASIDE * along[0]:
        raise IcyMoonError(f"{where}: the right eye is {along[0]:.4g} m to the right of the left one, {along[1]:.4g} m "
                           f"below and {along[2]:.4g} m before it, so they are not side by side; rectify their images.")
