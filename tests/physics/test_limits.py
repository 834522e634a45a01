"""The functions behind the pictures, at the limits of what they are given and beyond, many at once."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from icymoon.physics.camera import depth_accuracy, exposure_brackets
from icymoon.physics.camera.blur import find_blur, find_pose_after
from icymoon.physics.camera.point_spread import apply_point_spread
from icymoon.physics.camera.sensor import choose_exposure_s, collect_electrons, convert_to_digital, top_dn
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.physics.light.photons import electron_rate
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.physics.mesh.vertex_spacing import GradingView
from icymoon.physics.rocks.size_laws import draw_diameters, make_size_law
from icymoon.physics.surfaces import hapke, photometry, principled
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings import description
from icymoon.settings.table import TOPICS
from icymoon.stereo.images.disparity_and_occlusion import find_visible_in_left, find_visible_in_right
from icymoon.stereo.images.lens import make_lens
from icymoon.stereo.measure.metrics import (
    compute_depth_metrics,
    compute_disparity_metrics,
    compute_error_curve,
    compute_sparsification,
    compute_total_metrics,
    is_usable,
    sort_by_confidence,
)
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")
_ODD = (0.0, -0.0, -1.0, 1e-38, 1e38, math.nan, math.inf, -math.inf)


def _value(setting):
    """A limit of a setting, or anything between, or a choice."""
    if setting.kind == "choice":
        return st.sampled_from([choice[0] for choice in setting.choices])
    if setting.kind == "bool":
        return st.booleans()
    if setting.kind == "int":
        low, high = int(setting.minimum), int(setting.maximum)
        return st.sampled_from([low, high]) | st.integers(low, high)
    return st.sampled_from([setting.minimum, setting.maximum]) | st.floats(setting.minimum, setting.maximum)


def topic(name, *left_out):
    """Complete descriptions with a topic's settings anywhere in their range."""
    varied = st.fixed_dictionaries(
        {},
        optional={
            s.key: _value(s)
            for s in TOPICS[name].settings
            if s.kind in ("int", "float", "bool", "choice") and s.key not in left_out
        },
    )
    # A filter that passes no wavelength is refused, also where it is so in single precision only.
    varied = varied.filter(
        lambda values: np.float32(values.get("cut_on_nm", 400.0)) < np.float32(values.get("cut_off_nm", 700.0))
    )
    return varied.map(
        lambda values: description.merged(description.defaults(), description.check({name: values}, "test"))
    )


def images(*shape):
    """Arrays of what is a depth and of what is none."""
    return arrays.arrays(
        np.float64,
        shape or arrays.array_shapes(min_dims=2, max_dims=2, max_side=7),
        elements=st.sampled_from(_ODD) | st.floats(1e-6, 1e6),
        fill=st.nothing(),
    )


def made(make, *arguments):
    """What a function gives, or None where it refuses in a sentence."""
    said = "."
    try:
        return make(*arguments)
    except IcyMoonError as refusal:
        said = str(refusal)
    assert said.endswith(".")
    assert "\n" not in said
    return None


@hypothesis(max_examples=60)
@given(st.data())
def test_metrics_are_shares_or_nothing(data):
    truth = data.draw(images())
    prediction = data.draw(images(*truth.shape))
    known, both = is_usable(truth), is_usable(truth) & is_usable(prediction)
    depth, disparity = compute_depth_metrics(prediction, truth), compute_disparity_metrics(prediction, truth)
    total = compute_total_metrics(prediction, truth, prediction, truth, depth["dod"])
    assert depth["n"] == both.sum()
    shares = ("l1_rate_10", "l1_rate_30", "l1_rate_100", "bad_0_5", "bad_1", "bad_2", "bad_3", "d1", "dod")
    for numbers, defined in (({**depth, **disparity}, both.any()), (total, known.any())):
        for key, value in numbers.items():
            if key in shares and not math.isnan(value):
                assert -1e-12 <= value <= 1 + 1e-12, key
            if key not in ("n", "coverage", "dod"):
                assert math.isnan(value) != defined, key
            if key not in ("n", "bias_m") and not math.isnan(value):
                assert value >= -1e-12, key
    assert math.isnan(depth["coverage"]) or depth["coverage"] == pytest.approx(both.sum() / known.sum())
    curve = compute_error_curve(prediction, truth)
    assert np.isnan(curve).all() or (np.all(np.diff(curve) >= 0) and curve[-1] <= depth["coverage"] + 1e-12)
    error = np.abs(np.where(both, prediction, np.nan) - np.where(both, truth, np.nan))
    kept = compute_sparsification(error.ravel()[sort_by_confidence(np.nan_to_num(prediction))])
    assert np.isnan(kept).all() != both.any()


