"""Detectors against the laws of noise, drawn by simulation or by hand, and against an instrument's data sheet."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.lidar import apd as apds
from icymoon.physics.lidar import spad
from icymoon.physics.lidar.apd import Apd
from icymoon.physics.lidar.detector import (
    Detector,
    correct_walk_m,
    detect_returns,
    edge_jitter_s,
    edge_walk_s,
    photon_jitter_m,
)
from icymoon.physics.lidar.noise_streams import IDEAL, Effects
from icymoon.physics.lidar.sun_background import background_photons_1_s
from icymoon.physics.light.photons import LIGHT_M_S
from icymoon.support.errors import IcyMoonError

SILICON = Apd()
DARK = np.zeros((160, 4000))
FAST = Detector(threshold_electrons=50.0, noise_electrons=8.0)


def test_excess_noise_is_that_of_geometric_avalanches():
    # With electrons alone ionising, the gain is geometric (Yule's process); with both alike F is M.
    gain = np.random.default_rng(1).geometric(1 / 20, 200_000)
    single = Apd(gain=20.0, ionisation_ratio=0.0)
    assert single.excess_noise == pytest.approx((gain**2.0).mean() / gain.mean() ** 2, rel=0.01)
    assert Apd(gain=30.0, ionisation_ratio=1.0).excess_noise == pytest.approx(30.0)
    assert Apd(gain=1.0).excess_noise == pytest.approx(1.0)


def test_noise_adds_up_by_hand():
    # √(4 · 1.380649e-23 · 293 · 2e8 / 1e4) = 1.7989e-8 A, and √(2 q² M² F η r B) of 1e9 photons per second.
    quiet = replace(SILICON, dark_a=0.0)
    assert quiet.noise_a(0.0) == pytest.approx(1.7989e-8, rel=1e-4)
    shot = quiet.noise_a(1e9, Effects(amplifier_noise=False))
    assert shot == pytest.approx(1.602176634e-19 * 100 * math.sqrt(2 * SILICON.excess_noise * 0.7 * 1e9 * 2e8))
    assert quiet.noise_a(1e9) == pytest.approx(math.hypot(1.7989e-8, float(shot)), rel=1e-4)
    assert quiet.noise_a(1e9, IDEAL) == 0.0


def test_false_alarms_are_rices_within_5_percent():
    noise = float(SILICON.noise_a(0.0))
    current = apds.draw_waveforms(SILICON, DARK, 5e-10, seed=1)
    assert current.std() == pytest.approx(noise, rel=0.01)
    for over in (1.5, 2.0):
        beam, _ = apds.find_edges(current, over * noise, 5e-10)
        rate = len(beam) / (DARK.size * 5e-10)
        assert rate == pytest.approx(float(apds.false_alarm_rate_hz(over, SILICON.bandwidth_hz)), rel=0.05)
        assert apds.threshold_over_noise(rate, SILICON.bandwidth_hz) == pytest.approx(over, abs=0.05)


def test_an_edge_walks_and_jitters_as_stated():
    # 1000 Gaussian pulses of σ = 4 ns whose peak is 40 times the noise, timed at half of the peak.
    sample, sigma = 2e-10, 4e-9
    time = np.arange(300) * sample
    pulse = np.exp(-((time - 3e-8) ** 2) / (2 * sigma**2))
    quiet = replace(SILICON, dark_a=0.0)
    noise = float(quiet.noise_a(0.0))
    light = np.tile(40 * noise / float(quiet.signal_a(1.0)) * pulse, (1000, 1))
    current = apds.draw_waveforms(quiet, light, sample, 2, effects=Effects(shot_noise=False))
    beam, at = apds.find_edges(current, 20 * noise, sample, dead_s=1e-6)
    assert (beam == np.arange(1000)).all()
    # The standard deviation of 1000 draws is known to 2.2 %.
    assert at.std() == pytest.approx(float(edge_jitter_s(sigma, 2.0, 20.0)), rel=0.08)
    assert 3e-8 - at.mean() == pytest.approx(float(edge_walk_s(sigma, 2.0)), abs=4 * at.std() / math.sqrt(1000))
    # The rise time from 10 to 90 % is σ (√(2 ln 10) - √(2 ln(10/9))) = 1.687 σ: the usual t_rise/SNR.
    assert edge_jitter_s(sigma, 2.0, 20.0) == pytest.approx(1.687 * sigma / 40, rel=0.01)


def test_dead_time_swallows_the_edges_after_the_first():
    current = np.zeros((2, 40))
    current[0, [5, 10, 30]] = current[1, 7] = 1.0
    beam, time = apds.find_edges(current, 0.5, 1.0, dead_s=10.0)
    assert beam.tolist() == [0, 0, 1]
    assert time.tolist() == [4.5, 29.5, 6.5]
    assert len(apds.find_edges(current, 0.5, 1.0)[0]) == 4


def test_a_converter_rounds_and_saturates():
    out = apds.digitise(np.array([-1.0, 0.26, 0.5, 7.0]), 1.0, 2)
    assert out == pytest.approx([0.0, 1 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize(("snr", "stated_m"), [(250, 0.015), (100, 0.03), (12, 0.10)])
def test_jitter_is_that_of_an_ouster_within_30_percent(snr, stated_m):
    # OS1 data sheet: standard deviations at three signal-to-noise ratios and a resolution of 1.2 cm. They fall as the
    # root of the ratio, so it counts photons; a pulse of 4.5 ns is fitted, the law is not.
    ouster = Detector(4.5e-9, 2.0, 0.0, timing="CENTROID", resolution_m=0.012, gate_m=(0.8, 120.0))
    found = detect_returns(np.full(4000, 20.0), np.full(4000, float(snr)), ouster, seed=3)
    assert np.nanstd(found.range_m) == pytest.approx(stated_m, rel=0.3)
    assert np.nanmean(found.range_m) == pytest.approx(20.0, abs=4 * stated_m / math.sqrt(4000))


def test_photons_limit_the_mean_of_their_times():
    # The mean of N arrival times of a pulse, drawn one by one.
    sigma = 1e-9
    mean = np.random.default_rng(5).normal(0.0, sigma, (4000, 25)).mean(axis=1)
    assert photon_jitter_m(sigma, 25) == pytest.approx(LIGHT_M_S / 2 * mean.std(), rel=0.05)


def test_half_of_the_pulses_at_the_threshold_are_seen():
    quiet = replace(FAST, threshold_electrons=400.0, gate_m=(0.0, 100.0))
    found = detect_returns(np.full(4000, 10.0), np.full(4000, 400.0), quiet, 1)
    assert np.isfinite(found.range_m).mean() == pytest.approx(0.5, abs=3 * 0.5 / math.sqrt(4000))


def test_alarms_fill_an_empty_gate_as_often_as_rice_states():
    noisy = replace(FAST, threshold_electrons=40.0, noise_electrons=10.0, gate_m=(0.0, 100.0))
    found = detect_returns(np.full(20000, np.nan), 0.0, noisy, 2)
    rate = float(apds.false_alarm_rate_hz(4.0, noisy.rice_hz)) * 2 * 100.0 / LIGHT_M_S
    assert found.is_false.mean() == pytest.approx(-math.expm1(-rate), rel=0.05)
    assert np.nanmax(found.range_m) < 100.0
    assert (np.isnan(found.range_m) == ~found.is_false).all()


def test_strong_pulses_seem_near_until_the_walk_is_corrected():
    sharp = replace(FAST, jitter_s=0.0)
    electrons = np.array([100.0, 1e3, 1e6])
    effects = replace(IDEAL, walk=True, saturation=True)
    found = detect_returns(np.full(3, 50.0), electrons, sharp, 1, effects=effects)
    walk = LIGHT_M_S / 2 * edge_walk_s(sharp.deviation_s, electrons / 50.0)
    assert found.range_m == pytest.approx(50.0 - walk)
    assert correct_walk_m(found, sharp) == pytest.approx(50.0)
    clipped = replace(sharp, saturation=500.0)
    saturated = detect_returns(np.full(3, 50.0), electrons, clipped, 1, effects=effects)
    assert saturated.electrons.max() == 500.0
    assert (correct_walk_m(saturated, clipped) < 50.0 - 1e-3).tolist() == [False, True, True]


def test_without_effects_ranges_are_true_from_1_mm_to_10_km():
    true = np.array([1e-3, 0.1, 1e4, np.nan, np.inf, 2e4])
    found = detect_returns(true, 1000.0, FAST, 1, effects=IDEAL)
    assert (found.range_m[:3] == true[:3]).all()
    assert np.isnan(found.range_m[3:]).all()
    assert (found.electrons == [1000, 1000, 1000, 0, 0, 0]).all()


def test_no_light_is_no_return_and_one_photon_may_be_one():
    dark = detect_returns(np.full(100, 10.0), 0.0, FAST, 1, effects=replace(Effects(), false_alarms=False))
    assert np.isnan(dark.range_m).all()
    single = Detector(threshold_electrons=0.5, noise_electrons=0.0, timing="CENTROID")
    found = detect_returns(np.full(4000, 10.0), 1.0, single, 1)
    assert 0.5 < np.isfinite(found.range_m).mean() < 0.9
    assert detect_returns(np.array([]), 1.0, FAST, 1).range_m.shape == (0,)


def test_the_same_seed_gives_the_same_bits_and_effects_are_apart():
    true, light = np.linspace(1.0, 100.0, 500), np.full(500, 300.0)
    first, again = (detect_returns(true, light, FAST, 7, 3) for _ in range(2))
    assert first.range_m.tobytes() == again.range_m.tobytes()
    other = detect_returns(true, light, FAST, 7, 4)
    assert (first.range_m != other.range_m).all()
    calm = detect_returns(true, light, FAST, 7, 3, effects=replace(Effects(), jitter=False))
    assert (calm.electrons == first.electrons).all()


# --- single photons ---


def chi_square(counts, probability, shots):
    """Chi-square over bins of at least 10 expected counts and the rest, and its degrees of freedom."""
    expected = probability * shots
    large = expected >= 10
    seen = np.append(counts[large], counts[~large].sum())
    meant = np.append(expected[large], expected[~large].sum())
    return float(((seen - meant) ** 2 / np.maximum(meant, 1e-9)).sum()), len(seen) - 1


PULSE = spad.expect_pulse(2e-8, 1.5, 1e7, 100, 5e-10, 2e-9)


def test_a_first_photon_histogram_piles_up_as_stated():
    found, shots = spad.count_photons(PULSE, 60_000, seed=1), 60_000
    law = spad.detection_probability(PULSE)
    by_hand = np.exp(-np.concatenate([[0], np.cumsum(PULSE)[:-1]])) * (1 - np.exp(-PULSE))
    assert law == pytest.approx(by_hand)
    # Shots without a count make the total random too, so a bin varies by no more than Poisson's law.
    value, freedom = chi_square(found, law, shots)
    assert abs(value - freedom) < 3 * math.sqrt(2 * freedom)
    assert (found != PULSE * shots).any()
    naive, freedom = chi_square(found, PULSE, shots)
    assert naive > 10 * freedom


@pytest.mark.parametrize("dead", [4, 30])
def test_dead_time_shadows_the_bins_after_a_count(dead):
    shots = 40_000
    found = spad.count_photons(PULSE, shots, seed=2, dead_bins=dead)
    value, freedom = chi_square(found, spad.detection_probability(PULSE, dead), shots)
    # Counts of a shot exclude each other for a time, which only narrows the sum: the upper limit counts.
    assert value < freedom + 3 * math.sqrt(2 * freedom)
    assert value > 0.4 * freedom
    none, freedom = chi_square(found, spad.detection_probability(PULSE, 0), shots)
    assert none > 3 * freedom
    assert (spad.count_photons(PULSE, shots, seed=2, dead_bins=dead) == found).all()


@pytest.mark.parametrize("dead", [None, 0, 7])
def test_pile_up_is_corrected_back_to_the_light(dead):
    law = spad.detection_probability(PULSE, dead)
    assert spad.correct_pile_up(law * 1e6, 1_000_000, dead) == pytest.approx(PULSE, rel=1e-9)


def test_pile_up_makes_ranges_short():
    bins = np.arange(100)
    first = spad.detection_probability(spad.expect_pulse(2e-8, 100.0, 0.0, 100, 5e-10, 2e-9))
    assert (first * bins).sum() / first.sum() < 40.0 - 1.5
    weak = spad.detection_probability(spad.expect_pulse(2e-8, 1e-3, 0.0, 100, 5e-10, 2e-9))
    assert (weak * bins).sum() / weak.sum() == pytest.approx(39.5, abs=0.01)


def test_single_shots_are_drawn_by_the_same_law():
    drawn = spad.draw_first_counts(np.tile(PULSE, (20_000, 1)), seed=3)
    assert (drawn >= 0).mean() == pytest.approx(-math.expm1(-PULSE.sum()), abs=0.01)
    assert np.bincount(drawn[drawn >= 0], minlength=100)[40] == pytest.approx(
        20_000 * spad.detection_probability(PULSE)[40], rel=0.15
    )
    moved = spad.add_jitter(drawn, 2.0, seed=3)
    assert (moved[drawn < 0] == -1).all()
    assert (moved - drawn)[drawn >= 0].std() == pytest.approx(2.0, rel=0.05)


def test_extremes_of_light_on_a_single_photon_detector():
    assert (spad.count_photons(np.zeros(5), 100, 1) == 0).all()
    assert spad.count_photons(np.full(5, 1e6), 100, 1).tolist() == [100, 0, 0, 0, 0]
    assert spad.count_photons(np.full(5, 1e6), 100, 1, dead_bins=0).tolist() == [100] * 5
    assert spad.count_photons(PULSE, 0, 1).sum() == 0
    assert np.isinf(spad.correct_pile_up(np.array([100, 0]), 100)[0])
    assert np.isnan(spad.correct_pile_up(np.array([100, 0]), 100)[1])


@pytest.mark.parametrize(
    ("sun_w_m2", "wavelength", "expected"),
    [(50.26, 532.0, 1.8), (50.26, 905.0, 1.5), (50.26, 1064.0, 1.3), (14.82, 532.0, 0.53), (14.82, 1064.0, 0.37)],
)
def test_the_suns_background_is_that_of_another_program(sun_w_m2, wavelength, expected):
    # 5 cm aperture, 1 mrad, 1 nm, half of the photons, Sun 30° high, albedo 0.8: photons per 100 ns.
    rate = background_photons_1_s(sun_w_m2, 0.5, 0.8 / math.pi, wavelength, 1.0, 0.05, 1e-3, 0.5)
    assert rate * 1e-7 == pytest.approx(expected, rel=0.1)
    assert background_photons_1_s(sun_w_m2, -0.1, 0.8 / math.pi, wavelength, 1.0, 0.05, 1e-3) == 0.0
    assert background_photons_1_s(sun_w_m2, 0.5, 0.0, wavelength, 1.0, 0.05, 1e-3) == 0.0


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Apd(gain=0.5), "gain"),
        (lambda: Apd(bandwidth_hz=math.nan), "bandwidth"),
        (lambda: apds.threshold_over_noise(0.0, 1e8), "false alarms"),
        (lambda: apds.draw_waveforms(SILICON, DARK[:1, :10], 1e-8, 1), "apart"),
        (lambda: apds.digitise(np.zeros(1), 0.0, 8), "converter"),
        (lambda: Detector(pulse_fwhm_s=0.0), "pulse"),
        (lambda: Detector(threshold_electrons=0.0), "threshold"),
        (lambda: Detector(timing="PEAK"), "timing"),
        (lambda: Detector(gate_m=(5.0, 1.0)), "gate"),
        (lambda: Detector(jitter_s=-1.0), "jitter_s"),
        (lambda: Detector(excess_noise=0.5), "excess"),
        (lambda: detect_returns(np.ones(1), -1.0, FAST, 1), "negative"),
        (lambda: spad.detection_probability(np.array([-1.0])), "negative"),
        (lambda: spad.expect_pulse(0.0, 1.0, 0.0, 5, 1e-9, 0.0), "pulse"),
        (lambda: spad.count_photons(np.ones((2, 2)), 1, 1), "histogram"),
        (lambda: background_photons_1_s(50.0, 1.0, 1.0, 532.0, 0.0, 0.05, 1e-3), "filter"),
        (lambda: background_photons_1_s(50.0, 1.0, 1.0, 532.0, 1.0, 0.05, 0.0), "field"),
    ],
)
def test_faults_are_one_sentence(make, named):
    with pytest.raises(IcyMoonError, match=named) as told:
        make()
    assert str(told.value).count(". ") == 0
    assert str(told.value).endswith(".")


def test_a_low_threshold_on_a_strong_pulse_has_the_noise_of_its_foot():
    # Pulses of 1e5 electrons of σ = 4 ns, timed at 1/50 of the peak, with shot noise that follows the light.
    sigma, electrons, sample = 4e-9, 1e5, 5e-10
    apd = Apd(gain=50.0, bandwidth_hz=4e8, load_ohm=1e6)
    time = np.arange(120) * sample
    peak = electrons / sigma / math.sqrt(2 * math.pi)
    pulse = peak / apd.efficiency * np.exp(-((time - 3e-8) ** 2) / (2 * sigma**2))
    current = apds.draw_waveforms(apd, np.tile(pulse, (1500, 1)), sample, seed=4)
    beam, crossed = apds.find_edges(current, float(apd.signal_a(peak / apd.efficiency)) / 50, sample, 1e-6)
    detector = Detector(
        pulse_fwhm_s=2.3548 * sigma,
        threshold_electrons=electrons / 50,
        noise_electrons=0.0,
        excess_noise=2 * apd.excess_noise * apd.bandwidth_hz * sigma * math.sqrt(2 * math.pi),
    )
    found = detect_returns(
        np.full(20_000, 10.0), electrons, detector, 1, effects=Effects(false_alarms=False, walk=False)
    )
    assert len(np.unique(beam)) == 1500
    assert found.range_m.std() * 2 / LIGHT_M_S == pytest.approx(crossed.std(), rel=0.1)
