"""Waveforms of an analog receiver, as a digitiser stores them for each pulse whose light comes back.

A packet is a run of samples. It begins before the first return or false alarm of a pulse and contains every later event
that fits; an event that does not fit begins another packet. Samples contain the light of all returns of the pulse, and
noise of even power below the detector's bandwidth. At the peak of a return the noise equals the noise of the measured
intensity. A false alarm reaches the threshold. The steady current of sunlight and dark counts is subtracted.

The Leica ALS50-II is the model (NERC Airborne Research Facility, notes on full waveform digitisation, 2010): its record
begins a few samples before the first return, intervals are at most half of the pulse, a record has 64 to 512 samples,
and the gain is constant for a pulse. Its 8 bits are too coarse for the tail of light from ice; 16 are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..light.photons import LIGHT_M_S
from .ice_delay import DelayTable
from .instrument import Instrument
from .light_in_ice import Medium
from .measured_returns import AnalogReceiver, Measurement, PhotonCounter
from .noise_streams import draw_sample_normals
from .returns import Returns

#: Possible numbers of samples in a packet.
SAMPLE_COUNTS = (64, 128, 256, 512)
BITS = 16
#: The stored number for no light. Numbers below it represent negative noise.
ZERO = 2**12
#: Number of steps of the finest gain from no light to the threshold, which is six times the noise by default.
_STEPS_A_THRESHOLD = 16.0
#: Time from the start of a packet to its first return: standard deviations of the pulse, plus samples.
_DEVIATIONS, _SAMPLES_BEFORE = 5.0, 8
#: Number of samples that are made at a time; all their data take about 40 MB.
_SAMPLES_AT_ONCE = 2**19
#: Share of the variance by which noise at a return may differ from its measured value, so that near returns have a
#: solution.
_RIDGE = 1e-6


@dataclass(frozen=True)
class Digitiser:
    """A digitiser with ``samples`` in a packet, ``spacing_ps`` apart in ps. One step of the finest gain is ``step``
    electrons in an interval; gain number k has 2^k times larger steps.
    """

    samples: int
    spacing_ps: int
    step: float

    @property
    def spacing_m(self) -> float:
        """Interval between samples, as range in metres."""
        return self.spacing_ps * 1e-12 * LIGHT_M_S / 2.0


@dataclass(frozen=True)
class Waves:
    """The packets that contain returns or false alarms, arrays (k,). ``packet`` int64 is the packet's number in the
    scan, ``packet_gain`` uint8 its gain, and ``packet_start`` int64 the number of intervals from the pulse to the
    packet's first sample.
    """

    packet: Array
    packet_gain: Array
    packet_start: Array

    def take(self, chosen: slice) -> Waves:
        """Take the entries of a slice."""
        return Waves(self.packet[chosen], self.packet_gain[chosen], self.packet_start[chosen])


@dataclass(frozen=True)
class Packets:
    """Packets of a waveform: the stored numbers ``samples`` (p, s) uint16 of p packets, and the ``gain`` (p,) uint8 of
    each. ``returns`` and ``alarms`` are the packets that contain the reported returns and the false alarms.
    """

    samples: Array
    gain: Array
    returns: Waves
    alarms: Waves


def make_digitiser(detector: AnalogReceiver | PhotonCounter | None, instrument: Instrument, samples: int) -> Digitiser:
    """Make the digitiser of a detector. Its interval is half of the pulse's full width or half of 1 / bandwidth,
    whichever is shorter. Raises IcyMoonError without an analog receiver, or for too short a pulse.
    """
    if detector is None:
        raise IcyMoonError(
            "A waveform needs a detector, and this scan has no detector; choose a scanner with one, "
            "do not leave the detector out, or ask for no waveforms."
        )
    if isinstance(detector, PhotonCounter):
        raise IcyMoonError(
            "The detector counts single photons, so it has no waveform; choose a scanner whose detector is an APD, or "
            "ask for no waveforms."
        )
    spacing_ps = math.floor(min(instrument.pulse_fwhm_s, 1.0 / detector.apd.bandwidth_hz) / 2.0 * 1e12 + 1e-6)
    if not 1 <= spacing_ps < 2**32:
        raise IcyMoonError(
            f"Samples of a waveform would be {spacing_ps} ps apart; give a pulse (lidar.pulse_ns) of 0.002 ns or more."
        )
    share = spacing_ps * 1e-12 / (instrument.pulse_deviation_s * math.sqrt(2.0 * math.pi))
    threshold = detector.make_detector(instrument).threshold_electrons
    return Digitiser(samples, spacing_ps, threshold * share / _STEPS_A_THRESHOLD)


@dataclass(frozen=True)
class _PacketStarts:
    """Packets (p,) of some beams: number of the beam, first sample in intervals after the pulse, and place among the
    packets of the beam.
    """

    beam: Array
    start: Array
    slot: Array

    def take(self, chosen: slice) -> _PacketStarts:
        return _PacketStarts(self.beam[chosen], self.start[chosen], self.slot[chosen])


class Recorder:
    """Makes the packets of one scan, batch by batch; the division into batches does not change them."""

    def __init__(self, digitiser: Digitiser, measurement: Measurement) -> None:
        own, instrument = measurement.sensing, measurement.instrument
        self.digitiser, self.measurement = digitiser, measurement
        length_m = digitiser.samples * digitiser.spacing_m
        self._tables = {label: DelayTable(medium, instrument, length_m) for label, medium in own.media.items()}
        self._opaque = DelayTable(Medium("opaque", 0.0, 0.0, 0.0), instrument, length_m)
        frequency = np.fft.rfftfreq(digitiser.samples, digitiser.spacing_ps * 1e-12)
        self._kept = frequency <= measurement.detector.rice_hz
        kernel = np.fft.irfft(self._kept.astype(np.float64), digitiser.samples)
        self._correlation, self._variance = kernel / kernel[0], kernel[0]
        self._count = 0

    def record(self, found: Returns, chosen: Array, alarm_beam: Array, alarm_m: Array, first: int, end: int) -> Packets:
        """Make the packets of the beams from number ``first`` to before ``end``. ``found`` are all their returns, of
        which the instrument reports the returns with indices ``chosen`` (k,). False alarms (a,) are in the order of
        their beams.
        """
        own, pulse_m = self.digitiser, self._opaque.deviation_m
        beam = np.concatenate([found.beam[chosen], alarm_beam])
        range_m = np.concatenate([found.range_m[chosen], alarm_m])
        wide_m = np.concatenate([np.hypot(pulse_m, found.spread_m[chosen]), np.full(len(alarm_m), pulse_m)])
        before_m = _DEVIATIONS * wide_m + _SAMPLES_BEFORE * own.spacing_m
        number, run = _group_into_packets(beam, range_m, np.minimum(before_m, own.samples // 4 * own.spacing_m), own)
        returns = _Light(self, found, first, end)
        samples = np.zeros((len(run.beam), own.samples), np.uint16)
        gain = np.zeros(len(run.beam), np.uint8)
        step = max(1, _SAMPLES_AT_ONCE // own.samples)
        for low in range(first, end, step):
            high = min(low + step, end)
            part = slice(*np.searchsorted(run.beam, [low, high]).tolist())
            if part.start < part.stop:
                noisy = self._make_electrons(returns, run.take(part), alarm_beam, alarm_m, low, high)
                samples[part], gain[part] = self._store(noisy)
        waves = Waves(number + self._count, gain[number], run.start[number])
        self._count += len(run.beam)
        return Packets(samples, gain, waves.take(slice(len(chosen))), waves.take(slice(len(chosen), None)))

    def power(self, label: int) -> DelayTable:
        """Return the delays at surfaces with a label; the opaque surface's for a label without a medium."""
        return self._tables.get(label, self._opaque)

    def _make_electrons(
        self, returns: _Light, run: _PacketStarts, alarm_beam: Array, alarm_m: Array, low: int, high: int
    ) -> Array:
        """Make the noisy light (p, s) of packets of the beams from ``low`` to before ``high``. A sample's unit is the
        electrons of a pulse whose peak is as high as the sample.
        """
        own, sensing, detector = self.digitiser, self.measurement.sensing, self.measurement.detector
        light, places, variates = returns.add_up(run)
        base = self.measurement.steady_noise
        deviation = np.sqrt(base**2 + detector.excess_noise * light * sensing.effects.shot_noise)
        if not deviation.any():
            return light
        white = draw_sample_normals(run.beam, run.slot, low, high, own.samples, sensing.seed, sensing.scan)
        noise = np.fft.irfft(np.fft.rfft(white, axis=1) * self._kept, own.samples, axis=1) / math.sqrt(self._variance)
        place = _find_alarms(run, alarm_beam, alarm_m, own)
        at = np.arange(len(place)), np.maximum(place, 0)
        place = np.where(light[at] < detector.threshold_electrons, place, -1)
        needed = (detector.threshold_electrons - light[at]) / np.maximum(deviation[at], 1e-30)
        noise += self._correct(noise, np.column_stack([places, place]), np.column_stack([variates, needed]))
        return np.asarray(light + deviation * noise)

    def _correct(self, noise: Array, places: Array, wanted: Array) -> Array:
        """Compute the correction (p, s) that gives noise of variance 1 the ``wanted`` values (p, e) at samples
        ``places`` (p, e), -1 for none, and keeps its spectrum. It is the expected noise, given those values.
        """
        known = places >= 0
        at = np.where(known, places, 0)
        lacks = np.where(known, wanted - np.take_along_axis(noise, at, axis=1), 0.0)
        both = known[:, :, None] & known[:, None, :]
        matrix = np.where(both, self._correlation[np.abs(at[:, :, None] - at[:, None, :])], 0.0)
        matrix += np.eye(places.shape[1]) * np.where(known, _RIDGE, 1.0)[:, :, None]
        weight = np.linalg.solve(matrix, lacks[:, :, None])[:, :, 0]
        added, sample = np.zeros_like(noise), np.arange(noise.shape[1])
        for k in range(places.shape[1]):
            added += weight[:, k, None] * self._correlation[np.abs(sample - at[:, k, None])]
        return added

    def _store(self, electrons: Array) -> tuple[Array, Array]:
        """Convert light (p, s), in electrons of a pulse, to the stored numbers (p, s) and the gains (p,) of packets."""
        detector, effects = self.measurement.detector, self.measurement.sensing.effects
        kept = np.minimum(electrons, detector.saturation) if effects.saturation else electrons
        steps = kept * (_STEPS_A_THRESHOLD / detector.threshold_electrons)
        highest = np.maximum(steps.max(axis=1) / (2**BITS - 1 - ZERO), 1.0)
        gain = np.ceil(np.log2(highest))
        stored = np.rint(steps / np.exp2(gain)[:, None]) + ZERO
        return np.clip(stored, 0, 2**BITS - 1).astype(np.uint16), gain.astype(np.uint8)