@hypothesis(max_examples=60)
@given(images(), st.floats(1e-4, 100.0), st.sampled_from([1.0, 341.3, 8.2e7]))
def test_what_an_eye_sees_of_the_other_is_ground(depth, baseline_m, focal_px):
    """A pixel without depth is seen by nobody, whatever the depths."""
    depth = np.where(is_usable(depth), depth, np.nan)
    rows, columns = depth.shape
    camera = StereoCamera(columns, rows, focal_px, columns / 2, rows / 2, baseline_m)
    left, right = depth, depth[::-1]
    for visible, own in (
        (find_visible_in_right(left, right, camera), left),
        (find_visible_in_left(left, right, camera), right),
    ):
        assert visible.shape == depth.shape
        assert not visible[np.isnan(own)].any()


@hypothesis(max_examples=60)
@given(
    topic("sensor", "radiation_flux_cm2_s"),
    arrays.arrays(
        np.float64, (6, 5), elements=st.sampled_from((0.0, math.nan, math.inf, -1.0)) | st.floats(1e-12, 1e12)
    ),
)
def test_a_sensor_gives_numbers_of_its_range(settings, light):
    sensor = settings["sensor"]
    rate = electron_rate(settings["light"], sensor, 94e-6)
    seen = apply_point_spread(light, sensor)
    seconds = choose_exposure_s(seen, rate, sensor)
    assert math.isfinite(seconds)
    assert seconds > 0
    numbers = []
    for time in exposure_brackets.list_exposure_times(seconds, sensor):
        charge = collect_electrons(seen, time, rate, sensor, np.random.default_rng(1))
        assert np.isfinite(charge).all()
        numbers.append(convert_to_digital(charge, sensor))
        assert numbers[-1].max() <= top_dn(sensor)
    times = exposure_brackets.list_exposure_times(seconds, sensor)
    assert len(times) == sensor["brackets"]
    merged = exposure_brackets.merge_exposures(numbers, times, sensor)
    assert np.isfinite(merged).all()


@hypothesis(max_examples=60)
@given(topic("sensor", "radiation_flux_cm2_s", "shot_noise", "read_noise_e"))
def test_more_light_never_makes_a_darker_pixel(settings):
    sensor = settings["sensor"] | {"shot_noise": False, "read_noise_e": 0.0, "blooming": 0.0}
    light = np.concatenate([[0.0], np.geomspace(1e-9, 1e9, 40)])
    rate = electron_rate(settings["light"], sensor, 94e-6)
    charge = collect_electrons(light, sensor["exposure_s"], rate, sensor, np.random.default_rng(1))
    assert np.all(np.diff(convert_to_digital(charge, sensor).astype(int)) >= 0)


@hypothesis(max_examples=80)
@given(topic("hapke", "backend", "accuracy"), st.floats(0.0, 90.0), st.floats(0.0, 90.0), st.floats(0.0, 180.0))
def test_hapkes_law_is_a_reflectance(settings, incidence, emission, azimuth):
    """Never negative, black without scattering, and the same both ways (Helmholtz)."""
    q = hapke.hapke_from_settings(settings["hapke"])
    i, e, psi = np.radians([[incidence], [emission], [azimuth]])
    there, back = hapke.brdf(i, e, psi, q), hapke.brdf(e, i, psi, q)
    for value in (there, back):
        assert np.isfinite(value).all()
        assert (value >= 0).all()
    if q.w == 0:
        assert not there.any()
    if max(incidence, emission) < 89.0:
        np.testing.assert_allclose(there, back, rtol=1e-6, atol=1e-12)


@hypothesis(max_examples=30)
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_simple_laws_return_what_they_say(albedo, share):
    law = photometry.lunar_lambert(albedo, share)
    assert photometry.bond_albedo(law) == pytest.approx(albedo, rel=1e-3, abs=1e-12)


@given(topic("surface"))
def test_snow_is_as_white_as_can_be(settings):
    surface = settings["surface"]
    base = principled.base_colour(surface, surface["albedo"])
    assert 0 <= base <= 1
    assert 0 <= principled.real_albedo(surface) <= 1
    told = principled.advise_on_albedo(surface)
    assert bool(told) == (
        abs(principled.real_albedo(surface) - surface["albedo"]) > principled.REPORTED_FROM * surface["albedo"]
    )


