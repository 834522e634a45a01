"""Developing and exposing again: one exposure for both eyes, light that adds up, files that say how."""

import json

import cv2
import numpy as np
import pairs
import pytest
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.cli import main
from icymoon.stereo.images.develop import average_bands, develop, scale_radiance, to_8_bit
from icymoon.stereo.images.exr import read_light, read_view
from icymoon.stereo.images.exr_passes import keep_passes
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

QUIET = {"shot_noise": False, "read_noise_e": 0.0, "dark_current_e_s": 0.0}


def developed(folder, light=None, **sensor):
    pair = read_pair(folder)
    left, right = (read_view(pair.image(eye)) for eye in ("left", "right"))
    return develop(pair, left, right, merged(pair.settings, {"sensor": sensor, "light": light or {}}))


def test_development_is_repeatable_shares_one_exposure_and_keeps_the_scene(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair")
    one, two = developed(folder), developed(folder)
    np.testing.assert_array_equal(one.left, two.left)
    np.testing.assert_array_equal(one.right, two.right)
    assert not np.array_equal(one.left, developed(folder, noise_seed=1).left)
    light = average_bands(read_view(folder / "right.exr").radiance)
    quiet = developed(folder, **QUIET)
    expected = np.clip(light / quiet.saturation_radiance, 0, 1) * 255
    assert np.abs(quiet.right - expected).max() <= 0.5001
    assert np.quantile(quiet.left, 0.99) == pytest.approx(0.8 * 255, abs=1)


def test_exposure_time_is_that_of_the_photons(tmp_path):
    """By hand: what 1 W/(m² sr) of sunlight frees in a pixel of the paper's lens, and how long it takes to fill."""
    folder = pairs.write_pair(tmp_path / "pair")
    settings = read_pair(folder).settings
    pitch = settings.rig.sensor_width_mm * 1e-3 / settings.rig.width_px
    images = developed(folder, f_number=16.0, **QUIET)
    wide = developed(folder, f_number=8.0, **QUIET)
    assert images.exposure_s / wide.exposure_s == pytest.approx((1 + 4 * 256) / (1 + 4 * 64), rel=1e-6)
    # 24 % of a black body of 5772 K lies in 500 to 700 nm, in photons of about 600 nm: within 1 %.
    irradiance = np.pi * 0.9 / (1 + 4 * 64) * pitch**2
    assert wide.electron_rate == pytest.approx(0.5 * irradiance * 0.24 * 600e-9 / 1.98645e-25, rel=0.01)
    assert wide.saturation_radiance == pytest.approx(20000 / (wide.electron_rate * wide.exposure_s))


def test_the_eyes_have_noise_and_particles_of_their_own(tmp_path):
    flat = pairs.Scene(contrast=0.0, rock=False)
    folder = pairs.write_pair(tmp_path / "pair", flat)
    for changes in (
        {},
        {"read_noise_e": 0.0, "shot_noise": False, "prnu": 0.02},
        {"read_noise_e": 0.0, "shot_noise": False, "radiation_flux_cm2_s": 1e6},
    ):
        images = developed(folder, bits=12, **changes)
        assert images.left.std() > 10
        assert abs(np.corrcoef(images.left.ravel(), images.right.ravel())[0, 1]) < 5 / np.sqrt(images.left.size)


def test_overexposure_is_reported(tmp_path):
    images = developed(pairs.write_pair(tmp_path / "pair"), auto_exposure=False, exposure_s=0.1)
    assert images.saturated > 0.4  # read noise lifts and lowers what a full well gives
    assert images.left.min() > 240


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_matchers_get_8_bits_of_the_whole_range(tmp_path, bits):
    folder = pairs.write_pair(tmp_path / "pair")
    left, right = developed(folder, bits=bits).for_matchers()
    assert left.dtype == right.dtype == np.uint8
    assert 190 < np.quantile(left, 0.99) < 210
    top = 2**bits - 1
    for encoding in ("LINEAR", "SQUARE_ROOT"):
        assert to_8_bit(np.array([0, top], np.uint16), bits, encoding).tolist() == [0, 255]
    root, _ = developed(folder, bits=bits, encoding="SQUARE_ROOT").for_matchers()
    assert np.quantile(root, 0.99) == pytest.approx(255 * np.sqrt(0.8), abs=3)


def test_brackets_are_one_image_of_16_bits(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair")
    images = developed(folder, brackets=3, bracket_stops=2.0, bits=10, **QUIET)
    assert [frame.seconds / images.exposure_s for frame in images.frames] == [4.0, 1.0, 0.25]
    assert images.bits == 16
    light = average_bands(read_view(folder / "left.exr").radiance)
    np.testing.assert_allclose(images.left / 65535, light / images.saturation_radiance, atol=1e-3)
    assert images.frames[0].left.mean() > 2 * images.frames[2].left.mean()


def test_sun_and_planet_can_be_scaled_after_rendering(tmp_path):
    folder = pairs.write_pair(tmp_path / "pair", planet_share=0.25)
    pair, view = read_pair(folder), read_light(folder / "left.exr")
    np.testing.assert_allclose(sum(view.groups.values()), view.radiance, rtol=1e-5)
    night = scale_radiance(view, pair, merged(pair.settings, {"light": {"sun_scale": 0.0, "planet_scale": 2.0}}))
    np.testing.assert_allclose(night, 0.5 * view.radiance, rtol=1e-5)
    assert scale_radiance(view, pair, pair.settings) is view.radiance
    dim = developed(folder, light={"sun_scale": 0.5, "planet_scale": 0.5}, **QUIET)
    assert dim.exposure_s == pytest.approx(2 * developed(folder, **QUIET).exposure_s, rel=1e-4)
    alone = read_light(pairs.write_pair(tmp_path / "alone") / "left.exr")
    bright = merged(pair.settings, {"light": {"sun_scale": 3.0}})
    np.testing.assert_allclose(scale_radiance(alone, pair, bright), 3 * alone.radiance, rtol=1e-6)


def test_scaling_the_lights_of_a_denoised_pair_is_refused(tmp_path):
    settings = defaults()
    settings.quality.denoiser = "OIDN"
    folder = pairs.write_pair(tmp_path / "pair", planet_share=0.25, settings=settings)
    developed(folder)
    with pytest.raises(IcyMoonError, match=r"denoised.*quality\.denoiser.*planet_scale"):
        developed(folder, light={"planet_scale": 0.0})


@pytest.mark.parametrize("layout", ["4.x", "4.x view", "5.x"])
def test_the_light_alone_is_the_light_of_the_whole(tmp_path, layout):
    path = pairs.write_pair(tmp_path / "pair", layout=layout, planet_share=0.1) / "right.exr"
    light, view = read_light(path, "right"), read_view(path, "right")
    np.testing.assert_array_equal(light.radiance, view.radiance)
    assert set(light.groups) == set(view.groups) == {"Sun", "Planet"}
    np.testing.assert_array_equal(light.groups["Planet"], view.groups["Planet"])
    plain = read_light(path, "right", groups=False)
    np.testing.assert_array_equal(plain.radiance, view.radiance)
    assert plain.groups == {}


def test_a_file_of_parts_is_cut_down_to_the_layer(tmp_path):
    content = (pairs.write_pair(tmp_path / "pair") / "left.exr").read_bytes()
    assert len(keep_passes(content, ["Beauty.Combined"])) < 0.9 * len(content)
    assert keep_passes(content, ["Nothing"]) == content


def test_a_data_set_is_exposed_again_from_the_command_line(tmp_path, capsys):
    for name in ("aaa", "bbb"):
        pairs.write_pair(tmp_path / "set" / "pairs" / name)
    out = tmp_path / "out"
    assert (
        main(
            [
                "develop",
                str(tmp_path / "set"),
                "--out",
                str(out),
                "--set",
                "sensor.brackets=2",
                "--set",
                "sensor.bits=12",
            ]
        )
        == 0
    )
    assert capsys.readouterr().out.strip() == str(out)
    assert sorted(p.name for p in (out / "aaa").iterdir()) == [
        "images.json",
        "left.png",
        "left_0.png",
        "left_1.png",
        "right.png",
        "right_0.png",
        "right_1.png",
    ]
    assert main(["develop", str(tmp_path / "set"), "--out", str(out), "--preset", "sensors/default"]) == 0
    assert sorted(p.name for p in (out / "aaa").iterdir()) == ["images.json", "left.png", "right.png"]
    said = json.loads((out / "bbb" / "images.json").read_text())
    image = cv2.imread(str(out / "bbb" / "left.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(image, developed(tmp_path / "set" / "pairs" / "bbb").left)
    assert image.dtype == np.uint8
    assert (said["pair"], said["image_bits"], said["settings"]["sensor"]["bits"]) == (pairs.id_of("bbb"), 8, 8)
    assert said["camera"]["focal_baseline_px_m"] == pytest.approx(pairs.camera().focal_baseline_px_m)


def test_deposits_are_a_mask_that_is_stated_and_the_depth_stays(tmp_path):
    folder, out = pairs.write_pair(tmp_path / "set" / "pairs" / "aaa"), tmp_path / "out"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    truth = read_view(folder / "left.exr").depth
    assert (
        main(
            [
                "develop",
                str(folder),
                "--out",
                str(out),
                "--set",
                "sensor.deposit_share=0.3",
                "--set",
                "sensor.deposit_mm=1.5",
                "--set",
                "sensor.deposit_scatter=0.0",
            ]
        )
        == 0
    )
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before  # the truth among them
    np.testing.assert_array_equal(read_view(folder / "left.exr").depth, truth)
    said = json.loads((out / "aaa" / "images.json").read_text())
    images = developed(folder, deposit_share=0.3, deposit_mm=1.5, deposit_scatter=0.0, **QUIET)
    for eye in ("left", "right"):
        mask = cv2.imread(str(out / "aaa" / f"{eye}_deposits.png"), cv2.IMREAD_UNCHANGED)
        assert mask.dtype == np.uint8
        assert said["blocked_share"][eye] == pytest.approx(mask.mean() / 255)
        # What the mask says is lost is what the image lacks: to one step of the converter and one of the mask.
        light = average_bands(read_view(folder / f"{eye}.exr").radiance)
        left_over = light * (1.0 - mask / 255.0) / images.saturation_radiance * 255
        assert np.abs(getattr(images, eye) - np.clip(left_over, 0, 255)).max() <= 1.01
        assert np.ptp(mask) > 20
    assert main(["develop", str(folder), "--out", str(out)]) == 0
    assert sorted(path.name for path in (out / "aaa").iterdir()) == ["images.json", "left.png", "right.png"]
    assert "blocked_share" not in json.loads((out / "aaa" / "images.json").read_text())


def test_a_setting_that_needs_a_render_is_refused_and_a_broken_pair_is_named(tmp_path, capsys):
    folder = pairs.write_pair(tmp_path / "set" / "pairs" / "aaa")
    assert main(["develop", str(folder), "--out", str(tmp_path / "out"), "--set", "light.sun_elevation_deg=3"]) == 1
    assert "light.sun_elevation_deg needs a new render" in capsys.readouterr().err
    assert main(["develop", str(folder), "--out", str(tmp_path / "out"), "--preset", "rigs/guiss"]) == 1
    assert "needs a new render" in capsys.readouterr().err
    pairs.write_pair(tmp_path / "set" / "pairs" / "bbb")
    (folder / "left.exr").write_bytes(b"x")
    assert main(["develop", str(tmp_path / "set"), "--out", str(tmp_path / "out"), "--json-lines"]) == 1
    said = capsys.readouterr()
    assert "aaa" in said.err
    assert (tmp_path / "out" / "bbb" / "images.json").is_file()
