"""Waveforms of pulses against formulas for one pulse, photon paths in ice, and noise of a known band."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from icymoon.physics.lidar.apd import Apd
from icymoon.physics.lidar.digitiser import ZERO, Packets, Recorder, make_digitiser
from icymoon.physics.lidar.light_in_ice import draw_paths_m, make_snow
from icymoon.physics.lidar.measured_returns import AnalogReceiver, Measurement, PhotonCounter, Sensing
from icymoon.physics.lidar.noise_streams import IDEAL, Effects
from icymoon.physics.lidar.returns import NO_RETURNS, Returns
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from lidar_returns import HARD, ICE, instrument, returns

APD = AnalogReceiver(Apd())
#: A sum of samples of a Gaussian in place of its integral, with an interval of half of its full width:
#: 2 exp(-2 π² σ²/Δ²).
ALIASING = 2 * np.exp(-2 * (np.pi * 2 / 2.3548200450309493) ** 2)


class Recorded:
    """Packets of some returns: light (p, s) in electrons of an interval and ranges (p, s) of samples in metres."""

    def __init__(
        self,
        found: Returns,
        effects: Effects = IDEAL,
        receiver: AnalogReceiver = APD,
        chosen: Array | None = None,
        samples: int = 64,
        alarms: bool = True,
        **values: Any,
    ) -> None:
        count = int(found.beam.max(initial=0)) + 1
        self.instrument = instrument(count, **values)
        self.measurement = Measurement(self.instrument, Sensing({ICE: SNOW}, receiver, effects=effects))
        self.digitiser = make_digitiser(receiver, self.instrument, samples)
        self.measured, beam, self.alarm_m = self.measurement.measure(found, 0, count)
        indices = np.arange(len(found)) if chosen is None else chosen
        self.packets = Recorder(self.digitiser, self.measurement).record(found, indices, beam, self.alarm_m, 0, count)
        self.step = self.digitiser.step * np.exp2(self.packets.gain.astype(float))[:, None]
        self.light = (self.packets.samples.astype(float) - ZERO) * self.step
        waves = [self.packets.returns, self.packets.alarms]
        start = np.zeros(len(self.light))
        for each in waves:
            start[each.packet] = each.packet_start
        self.range_m = (start[:, None] + np.arange(samples)) * self.digitiser.spacing_m
        share = self.digitiser.spacing_ps * 1e-12 / (self.instrument.pulse_deviation_s * np.sqrt(2 * np.pi))
        self.height = self.light / share


SNOW = make_snow(1e-3, 500.0, 532.0)


def test_a_pulse_has_the_energy_range_and_width_of_its_return():
    electrons, spread_m = np.array([300.0, 3e4, 3e9]), np.array([0.0, 0.1, 0.05])
    found = replace(returns(electrons / 0.7, [10.0, 25.03, 60.01]), spread_m=spread_m)
    made = Recorded(found)
    # Each sample is off by half of a step at most.
    energy = made.light.sum(axis=1)
    assert (np.abs(energy - electrons) <= 0.5 * 64 * made.step[:, 0] + 2 * ALIASING * electrons).all()
    beyond = made.range_m - found.range_m[:, None]
    mean = (made.light * beyond).sum(axis=1) / energy
    bound = 0.5 * made.step[:, 0] * np.abs(beyond).sum(axis=1) / electrons
    assert (np.abs(mean) <= 1.1 * bound + 1e-6).all()
    variance = (made.light * beyond**2).sum(axis=1) / energy
    pulse_m = made.instrument.pulse_deviation_s * 299792458 / 2
    bound = 0.5 * made.step[:, 0] * (beyond**2).sum(axis=1) / electrons
    assert (np.abs(variance - pulse_m**2 - spread_m**2) <= 1.1 * bound + 1e-4 * pulse_m**2).all()


def test_the_gain_holds_any_pulse_and_saturation_cuts_it_off():
    found = returns([100.0, 1e6, 1e12])
    free = Recorded(found)
    assert (free.packets.samples.max(axis=1) < 2**16 - 1).all()
    assert free.packets.gain.tolist()[0] == 0 < free.packets.gain[1] < free.packets.gain[2]
    cut = Recorded(found, Effects(), replace(APD, saturation=500.0))
    assert cut.height.max(axis=1)[1:] == pytest.approx(500.0, abs=cut.step[0, 0] / cut.light.max() * 500.0)
    # A pulse is above a share q of its peak for 2 σ √(2 ln(1/q)): 7 and 13 intervals, less one for their phase.
    flat = (cut.packets.samples == cut.packets.samples.max(axis=1)[:, None]).sum(axis=1)
    widest = 2 * np.sqrt(2 * np.log(0.7 * np.array([1e6, 1e12]) / 500)) / 2.3548200450309493 * 2
    assert (np.abs(flat[1:] - widest) <= 1.0).all()
    assert cut.height[0].max() < 450.0
    unsaturated = Recorded(found, replace(Effects(), saturation=False), replace(APD, saturation=500.0))
    assert unsaturated.height[1].max() > 1e5


@pytest.mark.parametrize("electrons", [400.0, 1e5])
def test_noise_at_the_peak_is_that_of_the_measured_intensity(electrons):
    count = 500
    found = returns(np.full(count, electrons / 0.7), 10 + np.linspace(0, 0.3, count))
    made = Recorded(found, replace(Effects(), false_alarms=False))
    base, detector = made.measurement.steady_noise, made.measurement.detector
    excess = detector.excess_noise
    assert made.measured.detected.all()
    variate = (made.measured.measured_electrons - electrons) / np.sqrt(base**2 + excess * electrons)
    nearest = np.abs(made.range_m - found.range_m[:, None]).argmin(axis=1)
    at = np.arange(count), nearest
    pulse_m = made.instrument.pulse_deviation_s * 299792458 / 2
    expected = electrons * np.exp(-(((made.range_m[at] - found.range_m) / pulse_m) ** 2) / 2)
    expected += variate * np.sqrt(base**2 + excess * expected)
    step = made.step[:, 0] / made.light.max() * made.height.max()
    assert (np.abs(made.height[at] - expected) <= 0.51 * step).all()


def test_noise_has_the_power_and_the_band_of_the_detector():
    count = 3000
    # Too weak to be seen; the noise is that without light. One sample of each packet is that of the return.
    made = Recorded(returns(np.full(count, 1e-6)), replace(Effects(), false_alarms=False))
    base, samples = made.measurement.steady_noise, made.light.shape[1]
    step = made.height.max() / made.light.max() * made.step[0, 0]
    # 0.2 GHz of 1 GHz are about 13 independent numbers in a packet: 1 part in 140 for the variance, times five.
    assert made.height.var() == pytest.approx(base**2 + step**2 / 12, rel=0.035)
    spectrum = (np.abs(np.fft.rfft(made.height, axis=1)) ** 2).mean(axis=0) / samples
    frequency = np.fft.rfftfreq(samples, made.digitiser.spacing_ps * 1e-12)
    beyond = frequency > 2e8
    assert spectrum[beyond] == pytest.approx(step**2 / 12, rel=0.15)
    # Even power below it: the variance is the mean over the whole band.
    share = (2 * (~beyond).sum() - 1) / samples
    assert spectrum[~beyond][1:] == pytest.approx(base**2 / share, rel=0.15)


def test_returns_of_a_pulse_share_a_packet_until_it_ends():
    found = returns([3e3, 2e3, 1e3], [10.0, 12.5, 30.0], beam=[0, 0, 0], order=[1, 2, 3])
    made = Recorded(found)
    assert made.packets.returns.packet.tolist() == [0, 0, 1]
    assert made.light.sum(axis=1) == pytest.approx([3500.0, 700.0], rel=1e-3)
    for packet, range_m in ((0, 10.0), (0, 12.5), (1, 30.0)):
        near = np.abs(made.range_m[packet] - range_m) < 0.8
        mean = (made.light[packet] * made.range_m[packet])[near].sum() / made.light[packet][near].sum()
        assert mean == pytest.approx(range_m, abs=1e-3)
    assert Recorded(found, samples=512).packets.returns.packet.tolist() == [0, 0, 0]


def test_a_record_of_the_reported_return_has_the_others_that_fit():
    found = returns([3e3, 2e3], [10.0, 12.5], beam=[0, 0], order=[1, 2])
    made = Recorded(found, chosen=np.array([0]))
    assert made.packets.returns.packet.tolist() == [0]
    assert made.light.sum() == pytest.approx(3500.0, rel=1e-3)
    late = Recorded(found, chosen=np.array([1]))
    assert 10.0 < late.range_m[0, 0] < 12.5
    assert late.light.sum() == pytest.approx(1400.0, rel=1e-3)


def test_light_from_ice_is_late_as_photon_paths_are():
    found = returns([1e6, 1e6], 10.0, label=ICE)
    found.label[1] = HARD
    made = Recorded(found, samples=128)
    paths = draw_paths_m(SNOW, 200_000, np.random.default_rng(3))
    pulse_m = made.instrument.pulse_deviation_s * 299792458 / 2
    at = 10.0 + paths * SNOW.delay_index / 2 + pulse_m * np.random.default_rng(4).standard_normal(len(paths))
    edge = made.range_m[0] + made.digitiser.spacing_m / 2
    arrived = np.searchsorted(np.sort(at), edge) / len(at)
    held = np.cumsum(made.light, axis=1) / 7e5
    # The sum up to a sample is the integral up to the middle of the next interval within Δ²/24 of the slope there,
    # 0.014 for a pulse without ice; 200,000 paths have 0.002.
    assert np.abs(held[0] - arrived).max() < 0.018
    assert np.abs(held[1] - arrived).max() > 0.25


def test_a_slope_stretches_light_from_ice_about_its_peak():
    found = replace(returns([1e6, 1e6], 10.0, label=ICE), spread_m=np.array([0.0, 0.3]))
    made = Recorded(found, samples=128)
    pulse_m = made.instrument.pulse_deviation_s * 299792458 / 2
    stretch = np.hypot(pulse_m, 0.3) / pulse_m
    table = made.measurement.delay(found)
    fine = np.linspace(9.0, 12.0, 30001)
    both = [np.interp(fine, made.range_m[k], made.height[k]) for k in (0, 1)]
    peak = fine[np.argmax(both[1])]
    assert peak == pytest.approx(10.0 + table["ice_peak_m"][1], abs=made.digitiser.spacing_m)
    assert both[1].max() == pytest.approx(both[0].max() / stretch, rel=0.1)


def test_a_false_alarm_reaches_the_threshold_in_its_packet():
    # 2.5 times the noise is reached about a million times a second.
    count, low = 4000, replace(APD, threshold=2.5)
    found = returns([3e3], 50.0, beam=[0])
    found = replace(found, beam=np.array([count - 1]))
    made = Recorded(found, Effects(), low)
    assert 300 < len(made.alarm_m) < 4000
    waves = made.packets.alarms
    sample = np.rint(made.alarm_m / made.digitiser.spacing_m).astype(int) - waves.packet_start
    height = made.height[waves.packet, sample]
    step = made.height.max() / made.light.max() * made.step[waves.packet, 0]
    threshold = made.measurement.detector.threshold_electrons
    assert (np.abs(height - threshold) <= 0.51 * step).all()
    # Elsewhere noise is what it is: few other samples are so high.
    assert (made.height[waves.packet] >= threshold).mean() < 0.05


def test_numbers_do_not_depend_on_the_beams_that_are_recorded_together():
    beams = np.repeat(np.arange(300), 2)
    found = returns(np.full(600, 2e3), np.tile([10.0, 20.0], 300), beam=beams, order=np.tile([1, 2], 300))
    whole = Recorded(found, replace(Effects(), false_alarms=False))
    recorder = Recorder(whole.digitiser, whole.measurement)
    parts: list[Packets] = []
    for first, end in ((0, 7), (7, 200), (200, 300)):
        own = found.take((found.beam >= first) & (found.beam < end))
        none = np.zeros(0, np.int64), np.zeros(0)
        parts.append(recorder.record(own, np.arange(len(own)), *none, first, end))
    assert np.array_equal(np.concatenate([part.samples for part in parts]), whole.packets.samples)
    assert np.concatenate([part.returns.packet for part in parts]).tolist() == list(range(600))
    assert whole.packets.returns.packet.tolist() == list(range(600))
    # Two packets of a pulse, and two pulses, have other noise.
    assert len(np.unique(whole.packets.samples[:, -30:], axis=0)) == 600


def test_nothing_comes_back_and_nothing_is_recorded():
    made = Recorded(NO_RETURNS)
    assert made.packets.samples.shape == (0, 64)
    assert made.packets.returns.packet.shape == (0,)


@pytest.mark.parametrize(
    ("pulse_s", "bandwidth_hz", "spacing_ps"), [(1e-9, 2e8, 500), (3e-9, 1.47e8, 1500), (6e-9, 5e9, 100)]
)
def test_intervals_are_half_of_the_pulse_and_meet_nyquist(pulse_s, bandwidth_hz, spacing_ps):
    receiver = AnalogReceiver(Apd(bandwidth_hz=bandwidth_hz))
    assert make_digitiser(receiver, instrument(pulse_fwhm_s=pulse_s), 64).spacing_ps == spacing_ps


def test_a_scan_without_a_waveform_is_one_sentence():
    with pytest.raises(IcyMoonError, match="counts single photons, so it has no waveform; choose"):
        make_digitiser(PhotonCounter(), instrument(), 64)
    with pytest.raises(IcyMoonError, match="this scan has no detector; choose"):
        make_digitiser(None, instrument(), 64)
    with pytest.raises(IcyMoonError, match="0 ps apart; give a pulse"):
        make_digitiser(APD, instrument(pulse_fwhm_s=1e-12), 64)
