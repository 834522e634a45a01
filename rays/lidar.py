"""Scans of laser scanners: their beams traced against triangles, in batches of bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..physics.lidar.backscatter import Backscatter
from ..physics.lidar.beam import SubRays, make_sub_rays, spread_beams
from ..physics.lidar.instrument import Instrument, SensorPose
from ..physics.lidar.returns import Echoes, Returns, find_returns, join_returns, select_returns
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .shapes import World
from .surface import Surface, Tracer, find_surface

#: Number of rays that are traced at a time: about 60 MB for all their data.
_RAYS_AT_ONCE = 2**17
#: Distance in metres below which the energy that comes back grows no further.
_LEAST_RANGE_M = 1e-6


def scan(
    world: World, tracer: Tracer, instrument: Instrument, pose: SensorPose, laws: Mapping[int, Backscatter]
) -> Iterator[Returns]:
    """The returns of a scan that stands still, batch by batch, with points and normals in the world.

    ``laws`` have the reflectance by the label of triangles. Beams without a return have no entry. Raises IcyMoonError
    for a label without a law.
    """
    rays = make_sub_rays(instrument.sub_rays)
    step = max(1, _RAYS_AT_ONCE // len(rays.weight))
    for first in range(0, instrument.pattern.count, step):
        beams = instrument.pattern.make_beams(first, first + step)
        echoes = trace_beams(world, tracer, instrument, pose, laws, beams.direction, rays)
        found = find_returns(echoes, rays, instrument.gate_m, first)
        found = select_returns(found, instrument.reported)
        found.point_m[:] += pose.position_m
        found.true_point_m[:] += pose.position_m
        yield found


def scan_whole(
    world: World, tracer: Tracer, instrument: Instrument, pose: SensorPose, laws: Mapping[int, Backscatter]
) -> Returns:
    """All returns of ``scan``."""
    return join_returns(scan(world, tracer, instrument, pose, laws))


def trace_beams(
    world: World,
    tracer: Tracer,
    instrument: Instrument,
    pose: SensorPose,
    laws: Mapping[int, Backscatter],
    axis: Array,
    rays: SubRays,
) -> Echoes:
    """What the rays of beams meet; ``axis`` (m, 3) are unit vectors in the sensor's axes. Directions and normals of the
    result are in the world."""
    own = spread_beams(axis, rays, instrument.half_angle_rad)
    shape = own.shape[:2]
    direction = own.reshape(-1, 3) @ pose.rotation.T
    position = np.asarray(pose.position_m, np.float64)
    hits = tracer.intersect(position, direction, 0.0, np.inf)
    seen = find_surface(world, hits, position, direction)
    seen.along[(seen.along < instrument.nearest_m) | (seen.along > instrument.farthest_m)] = np.inf
    energy = _compute_energy(instrument, laws, seen, direction).reshape(shape) * rays.weight
    return Echoes(
        seen.along.reshape(shape),
        energy,
        direction.reshape(*shape, 3),
        seen.normal.reshape(*shape, 3),
        seen.label.reshape(shape),
        seen.number.reshape(shape),
    )


def _compute_energy(instrument: Instrument, laws: Mapping[int, Backscatter], seen: Surface, direction: Array) -> Array:
    """The energy in J (n,) that comes back by each ray, if it had the whole pulse."""
    cosine = np.clip(-np.einsum("ij,ij->i", direction, seen.normal), 0.0, 1.0)
    reflectance = np.zeros(len(cosine))
    met = seen.along < np.inf
    for label in np.flatnonzero(np.bincount(seen.label[met])).tolist():
        if label not in laws:
            raise IcyMoonError(f"The LiDAR meets a surface with the label {label}, which has no law of reflectance.")
        chosen = np.flatnonzero(met & (seen.label == label))
        reflectance[chosen] = laws[label].find(cosine[chosen])
    return instrument.collect(np.where(met, np.maximum(seen.along, _LEAST_RANGE_M), 1.0)) * reflectance
