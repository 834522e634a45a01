"""Hapke's model against 50-digit values, other programs, laws and limits; albedos against closed forms."""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from hapke_table import angles, parameters, rows
from hypothesis import given, settings
from hypothesis import strategies as st
from icymoon.physics.surfaces import hapke, photometry, surface_law
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.settings import description, preset_files
from icymoon.support.errors import IcyMoonError

EUROPA: dict[str, Any] = {
    "w": 0.964,
    "b": 0.429,
    "c": 0.113,
    "b_s0": 0.5,
    "h_s": 0.0016,
    "theta_bar": math.radians(10.0),
}
HALF_PI = math.pi / 2


def law(**changes) -> photometry.Law:
    return partial(bidirectional_reflectance, parameters=HapkeParameters(**changes))


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row['tag']}-{row['i_deg']}-{row['e_deg']}-{row['H']}")
def test_every_row_of_the_truth_table(row):
    r = float(bidirectional_reflectance(*angles(row), parameters(row)))
    interior = max(float(row["i_deg"]), float(row["e_deg"])) < 89.95
    # One ulp of an angle next to 90 degrees is 1e-10 of its cosine at 89.9999 degrees.
    assert r == pytest.approx(float(row["r"]), rel=1e-12 if interior else 1e-9)


@pytest.mark.parametrize("column", ["isis_pi_r", "mitsuba_r"])
def test_the_other_programs_agree(column):
    shared = [row for row in rows() if row[column]]
    assert len(shared) > 50
    ours = np.array([float(bidirectional_reflectance(*angles(row), parameters(row))) for row in shared])
    theirs = np.array([float(row[column]) for row in shared]) / (math.pi if column == "isis_pi_r" else 1.0)
    # They lose half of the digits where g is 0: g is then 2e-8, 6e-6 of the width 0.0016 of the surge there.
    assert np.allclose(ours, theirs, rtol=1e-5, atol=1e-12)
    assert np.median(np.abs(ours / np.where(theirs == 0, 1, theirs) - 1)) < 1e-14


def test_arrays_broadcast_and_give_what_single_angles_give():
    i, e, psi = (
        np.radians(values) for values in ([[[0.0]], [[40.0]], [[80.0]]], [[0.0], [70.0]], [0.0, 90.0, 180.0, 270.0])
    )
    together = bidirectional_reflectance(i, e, psi, HapkeParameters(**EUROPA))
    assert together.shape == (3, 2, 4)
    assert together[2, 1, 1] == bidirectional_reflectance(i[2, 0, 0], e[1, 0], psi[1], HapkeParameters(**EUROPA))
    assert together[..., 3] == pytest.approx(together[..., 1], rel=1e-12)  # the plane of incidence is a mirror
    textured = bidirectional_reflectance(0.5, 0.6, 0.7, HapkeParameters(**EUROPA | {"w": np.array([0.2, 0.964])}))
    assert textured[1] == bidirectional_reflectance(0.5, 0.6, 0.7, HapkeParameters(**EUROPA))
    assert textured[0] < textured[1]


PARAMETERS = st.fixed_dictionaries(
    {
        "w": st.floats(0.0, 1.0),
        "b": st.floats(-0.99, 0.99),
        "c": st.floats(-1.0, 1.0),
        "b_s0": st.floats(0.0, 3.0),
        "h_s": st.floats(0.0, 10.0),
        "b_c0": st.floats(0.0, 1.0),
        "h_c": st.floats(0.0, 10.0),
        "theta_bar": st.floats(0.0, math.radians(60.0)),
        "filling_factor": st.floats(0.0, 0.752),
        "h_function": st.sampled_from(hapke.H_FUNCTIONS),
    }
)
ANGLE, AZIMUTH = st.floats(0.0, HALF_PI), st.floats(-7.0, 7.0)


@given(PARAMETERS, ANGLE, ANGLE, AZIMUTH)
@settings(deadline=None, max_examples=300)
def test_finite_and_never_negative(described, i, e, psi):
    with np.errstate(all="raise", under="ignore"):
        r = float(bidirectional_reflectance(i, e, psi, HapkeParameters(**described)))
    assert math.isfinite(r)
    assert r >= 0.0


