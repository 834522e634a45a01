"""Delays of returns from snow and ice as a detector times them, tabulated once over the range of a scan."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...support.arrays import Array
from .instrument import Instrument
from .light_in_ice import Medium, Receiver, Waveform, make_waveform, measure_bias

#: Number of ranges of a table if the receiver's field cuts off light; delays are interpolated in the range's logarithm.
_NODES = 17
#: Nearest and farthest range of a table in metres.
_RANGES_M = (0.1, 1e5)
#: Places before the peak of a pulse, in its standard deviations, at which the rising edge is tabulated. The waveform
#: begins 5 deviations before the surface.
_PLACES = np.linspace(0.0, 4.6, 93)
#: Shares of the light before a photon, for which its time is tabulated; their steps are fine for early light.
_SHARES = np.unique(np.concatenate([np.geomspace(1e-7, 0.5, 120), 1.0 - np.geomspace(0.5, 1e-4, 60)]))


@dataclass(frozen=True)
class IceDelays:
    """Range delays (k,), m, of returns from a medium. They are measured at half of the peak on the rising edge, at the
    peak, and at the centroid of the light up to ``gate_m`` behind the surface. ``energy`` is the share of the light
    that the receiver sees inside this gate. ``height`` is the peak over the peak of a hard surface that reflects as
    much.
    """

    edge_m: Array
    peak_m: Array
    centroid_m: Array
    energy: Array
    height: Array


class DelayTable:
    """The delays of a medium in a scan by an instrument. A medium with l* = 0 is a hard surface without delay."""

    def __init__(self, medium: Medium, instrument: Instrument, gate_m: float = 1.0) -> None:
        """Make the table; ``gate_m`` is the range behind the surface to which light counts."""
        self._medium, self._instrument, self._gate_m = medium, instrument, gate_m
        self.deviation_m = self._make_receiver(1.0).deviation_m

    @cached_property
    def _ranges_m(self) -> Array:
        """The ranges of the table; only one if the receiver sees all light at any range."""
        own = self._instrument
        if own.field_half_angle_rad >= math.pi / 2 or self._medium.transport_m == 0.0:
            return np.ones(1)
        near = max(own.nearest_m, _RANGES_M[0])
        return np.geomspace(near, max(min(own.farthest_m, _RANGES_M[1]), 2.0 * near), _NODES)

    def _make_receiver(self, range_m: float) -> Receiver:
        own = self._instrument
        wide = own.field_half_angle_rad >= math.pi / 2
        field_m = math.inf if wide else own.aperture_radius_m + range_m * math.tan(own.field_half_angle_rad)
        spot_m = own.exit_radius_m + range_m * max(own.half_angle_rad)
        return Receiver(own.pulse_fwhm_s, self._gate_m, max(field_m, 1e-6), 0.0 if wide else spot_m)

    @cached_property
    def _waves(self) -> list[Waveform]:
        return [make_waveform(self._medium, self._make_receiver(one)) for one in self._ranges_m.tolist()]

    @cached_property
    def _hard(self) -> Waveform:
        return make_waveform(replace(self._medium, transport_m=0.0), self._make_receiver(1.0))

    @cached_property
    def _biases(self) -> Array:
        """Edge, peak, centroid, energy and height at the table's ranges (nodes, 5)."""
        found = [measure_bias(self._medium, self._make_receiver(one)) for one in self._ranges_m.tolist()]
        height = [wave.power.max() / self._hard.power.max() for wave in self._waves]
        return np.array(
            [
                [each.edge_m, each.peak_m, each.centroid_m, each.energy, one]
                for each, one in zip(found, height, strict=True)
            ]
        )

    @cached_property
    def _edges(self) -> Array:
        """Delay (nodes, places), m, of the rising edge at the heights that a hard pulse has at ``_PLACES``."""
        level = np.exp(-(_PLACES**2) / 2.0)
        return np.array(
            [_find_rising_ranges(wave, level) - _find_rising_ranges(self._hard, level) for wave in self._waves]
        )

    @cached_property
    def _arrivals(self) -> Array:
        """Delay (nodes, shares), m, relative to a hard surface, at which a share of the light has arrived."""
        return np.array([_find_quantiles(wave) - _find_quantiles(self._hard) for wave in self._waves])

    def find(self, range_m: Array) -> IceDelays:
        """Find the delays of returns at ranges (k,) in metres."""
        if self._medium.transport_m == 0.0:
            nothing = np.zeros(len(range_m))
            return IceDelays(nothing, nothing, nothing, nothing + 1.0, nothing + 1.0)
        place = self._locate_ranges(range_m)
        return IceDelays(*(_interpolate_nodes(place, column) for column in self._biases.T))

    def find_edge(self, range_m: Array, amplitude_over_threshold: Array) -> Array:
        """Find the delay (k,) in metres of a rising edge at a threshold, from the ratio (k,) of the peak to the
        threshold.
        """
        if self._medium.transport_m == 0.0:
            return np.zeros(len(range_m))
        before = np.sqrt(2.0 * np.log(np.maximum(amplitude_over_threshold, 1.0)))
        return _interpolate(self._locate_ranges(range_m), self._edges, _PLACES, before)

    def find_arrival(self, range_m: Array, share: Array) -> Array:
        """Find the delay (k,) in metres of the photon before which a share (k,) of the light arrives."""
        if self._medium.transport_m == 0.0:
            return np.zeros(len(range_m))
        return _interpolate(self._locate_ranges(range_m), self._arrivals, _SHARES, share)

    def find_hard_arrival(self, share: Array) -> Array:
        """Find the time (k,), as range in metres from the centre of a hard surface's pulse, before which a share (k,)
        of the light arrives.
        """
        return np.asarray(np.interp(share, _SHARES, _find_quantiles(self._hard)))

    def find_power(self, range_m: Array, beyond_m: Array, stretch: Array) -> Array:
        """Find the received power (k, s) in 1/m of range, of pulses of unit light from surfaces at ranges (k,), at
        distances ``beyond_m`` (k, s) in metres behind these surfaces. A pulse that a slope makes ``stretch`` (k,) times
        longer is stretched about its peak.
        """
        longer = stretch[:, None]
        if self._medium.transport_m == 0.0:
            scale = self.deviation_m * longer
            return np.asarray(np.exp(-((beyond_m / scale) ** 2) / 2.0) / (scale * math.sqrt(2.0 * math.pi)))
        peak = self.find(range_m).peak_m[:, None]
        at = (beyond_m - peak) / longer + peak
        cells = self._waves[0].range_m
        place = np.broadcast_to(self._locate_ranges(range_m)[:, None], at.shape)
        power = _interpolate(place.ravel(), self._powers, cells, at.ravel()).reshape(at.shape)
        return np.asarray(np.where((at >= cells[0]) & (at <= cells[-1]), power, 0.0) / longer)

    @cached_property
    def _powers(self) -> Array:
        """Power (nodes, cells) of the waveforms in 1/m."""
        return np.array([wave.power for wave in self._waves])

    def _locate_ranges(self, range_m: Array) -> Array:
        """Find the fractional indices (k,) of ranges (k,) in the table's ranges."""
        if len(self._ranges_m) == 1:
            return np.zeros(len(range_m))
        at = np.log(np.maximum(range_m, 1e-6))
        return np.asarray(np.interp(at, np.log(self._ranges_m), np.arange(len(self._ranges_m))))


