"""Scans of laser scanners: their beams are traced against triangles, in batches of bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..physics.lidar.backscatter import AlbedoMap, Backscatter
from ..physics.lidar.beam import SubRays, make_sub_rays, spread_beams
from ..physics.lidar.digitiser import Digitiser, Packets, Recorder
from ..physics.lidar.instrument import Instrument, SensorPose
from ..physics.lidar.measured_returns import Alarms, Measurement, Sensing, select_measured
from ..physics.lidar.returns import Echoes, Returns, find_returns, join_returns, select_returns
from ..support.arrays import Array
from ..support.errors import IcyMoonError
from .shapes import World
from .surface import Surface, Tracer, find_surface

#: Number of rays that are traced at a time: about 60 MB for all their data.
_RAYS_AT_ONCE = 2**17
#: Distance in metres below which a nearer surface returns no more energy.
_MIN_RANGE_M = 1e-6


@dataclass(frozen=True)
class ScannedBeams:
    """Reported returns (k,) of consecutive beams, further arrays (k,) by name, and the false alarms in these beams
    (None without a detector). ``beams`` is the number of beams, ``empty`` the number of beams without a return, and
    ``packets`` are the waveforms, None if they were not requested."""

    returns: Returns
    beside: dict[str, Array]
    alarms: Alarms | None
    beams: int
    empty: int
    packets: Packets | None = None


def scan(
    world: World, tracer: Tracer, instrument: Instrument, pose: SensorPose, laws: Mapping[int, Backscatter]
) -> Iterator[Returns]:
    """Yield the returns of a scan from a fixed sensor, batch by batch, with points and normals in world axes, metres.

    ``laws`` state the reflectance by the label of triangles. Beams without a return have no entry. Raises IcyMoonError
    for a label without a law.
    """
    for _, _, found in _trace_batches(world, tracer, instrument, pose, laws):
        yield select_returns(found, instrument.reported)


def scan_and_measure(
    world: World,
    tracer: Tracer,
    instrument: Instrument,
    pose: SensorPose,
    laws: Mapping[int, Backscatter],
    sensing: Sensing,
    albedo: AlbedoMap | None = None,
    digitiser: Digitiser | None = None,
) -> Iterator[ScannedBeams]:
    """Yield the returns of ``scan`` with the delay of light in ice and the measurements of a detector.

    ``albedo`` varies the reflectance over the ground; ``digitiser`` records the waveforms of a detector. Raises
    IcyMoonError as ``scan`` does, and for a detector that cannot measure with the instrument.
    """
    measurement = Measurement(instrument, sensing)
    recorder = None if digitiser is None else Recorder(digitiser, measurement)
    for first, end, found in _trace_batches(world, tracer, instrument, pose, laws, albedo):
        empty = end - first - len(np.unique(found.beam))
        if sensing.detector is None:
            chosen = select_returns(found, instrument.reported)
            yield ScannedBeams(chosen, measurement.delay(chosen), None, end - first, empty)
            continue
        measured, beam, range_m = measurement.measure(found, first, end)
        direction = instrument.pattern.make_beams(first, end).direction[beam - first] @ pose.rotation.T
        alarms = Alarms(beam, range_m, pose.position_m + direction * range_m[:, None])
        indices = select_measured(found, measured, instrument.reported)
        packets = None if recorder is None else recorder.record(found, indices, beam, range_m, first, end)
        chosen, measured = found.take(indices), measured.take(indices)
        yield ScannedBeams(chosen, measurement.delay(chosen) | vars(measured), alarms, end - first, empty, packets)


def _trace_batches(
    world: World,
    tracer: Tracer,
    instrument: Instrument,
    pose: SensorPose,
    laws: Mapping[int, Backscatter],
    albedo: AlbedoMap | None = None,
) -> Iterator[tuple[int, int, Returns]]:
    """Yield for each batch its first beam, the beam after its last, and all returns of the batch."""
    rays = make_sub_rays(instrument.sub_rays)
    step = max(1, _RAYS_AT_ONCE // len(rays.weight))
    for first in range(0, instrument.pattern.count, step):
        end = min(first + step, instrument.pattern.count)
        beams = instrument.pattern.make_beams(first, end)
        echoes = trace_beams(world, tracer, instrument, pose, laws, beams.direction, rays, albedo)
        found = find_returns(echoes, rays, instrument.gate_m, first)
        found.point_m[:] += pose.position_m
        found.true_point_m[:] += pose.position_m
        yield first, end, found


def scan_whole(
    world: World, tracer: Tracer, instrument: Instrument, pose: SensorPose, laws: Mapping[int, Backscatter]
) -> Returns:
    """Scan at once, and return all returns of ``scan``."""
    return join_returns(scan(world, tracer, instrument, pose, laws))


def trace_beams(
    world: World,
    tracer: Tracer,
    instrument: Instrument,
    pose: SensorPose,
    laws: Mapping[int, Backscatter],
    axis: Array,
    rays: SubRays,
    albedo: AlbedoMap | None = None,
) -> Echoes:
    """Trace the rays of beams to surfaces; ``axis`` (m, 3) are the beams' unit vectors in the sensor's axes.
    Directions and normals of the result are in the world. For ``albedo`` see ``scan_and_measure``."""
    own = spread_beams(axis, rays, instrument.half_angle_rad)
    shape = own.shape[:2]
    direction = own.reshape(-1, 3) @ pose.rotation.T
    position = np.asarray(pose.position_m, np.float64)
    hits = tracer.intersect(position, direction, 0.0, np.inf)
    seen = find_surface(world, hits, position, direction)
    seen.along[(seen.along < instrument.nearest_m) | (seen.along > instrument.farthest_m)] = np.inf
    energy = _compute_energy(instrument, laws, seen, direction)
    if albedo is not None:
        point = position + direction * np.where(np.isfinite(seen.along), seen.along, 0.0)[:, None]
        energy *= albedo.find_factors(point, seen.label)
    energy = energy.reshape(shape) * rays.weight
    return Echoes(
        seen.along.reshape(shape),
        energy,
        direction.reshape(*shape, 3),
        seen.normal.reshape(*shape, 3),
        seen.label.reshape(shape),
        seen.number.reshape(shape),
    )


def _compute_energy(instrument: Instrument, laws: Mapping[int, Backscatter], seen: Surface, direction: Array) -> Array:
    """Compute the energy (n,) in J that each ray would return if it carried the whole pulse."""
    cosine = np.clip(-np.einsum("ij,ij->i", direction, seen.normal), 0.0, 1.0)
    reflectance = np.zeros(len(cosine))
    met = seen.along < np.inf
    for label in np.flatnonzero(np.bincount(seen.label[met])).tolist():
        if label not in laws:
            raise IcyMoonError(f"The LiDAR meets a surface with the label {label}, which has no law of reflectance.")
        chosen = np.flatnonzero(met & (seen.label == label))
        reflectance[chosen] = laws[label].find(cosine[chosen])
    return instrument.collect(np.where(met, np.maximum(seen.along, _MIN_RANGE_M), 1.0)) * reflectance
