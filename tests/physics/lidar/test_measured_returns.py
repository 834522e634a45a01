"""Returns after ice and detectors, against formulas for one pulse and against histograms of single photons."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from icymoon.physics.lidar import spad
from icymoon.physics.lidar.apd import Apd, false_alarm_rate_hz
from icymoon.physics.lidar.ice_delay import DelayTable
from icymoon.physics.lidar.light_in_ice import (
    Medium,
    Receiver,
    make_bubbly_ice,
    make_snow,
    measure_bias,
    measure_return_biases,
)
from icymoon.physics.lidar.measured_returns import (
    AnalogReceiver,
    Measurement,
    PhotonCounter,
    Sensing,
    select_measured,
)
from icymoon.physics.lidar.noise_streams import IDEAL, Effects
from icymoon.physics.lidar.returns import NO_RETURNS, Returns
from icymoon.physics.light.photons import LIGHT_M_S
from icymoon.support.errors import IcyMoonError
from lidar_returns import ICE, PULSE_S, instrument, returns

SIGMA_M = PULSE_S / 2.3548200450309493 * LIGHT_M_S / 2
SNOW = make_snow(1e-3, 500.0, 532.0)
ANALOG = AnalogReceiver(Apd(), resolution_m=0.0)


def measure(found: Returns, sensing: Sensing, beams: int | None = None, **values: Any) -> Any:
    count = beams or len(found)
    return Measurement(instrument(count, **values), sensing).measure(found, 0, count)


@pytest.mark.parametrize("medium", [make_bubbly_ice(5e-4, 0.063, 905.0), replace(SNOW, absorption_1_m=0.0)])
def test_tabulated_delays_are_those_of_one_return(medium):
    field = 2e-3
    own = replace(instrument(), field_half_angle_rad=field)
    at = np.array([0.1, 3.0, 40.0])
    found = DelayTable(medium, own).find(at)
    for k, range_m in enumerate(at.tolist()):
        spot_m, radius_m = range_m * 1e-3, 0.02 + range_m * np.tan(field)
        one = measure_bias(medium, Receiver(PULSE_S, 1.0, radius_m, spot_m))
        assert [found.edge_m[k], found.peak_m[k], found.centroid_m[k], found.energy[k]] == pytest.approx(
            [one.edge_m, one.peak_m, one.centroid_m, one.energy], rel=0.01, abs=1e-5
        )
    assert (found.height > 0).all()
    assert (found.height <= found.energy + 1e-9).all()


def test_a_receiver_that_sees_all_light_needs_one_range():
    found = DelayTable(SNOW, instrument()).find(np.array([0.1, 1e4]))
    same = measure_return_biases(SNOW, Receiver(PULSE_S), np.array([np.inf, np.inf]))
    assert found.edge_m == pytest.approx(same.edge_m, abs=1e-12)
    hard = DelayTable(Medium("hard", 0.0, 0.0, 0.0), instrument())
    assert not hard.find(np.ones(2)).edge_m.any()
    assert not hard.find_edge(np.ones(2), np.array([2.0, 1e6])).any()


@pytest.mark.parametrize("range_m", [0.1, 10.0, 1e4])
def test_without_effects_a_hard_surface_is_measured_exactly(range_m):
    measured, beam, _ = measure(returns([1e3, 1e6], range_m), Sensing({}, ANALOG, effects=IDEAL), farthest_m=2e4)
    assert measured.measured_range_m.tolist() == [range_m, range_m]
    assert measured.measured_electrons == pytest.approx([700.0, 7e5])
    assert not measured.ice_delay_m.any()
    assert not len(beam)


def test_a_corrected_edge_is_exact_until_it_saturates():
    quiet = replace(IDEAL, walk=True, saturation=True)
    own = replace(ANALOG, saturation=1e4)
    detector = own.make_detector(instrument())
    measured, _, _ = measure(returns([1e3, 1e7]), Sensing({}, own, effects=quiet))
    before = np.sqrt(2 * np.log(np.array([7e6, 1e4]) / detector.threshold_electrons))
    assert measured.measured_range_m - 10 == pytest.approx([0, -SIGMA_M * (before[0] - before[1])], abs=1e-9)
    assert measured.measured_electrons.tolist() == pytest.approx([700, 1e4])
    raw, _, _ = measure(returns([1e3]), Sensing({}, replace(own, corrects_walk=False), effects=quiet))
    walk = SIGMA_M * np.sqrt(2 * np.log(700 / detector.threshold_electrons))
    assert raw.measured_range_m - 10 == pytest.approx([-walk], abs=1e-9)


def test_an_edge_at_half_of_the_peak_is_late_by_the_bias_of_ice():
    quiet = replace(IDEAL, walk=True)
    table = DelayTable(SNOW, instrument())
    bias = table.find(np.ones(1))
    detector = ANALOG.make_detector(instrument())
    photons = 2 * detector.threshold_electrons / 0.7 / bias.height[0]
    measured, _, _ = measure(returns([photons, 30 * photons], label=ICE), Sensing({ICE: SNOW}, ANALOG, effects=quiet))
    assert measured.measured_electrons[0] == pytest.approx(2 * detector.threshold_electrons)
    # The table of the edge has steps of 1/20 of the pulse's deviation.
    assert measured.ice_delay_m[0] == pytest.approx(bias.edge_m[0], rel=3e-3)
    assert measured.measured_range_m - 10 == pytest.approx(measured.ice_delay_m, abs=1e-9)
    # A stronger return passes the threshold earlier on its edge, where less of the delay is.
    assert 0 < measured.ice_delay_m[1] < 0.85 * bias.edge_m[0]
    without_walk, _, _ = measure(returns([photons], label=ICE), Sensing({ICE: SNOW}, ANALOG, effects=IDEAL))
    assert without_walk.ice_delay_m == pytest.approx(bias.edge_m)
    centroid, _, _ = measure(
        returns([photons], label=ICE), Sensing({ICE: SNOW}, replace(ANALOG, timing="CENTROID"), effects=IDEAL)
    )
    assert centroid.measured_range_m - 10 == pytest.approx(bias.centroid_m)


def test_a_slope_makes_the_pulse_lower_and_longer():
    quiet = replace(IDEAL, walk=True)
    found = replace(returns([1e4, 1e4]), spread_m=np.array([0.0, 3 * SIGMA_M]))
    measured, _, _ = measure(found, Sensing({}, replace(ANALOG, corrects_walk=False), effects=quiet))
    assert measured.measured_electrons[0] / measured.measured_electrons[1] == pytest.approx(np.sqrt(10))
    assert measured.measured_range_m[1] < measured.measured_range_m[0] < 10


def test_weak_returns_are_lost_and_effects_switch_alone():
    sensing = Sensing({}, ANALOG)
    found = returns(np.full(4000, 30.0))
    everything, _, _ = measure(found, sensing)
    still, _, _ = measure(found, replace(sensing, effects=Effects(jitter=False)))
    assert np.array_equal(everything.measured_electrons, still.measured_electrons)
    both = everything.detected
    assert 0 < both.mean() <= 1
    assert not np.array_equal(everything.measured_range_m[both], still.measured_range_m[both])
    lost, _, _ = measure(returns([0.0, 1.0]), replace(sensing, effects=IDEAL))
    assert np.isnan(lost.measured_range_m).all()
    assert not lost.measured_electrons.any()
    other, _, _ = measure(found, replace(sensing, scan=1))
    assert not np.array_equal(other.measured_electrons, everything.measured_electrons)


@pytest.mark.parametrize("detector", [ANALOG, PhotonCounter(jitter_s=1e-10, dark_hz=1e6)])
def test_numbers_do_not_depend_on_the_beams_that_are_processed_together(detector):
    found = replace(returns(np.full(60, 40.0), beam=np.repeat(np.arange(30), 2), order=np.tile([1, 2], 30)))
    found = replace(found, range_m=np.tile([10.0, 12.0], 30))
    whole = Measurement(instrument(30), Sensing({}, detector))
    one, beam, at = whole.measure(found, 0, 30)
    parts = [whole.measure(found.take(found.beam // 17 == k), 17 * k, min(17 * k + 17, 30)) for k in (0, 1)]
    for name in ("measured_range_m", "measured_electrons"):
        assert np.array_equal(
            getattr(one, name), np.concatenate([getattr(part[0], name) for part in parts]), equal_nan=True
        )
    assert beam.tolist() == np.concatenate([part[1] for part in parts]).tolist()
    assert at.tolist() == np.concatenate([part[2] for part in parts]).tolist()


def test_false_alarms_of_a_threshold_are_rices():
    own = replace(ANALOG, threshold=3.0)
    _, beam, at = measure(NO_RETURNS, Sensing({}, own), 40_000)
    detector = own.make_detector(instrument())
    base = np.sqrt(detector.noise_electrons**2 + detector.excess_noise * own.find_dark_electrons(instrument()))
    rate = float(false_alarm_rate_hz(detector.threshold_electrons / base, detector.rice_hz))
    share = -np.expm1(-rate * 2 * 100 / LIGHT_M_S)
    assert len(beam) / 40_000 == pytest.approx(share, abs=4 * np.sqrt(share / 40_000))
    assert (at <= 100).all()
    assert not len(measure(NO_RETURNS, Sensing({}, own, effects=Effects(false_alarms=False)), 40_000)[1])


def test_an_alarm_takes_the_place_of_a_return_by_what_is_reported():
    own, effects = replace(ANALOG, threshold=3.0), Effects(jitter=False, shot_noise=False)
    found = returns(np.full(500, 1e5), 50.0)
    kept = {
        reported: measure(found, Sensing({}, own, effects=effects), reported=reported)[1:]
        for reported in ("ALL", "FIRST", "STRONGEST", "LAST")
    }
    assert not len(kept["STRONGEST"][0])
    assert 0 < len(kept["FIRST"][0]) < len(kept["ALL"][0])
    assert (kept["FIRST"][1] < 50.1).all()
    assert len(kept["LAST"][0]) > 0
    assert (kept["LAST"][1] > 49.9).all()


def test_first_photons_have_the_law_of_pile_up():
    """Ranges of 2 expected photons and a background against the histogram's probabilities, by chi-square."""
    count, photons, dark_hz = 20_000, 2.0, 5e6
    counter = PhotonCounter(efficiency=0.5, dark_hz=dark_hz)
    measured, beam, at = measure(returns(np.full(count, 2 * photons), 10.0), Sensing({}, counter), farthest_m=15.0)
    bin_s, bins = 2e-10, round(2 * 15 / LIGHT_M_S / 2e-10)
    expected = spad.expect_pulse(2 * 10 / LIGHT_M_S, photons, dark_hz, bins, bin_s, PULSE_S)
    probability = spad.detection_probability(expected)
    times = np.concatenate([measured.measured_range_m[measured.detected], at]) * 2 / LIGHT_M_S
    assert len(times) == measured.detected.sum() + len(beam)
    counts = np.bincount(np.minimum((times / bin_s).astype(int), bins - 1), minlength=bins)
    # Bins of less than 20 counts together; both noise and pulse must fit.
    enough = probability * count >= 20
    chi = ((counts - probability * count) ** 2 / (probability * count))[enough].sum()
    degrees = int(enough.sum())
    assert abs(chi - degrees) < 5 * np.sqrt(2 * degrees)
    assert counts.sum() / count == pytest.approx(probability.sum(), abs=0.01)


