"""Advice on calibrations with exchanged eyes, or with lengths in a wrong unit."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..formats.calibrations.options import UNITS_M, Stated
from ..formats.calibrations.registry import FORMATS
from ..physics.camera.calibrated_camera import CalibratedRig
from ..settings.description import defaults
from ..settings.table import TOPICS
from ..support.errors import IcyMoonError

#: Shortest and longest baseline of two eyes on one mount, m; endoscopes have 0.004, NASA's rovers at most 0.42, cars
#: 1.5.
_SHORT_BASELINE_M, _LIKELY_BASELINE_M = 0.003, 5.0


def selects_by_name(kind: str, chosen: str | None) -> bool:
    """Return whether ``--cameras`` or their order in one file selects the cameras. False if each camera has its own
    file."""
    return chosen is not None or not FORMATS[kind].each


def describe_exchange(names: Sequence[str]) -> str:
    """Return the fix for eyes in the wrong order: two files, or two ``names`` in one file."""
    return f"add --cameras {names[1]},{names[0]}" if all(names) else "give it first"


def describe_exchanged(second: str, first: str, aside_m: float, names: Sequence[str]) -> str:
    """Return a sentence on eyes in the wrong order: the ``second`` eye stands ``aside_m`` to the left of the ``first``
    eye. ``names`` are as in ``describe_exchange``."""
    return f"{second} stands {aside_m:.4g} m to the left of {first}, so it is the left eye; {describe_exchange(names)}."


def check_eye_order(rig: CalibratedRig, by_name: bool) -> list[str]:
    """Return a sentence if the second camera of a pair is to the left of the first camera."""
    if len(rig.cameras) != 2:
        return []
    first, second = rig.cameras
    x, y, z = (first.rotation @ (second.centre_m - first.centre_m)).tolist()
    if not -x > max(abs(y), abs(z)):
        return []
    names = [camera.name for camera in rig.cameras]
    return [describe_exchanged(names[1], names[0], -x, names if by_name else ("", ""))]


def check_baseline(baseline_m: float, where: str, stated_in: str, kind: str, stated: Stated) -> list[str]:
    """Return a sentence if the baseline, stated in metres, is likely in another unit.

    Raises IcyMoonError if it is too long for any rig. ``stated_in`` names the number in the file.
    """
    most = TOPICS["rig"]["baseline_m"].maximum
    if _SHORT_BASELINE_M <= baseline_m <= _LIKELY_BASELINE_M:
        return []
    own = baseline_m / UNITS_M[stated.unit or "m"]
    likely = [unit for unit in UNITS_M if _SHORT_BASELINE_M <= own * UNITS_M[unit] <= _LIKELY_BASELINE_M]
    is_open = not FORMATS[kind].in_metres and (kind != "opencv" or stated.unit is not None)
    unit = "metres" if stated.unit in (None, "m") else stated.unit
    if not likely:
        fix = "no unit makes that the baseline of a rig, so correct it, or calibrate again"
    elif is_open:
        fix = f"if it is in another unit, state --unit {' or '.join(likely)}"
    else:
        fix = "if it is in millimetres, divide it by 1000 in the file"
    if baseline_m > most:
        raise IcyMoonError(
            f"{where}: the eyes are {baseline_m:g} m apart, more than {most:g} m, since {stated_in} in {unit}; {fix}."
        )
    return [f"The eyes are {baseline_m:g} m apart, since {stated_in} in {unit}; {fix}."]


def check_focal_length(focal_px: float, size_px: tuple[int, int], where: str) -> None:
    """Raise IcyMoonError if a focal length is likely not in pixels: too short or too long for any image of this
    size."""
    focal = TOPICS["rig"]["focal_length_mm"]
    mm = focal_px / size_px[0] * defaults().rig.sensor_width_mm
    if focal.minimum <= mm <= focal.maximum:
        return
    fix = "if it is in millimetres, divide it by the pixel pitch in millimetres"
    if mm > focal.maximum:
        fix = "give it in pixels, or the images' own size"
    raise IcyMoonError(
        f"{where}: the focal length is {focal_px:g} px for images of {size_px[0]} x {size_px[1]} px, a field of "
        f"{2 * math.degrees(math.atan(size_px[0] / 2 / focal_px)):.3g} degrees; {fix}."
    )
