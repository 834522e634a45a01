"""Every preset with a law of reflection has numbers beside it that it was not fitted to."""

import numpy as np
import pytest
from icymoon.physics.surfaces import photometry
from icymoon.physics.surfaces.surface_law import make_law
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.support.version import ROOT
from icymoon.validation import moon_albedos
from icymoon.validation.comparison import FAILS, NOT_JUDGED, Bench


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return moon_albedos.COMPARISON.compare(Bench(tmp_path_factory.mktemp("bench")))


@pytest.mark.parametrize("preset", sorted(path.stem for path in (ROOT / "presets" / "surfaces").glob("hapke_*.toml")))
def test_every_preset_has_a_number_that_it_was_not_fitted_to(rows, preset):
    own = [row for row in rows if f"`{preset}`" in row.quantity]
    assert any(not row.fitted for row in own)
    assert all(row.source and row.allowed > 0 for row in own)
    assert all(row.why for row in own if row.verdict == FAILS)


def test_a_number_is_not_judged_only_if_publications_contradict_each_other_and_we_meet_one(rows):
    albedos = {
        (row.theirs, row.allowed): row for row in rows if row.quantity == "`hapke_enceladus_global`, geometric albedo"
    }
    # 1.375 ± 0.008 and 1.24 ± 0.01 are farther apart than 0.018; 1.41 ± 0.04 has 1.375 within its error.
    assert albedos[1.24, 0.01].verdict == NOT_JUDGED
    assert "1.375 ± 0.008" in albedos[1.24, 0.01].note
    assert not albedos[1.41, 0.04].unjudged
    other = moon_albedos.Measured("enceladus_global", "geometric", 1.24, 0.01, "")
    assert moon_albedos.find_contradicting_measurement(other, 1.375) is not None
    assert moon_albedos.find_contradicting_measurement(other, 1.5) is None  # ours meets neither: it is off


@pytest.mark.parametrize(("terrain", "share"), [("ridges", 0.25), ("bands", 0.5)])
def test_mixtures_state_what_they_were_fitted_to_and_a_disc_of_them(rows, terrain, share):
    fitted, _, disc = (row for row in rows if row.quantity.startswith(f"`hapke_europa_{terrain}`"))
    assert fitted.fitted
    assert "no measurement" in fitted.source
    plains, dark, mixed = (
        moon_albedos.read_preset_photometric_law(f"surfaces/hapke_europa_{name}")
        for name in ("bright_plains", "dark_lineae", terrain)
    )
    ends = [moon_albedos.compute_radiance_factor_at_5_deg(law) for law in (plains, dark)]
    assert fitted.theirs == pytest.approx(ends[0] + share * (ends[1] - ends[0]))
    # The disc is between its two terrains, three tenths of the way.
    bond = [photometry.bond_albedo(law) for law in (plains, mixed)]
    assert (disc.ours - bond[0]) / (bond[1] - bond[0]) == pytest.approx(0.3)
    assert not disc.fitted


def test_brightness_of_europa_at_phases_that_the_page_states():
    law = moon_albedos.read_preset_photometric_law("surfaces/hapke_europa_global")
    found = photometry.disc_brightness(law, np.radians([0.2, 0.45, 1.0]))
    assert found == pytest.approx([0.67, 0.64, 0.62], abs=0.005)


def test_the_moons_curve_is_compared_beyond_its_surge(rows):
    curve = [row for row in rows if row.unit == "mag"]
    # Differences of Allen's polynomial, by hand: 0.78 + 0.00324 at 30°, 1.56 + 0.05184 at 60°.
    assert curve[0].theirs == pytest.approx(1.61184 - 0.78324)
    assert all(row.ours > 0 for row in curve)


def test_a_sharper_phase_function_takes_the_difference_to_the_moons_curve_away():
    settings = merged(
        defaults(), load_preset("surfaces/hapke_lunar_like"), check({"hapke": moon_albedos.SHARPER_LOBE}, "sharper")
    )
    law = make_law(settings.surface, settings.hapke)
    assert photometry.geometric_albedo(law) == pytest.approx(0.12, abs=0.0005)
    phases = np.array([30.0, 60.0, 90.0, 120.0])
    ours = -2.5 * np.log10(photometry.disc_brightness(law, np.radians(phases)))
    apart = ours - (0.026 * phases + 4e-9 * phases**4)
    assert apart - apart[0] == pytest.approx(0.0, abs=0.04)


def test_reflectance_at_five_of_lamberts_law_is_its_albedo_by_the_cosine():
    # I/F is pi times the radiance of ground under a Sun of irradiance 1 that faces it.
    assert moon_albedos.compute_radiance_factor_at_5_deg(photometry.lunar_lambert(0.5, 0.0)) == pytest.approx(0.5)
