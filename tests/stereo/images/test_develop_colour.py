"""Developing a pair by a colour sensor: the same light, its noise, its mosaic, and what is written of it."""

import json

import cv2
import numpy as np
import pairs
import pytest
from icymoon.physics.camera.colour import apply_mosaic
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import DevelopedImages, develop
from icymoon.stereo.images.exr import Light
from icymoon.stereo.pair_views import read_pair_views

pytestmark = pytest.mark.filterwarnings("error")

QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0}
#: Filters that all pass what a monochrome sensor of efficiency 0.5 detects, 500 to 700 nm.
GLASS = {f"{name}_efficiency": 0.0 for name in ("red", "green", "blue")} | {"filter_leak": 0.5, "cut_on_nm": 500.0}


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return read_pair(pairs.write_pair(tmp_path_factory.mktemp("colour") / "pair"))


def developed(pair, radiance, **sensor) -> DevelopedImages:
    light = Light(np.asarray(radiance, np.float32), {})
    return develop(pair, light, light, merged(pair.settings, {"sensor": {"colour": "BAYER"} | sensor}))


def even(pair, *bands):
    return np.broadcast_to(np.array(bands), (pair.camera.height_px, pair.camera.width_px, 3))


def ground(pair):
    y, x = np.mgrid[: pair.camera.height_px, : pair.camera.width_px]
    return (1.2 + np.sin(0.3 * x + 0.1 * y) * np.cos(0.2 * y))[..., None] * np.ones(3)


def test_the_mosaic_of_a_flat_white_field_is_flat_after_white_balance(pair):
    images = developed(pair, even(pair, 1.0, 1.0, 1.0), bits=12, **QUIET)
    assert np.ptp(images.colour_left) <= 2  # numbers of 4095: half a number of the mosaic times the gains
    assert len(np.unique(images.detected_left)) == 3
    assert images.left.mean() == pytest.approx(0.8 * 4095, abs=1.5)
    unbalanced = developed(pair, even(pair, 1.0, 1.0, 1.0), bits=12, white_balance="NONE", **QUIET)
    assert np.ptp(unbalanced.colour_left, axis=-1).min() > 400


def test_grey_ground_behind_equal_filters_is_what_a_monochrome_sensor_sees(pair):
    light = ground(pair)
    mono = developed(pair, light, colour="MONO", bits=12, **QUIET)
    colour = developed(pair, light, bits=12, **GLASS, **QUIET)
    assert colour.exposure_s == pytest.approx(mono.exposure_s, rel=1e-6)
    assert np.abs(colour.detected_left.astype(int) - mono.left).max() <= 1
    # Smooth light: what demosaicing adds is small.
    assert np.abs(colour.left.astype(int) - mono.left)[4:-4, 4:-4].max() < 0.02 * 4095
    flat = even(pair, 0.7, 0.7, 0.7)
    equal = developed(pair, flat, bits=12, **GLASS, **QUIET), developed(pair, flat, colour="MONO", bits=12, **QUIET)
    np.testing.assert_array_equal(equal[0].left, equal[1].left)


def test_photon_transfer_gives_the_gain_of_each_channel_back(pair):
    """The variance of shot noise over its mean is the system gain K, whatever the filter passes."""
    settings = {"bits": 14, "read_noise_e": 0.0, "dark_current_e_s": 0.0, "black_level": 0.01}
    one, two = (developed(pair, even(pair, 1.0, 1.0, 1.0), noise_seed=seed, **settings) for seed in (1, 2))
    black = 0.01 * (2**14 - 1)
    means = []
    for row, column in np.ndindex(2, 2):
        a, b = (image.detected_left[row::2, column::2].astype(float) for image in (one, two))
        mean = a.mean() - black
        means.append(mean)
        # Half the variance of the difference, less that of rounding; 9216 pixels: 1.5 % at one deviation.
        assert ((a - b).var() / 2 - 1 / 12) / mean == pytest.approx(one.gain_dn_per_e, rel=0.07)
    red, green, also_green, blue = means
    assert green == pytest.approx(also_green, rel=0.01)
    assert one.white_gains == pytest.approx([max(means) / mean for mean in (red, green, blue)], rel=0.01)


def test_brown_ground_is_brown_and_blue_ice_is_blue(pair):
    brown = developed(pair, even(pair, 0.25, 0.17, 0.1), **QUIET).colour_left.mean(axis=(0, 1))
    assert brown[0] > 1.2 * brown[1] > 1.2 * brown[2]
    blue = developed(pair, even(pair, 0.6, 0.8, 0.9), **QUIET).colour_left.mean(axis=(0, 1))
    assert blue[0] < blue[1] < blue[2]


def test_a_monochrome_camera_by_its_band_sees_brown_ground_brighter_in_the_red(pair):
    brown = even(pair, 0.25, 0.17, 0.1)
    fixed = {"colour": "MONO", "auto_exposure": False, "exposure_s": 1e-5, "bits": 16, **QUIET}
    grey = developed(pair, even(pair, *[0.52 / 3] * 3), band_weights="BAND", **fixed).left.mean()
    assert developed(pair, brown, band_weights="EQUAL", **fixed).left.mean() == pytest.approx(grey, rel=1e-3)
    assert developed(pair, brown, band_weights="BAND", **fixed).left.mean() > 1.15 * grey


