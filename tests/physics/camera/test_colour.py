"""A colour sensor against laws: what filters see of sunlight, the mosaic, and demosaicing."""

from typing import Any

import numpy as np
import pytest
from icymoon.physics.camera.colour import (
    LINEAR,
    apply_mosaic,
    compute_channel_rates,
    compute_white_gains,
    compute_white_rates,
    demosaic,
    filter_efficiency,
    find_channel,
    mix_to_grey,
)
from icymoon.physics.light.photons import electron_rate, photons_by_wavelength, photons_per_joule
from icymoon.physics.light.sunlight import sun_colour
from icymoon.settings.description import defaults
from icymoon.settings.preset_files import load_preset
from icymoon.settings.topics.camera import SensorSettings
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

LIGHT = defaults().light
PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
PITCH_M = 7.4e-6
#: Filters that all pass all, as the glass of a monochrome sensor of efficiency 0.5.
GLASS = {f"{name}_efficiency": 0.0 for name in ("red", "green", "blue")} | {"filter_leak": 0.5}


def sensor(**changes: Any) -> SensorSettings:
    return defaults().sensor | {"colour": "BAYER"} | changes


def test_photons_of_all_wavelengths_are_those_of_the_band():
    for band in ("BOLOMETRIC", "CAMERA"):
        light = LIGHT | {"irradiance_band": band}
        assert photons_by_wavelength(light, sensor())[1].sum() == pytest.approx(photons_per_joule(light, sensor()))


@pytest.mark.parametrize("kelvin", [3500.0, 5772.0, 9000.0])
def test_filters_of_glass_see_white_ground_as_a_monochrome_sensor_does(kelvin):
    light = LIGHT | {"sun_temperature_k": kelvin}
    glass = sensor(**GLASS, quantum_efficiency=0.5, cut_on_nm=500.0, cut_off_nm=700.0)
    rates = compute_channel_rates(light, glass, PITCH_M)
    one = electron_rate(light, glass | {"colour": "MONO"}, PITCH_M)
    # Grey of radiance L in sunlight has the bands L times the colour of the Sun, whose mean is 1.
    assert compute_white_rates(light, rates) == pytest.approx([one] * 3, rel=1e-9)
    assert compute_white_gains(compute_white_rates(light, rates), glass) == pytest.approx([1.0] * 3)


def test_a_narrow_filter_sees_its_own_band_only():
    narrow = sensor(
        red_centre_nm=620.0,
        green_centre_nm=550.0,
        blue_centre_nm=460.0,
        filter_leak=0.0,
        **{f"{name}_half_width_nm": 8.0 for name in ("red", "green", "blue")},
    )
    rates = compute_channel_rates(LIGHT, narrow, PITCH_M)
    assert (np.diag(rates) > 0.9 * rates.sum(axis=1)).all()


def test_white_balance_makes_white_ground_grey_under_any_sun():
    for kelvin in (4000.0, 5772.0, 7500.0):
        light = LIGHT | {"sun_temperature_k": kelvin}
        rates = compute_channel_rates(light, sensor(), PITCH_M)
        gains = compute_white_gains(compute_white_rates(light, rates), sensor())
        seen = rates @ sun_colour(kelvin) * gains
        assert seen == pytest.approx([seen.max()] * 3)
        assert gains.min() == pytest.approx(1.0)
    assert compute_white_gains(compute_white_rates(LIGHT, rates), sensor(white_balance="NONE")).tolist() == [1, 1, 1]


def test_mastcam_z_sees_white_ground_on_mars_as_calibrated():
    """Hayes et al. 2021, Table 2: a 10 ms exposure of white ground facing the Sun at 1.38 au, left eye, above bias."""
    preset = defaults().sensor | load_preset("sensors/mastcam_z").sensor
    radiance = 1361.0 / 1.38**2 / np.pi
    white = compute_white_rates(LIGHT, compute_channel_rates(LIGHT, preset, PITCH_M))
    # 15.6 e- per number. A black body instead of the solar spectrum is some per cent off in such bands.
    assert white * radiance * 0.01 / 15.6 == pytest.approx([6185, 7212, 6834], rel=0.03)
    wavelength, photons = photons_by_wavelength(LIGHT, preset)
    seen = filter_efficiency(preset, wavelength) * photons
    assert (seen @ wavelength) / seen.sum(axis=1) * 1e9 == pytest.approx([630, 544, 480], abs=3)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_mosaics_have_two_greens_among_four_pixels(pattern):
    assert sorted(find_channel(pattern, *at) for at in np.ndindex(2, 2)) == [0, 1, 1, 2]
    planes = np.stack([np.full((5, 7), value) for value in (1.0, 2.0, 3.0)])
    seen = apply_mosaic(planes, pattern)
    assert "".join("RGB"[int(seen[at]) - 1] for at in np.ndindex(2, 2)) == pattern
    assert (seen[2:4, 2:4] == seen[:2, :2]).all()


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("method", LINEAR)
def test_demosaicing_returns_flat_colours_everywhere(pattern, method):
    flat = apply_mosaic(np.stack([np.full((9, 8), value) for value in (10.0, 20.0, 30.0)]), pattern)
    # A mirror at the outermost pixels keeps the pattern, so even the border is exact.
    np.testing.assert_allclose(demosaic(flat, pattern, method), np.broadcast_to([10.0, 20.0, 30.0], (9, 8, 3)))


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("method", LINEAR)
def test_demosaicing_returns_ramps_inside(pattern, method):
    y, x = np.mgrid[:11, :13].astype(float)
    planes = np.stack([3 + 2 * x - y, 40 - x + 0.5 * y, 7 + 0.25 * x + 3 * y])
    found = demosaic(apply_mosaic(planes, pattern), pattern, method)
    np.testing.assert_allclose(found[2:-2, 2:-2], planes.transpose(1, 2, 0)[2:-2, 2:-2], atol=1e-9)


def test_malvar_finds_grey_detail_that_means_blur():
    y, x = np.mgrid[:64, :64]
    waves = 2000 + 800 * np.sin(2 * np.pi * (0.15 * x + 0.08 * y))
    error = {method: (demosaic(waves, "RGGB", method) - waves[..., None])[4:-4, 4:-4].std() for method in LINEAR}
    assert error["MALVAR"] < 0.5 * error["BILINEAR"]


def test_filters_without_wavelengths_are_refused():
    with pytest.raises(IcyMoonError, match="cut_on_nm"):
        compute_channel_rates(LIGHT, sensor(cut_on_nm=700.0, cut_off_nm=400.0), PITCH_M)


def test_the_grey_of_grey_is_itself():
    for grey in ("LUMINANCE", "MEAN"):
        assert mix_to_grey(np.full((2, 3, 3), 7.0), sensor(grey=grey)) == pytest.approx(np.full((2, 3), 7.0))