def _interpolate_nodes(place: Array, values: Array) -> Array:
    return np.asarray(np.interp(place, np.arange(len(values)), values))


def _interpolate(place: Array, table: Array, axis: Array, at: Array) -> Array:
    """Interpolate ``table`` (nodes, a) at fractional rows ``place`` (k,) and at ``at`` (k,) along ``axis`` (a,)."""
    column = np.interp(at, axis, np.arange(len(axis)))
    corners = []
    for row in (np.floor(place).astype(np.int64), np.ceil(place).astype(np.int64)):
        left, right = np.floor(column).astype(np.int64), np.ceil(column).astype(np.int64)
        corners.append(table[row, left] + (column - left) * (table[row, right] - table[row, left]))
    return np.asarray(corners[0] + (place - np.floor(place)) * (corners[1] - corners[0]))


def _find_rising_ranges(wave: Waveform, level: Array) -> Array:
    """Find the ranges, m, at which a waveform rises to shares ``level`` of its peak."""
    top = int(np.argmax(wave.power))
    return np.asarray(np.interp(level * wave.power[top], wave.power[: top + 1], wave.range_m[: top + 1]))


def _find_quantiles(wave: Waveform) -> Array:
    """Find the ranges, m, before which the shares ``_SHARES`` of a waveform have arrived."""
    step = wave.range_m[1] - wave.range_m[0]
    arrived = np.concatenate([[0.0], np.cumsum(wave.power)])
    edges = np.concatenate([[wave.range_m[0] - step / 2.0], wave.range_m + step / 2.0])
    return np.asarray(np.interp(_SHARES, arrived / arrived[-1], edges))