class _Light:
    """The light, without noise, of all returns of a batch of beams."""

    def __init__(self, recorder: Recorder, found: Returns, first: int, end: int) -> None:
        measurement = recorder.measurement
        self._recorder, self._found = recorder, found
        self._pulses = measurement.expect_pulses(found, first, end)
        self._stretch = self._pulses.deviation_s / measurement.detector.deviation_s
        self._peak_m = np.zeros(len(found))
        for label in np.unique(found.label).tolist():
            own = np.flatnonzero(found.label == label)
            self._peak_m[own] = found.range_m[own] + recorder.power(label).find(found.range_m[own]).peak_m

    def add_up(self, run: _PacketStarts) -> tuple[Array, Array, Array]:
        """Add up the light (p, s) of packets, as electrons of a pulse whose peak is as high as the sample. Also return
        the samples (p, r) at the peaks of r returns, -1 outside the packet, and the normal variates (p, r) of the noise
        at these peaks.
        """
        spacing_m = self._recorder.digitiser.spacing_m
        samples = self._recorder.digitiser.samples
        low, high = np.searchsorted(self._found.beam, run.beam), np.searchsorted(self._found.beam, run.beam, "right")
        light, most = np.zeros((len(run.beam), samples)), int((high - low).max())
        places, variates = np.full((len(run.beam), most), -1), np.zeros((len(run.beam), most))
        for k in range(most):
            packet = np.flatnonzero(low + k < high)
            one = low[packet] + k
            start_m = run.start[packet] * spacing_m
            light[packet] += self._draw(one, start_m[:, None] + np.arange(samples) * spacing_m)
            place = np.rint((self._peak_m[one] - start_m) / spacing_m).astype(np.int64)
            places[packet, k] = np.where((place >= 0) & (place < samples), place, -1)
            variates[packet, k] = self._pulses.drawn[0, one]
        return light, places, variates

    def _draw(self, one: Array, at_m: Array) -> Array:
        """Compute the light (q, s) of the returns with indices (q,) at ranges (q, s) in metres."""
        made, found = np.zeros(at_m.shape), self._found
        for label in np.unique(found.label[one]).tolist():
            own = np.flatnonzero(found.label[one] == label)
            which, table = one[own], self._recorder.power(label)
            range_m = found.range_m[which]
            power = table.find_power(range_m, at_m[own] - range_m[:, None], self._stretch[which])
            # A pulse of N electrons has the height N / (σ √2π).
            made[own] = power * (self._pulses.whole[which] * table.deviation_m * math.sqrt(2.0 * math.pi))[:, None]
        return made