@hypothesis(max_examples=60)
@given(topic("light", "directions_from"))
def test_a_sky_is_of_numbers(settings):
    shown = compute_sky(settings["light"])
    said = json.loads(json.dumps(describe_sky(shown), allow_nan=False))
    assert 0 <= said["sun"]["eclipse"] <= 1 + 1e-9
    assert said["sun"]["ground_irradiance_wm2"] >= 0
    if said["planet"] is not None:
        assert said["planet"]["ground_irradiance_wm2"] >= 0
        assert 0 <= said["planet"]["phase_deg"] <= 180


@given(topic("rig"), st.floats(-1e4, 1e4))
def test_what_a_camera_can_measure_is_positive_or_nothing(settings, row):
    rig = settings["rig"]
    found = depth_accuracy.measure_ground_row(rig, row)
    assert found.depth_m > 0
    assert found.width_m > 0
    assert found.across_m > 0
    assert found.along_m > 0
    assert depth_accuracy.depth_error_m(1.0, rig, 0.1) > 0
    assert depth_accuracy.shared_width_px(rig, 1.0) <= rig["width_px"] + 1e-9
    assert depth_accuracy.ground_rounding_px(rig, 0.0) > 0
    assert all(text.endswith(".") for text in depth_accuracy.advise_on_rounding(rig, 0.0))


@pytest.mark.parametrize(("x_m", "step_m"), [(0.0, 1.2e-7), (1000.0, 6.1e-5), (5e4, 3.9e-3)])
def test_rounding_is_that_of_single_precision(x_m, step_m):
    """24 bits: 2^-23 of the power of two under the number."""
    rig = description.defaults().rig | {"x_m": x_m}
    assert depth_accuracy.coordinate_rounding_m(x_m, 0.0, 1.6) == pytest.approx(step_m, rel=0.03)
    assert depth_accuracy.ground_rounding_px(rig, 0.0) == pytest.approx(341.33 * step_m / 2 / 1.6, rel=0.03)
    assert bool(depth_accuracy.advise_on_rounding(rig, 0.0)) == (x_m == 5e4)


@given(topic("rig"))
def test_a_lens_is_refused_or_of_numbers(settings):
    rig = settings["rig"] | {"width_px": 12, "height_px": 8}
    camera = StereoCamera.from_settings(rig)
    if camera.rendered_px[0] > 100:
        return
    image = np.ones(camera.rendered_px[::-1])

    def taken():
        lens = make_lens(camera, rig, "left")
        return camera.cropped(image) if lens is None else lens.distort(image)

    seen = made(taken)
    if seen is not None:
        assert seen.shape == (8, 12)
        assert np.isfinite(seen).all()


@given(topic("rig"))
def test_a_motion_is_refused_or_a_pose(settings):
    blur = made(find_blur, settings)
    if blur is not None and blur.exposure_s is not None:
        pose = find_pose_after(blur, blur.exposure_s / 2)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.isfinite(pose).all()


@hypothesis(max_examples=60)
@given(topic("rocks", "most"), st.sampled_from([1e-4, 1.0, 400.0, 1e10]), st.integers(0, 500))
def test_rocks_keep_to_their_sizes_and_their_number(settings, area_m2, most):
    rocks = settings["rocks"]
    if rocks["coverage"] == 0.0:
        return
    law = made(make_size_law, rocks)
    if law is None:
        assert rocks["largest_m"] < rocks["smallest_m"]
        return
    diameter, smallest = draw_diameters(law, area_m2, most, np.random.default_rng(1))
    assert len(diameter) <= most
    assert np.isfinite(diameter).all()
    assert math.isfinite(smallest)
    if len(diameter):
        assert diameter.min() >= rocks["smallest_m"] * (1 - 1e-6)
        assert diameter.max() <= rocks["largest_m"] * (1 + 1e-6)


@hypothesis(max_examples=25)
@given(
    topic("terrain", "size_m", "resolution"),
    st.lists(st.tuples(st.floats(-5e4, 5e4), st.floats(-5e4, 5e4)), min_size=1, max_size=5),
)
def test_ground_has_a_height_everywhere(settings, places):
    ground = settings["terrain"]
    ground["inner_scale_m"] = min(ground["inner_scale_m"], ground["outer_scale_m"])
    x, y = np.array(places).T
    found = made(make_terrain, settings, 1)
    assert found is None or np.isfinite(found.heights(x, y)).all()


@given(st.floats(1e-3, 1e4), st.floats(1e-4, 100.0), st.floats(0.0, 1e6))
def test_the_nearer_eye_is_never_nearer_than_its_height(height_m, baseline_m, radius_m):
    at = GradingView(0.0, 0.0, height_m, baseline_m, 300.0)
    assert height_m <= at.nearest_m(radius_m) <= math.hypot(radius_m, height_m) * (1 + 1e-12)