def test_single_photons_from_ice_are_late_as_its_law_and_early_in_strong_light():
    counter, sensing = PhotonCounter(efficiency=1.0, dark_hz=0.0), {ICE: SNOW}
    weak, _, _ = measure(returns(np.full(40_000, 0.05), label=ICE), Sensing(sensing, counter))
    late = weak.measured_range_m[weak.detected] - 10
    bias = DelayTable(SNOW, instrument()).find(np.ones(1))
    assert late.mean() == pytest.approx(bias.centroid_m[0], abs=4 * late.std() / np.sqrt(len(late)))
    strong, _, _ = measure(returns(np.full(200, 1e5), label=ICE), Sensing(sensing, counter))
    hard, _, _ = measure(returns(np.full(200, 1e5)), Sensing({}, counter))
    assert hard.measured_range_m.mean() < 10 - 3 * SIGMA_M
    assert 0 < (strong.measured_range_m - hard.measured_range_m).mean() < bias.edge_m[0]
    # Without pile-up each photon counts alike.
    even, _, _ = measure(returns(np.full(4000, 1e5)), Sensing({}, counter, effects=Effects(walk=False)))
    assert even.measured_range_m.mean() == pytest.approx(10, abs=4 * SIGMA_M / np.sqrt(4000))


def test_a_photon_counter_stops_at_the_first_return_of_a_beam():
    found = returns(np.full(200, 1e4), beam=np.repeat(np.arange(100), 2), order=np.tile([1, 2], 100))
    found = replace(found, range_m=np.tile([10.0, 12.0], 100))
    measured, beam, _ = measure(found, Sensing({}, PhotonCounter(dark_hz=0.0)), 100)
    assert measured.detected.tolist() == [True, False] * 100
    assert not len(beam)


