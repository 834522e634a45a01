"""Calibrated cameras as text for the user."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..formats.calibrations.options import BROWN_NAMES
from ..physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from ..physics.camera.lens_models import Brown, Cahvore, LensModel
from ..physics.camera.rotations import to_vector
from ..support.arrays import Array


def describe_rig(rig: CalibratedRig) -> Iterator[str]:
    """Describe all cameras in lines, each with its position and direction relative to the first camera."""
    for number, camera in enumerate(rig.cameras):
        yield from _describe(camera, camera.name or f"camera {number + 1}")
        if number:
            rotation, translation = rig.relative_pose(number)
            turned = math.degrees(float(np.linalg.norm(to_vector(rotation))))
            right, down, ahead = (-rotation.T @ translation).tolist()
            first = rig.cameras[0].name or "camera 1"
            yield f"  {np.linalg.norm(translation):.9g} m from {first}, turned by {turned:.6g} degrees from it"
            yield f"  {right:.6g} m to the right, {down:.6g} m down, {ahead:.6g} m ahead in its axes"
            yield f"  R = {_words(rotation)}"
            yield f"  t = {_words(translation)} m"


def _describe(camera: CalibratedCamera, name: str) -> Iterator[str]:
    yield f"{name}: {camera.width_px} x {camera.height_px} px, {camera.lens.name}"
    yield f"  fx = {camera.fx_px:.9g}, fy = {camera.fy_px:.9g}, skew = {camera.skew_px:.9g} px"
    yield f"  cx = {camera.cx_px:.9g}, cy = {camera.cy_px:.9g} px from the centre of the first pixel"
    numbers = _list_coefficients(camera.lens)
    if numbers:
        yield f"  {numbers}"
    (across, whole_across), (down, whole_down) = (_measure_field_deg(camera, axis) for axis in range(2))
    seen = "" if whole_across and whole_down else ", up to where its lens turns back"
    yield f"  field of view {across:.4g} x {down:.4g} degrees through the principal point{seen}"
    if dark := camera.dark_share():
        yield f"  {dark:.1%} of the pixels see nothing"


def _list_coefficients(lens: LensModel) -> str:
    """Name the coefficients of a lens with their values."""
    if isinstance(lens, Cahvore):
        vectors = {"O": lens.axis, "R": lens.radial, **({} if lens.pupil is None else {"E": lens.pupil})}
        return ", ".join(f"{letter} = ({_words(vector)})" for letter, vector in vectors.items())
    is_brown = isinstance(lens, Brown)
    names = BROWN_NAMES if is_brown else ("k1", "k2", "k3", "k4")
    values = lens.shortened() if isinstance(lens, Brown) else lens.coefficients
    return ", ".join(f"{name} = {value:.9g}" for name, value in zip(names, values, strict=False))


def _measure_field_deg(camera: CalibratedCamera, axis: int) -> tuple[float, bool]:
    """Measure the field of view in degrees along an axis through the principal point, 0 if it sees nothing. Also return
    whether both borders see something."""
    size = camera.size_px[axis]
    places = np.array([[camera.cx_px, camera.cy_px]] * (4 * size + 1))
    places[:, axis] = np.linspace(-0.5, size - 0.5, len(places))
    # The angles to the axis are added, so that a field of more than 180 degrees is correct.
    rays = camera.unproject(places)
    angles = np.degrees(np.arctan2(rays[:, axis], rays[:, 2]))
    seen = angles[np.isfinite(angles)]
    return float(np.ptp(seen)) if len(seen) else 0.0, bool(np.isfinite(angles[[0, -1]]).all())


def _words(numbers: Array | tuple[float, ...]) -> str:
    return ", ".join(f"{value:.9g}" for value in np.ravel(numbers))
