"""A pulsed laser scanner, and its pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..camera.pose_sequence import CAMERA_IN
from ..camera.rotations import from_quaternion, rotation_error
from ..light.photons import LIGHT_M_S, PLANCK_J_S
from .beam import compute_overlap
from .returns import Reported
from .scan_patterns import ScanPattern

#: Largest deviation of a rotation matrix times its transpose from the unit matrix.
_ROTATION_TOLERANCE = 1e-6
#: Full width at half maximum of a Gaussian over its standard deviation.
PULSE_FWHM = 2.0 * float(np.sqrt(2.0 * np.log(2.0)))


@dataclass(frozen=True)
class Instrument:
    """A laser scanner.

    ``pulse_j`` is the energy of the pulse of each beam. ``half_angle_rad`` is the half-angle of the beam at 1/e² of its
    intensity along the rows and across them, and ``exit_radius_m`` its radius at the sensor. The receiver has the
    radius ``aperture_radius_m``, sees a cone of ``field_half_angle_rad``, and is ``separation_m`` beside the
    transmitter. ``efficiency`` is the transmission of both optics. Surfaces from ``nearest_m`` to ``farthest_m`` are
    measured; nearer ones only block. Surfaces within ``gate_m`` in range are one return. ``sub_rays`` rays sample a
    beam. A pulse has the full width ``pulse_fwhm_s`` at half of its height. Raises IcyMoonError for impossible values.
    """

    pattern: ScanPattern
    pulse_j: float
    half_angle_rad: tuple[float, float]
    aperture_radius_m: float
    wavelength_m: float = 1064e-9
    exit_radius_m: float = 0.0
    field_half_angle_rad: float = np.pi / 2
    separation_m: float = 0.0
    efficiency: float = 1.0
    nearest_m: float = 0.0
    farthest_m: float = np.inf
    gate_m: float = 0.15
    sub_rays: int = 20
    reported: Reported = "ALL"
    pulse_fwhm_s: float = 1e-9

    def __post_init__(self) -> None:
        if not 0 < self.pulse_j < np.inf:
            raise IcyMoonError(
                f"The LiDAR's pulse has {self.pulse_j:g} J; give an energy above 0 (lidar.pulse_uj, in microjoules)."
            )
        if not 0 < self.pulse_fwhm_s < np.inf:
            raise IcyMoonError(
                f"The LiDAR's pulse is {self.pulse_fwhm_s:g} s long; give a time above 0 (lidar.pulse_ns)."
            )
        if not 0 < self.wavelength_m < np.inf:
            raise IcyMoonError(f"The LiDAR's wavelength is {self.wavelength_m:g} m; give a length above 0.")
        for name, what in _LENGTHS.items():
            if not 0 <= getattr(self, name) < np.inf:
                raise IcyMoonError(f"The LiDAR's {what} is {getattr(self, name):g}; give 0 or a positive number.")
        if not all(0 <= angle < np.pi / 4 for angle in self.half_angle_rad):
            raise IcyMoonError(
                f"The half-angles of the LiDAR's beam are {self.half_angle_rad[0]:g} and {self.half_angle_rad[1]:g} "
                "rad; give 0 to 0.785."
            )
        if not self.aperture_radius_m > 0:
            raise IcyMoonError("The LiDAR's aperture is 0, so no light comes back; give a width above 0.")
        if not 0 < self.efficiency <= 1:
            raise IcyMoonError(
                f"The LiDAR's optics transmit {self.efficiency:g} of the light; give a share above 0 and at most 1."
            )
        if self.sub_rays != 1 and (self.sub_rays < 6 or self.sub_rays % 2):
            raise IcyMoonError(
                f"A beam of the LiDAR has {self.sub_rays} rays; give 1, or an even number of at least 6, such as 20."
            )
        if not self.nearest_m < self.farthest_m:
            raise IcyMoonError(
                f"The LiDAR measures from {self.nearest_m:g} m to {self.farthest_m:g} m; make the first smaller."
            )

    @property
    def pulse_deviation_s(self) -> float:
        """Standard deviation of the pulse in s."""
        return self.pulse_fwhm_s / PULSE_FWHM

    def collect(self, range_m: Array) -> Array:
        """Compute the energy in J that comes back from a surface at ``range_m`` (n,) that meets the whole beam, over
        the surface's bidirectional reflectance in 1/sr: E η A O(R) / R².
        """
        overlap = compute_overlap(
            range_m,
            self.separation_m,
            self.exit_radius_m,
            max(self.half_angle_rad),
            self.aperture_radius_m,
            self.field_half_angle_rad,
        )
        area_m2 = np.pi * self.aperture_radius_m**2
        return np.asarray(self.pulse_j * self.efficiency * area_m2 * overlap / range_m**2)

    def count_photons(self, energy_j: Array) -> Array:
        """Compute the mean number of photons in an energy."""
        return np.asarray(energy_j * (self.wavelength_m / (PLANCK_J_S * LIGHT_M_S)))


_LENGTHS = {
    "aperture_radius_m": "aperture",
    "exit_radius_m": "radius of the beam",
    "field_half_angle_rad": "receiver's field",
    "separation_m": "separation of transmitter and receiver",
    "nearest_m": "nearest range",
    "gate_m": "range gate",
}


@dataclass(frozen=True)
class SensorPose:
    """The place (3,) of a sensor in metres, and the rotation (3, 3) whose columns are the sensor's axes in the world: x
    forward, y left and z up. Raises IcyMoonError for a pose without a place or a rotation.
    """

    position_m: Array
    rotation: Array

    def __post_init__(self) -> None:
        if np.shape(self.position_m) != (3,) or not np.isfinite(self.position_m).all():
            raise IcyMoonError("The LiDAR's pose has no place; give x, y and z in metres.")
        if np.shape(self.rotation) != (3, 3) or rotation_error(np.asarray(self.rotation)) > _ROTATION_TOLERANCE:
            raise IcyMoonError(
                "The LiDAR's pose has no rotation; give a quaternion w, x, y, z, or a right-handed matrix of unit "
                "vectors."
            )

    def to_world(self, point_m: Array) -> Array:
        """Transform points (n, 3) from the sensor's axes to the world."""
        return np.asarray(point_m @ self.rotation.T + self.position_m)

    def to_sensor(self, point_m: Array) -> Array:
        """Transform points (n, 3) from the world to the sensor's axes."""
        return np.asarray((point_m - self.position_m) @ self.rotation)

    @property
    def matrix(self) -> Array:
        """The matrix (4, 4) from the sensor's axes to the world."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position_m
        return matrix


def make_pose(position_m: Sequence[float], wxyz: Sequence[float]) -> SensorPose:
    """Make the pose with a quaternion w, x, y, z of any length but 0, from the sensor's axes to the world's. Raises
    IcyMoonError as ``SensorPose`` does.
    """
    try:
        rotation = from_quaternion(np.asarray(wxyz, np.float64)) if len(wxyz) == 4 else np.zeros(0)
    except ValueError:
        rotation = np.zeros(0)
    return SensorPose(np.asarray(position_m, np.float64), rotation)


def mount_on_rig(left: Array, aim: str) -> SensorPose:
    """Make the pose of a sensor at the left eye, whose pose ``left`` (4, 4) is in OpenCV's axes. The sensor looks along
    the camera, or horizontally along its heading if ``aim`` is LEVEL.
    """
    if aim == "LEVEL":
        x, y = left[:2, 2]
        heading = np.arctan2(y, x) if np.hypot(x, y) > 1e-9 else 0.0
        return make_pose(left[:3, 3].tolist(), (np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)))
    return SensorPose(left[:3, 3], left[:3, :3] @ CAMERA_IN["ROS"].T)
