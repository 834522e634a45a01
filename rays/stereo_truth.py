"""The truth of a stereo pair at pixel centres: depth, normals, labels, and points hidden from the other eye."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..physics.camera.calibrated_camera import CalibratedCamera
from ..physics.camera.eyes import find_rays_in_rig
from ..support.arrays import Array
from .shapes import World
from .surface import Surface, Tracer, find_surface, intersect_opaque

#: Disparity in px by which an occluder must be nearer than the hidden point; see ``docs/theory/metrics.md``.
MIN_GAP_PX = 0.25
#: Side in pixels of a square whose rays are traced in a row, because they meet similar places.
_TILE_SIDE_PX = 4
#: Number of pixels traced at a time: 500 MB for all their data.
_PIXELS_AT_ONCE = 2**19


@dataclass(frozen=True)
class Eye:
    """A pinhole camera. ``axes`` (3, 3) has its axes right, down and ahead as columns, in the world; ``position`` (3,)
    is in metres. The principal point is in pixel-corner coordinates.

    With a rolling shutter, ``axes`` (rows, 3, 3) and ``position`` (rows, 3) are for each row at the time of its
    exposure."""

    columns: int
    rows: int
    focal_px: float
    cx_px: float
    cy_px: float
    axes: Array
    position: Array

    def directions(self, pixels: Array) -> Array:
        """Return world rays (n, 3) through the centres of pixels (n,), counted along rows, scaled to a planar depth of
        1."""
        row, column = np.divmod(pixels, self.columns)
        own = np.stack(
            [
                (column + 0.5 - self.cx_px) / self.focal_px,
                (row + 0.5 - self.cy_px) / self.focal_px,
                np.ones(len(pixels)),
            ],
            axis=1,
        )
        return to_world(own, self.place(pixels)[0])

    def place(self, pixels: Array) -> tuple[Array, Array]:
        """Return the axes (3, 3) and the position (3,) of the eye while pixels (n,) are exposed; with a rolling
        shutter, one of each for every pixel."""
        if self.axes.ndim == 2:
            return self.axes, self.position
        row = pixels // self.columns
        return self.axes[row], self.position[row]

    def is_seen(self, right: Array, down: Array, ahead: Array) -> Array:
        """Return whether (n,) points, in metres along the camera's axes, are in the image's frame."""
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = self.cx_px + self.focal_px * right / ahead, self.cy_px + self.focal_px * down / ahead
            return np.asarray(
                (ahead > 0)
                & (column >= 0)
                & (column <= self.columns)
                & (row >= -_ROW_SLACK)
                & (row <= self.rows + _ROW_SLACK)
            )

    def measure(self, away: Array) -> Array:
        """Return the planar depths (n,) of points ``away`` (n, 3) from the eye, in its axes."""
        return np.asarray(away[:, 2])

    def to_own_depth(self, direction: Array, depth_m: Array) -> Array:
        """Convert the depths (n,) along the rig's axis to depths along the eye's own axis; here they are the same."""
        return depth_m


@dataclass(frozen=True)
class CalibratedEye:
    """A calibrated camera at an eye of a parallel rig; the other fields are as in the rig's ``Eye``.

    Its rays have length 1, since they may lead in any direction. The pose of ``own`` is in the rig's axes.
    """

    own: CalibratedCamera
    focal_px: float
    axes: Array
    position: Array

    @property
    def columns(self) -> int:
        return self.own.width_px

    @property
    def rows(self) -> int:
        return self.own.height_px

    def directions(self, pixels: Array) -> Array:
        """Return the rays (n, 3) of length 1 in the world through the centres of pixels (n,), counted along rows; NaN
        outside the lens's field."""
        row, column = np.divmod(pixels, self.columns)
        return np.asarray(find_rays_in_rig(self.own, np.stack([column, row], axis=1).astype(np.float64)) @ self.axes.T)

    def place(self, pixels: Array) -> tuple[Array, Array]:
        """Return the axes (3, 3) of the rig and the position (3,) of the eye, which are the same for all pixels."""
        return self.axes, self.position

    def is_seen(self, right: Array, down: Array, ahead: Array) -> Array:
        """Return whether (n,) points, in metres along the rig's axes from the eye, are in the image's frame."""
        where = self.own.show(np.stack([right, down, ahead], axis=-1) @ self.own.rotation.T)
        beyond = np.array(self.own.size_px) - 0.5
        with np.errstate(invalid="ignore"):
            return np.asarray(((where >= -0.5) & (where <= beyond)).all(axis=-1))

    def measure(self, away: Array) -> Array:
        """Return the distances (n,) of points ``away`` (n, 3) from the eye."""
        return np.asarray(np.linalg.norm(away, axis=-1))

    def to_own_depth(self, direction: Array, distance_m: Array) -> Array:
        """Convert distances (n,) along rays (n, 3) to depths (n,) along the eye's own axis; NaN for rays that lead 90
        degrees or more away from it."""
        ahead = direction @ (self.axes @ self.own.rotation[2])
        with np.errstate(invalid="ignore"):
            return np.where(ahead > 0, distance_m * ahead, np.nan)