@given(PARAMETERS, st.floats(0.0, 1.55), st.floats(0.0, 1.55), AZIMUTH)
@settings(deadline=None, max_examples=300)
def test_reciprocal(described, i, e, psi):
    there, back = (hapke.brdf(*way, psi, HapkeParameters(**described)) for way in ((i, e), (e, i)))
    # Terms up to (1/(1-b))^2 cancel in p; 1e-10 leaves six digits to a real asymmetry.
    assert float(there) == pytest.approx(float(back), rel=1e-10, abs=1e-300)


def test_no_corner_of_angles_and_parameters_breaks():
    edge = [
        0.0,
        1e-12,
        1e-6,
        0.3,
        HALF_PI / 2,
        HALF_PI - 1e-6,
        np.nextafter(HALF_PI, 0),
        HALF_PI,
        HALF_PI + 0.1,
        math.pi,
    ]
    around = [0.0, 1e-12, 1.0, HALF_PI, np.nextafter(math.pi, 0), math.pi, -math.pi]
    i, e, psi = np.meshgrid(edge, edge, around, indexing="ij")
    lit = (i < HALF_PI) & (e <= HALF_PI)
    for w, b, theta, h, f in itertools.product(
        (0.0, 1e-12, 0.9, 1.0),
        (-0.99, 0.0, 0.99),
        (0.0, 1e-300, 1e-9, 1e-3, math.radians(60)),
        (0.0, 1e-300, 1e-8, 1.0, 1e300),
        (0.0, 0.752),
    ):
        for kind in hapke.H_FUNCTIONS:
            with np.errstate(all="raise", under="ignore"):
                r = bidirectional_reflectance(i, e, psi, HapkeParameters(w, b, 0.5, 1.0, h, 1.0, h, theta, f, kind))
            assert np.isfinite(r).all()
            assert (r >= 0).all()
            assert (r[~lit] == 0).all()
            assert w == 0.0 or (r[lit] > 0).all()


@pytest.mark.parametrize("kind", hapke.H_FUNCTIONS)
def test_dark_grains_are_lommel_and_seeligers_law(kind):
    i, e = np.radians([[0.0], [30.0], [85.0]]), np.radians([0.0, 45.0, 89.0])
    w = 1e-9  # multiple scattering is of the order of w
    r = bidirectional_reflectance(i, e, 1.0, HapkeParameters(w, h_function=kind))
    assert r == pytest.approx(w / (4 * math.pi) * np.cos(i) / (np.cos(i) + np.cos(e)), rel=1e-8)


@pytest.mark.parametrize(("kind", "error"), [("1981", 0.014), ("1993", 0.014), ("2002", 0.014)])
def test_white_isotropic_grains_return_all_light(kind, error):
    """Chandrasekhar's exact H gives a Bond albedo of 1 at w = 1; the approximations of H keep it within 1.4 %."""
    assert photometry.bond_albedo(law(w=1.0, h_function=kind)) == pytest.approx(1.0, abs=error)


def test_hapkes_closed_forms_of_the_albedos():
    """Hapke 2012, chapter 11: the spherical albedo, which he states to some per cent, and the hemispherical one."""
    for w in (0.2, 0.6, 0.9):
        gamma = math.sqrt(1 - w)
        r0 = (1 - gamma) / (1 + gamma)
        assert photometry.bond_albedo(law(w=w, h_function="1981")) == pytest.approx(r0 * (1 - (1 - r0) / 6), rel=0.05)
        # 1 - γ H(µ0) is exact with the exact H; the 1993 form of H is 0.2 % off, which 1 - γ H magnifies where it is
        # small.
        i = np.radians([0.0, 40.0, 80.0])
        exact = 1 - gamma * hapke.h_function(np.cos(i), w, "1993")
        assert photometry.hemispherical_albedo(law(w=w, h_function="1993"), i) == pytest.approx(exact, abs=0.003)