def _group_into_packets(
    beam: Array, range_m: Array, reach_m: Array, digitiser: Digitiser
) -> tuple[Array, _PacketStarts]:
    """Group events into packets, sorted by beam and time. Return the number (e,) of each event's packet, and the
    packets. A packet must contain ``reach_m`` (e,) before and after an event.
    """
    first = np.floor((range_m - reach_m) / digitiser.spacing_m).astype(np.int64)
    last = np.ceil((range_m + reach_m) / digitiser.spacing_m).astype(np.int64)
    order = np.lexsort((first, beam))
    opener = np.full(len(beam), -1)
    left = order
    while len(left):
        begins = np.flatnonzero(np.diff(beam[left], prepend=-1))
        head = np.repeat(left[begins], np.diff(np.append(begins, len(left))))
        fits = (last[left] - first[head] < digitiser.samples) | (left == head)
        opener[left[fits]] = head[fits]
        left = left[~fits]
    heads = order[opener[order] == order]
    number = np.zeros(len(beam), np.int64)
    number[heads] = np.arange(len(heads))
    owner = beam[heads]
    slot = np.arange(len(heads)) - np.searchsorted(owner, owner)
    return number[opener], _PacketStarts(owner, first[heads], slot)


def _find_alarms(run: _PacketStarts, beam: Array, range_m: Array, digitiser: Digitiser) -> Array:
    """Find the sample (p,) of the false alarm in each packet, -1 without one. A beam (a,) has at most one alarm."""
    if not len(beam):
        return np.full(len(run.beam), -1)
    index = np.minimum(np.searchsorted(beam, run.beam), len(beam) - 1)
    place = np.rint(range_m[index] / digitiser.spacing_m).astype(np.int64) - run.start
    there = (beam[index] == run.beam) & (place >= 0) & (place < digitiser.samples)
    return np.where(there, place, -1)