#: Rounding in rows. A point in the first or last row of one eye is in the same row of the other eye.
_ROW_SLACK = 1e-6


AnyEye = Eye | CalibratedEye


def to_world(own: Array, axes: Array) -> Array:
    """Rotate vectors (n, 3) from an eye's axes to the world. ``axes`` (3, 3) or (n, 3, 3) are columns in the world."""
    return np.asarray(own @ axes.T if axes.ndim == 2 else np.einsum("nij,nj->ni", axes, own))


def to_eye(away: Array, axes: Array) -> Array:
    """Rotate vectors (n, 3) from the world to an eye's axes; see ``to_world``."""
    return np.asarray((axes.T @ away.T).T if axes.ndim == 2 else np.einsum("nij,ni->nj", axes, away))


@dataclass(frozen=True)
class EyeTruth:
    """The truth of an eye, arrays (rows, columns). ``depth_m`` float32 is along its axis, infinite for the sky.
    ``normal`` (..., 3) float32 belongs to the facet. ``label`` uint8 and ``number`` int64 are as in ``rays.shapes``.
    ``hidden`` is true for points in the other eye's frame that are hidden from the other eye. ``loose_m`` float32 is
    the thickness of loose material; None if no shape has it."""

    depth_m: Array
    normal: Array
    label: Array
    number: Array
    hidden: Array
    loose_m: Array | None


@dataclass(frozen=True)
class Stage:
    """The traced scene: the ground with all objects on it, and the far sky, which hides nothing,
    each with its tracer."""

    ground: World
    ground_tracer: Tracer
    sky: World
    sky_tracer: Tracer


def trace_eyes(
    stage: Stage, eyes: Mapping[str, AnyEye], baseline_m: float, near_m: float, far_m: float
) -> dict[str, EyeTruth]:
    """Trace the truth of two eyes, by their names, that are ``baseline_m`` apart. They see nothing nearer than
    ``near_m`` or farther than ``far_m``."""
    left, right = eyes
    return {
        eye: _trace_eye(stage, eyes[eye], eyes[other], baseline_m, near_m, far_m)
        for eye, other in ((left, right), (right, left))
    }