def test_h_function_against_chandrasekhars_equation():
    """Exact H by iteration of 1/H = sqrt(1-w) + w/2 int x'H/(x+x') dx', and the known errors."""
    x, weight = np.polynomial.legendre.leggauss(200)
    x, weight = (x + 1) / 2, weight / 2
    for w, errors in ((0.5, (0.021, 0.0007, 0.0018)), (0.964, (0.042, 0.0013, 0.0095)), (1.0, (0.039, 0.0079, 0.0079))):
        exact = np.ones_like(x)
        for _ in range(20000):
            new = 1 / (math.sqrt(1 - w) + w / 2 * (weight * x * exact / (x[:, None] + x)).sum(axis=1))
            moved, exact = np.abs(new / exact - 1).max(), (exact + new) / 2
            if moved < 1e-10:
                break
        for kind, error in zip(hapke.H_FUNCTIONS, errors, strict=True):
            found = np.abs(hapke.h_function(x, w, kind) / exact - 1).max()
            assert error * 0.8 < found < error, (w, kind)


def test_the_phase_function_is_normalised():
    node, share = np.polynomial.legendre.leggauss(40)
    steps = np.linspace(0.0, math.pi, 101)  # a hundred parts: a lobe of b = 0.99 is 0.01 wide
    g = (steps[:-1, None] + (node + 1) / 2 * np.diff(steps)[:, None]).ravel()
    weight = (share / 2 * np.diff(steps)[:, None]).ravel()
    for b, c in ((0.0, 0.0), (0.429, 0.113), (0.7, -1.0), (-0.5, 0.3), (0.1, 2.86), (0.99, 1.0)):
        assert (hapke.phase_function(g, b, c) * np.sin(g)) @ weight / 2 == pytest.approx(1.0, rel=1e-9)
    back, forward = (hapke.phase_function(np.array([0.0, math.pi]), **hapke.single_lobe(xi)) for xi in (-0.3, 0.3))
    assert back == pytest.approx(forward[::-1])
    assert back[0] > back[1]


def test_opposition_effects_have_their_amplitude_and_width():
    smooth: dict[str, Any] = {"w": 0.3, "b": 0.2, "c": 1.0}
    angle = 0.6
    plain, hidden, coherent = (
        bidirectional_reflectance(angle, angle, 0.0, HapkeParameters(**smooth, **extra))
        for extra in (dict[str, Any](), {"b_s0": 0.7, "h_s": 0.01}, {"b_c0": 0.7, "h_c": 0.01})
    )
    single = 0.3 / (8 * math.pi) * hapke.phase_function(0.0, 0.2, 1.0)
    assert hidden - plain == pytest.approx(0.7 * single, rel=1e-9)
    assert coherent == pytest.approx(1.7 * plain, rel=1e-9)
    half = 2 * math.atan(0.01)
    assert hapke.shadow_hiding(math.tan(half / 2), 0.01) == pytest.approx(0.5)
    assert hapke.coherent_backscatter(0.01, 0.01) == pytest.approx((2 - math.exp(-1)) / 8)
    assert hapke.coherent_backscatter(0.0, 0.01) == 1.0


def test_roughness_vanishes_continuously():
    i, e, psi = np.meshgrid(np.radians([0, 20, 60, 85]), np.radians([0, 30, 70, 88]), np.radians([0, 90, 180]))
    smooth = bidirectional_reflectance(i, e, psi, HapkeParameters(0.9, 0.3, 0.4))
    for theta in (1e-300, 1e-9, 1e-5):
        rough = bidirectional_reflectance(i, e, psi, HapkeParameters(0.9, 0.3, 0.4, theta_bar=theta))
        # The first term of the series is of second order in θ̄, but for slopes that shadow: none does 1e-5.
        assert rough == pytest.approx(smooth, rel=1e-8)


def test_roughness_is_continuous_where_its_two_cases_meet():
    q = HapkeParameters(0.9, 0.3, 0.4, theta_bar=0.4)
    for angle, psi in itertools.product((0.2, 0.8, 1.4), (0.0, 1.0, math.pi)):
        left, right = (bidirectional_reflectance(angle, angle + side * 1e-9, psi, q) for side in (-1, 1))
        assert float(left) == pytest.approx(float(right), rel=1e-7)


