"""Ranges and intensities of the returns of a scan as the scanner's detector measures them, and its false alarms.

A photodiode with a threshold (``AnalogReceiver``) measures each return separately. A counter of single photons
(``PhotonCounter``) stops at the first photon of a beam. Ice delays light before it reaches either detector.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..light.photons import LIGHT_M_S
from .apd import ELECTRON_C, Apd, false_alarm_rate_hz
from .detector import Detections as _Detections
from .detector import Detector, correct_walk_m, find_noise, quantize, time_return
from .ice_delay import DelayTable
from .instrument import Instrument
from .light_in_ice import Medium
from .noise_streams import Effects, draw_beam_waits, draw_return_normals
from .returns import Returns, select_by

#: A surface that light does not enter.
_OPAQUE = Medium("opaque", 0.0, 0.0, 0.0)
#: Seconds that light takes there and back for a metre of range.
_S_PER_M = 2.0 / LIGHT_M_S


@dataclass(frozen=True)
class AnalogReceiver:
    """An avalanche photodiode whose threshold is at ``threshold`` times its noise without light. ``timing``,
    ``jitter_s``, ``resolution_m`` and ``saturation`` (in electrons) are as in ``Detector``. With ``corrects_walk`` the
    instrument subtracts the walk that a pulse of the measured intensity has.
    """

    apd: Apd
    threshold: float = 6.0
    timing: str = "EDGE"
    jitter_s: float = 0.0
    resolution_m: float = 0.0
    saturation: float = math.inf
    corrects_walk: bool = True

    def make_detector(self, instrument: Instrument) -> Detector:
        """Make the detector in electrons of a pulse. Raises IcyMoonError for impossible figures."""
        # A pulse of N electrons has the peak N/(σ √2π) per second.
        length_s = instrument.pulse_deviation_s * math.sqrt(2.0 * math.pi)
        quiet = Effects(shot_noise=False, dark_counts=False)
        thermal = float(self.apd.noise_a(0.0, quiet)) * length_s / (ELECTRON_C * self.apd.gain)
        excess = max(1.0, 2.0 * self.apd.excess_noise * self.apd.bandwidth_hz * length_s)
        noise = math.sqrt(thermal**2 + excess * self.find_dark_electrons(instrument))
        return Detector(
            instrument.pulse_fwhm_s,
            max(self.threshold * noise, 1.0),
            thermal,
            excess,
            self.timing,
            self.jitter_s,
            self.resolution_m,
            self.saturation,
            self.apd.bandwidth_hz,
            (instrument.nearest_m, instrument.farthest_m),
        )

    def find_dark_electrons(self, instrument: Instrument) -> float:
        """Compute the electrons of the dark current in the length of a pulse."""
        return self.apd.dark_a / ELECTRON_C * instrument.pulse_deviation_s * math.sqrt(2.0 * math.pi)


@dataclass(frozen=True)
class PhotonCounter:
    """A detector that fires once a beam, at the first photon after the gate opens: its quantum efficiency, dark counts
    in Hz, jitter in s, and the step of the range in metres. Raises IcyMoonError for impossible values.
    """

    efficiency: float = 0.3
    dark_hz: float = 1e4
    jitter_s: float = 0.0
    resolution_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.efficiency <= 1.0:
            raise IcyMoonError(
                f"The quantum efficiency of the photon counter is {self.efficiency:g}; give more than 0 and at most 1."
            )
        for name in ("dark_hz", "jitter_s", "resolution_m"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise IcyMoonError(f"The photon counter's {name} is {getattr(self, name):g}; give 0 or more.")


@dataclass(frozen=True)
class Measured:
    """Measurements (k,) of returns. ``measured_range_m`` is NaN for a lost return. ``measured_electrons`` is the
    intensity as electrons of a pulse of its height (counts of a photon counter), 0 for a lost return. ``ice_delay_m``
    is the part of the range that is delay in ice, as the detector times it without noise.
    """

    measured_range_m: Array
    measured_electrons: Array
    ice_delay_m: Array

    def take(self, chosen: Array) -> Measured:
        """Take some of the measurements, by a mask or by indices."""
        return Measured(*(getattr(self, field.name)[chosen] for field in fields(self)))

    @property
    def detected(self) -> Array:
        """Whether each return (k,) is detected."""
        return np.isfinite(self.measured_range_m)


@dataclass(frozen=True)
class Alarms:
    """False alarms: the numbers of their beams (a,), their ranges (a,) in metres, and points (a, 3) in the axes of
    ``Returns.point_m``.
    """

    beam: Array
    range_m: Array
    point_m: Array


@dataclass(frozen=True)
class Sensing:
    """The causes of delay and noise. ``media`` are by the label of triangles; a label without a medium is opaque.
    ``detector`` is None if ranges are not measured. ``sunlight_1_s`` is the sunlight on the detector in photons per
    second. ``effects`` are the simulated effects; ``seed`` and ``scan`` choose the random numbers. ``gate_m`` is the
    range behind a surface to which light from ice counts.
    """

    media: Mapping[int, Medium]
    detector: AnalogReceiver | PhotonCounter | None = None
    sunlight_1_s: float = 0.0
    effects: Effects = Effects()  # noqa: RUF009
    seed: int = 1
    scan: int = 0
    gate_m: float = 1.0


@dataclass(frozen=True)
class Pulses:
    """Returns (k,) in an analog receiver. ``whole`` are the electrons of all light of a return; ``light`` are the
    electrons of an undistorted pulse with the return's peak. ``deviation_s`` is the pulse's standard deviation, and
    ``noise`` the noise at the peak in electrons. ``drawn`` (2, k) are the normal variates of amplitude and jitter,
    ``amplitude`` is the noisy ``light``, and ``centroid_m`` the delay of the centroid in ice in metres.
    """

    whole: Array
    light: Array
    deviation_s: Array
    noise: Array
    drawn: Array
    amplitude: Array
    centroid_m: Array


class Measurement:
    """Measures the returns of one scan, batch by batch; the division into batches does not change the numbers."""

    def __init__(self, instrument: Instrument, sensing: Sensing) -> None:
        """Prepare the measurement. Raises IcyMoonError for a detector without a farthest range of the instrument."""
        self.instrument, self.sensing = instrument, sensing
        if sensing.detector is not None and not math.isfinite(instrument.farthest_m):
            raise IcyMoonError(
                "The LiDAR has a detector without a farthest range, so false alarms have no end; give lidar.farthest_m."
            )
        self._tables = {
            label: DelayTable(medium, instrument, sensing.gate_m) for label, medium in sensing.media.items()
        }
        self._opaque = DelayTable(_OPAQUE, instrument, sensing.gate_m)

    def delay(self, found: Returns) -> dict[str, Array]:
        """Find the delays of returns (k,) in ice: arrays ``ice_edge_m``, ``ice_peak_m``, ``ice_centroid_m`` and
        ``ice_energy``, see ``IceDelays``; empty if no surface is ice.
        """
        if not self._tables:
            return {}
        edge, peak, centroid, energy, _ = self._delays(found)
        return {"ice_edge_m": edge, "ice_peak_m": peak, "ice_centroid_m": centroid, "ice_energy": energy}

    def measure(self, found: Returns, first: int, end: int) -> tuple[Measured, Array, Array]:
        """Measure all returns of the beams from number ``first`` to before ``end``, in the order of ``find_returns``.
        Also return the numbers (a,) of the beams with a false alarm, and the alarms' ranges (a,) in metres.
        """
        detector = self.sensing.detector
        assert detector is not None
        run = self._count_photons if isinstance(detector, PhotonCounter) else self._compare
        return run(found, first, end)

    def _by_medium(self, found: Returns) -> list[tuple[DelayTable, Array]]:
        """List the delay table of each surface from which returns come, with the indices of these returns."""
        labels = np.unique(found.label).tolist()
        return [(self._tables.get(label, self._opaque), np.flatnonzero(found.label == label)) for label in labels]

    def _delays(self, found: Returns) -> Array:
        """Return the values of ``IceDelays`` (5, k) of returns: edge, peak, centroid, energy and height."""
        made = np.zeros((5, len(found)))
        for table, own in self._by_medium(found):
            each = table.find(found.range_m[own])
            made[:, own] = each.edge_m, each.peak_m, each.centroid_m, each.energy, each.height
        return made

    @cached_property
    def detector(self) -> Detector:
        """The detector of an analog receiver, in electrons of a pulse."""
        assert isinstance(self.sensing.detector, AnalogReceiver)
        return self.sensing.detector.make_detector(self.instrument)

    @property
    def background_electrons(self) -> float:
        """Electrons of sunlight and dark current in the length of a pulse of an analog receiver."""
        receiver, effects = self.sensing.detector, self.sensing.effects
        assert isinstance(receiver, AnalogReceiver)
        length_s = self.instrument.pulse_deviation_s * math.sqrt(2.0 * math.pi)
        dark = receiver.find_dark_electrons(self.instrument) if effects.dark_counts else 0.0
        return self.sensing.sunlight_1_s * receiver.apd.efficiency * length_s + dark

    @property
    def steady_noise(self) -> float:
        """Noise of an analog receiver without a return, in electrons of a pulse."""
        return float(find_noise(self.detector, np.asarray(self.background_electrons), self.sensing.effects))

    def expect_pulses(self, found: Returns, first: int, end: int) -> Pulses:
        """Compute the pulses in an analog receiver of all returns (k,) of the beams from number ``first`` to before
        ``end``.
        """
        own, effects, detector = self.sensing, self.sensing.effects, self.detector
        receiver = own.detector
        assert isinstance(receiver, AnalogReceiver)
        base = self.steady_noise
        deviation_s = np.hypot(detector.deviation_s, found.spread_m * _S_PER_M)
        _, _, centroid, _, height = self._delays(found)
        whole = receiver.apd.efficiency * self.instrument.count_photons(found.energy_j)
        # A pulse that slopes or ice make longer has a lower peak.
        light = whole * height * detector.deviation_s / deviation_s
        noise = np.sqrt(base**2 + detector.excess_noise * light * effects.shot_noise)
        drawn = draw_return_normals(found.beam, found.order, first, end, own.seed, own.scan)
        return Pulses(whole, light, deviation_s, noise, drawn, light + noise * drawn[0], centroid)

    def _compare(self, found: Returns, first: int, end: int) -> tuple[Measured, Array, Array]:
        """Measure as ``measure`` does, with an analog receiver."""
        effects, detector, receiver = self.sensing.effects, self.detector, self.sensing.detector
        assert isinstance(receiver, AnalogReceiver)
        base, pulses = self.steady_noise, self.expect_pulses(found, first, end)
        amplitude = pulses.amplitude
        seen = (amplitude >= detector.threshold_electrons) & (found.range_m <= detector.gate_m[1])
        drawn = pulses.drawn[1] if effects.jitter else 0.0
        error = time_return(detector, pulses.light, amplitude, pulses.noise, drawn, effects, pulses.deviation_s)
        delay = self._delay_edges(found, amplitude) if detector.timing == "EDGE" else pulses.centroid_m
        range_m = np.where(seen, found.range_m + delay + LIGHT_M_S / 2.0 * error, np.nan)
        shown = np.where(seen, np.clip(amplitude, 0.0, detector.saturation if effects.saturation else math.inf), 0.0)
        if receiver.corrects_walk and effects.walk and detector.timing == "EDGE":
            range_m = correct_walk_m(_Detections(range_m, shown, np.zeros(len(found), bool)), detector)
        if effects.quantization:
            range_m = quantize(range_m, detector.resolution_m)
        rate = float(false_alarm_rate_hz(detector.threshold_electrons / max(base, 1e-30), detector.rice_hz))
        measured = Measured(range_m, shown, delay)
        return measured, *self._raise_alarms(found, measured, rate * effects.false_alarms, first, end)

    def _delay_edges(self, found: Returns, amplitude: Array) -> Array:
        """Compute the delay (k,), m, of the rising edge; without walk, at half of the peak."""
        if not self.sensing.effects.walk:
            return self._delays(found)[0]
        delay = np.zeros(len(found))
        over = amplitude / self.detector.threshold_electrons
        for table, own in self._by_medium(found):
            delay[own] = table.find_edge(found.range_m[own], over[own])
        return delay

    def _raise_alarms(
        self, found: Returns, measured: Measured, rate_hz: float, first: int, end: int
    ) -> tuple[Array, Array]:
        """Return the beams and ranges, m, of reported false alarms: the first alarm in the gate, or the last if the
        instrument reports the last return. An instrument with one return per beam reports an alarm only in place of a
        return.
        """
        near, far = self.instrument.nearest_m, self.instrument.farthest_m
        wait_m = draw_beam_waits(first, end, self.sensing.seed, self.sensing.scan)
        wait_m = wait_m / max(rate_hz * _S_PER_M, 1e-300)
        rises = wait_m < far - near
        seen = measured.detected
        place = found.beam[seen] - first
        reported = self.instrument.reported
        if reported == "FIRST":
            limit = np.full(end - first, np.inf)
            np.minimum.at(limit, place, measured.measured_range_m[seen])
            rises &= near + wait_m < limit
        elif reported == "LAST":
            limit = np.full(end - first, -np.inf)
            np.maximum.at(limit, place, measured.measured_range_m[seen])
            rises &= far - wait_m > limit
        elif reported == "STRONGEST":
            rises &= np.bincount(place, minlength=end - first) == 0
        beam = np.flatnonzero(rises)
        at = far - wait_m[beam] if reported == "LAST" else near + wait_m[beam]
        return beam + first, at

    def _count_photons(self, found: Returns, first: int, end: int) -> tuple[Measured, Array, Array]:
        """Measure as ``measure`` does, with a photon counter. It stops at the first photon of each beam: where the
        expected photons since the gate opened reach an exponential variate.
        """
        own, effects = self.sensing, self.sensing.effects
        counter = own.detector
        assert isinstance(counter, PhotonCounter)
        wait = draw_beam_waits(first, end, own.seed, own.scan)
        rate_hz = (own.sunlight_1_s * counter.efficiency + counter.dark_hz * effects.dark_counts) * effects.false_alarms
        rate_1_m = rate_hz * _S_PER_M
        near, far = self.instrument.nearest_m, self.instrument.farthest_m
        _, _, centroid, energy, _ = self._delays(found)
        light = counter.efficiency * self.instrument.count_photons(found.energy_j) * energy
        place = found.beam - first
        total = np.concatenate([[0.0], np.cumsum(light)])
        begins = np.flatnonzero(np.diff(found.beam, prepend=-1)) if len(found) else np.zeros(0, np.int64)
        counts = np.diff(np.append(begins, len(found)))
        before = total[:-1] - np.repeat(total[begins], counts) + rate_1_m * np.maximum(found.range_m - near, 0.0)
        left = wait[place] - before
        seen = (left >= 0.0) & (left < light) & (found.range_m <= far)
        share = np.clip(left / np.maximum(light, 1e-300), 0.0, 1.0)
        if not effects.walk:
            share = np.expm1(-share * light) / np.minimum(np.expm1(-light), -1e-300)
        range_m, delay = self._time_photons(found, share, first, end)
        range_m = np.where(seen, range_m, np.nan)
        if effects.quantization:
            range_m = quantize(range_m, counter.resolution_m)
        measured = Measured(range_m, seen.astype(np.float64), np.where(seen, delay, centroid))
        passed = np.zeros(end - first)
        np.add.at(passed, place, np.where(before + light <= wait[place], light, 0.0))
        at = near + (wait - passed) / max(rate_1_m, 1e-300)
        fired = np.bincount(place[seen], minlength=end - first) > 0
        beam = np.flatnonzero(~fired & (at < far))
        return measured, beam + first, at[beam]

    def _time_photons(self, found: Returns, share: Array, first: int, end: int) -> tuple[Array, Array]:
        """Compute the range and the delay in ice (k,), m, of photons with a share (k,) of their return's light before
        them.
        """
        counter, own = self.sensing.detector, self.sensing
        assert isinstance(counter, PhotonCounter)
        delay = np.zeros(len(found))
        for table, chosen in self._by_medium(found):
            delay[chosen] = table.find_arrival(found.range_m[chosen], share[chosen])
        pulse_m = self._opaque.deviation_m
        wider = np.hypot(pulse_m, found.spread_m) / pulse_m
        range_m = found.range_m + self._opaque.find_hard_arrival(share) * wider + delay
        if own.effects.jitter:
            drawn = draw_return_normals(found.beam, found.order, first, end, own.seed, own.scan)[1]
            range_m = range_m + LIGHT_M_S / 2.0 * counter.jitter_s * drawn
        return range_m, delay


def select_measured(found: Returns, measured: Measured, reported: str) -> Array:
    """Select the indices of the returns that an instrument reports: all, or one of each beam, chosen among detected
    returns by measured range or intensity. A beam without a detected return keeps the return chosen by true range or
    energy.
    """
    if reported == "ALL" or not len(found):
        return np.arange(len(found))
    true = {"FIRST": found.range_m, "LAST": -found.range_m, "STRONGEST": -found.energy_j}[reported]
    keys = {
        "FIRST": measured.measured_range_m,
        "LAST": -measured.measured_range_m,
        "STRONGEST": -measured.measured_electrons,
    }
    return select_by(found.beam, np.where(measured.detected, keys[reported], true), ~measured.detected)
