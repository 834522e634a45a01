"""Pulses that come back: rays of a beam that meet surfaces at similar distances are one return."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from ...support.arrays import Array
from .beam import SubRays

#: The gate of a beam of n rays is wider by the share of this number over n. With it 20 and 60 rays divide rocks as 2401
#: rays do; the study ``lidar_beams`` in benchmarks/ measures it.
_GATE_PER_RAY = 2.5
#: The returns of a beam that an instrument reports.
Reported = Literal["ALL", "FIRST", "STRONGEST", "LAST"]


@dataclass(frozen=True)
class Echoes:
    """The places where the n rays of m beams meet surfaces. ``range_m`` (m, n) is infinite without a surface, and
    ``energy_j`` (m, n) is the energy that comes back. ``direction`` and ``normal`` (m, n, 3) are unit vectors, the
    normal on the side of the sensor. ``label`` and ``number`` (m, n) belong to the surface, as in ``rays.shapes``. The
    first ray is the axis of the beam.
    """

    range_m: Array
    energy_j: Array
    direction: Array
    normal: Array
    label: Array
    number: Array


@dataclass(frozen=True)
class Returns:
    """Returns (k,) in the order of their beams, and by range within a beam.

    ``beam`` int64 is the beam's number. ``order`` uint8 is the return's number in the beam, from 1, and ``of`` uint8
    the number of returns of the beam. ``range_m`` is the mean range of the return's rays, weighted by the energy that
    each brings back. ``energy_j`` is the sum of these energies, and ``spread_m`` the standard deviation of the ranges.
    ``share`` is the share of the pulse that met these surfaces. ``point_m`` (k, 3) is at the mean range along the
    beam's axis, in the axes of ``direction``.

    The truth belongs to one surface: the surface on the beam's axis if the axis is part of the return (``on_axis``),
    otherwise the surface of the return's ray nearest to the axis. It is ``true_range_m``, ``true_point_m`` (k, 3),
    ``incidence_rad``, the facet's ``normal`` (k, 3), ``label`` uint8 and ``number`` int64.
    """

    beam: Array
    order: Array
    of: Array
    range_m: Array
    energy_j: Array
    spread_m: Array
    share: Array
    point_m: Array
    true_range_m: Array
    true_point_m: Array
    incidence_rad: Array
    normal: Array
    label: Array
    number: Array
    on_axis: Array

    def __len__(self) -> int:
        return len(self.beam)

    def take(self, chosen: Array) -> Returns:
        """Take some of the returns, by a mask or by indices."""
        return Returns(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


def find_returns(echoes: Echoes, rays: SubRays, gate_m: float, first_beam: int = 0) -> Returns:
    """Find the returns of beams whose rays are ``rays``.

    A return ends where the next ray is farther by more than the gate, unless two neighbouring rays on both sides of
    this gap meet one surface: the plane at one hit comes within ``gate_m`` of the other hit. So a plane at a grazing
    angle is one return, however long it is. The gate is ``gate_m``, and wider for few rays, which leave gaps in uneven
    surfaces. Rays without energy make no return. Points are in metres from the sensor; ``first_beam`` is added to the
    numbers of beams.
    """
    sorting = np.argsort(echoes.range_m, axis=1, kind="stable")
    beams, place = np.nonzero(np.isfinite(np.take_along_axis(echoes.range_m, sorting, axis=1)))
    hits = beams, sorting[beams, place]
    group = _number_groups(echoes, *hits, rays, gate_m)
    returns = _measure_groups(echoes, *hits, group, rays)
    returns = returns.take(returns.energy_j > 0)
    _, start, count = np.unique(returns.beam, return_index=True, return_counts=True)
    returns.of[:] = np.repeat(np.minimum(count, 255), count)
    returns.order[:] = np.minimum(np.arange(len(returns)) - np.repeat(start, count) + 1, 255)
    returns.beam[:] += first_beam
    return returns


def _number_groups(echoes: Echoes, beams: Array, ray: Array, rays: SubRays, gate_m: float) -> Array:
    """Number the return (h,) of each hit; hits (h,) are sorted by beam and range."""
    range_m = echoes.range_m[beams, ray]
    begins = np.ones(len(beams), bool)
    begins[1:] = np.diff(beams) > 0
    apart = begins.copy()
    apart[1:] |= np.diff(range_m) > gate_m * (1 + _GATE_PER_RAY / max(1, np.count_nonzero(rays.weight)))
    broken = np.unique(beams[apart & ~begins])
    if len(broken) and len(rays.neighbours):
        place = np.full(echoes.range_m.shape, -1)
        place[beams, ray] = np.arange(len(beams))
        beam, edge = np.nonzero(_are_one_surface(echoes, broken, rays.neighbours, gate_m))
        ends = place[broken[beam][:, None], rays.neighbours[edge]]
        ends = ends[(ends >= 0).all(axis=1)]
        # A surface that reaches from one hit to another in range joins all hits between.
        cover = np.zeros(len(beams) + 1, np.int64)
        np.add.at(cover, ends.min(axis=1) + 1, 1)
        np.add.at(cover, ends.max(axis=1) + 1, -1)
        apart &= np.cumsum(cover)[:-1] == 0
    return np.cumsum(apart) - 1


def _are_one_surface(echoes: Echoes, beams: Array, edges: Array, gate_m: float) -> Array:
    """Return whether neighbouring rays (e, 2) of ``beams`` (b,) meet one surface, bool (b, e)."""
    range_m, normal, direction = echoes.range_m[beams], echoes.normal[beams], echoes.direction[beams]
    one, other = edges.T
    found = np.zeros((len(beams), len(edges)), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        step = range_m[:, other] - range_m[:, one]
        for here, there, way in ((one, other, 1), (other, one, -1)):
            own = np.einsum("bei,bei->be", normal[:, here], direction[:, here])
            cross = np.einsum("bei,bei->be", normal[:, here], direction[:, there])
            expected = way * range_m[:, here] * (own / cross - 1)
            found |= np.abs(expected - step) <= gate_m
    return found


def _measure_groups(echoes: Echoes, beams: Array, ray_of_hit: Array, group: Array, rays: SubRays) -> Returns:
    """Measure the returns of groups of hits, numbered from 0; ``order`` and ``of`` are left 0."""
    range_m, energy = echoes.range_m[beams, ray_of_hit], echoes.energy_j[beams, ray_of_hit]
    start = np.flatnonzero(np.diff(group, prepend=-1))
    if not len(start):
        return NO_RETURNS
    total = np.add.reduceat(energy, start)
    base = range_m[start]  # sums of differences keep their digits
    beyond = range_m - base[group]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.add.reduceat(energy * beyond, start) / total
        spread = np.sqrt(np.maximum(np.add.reduceat(energy * beyond**2, start) / total - mean**2, 0.0))
    beam, ray = beams[start], np.minimum.reduceat(ray_of_hit, start)  # rays are sorted by their distance from the axis
    direction, normal = echoes.direction[beam, ray], echoes.normal[beam, ray]
    true_m, measured_m = echoes.range_m[beam, ray], base + mean
    cosine = np.clip(-np.einsum("ij,ij->i", direction, normal), 0.0, 1.0)
    return Returns(
        beam,
        np.zeros(len(start), np.uint8),
        np.zeros(len(start), np.uint8),
        measured_m,
        total,
        spread,
        np.add.reduceat(rays.weight[ray_of_hit], start),
        echoes.direction[beam, 0] * measured_m[:, None],
        true_m,
        direction * true_m[:, None],
        np.arccos(cosine),
        normal,
        echoes.label[beam, ray],
        echoes.number[beam, ray],
        ray == 0,
    )


def select_returns(returns: Returns, reported: Reported) -> Returns:
    """Select the returns that an instrument reports: all, or one of each beam. A selected return keeps its ``order``
    and ``of``, which count all returns.
    """
    if reported == "ALL" or not len(returns):
        return returns
    key = {"FIRST": returns.range_m, "LAST": -returns.range_m, "STRONGEST": -returns.energy_j}[reported]
    return returns.take(select_by(returns.beam, key))


def select_by(beam: Array, *keys: Array) -> Array:
    """Select the index of the return with the lowest key in each beam (k,); later keys take precedence."""
    sorting = np.lexsort((*keys, beam))
    return sorting[np.flatnonzero(np.diff(beam[sorting], prepend=-1))]


def join_returns(parts: Iterable[Returns]) -> Returns:
    """Join the returns of several groups of beams, one after the other."""
    listed = [*parts] or [NO_RETURNS]
    return Returns(
        **{field.name: np.concatenate([getattr(each, field.name) for each in listed]) for field in fields(Returns)}
    )


#: The returns of a scan in which nothing comes back.
NO_RETURNS = Returns(
    np.zeros(0, np.int64),
    np.zeros(0, np.uint8),
    np.zeros(0, np.uint8),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros(0, np.uint8),
    np.zeros(0, np.int64),
    np.zeros(0, bool),
)