def _trace_eye(stage: Stage, eye: AnyEye, other: AnyEye, baseline_m: float, near_m: float, far_m: float) -> EyeTruth:
    shape = eye.rows, eye.columns
    truth = EyeTruth(
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.float32),
        np.empty(shape, np.uint8),
        np.empty(shape, np.int64),
        np.empty(shape, bool),
        np.empty(shape, np.float32) if any(each.shape.loose_m is not None for each in stage.ground.placed) else None,
    )
    for pixels in list_squares(eye.rows, eye.columns):
        direction = eye.directions(pixels)
        axes, origin = eye.place(pixels)
        lost = np.isnan(direction).any(axis=1)
        direction[lost] = np.broadcast_to(axes, (len(pixels), 3, 3))[lost, :, 2]  # any direction; the hit is dropped
        seen = find_first_surface(stage, origin, direction, near_m, far_m)
        for values in (seen.label, seen.number, seen.normal, seen.loose_m):
            values[lost] = 0
        seen.along[lost] = np.inf
        hidden = find_hidden(stage.ground_tracer, eye, other, pixels, direction, seen.along, baseline_m, near_m)
        for values, target in (
            (eye.to_own_depth(direction, seen.along), truth.depth_m),
            (seen.label, truth.label),
            (seen.number, truth.number),
            (hidden, truth.hidden),
            (seen.loose_m, truth.loose_m),
        ):
            if target is not None:
                target.reshape(-1)[pixels] = values
        truth.normal.reshape(-1, 3)[pixels] = seen.normal
    return truth


def list_squares(rows: int, columns: int) -> Iterator[Array]:
    """Yield groups of pixels, counted along rows: square by square, so that consecutive rays hit nearby places. Some
    pixels occur twice at the borders."""
    step = max(_TILE_SIDE_PX, _PIXELS_AT_ONCE // max(1, columns) // _TILE_SIDE_PX * _TILE_SIDE_PX)
    for first in range(0, rows, step):
        part = np.arange(first * columns, min(rows, first + step) * columns).reshape(-1, columns)
        part = np.pad(part, [(0, -part.shape[0] % _TILE_SIDE_PX), (0, -columns % _TILE_SIDE_PX)], mode="edge")
        yield part.reshape(part.shape[0] // _TILE_SIDE_PX, _TILE_SIDE_PX, -1, _TILE_SIDE_PX).swapaxes(1, 2).reshape(-1)


def find_first_surface(stage: Stage, origin: Array, direction: Array, near_m: float, far_m: float) -> Surface:
    """Find the first surface, of the ground or else of the sky, that rays (n, 3) from ``origin``, (3,) or (n, 3),
    hit."""
    seen = find_surface(
        stage.ground, stage.ground_tracer.intersect(origin, direction, near_m, far_m), origin, direction
    )
    if not stage.sky.placed:
        return seen
    free = np.flatnonzero(np.isinf(seen.along))
    if len(free):
        ahead, start = direction[free], origin if origin.ndim == 1 else origin[free]
        beyond = find_surface(
            stage.sky, intersect_opaque(stage.sky_tracer, stage.sky, start, ahead, near_m, far_m), start, ahead
        )
        for name in ("along", "normal", "label", "number", "loose_m"):
            getattr(seen, name)[free] = getattr(beyond, name)
    return seen


def find_hidden(
    tracer: Tracer,
    eye: AnyEye,
    other: AnyEye,
    pixels: Array,
    direction: Array,
    along_m: Array,
    baseline_m: float,
    near_m: float,
) -> Array:
    """Return whether (n,) a surface hides each point from the other eye, nearer by at least ``MIN_GAP_PX`` of
    disparity. Points are ``along_m`` (n,) along the rays. With a rolling shutter, the other eye sees the point in the
    same row.
    """
    hidden = np.zeros(len(along_m), bool)
    axes, position = other.place(pixels)
    away = direction * np.where(np.isinf(along_m), 0.0, along_m)[:, None] + (eye.place(pixels)[1] - position)
    right, down, ahead = to_eye(away, axes).T
    asked = np.flatnonzero(np.isfinite(along_m) & other.is_seen(right, down, ahead))
    if axes.ndim == 3:
        axes, position = axes[asked], position[asked]
    reach = other.measure(to_eye(away[asked], axes))
    end = 1.0 / (1.0 / reach + MIN_GAP_PX / (eye.focal_px * baseline_m))
    hidden[asked] = tracer.is_blocked(position, away[asked] / reach[:, None], near_m, end)
    return hidden