def test_merged_exposures_keep_colours(pair):
    one, merged_ = (
        developed(pair, even(pair, 0.5, 0.4, 0.3), bits=12, black_level=black, brackets=count, **QUIET)
        for count, black in ((1, 0.02), (3, 0.02))
    )
    ratios = [(image.colour_left - black).mean(axis=(0, 1)) for image, black in ((one, 0.02 * 4095), (merged_, 0.0))]
    assert ratios[0] / ratios[0][0] == pytest.approx(ratios[1] / ratios[1][0], rel=0.01)


def test_bent_lenses_and_odd_sizes_have_colours(pair):
    light = Light(np.asarray(ground(pair), np.float32), {})
    images = develop(
        pair,
        light,
        light,
        merged(
            pair.settings, {"sensor": {"colour": "BAYER", "bayer_pattern": "GBRG"}, "rig": {"distortion_k1": -0.05}}
        ),
    )
    assert images.colour_left.shape == (*images.left.shape, 3)
    assert not np.array_equal(images.detected_left, images.left)
    odd = np.arange(3 * 7 * 5, dtype=float).reshape(3, 7, 5)
    assert apply_mosaic(odd, "BGGR").shape == (7, 5)


def test_no_light_and_filters_that_pass_nothing_are_dark(pair):
    assert not developed(pair, even(pair, 0.0, 0.0, 0.0), **QUIET).colour_left.any()
    opaque = developed(pair, even(pair, 1.0, 1.0, 1.0), **GLASS | {"filter_leak": 0.0}, **QUIET)
    assert not opaque.colour_left.any()
    assert np.isfinite(opaque.white_gains).all()


@pytest.mark.parametrize("half_width_nm", [1.0, 9.1669, 20.0])
def test_a_filter_that_passes_next_to_nothing_has_no_white_balance_and_that_is_said(pair, half_width_nm):
    far = {"blue_centre_nm": 100.0, "blue_half_width_nm": half_width_nm, "filter_leak": 0.0}
    images = developed(pair, even(pair, 1.0, 1.0, 1.0), **far, **QUIET)
    assert images.white_gains == (1.0, 1.0, 1.0)
    assert any("no white balance" in warning for warning in images.warnings)
    assert not any(
        "white balance" in warning
        for warning in developed(pair, even(pair, 1.0, 1.0, 1.0), **far, **QUIET, white_balance="NONE").warnings
    )


def test_defects_of_a_render_stay_where_they_are(pair):
    light = np.array(even(pair, 0.5, 0.5, 0.5), np.float32)
    light[40, 40], light[80, 80] = np.nan, np.inf
    images = developed(pair, light, psf_sigma_px=0.0, **QUIET)
    assert np.ptp(images.colour_left[50:70, 50:70]) <= 1
    assert images.colour_left[80, 80].max() == 255


def test_develop_and_exports_write_colour(tmp_path, pair):
    colour = ["--set", "sensor.colour=BAYER", "--set", "sensor.noise_seed=3"]
    assert main(["develop", str(pair.folder), "--out", str(tmp_path / "images"), *colour]) == 0
    folder = tmp_path / "images" / pair.folder.name
    left, raw = (cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED) for name in ("left", "left_mosaic"))
    assert left.shape == (*raw.shape, 3)
    facts = json.loads((folder / "images.json").read_text())
    assert min(facts["white_gains"]) == 1
    assert facts["settings"]["sensor"]["bayer_pattern"] == "RGGB"
    for layout, name in (
        ("png8", f"{pair.folder.name}/left.png"),
        ("png16", f"{pair.folder.name}/left.png"),
        ("kitti", "training/image_2/000000_10.png"),
        ("middlebury", f"{pair.folder.name}/im0.png"),
    ):
        assert main(["export", str(pair.folder), "--format", layout, "--out", str(tmp_path / layout), *colour]) == 0
        image = cv2.imread(str(tmp_path / layout / name), cv2.IMREAD_UNCHANGED)
        assert image.shape == left.shape, layout
        if image.dtype == np.uint8:
            np.testing.assert_array_equal(image, left)
    assert main(["export", str(pair.folder), "--format", "raw", "--out", str(tmp_path / "raw"), *colour]) == 0
    np.testing.assert_array_equal(
        cv2.imread(str(tmp_path / "raw" / pair.folder.name / "left.png"), cv2.IMREAD_UNCHANGED), raw
    )
    # A monochrome development in the same folder leaves no mosaic behind.
    assert main(["develop", str(pair.folder), "--out", str(tmp_path / "images")]) == 0
    assert not (folder / "left_mosaic.png").exists()


def test_the_viewer_shows_colour_and_matchers_get_grey(pair):
    views = read_pair_views(pair.folder, {"sensor": {"colour": "BAYER", "white_balance": "NONE"}})
    (shown,) = views.pictures("LEFT")
    assert np.ptp(shown, axis=-1).max() > 20
    assert views.left.ndim == 2
    for view in ("SIDE_BY_SIDE", "RIGHT", "FLICKER", "ANAGLYPH", "DEPTH"):
        assert all(picture.shape[-1] == 3 for picture in views.pictures(view))
    edges = read_pair_views(pair.folder, {"sensor": {"colour": "BAYER", "demosaicing": "EDGE_AWARE"}})
    assert "edge-aware" in edges.warnings[0]


def test_the_default_camera_is_monochrome():
    assert defaults().sensor.colour == "MONO"