def test_porosity_factor():
    assert hapke.porosity_factor(0.0) == 1.0
    assert hapke.porosity_factor(1e-9) == pytest.approx(1 + 1.209e-6 / 2, rel=1e-9)
    assert hapke.porosity_factor(0.3) == pytest.approx(-math.log(1 - 1.209 * 0.3 ** (2 / 3)) / (1.209 * 0.3 ** (2 / 3)))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"w": 1.01}, ("w is 1.01", "from 0 to 1")),
        ({"w": -0.1}, ("w is -0.1",)),
        ({"w": math.nan}, ("w", "finite")),
        ({"w": np.array([0.5, 1.5])}, ("0.5 to 1.5",)),
        ({"w": 0.5, "b": 1.0}, ("b is 1", "above -1 and below 1")),
        ({"w": 0.5, "b": 0.4, "c": 2.0}, ("c is 2", "negative")),
        ({"w": 0.5, "h_s": -1e-9}, ("h_s", "at least 0")),
        ({"w": 0.5, "b_c0": -1.0}, ("b_c0",)),
        ({"w": 0.5, "theta_bar": 1.6}, ("theta_bar is 1.6", "1.5708")),
        ({"w": 0.5, "filling_factor": 0.76}, ("filling_factor is 0.76", "0.7522")),
        ({"w": 0.5, "h_function": "2012"}, ("1981, 1993, 2002",)),
    ],
)
def test_parameters_outside_physics_are_refused_with_the_bound(wrong, words):
    with pytest.raises(IcyMoonError) as caught:
        HapkeParameters(**wrong)
    for word in words:
        assert word in str(caught.value)


def test_albedos_of_lamberts_law():
    white = photometry.lunar_lambert(1.0, 0.0)
    # The sphere's integral phase function of Lambert's law is known: [sin a + (π - a) cos a] / π.
    alpha = np.radians([0.0, 10.0, 90.0, 170.0])
    assert photometry.phase_curve(white, alpha) == pytest.approx(
        (np.sin(alpha) + (math.pi - alpha) * np.cos(alpha)) / math.pi, rel=1e-6
    )
    assert photometry.geometric_albedo(white) == pytest.approx(2 / 3, rel=1e-9)
    assert photometry.bond_albedo(white) == pytest.approx(1.0, rel=1e-9)
    assert photometry.normal_albedo(white) == pytest.approx(1.0)


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_lunar_lambert_has_the_bond_albedo_it_is_given(share):
    lunar = photometry.lunar_lambert(0.5, share)
    assert photometry.bond_albedo(lunar) == pytest.approx(0.5, rel=1e-9)
    assert photometry.normal_albedo(lunar) == pytest.approx(photometry.lunar_lambert_normal_albedo(0.5, share))
    mu = np.cos(np.radians([0.0, 45.0, 85.0]))
    directional = 4 * (1 - mu * np.log1p(1 / mu))  # of 2 µ0/(µ0 + µ)
    assert photometry.hemispherical_albedo(lunar, np.arccos(mu)) == pytest.approx(
        photometry.normal_albedo(lunar) * (share * directional + 1 - share), rel=1e-6
    )


@pytest.mark.parametrize(
    "described",
    [
        EUROPA,
        {"w": 0.979, "b": 0.39, "c": 1.0, "b_s0": 1.0, "h_s": 0.014, "theta_bar": 0.1},
        {"w": 0.9, "b": 0.5, "c": 0.2, "theta_bar": 0.6},
    ],
)
def test_the_two_ways_to_the_bond_albedo_agree(described):
    """p q of the sphere against the mean of the plane's hemispherical albedo, integrals that share nothing."""
    mu, weight = np.polynomial.legendre.leggauss(24)
    mu, weight = (mu + 1) / 2, weight / 2
    plane = 2 * (photometry.hemispherical_albedo(law(**described), np.arccos(mu)) * mu) @ weight
    assert photometry.bond_albedo(law(**described)) == pytest.approx(plane, rel=2e-4)