def test_the_reported_return_is_chosen_among_those_detected():
    found = replace(
        returns([1e4, 1.0, 1e3, 1.0, 0.5], beam=[0, 0, 0, 1, 1], order=[1, 2, 3, 1, 2]),
        range_m=np.array([5.0, 6, 7, 5, 6]),
    )
    measured, _, _ = measure(found, Sensing({}, ANALOG, effects=IDEAL), 2)
    assert measured.detected.tolist() == [True, False, True, False, False]
    chosen = {kind: select_measured(found, measured, kind).tolist() for kind in ("ALL", "FIRST", "STRONGEST", "LAST")}
    # The second beam is lost, and keeps the return that it would have reported.
    assert chosen == {"ALL": [0, 1, 2, 3, 4], "FIRST": [0, 3], "STRONGEST": [0, 3], "LAST": [2, 4]}


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: Measurement(instrument(farthest_m=np.inf), Sensing({}, ANALOG)), "lidar.farthest_m"),
        (lambda: PhotonCounter(efficiency=0.0), "efficiency of the photon counter"),
        (lambda: PhotonCounter(dark_hz=-1.0), "dark_hz"),
        (lambda: instrument(pulse_fwhm_s=0.0), "lidar.pulse_ns"),
    ],
)
def test_impossible_detectors_are_one_sentence(make, part):
    with pytest.raises(IcyMoonError, match=part):
        make()


def test_nothing_comes_back_and_nothing_is_measured():
    for detector in (ANALOG, PhotonCounter(dark_hz=0.0)):
        measured, beam, at = measure(NO_RETURNS, Sensing({ICE: SNOW}, detector, effects=IDEAL), 5)
        assert (len(measured.measured_range_m), len(beam), len(at)) == (0, 0, 0)
    assert Measurement(instrument(), Sensing({})).delay(NO_RETURNS) == {}