def test_europa_is_as_bright_as_observed():
    """Domingue et al. 1991 at 0.55 µm with their H: brightness at 6 degrees and Bond albedo (0.62 to 0.68)."""
    europa = law(**EUROPA, h_function="1981")
    assert photometry.bond_albedo(europa) == pytest.approx(0.62, abs=0.005)
    assert photometry.disc_brightness(europa, math.radians(6.0)) == pytest.approx(0.587, abs=0.002)


def _preset(name: str) -> dict:
    loaded = preset_files.load_preset(f"surfaces/hapke_{name}")
    return description.merged(description.defaults(), loaded)


@pytest.mark.parametrize(
    ("name", "quantity", "value"),
    [
        ("europa_global", "bond", 0.62),
        ("europa_bright_plains", "bond", 0.68),
        ("enceladus_global", "bond", 0.81),
        ("enceladus_global", "geometric", 1.375),
        ("lunar_like", "geometric", 0.12),
    ],
)
def test_presets_have_the_albedos_that_their_sources_state(name, quantity, value):
    settings = _preset(name)
    found = surface_law.find_albedos(settings["surface"], settings["hapke"])
    assert getattr(found, quantity) == pytest.approx(value, abs=0.003)  # sources state two or three digits


@pytest.mark.parametrize(
    ("name", "equigonal", "geometric"),
    [
        ("enceladus_global", 0.894, 1.375),
        ("enceladus_south_polar", 0.92, 1.398),
        ("mimas", 0.63, 0.962),
        ("tethys", 0.74, 1.229),
        ("dione", 0.65, 0.998),
        ("rhea", 0.60, 0.949),
    ],
)
def test_moons_of_saturn_have_their_measured_albedos_together(name, equigonal, geometric):
    settings = _preset(name)
    fitted = surface_law.make_law(settings["surface"], settings["hapke"])
    assert photometry.equigonal_albedo(fitted) == pytest.approx(equigonal, abs=0.001)  # the presets have five digits
    assert photometry.geometric_albedo(fitted) == pytest.approx(geometric, abs=0.001)


def test_the_equigonal_albedo_is_a_fit_without_the_surge():
    """Of Lambert's law, A cos(g/2), the fit is nearly A; a surge within a few degrees does not change it."""
    assert photometry.equigonal_albedo(photometry.lunar_lambert(0.7, 0.0)) == pytest.approx(0.7, rel=0.01)
    sharp, none = (law(**EUROPA | {"b_s0": amplitude, "h_s": 1e-4}) for amplitude in (1.0, 0.0))
    assert photometry.normal_albedo(sharp) > 1.3 * photometry.normal_albedo(none)
    assert photometry.equigonal_albedo(sharp) == pytest.approx(photometry.equigonal_albedo(none), rel=2e-3)


def test_europas_terrains_are_as_bright_beside_each_other_as_stated():
    five = math.radians(5.0)

    def radiance_factor(name):
        settings = _preset(f"europa_{name}")
        return math.pi * float(
            surface_law.make_law(settings["surface"], settings["hapke"])(*np.array([0.0, five, 0.0]))
        )

    plains, ridges, bands, dark = (radiance_factor(n) for n in ("bright_plains", "ridges", "bands", "dark_lineae"))
    assert dark == pytest.approx(0.17, abs=0.001)
    assert ridges == pytest.approx(0.75 * plains + 0.25 * dark, abs=0.002)
    assert bands == pytest.approx(0.5 * plains + 0.5 * dark, abs=0.002)


def test_the_laws_of_settings():
    settings = description.defaults()
    for model, share in (("LAMBERT", 0.0), ("LOMMEL_SEELIGER", 1.0), ("LUNAR_LAMBERT", 0.7)):
        surface = settings.surface | {"model": model, "albedo": 0.4}
        assert surface_law.find_albedos(surface, settings.hapke).bond == pytest.approx(0.4)
        law_here, plain = surface_law.make_law(surface, settings.hapke), photometry.lunar_lambert(0.4, share)
        angles_here = np.array([[0.3], [1.2], [0.5]])
        assert law_here(*angles_here) == pytest.approx(plain(*angles_here))
    assert surface_law.find_albedos(settings.surface | {"model": "PRINCIPLED"}, settings.hapke) is None
