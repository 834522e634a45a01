"""Faces of planets: pattern, place of the Red Spot, and the light, which stays what it is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.light.planet_face import (
    FACES,
    MIN_COSINE,
    face_tint,
    radiance_over_zenith,
    spot_axes,
)
from icymoon.physics.light.planetshine import Planet, VisibleCap, irradiance_wm2, make_cap_nodes
from icymoon.physics.light.saturn_rings import RINGS
from icymoon.physics.mesh.horizon import dip_deg
from planet_radiance import face_radiance

NORTH = np.array([0.0, 1.0, 0.0])


def unit(*components):
    return np.array(components) / np.linalg.norm(components)


def planet(face, sun=(0.4, -1.0, 0.2), **changes):
    rings = tuple(RINGS.values()) if changes.pop("rings", False) else ()
    return replace(Planet(unit(0.3, 0.0, 1.0), 20.0, 0.098, NORTH, unit(*sun), 15.0, 0.5, face, rings, face), **changes)


def rays_to(shown, n=600):
    """Unit vectors (n, n, 3) over the planet, the solid angle (n, n) of each, and the places that they meet."""
    side = np.cross(shown.direction, NORTH)
    side /= np.linalg.norm(side)
    half = 1.02 * math.tan(math.radians(shown.angular_diameter_deg / 2))
    step = 2 * half / n
    x, y = np.meshgrid(*[-half + step * (np.arange(n) + 0.5)] * 2)
    ray = shown.direction + x[..., None] * side + y[..., None] * np.cross(side, shown.direction)
    length = np.linalg.norm(ray, axis=-1)
    ray /= length[..., None]
    radius = math.sin(math.radians(shown.angular_diameter_deg / 2))
    shape = (np.eye(3) + ((1 - shown.flattening) ** -2 - 1) * np.outer(shown.pole, shown.pole)) / radius**2
    a, b = np.einsum("hwi,ij,hwj->hw", ray, shape, ray), ray @ shape @ shown.direction
    inside = b**2 - a * (shown.direction @ shape @ shown.direction - 1)
    way = (b - np.sqrt(np.maximum(inside, 0))) / a
    return ray, step**2 / length**3 * (inside > 0), way[..., None] * ray


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("changes", [{}, {"sun": (1.0, -0.3, 0.6)}, {"rings": True}, {"phase_law": "LAMBERT"}])
def test_a_face_gives_the_light_of_an_even_globe_in_the_colour_of_the_planet(face, changes):
    shown = planet(face, **changes)
    ray, solid_angle, place = rays_to(shown)
    light = (face_radiance(shown, place) * (solid_angle * (ray @ shown.direction))[..., None]).sum(axis=(0, 1))
    # 600 x 600 rays; the limb, and with rings the edge of the shadow, leave 2e-3.
    assert light == pytest.approx(irradiance_wm2(shown) * face_tint(shown), rel=4e-3)
    assert face_tint(shown).mean() == pytest.approx(1)
    assert irradiance_wm2(shown) == irradiance_wm2(replace(shown, face="PLAIN"))


@pytest.mark.parametrize("face", FACES)
def test_a_face_has_an_end_at_each_pole_and_fits_a_colour_ramp(face):
    sine, bands = np.array(FACES[face].sine), np.array(FACES[face].reflectance)
    assert (sine[0], sine[-1]) == (-1, 1)
    assert (np.diff(sine) > 0).all()
    assert len(sine) == len(bands) <= 32  # Blender has no more stops
    assert ((bands > 0.3) & (bands < 1.3)).all()


def test_the_red_spot_is_where_its_longitude_is_and_red():
    shown = planet("JUPITER", sun=(0.0, 0.0, -1.0), direction=unit(0.0, 0.0, 1.0), flattening=0.065)
    spot = FACES["JUPITER"].spot
    for longitude, x in ((0.0, 0.0), (30.0, math.sin(math.radians(30.0)))):
        middle, east, north = spot_axes(replace(shown, spot_longitude_deg=longitude), spot)
        assert middle @ NORTH == pytest.approx(math.sin(math.radians(-22.5)))
        # Seen from the south side up: the planet's east is the side that its rotation carries away, pole x outward.
        assert middle @ np.cross(NORTH, -shown.direction) == pytest.approx(x * math.cos(math.radians(22.5)))
        assert np.cross(middle, east) == pytest.approx(north)
        turned = replace(shown, spot_longitude_deg=longitude)
        radius = math.sin(math.radians(10.0))
        there = shown.direction + radius * middle * (1, 1 - 0.065, 1)
        beside = shown.direction + radius * spot_axes(replace(shown, spot_longitude_deg=longitude + 25), spot)[0]
        inside, outside = face_radiance(turned, np.stack([there, beside]))
        assert inside[2] / inside[0] < 0.7 * outside[2] / outside[0]


def test_saturn_is_brightest_at_its_equator_and_has_a_darker_limb_in_red_than_in_blue():
    shown = planet("SATURN", sun=(-0.3, 0.0, -1.0), flattening=0.0)
    radius = math.sin(math.radians(10.0))
    toward = -shown.direction

    def at(latitude, longitude):
        side = np.cross(NORTH, toward)
        out = math.cos(math.radians(longitude)) * toward + math.sin(math.radians(longitude)) * side
        up = math.radians(latitude)
        return shown.direction + radius * (math.cos(up) * out + math.sin(up) * NORTH)

    equator, belt, limb = face_radiance(shown, np.stack([at(0, 0), at(25, 0), at(0, 70)]))
    # Both cosines of the belt are smaller by the cosine of its latitude: 0.906^(1.295 - 1).
    assert belt[1] / equator[1] == pytest.approx(0.90 / 1.16 * math.cos(math.radians(25)) ** 0.295, rel=0.03)
    assert limb[0] / equator[0] < limb[2] / equator[2]


@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("phase", [0.0, 20.0, 75.0, 140.0])
def test_a_place_is_as_bright_if_sun_and_observer_change_places(face, phase):
    """Helmholtz's reciprocity: light that leaves a surface, per light that reaches it, is the same both ways.

    Without the spot, whose longitude is counted from the observer's.
    """
    random = np.random.default_rng(1)
    toward = random.normal(size=(200, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    aside = np.cross(toward, random.normal(size=(200, 3)))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    sun = math.cos(math.radians(phase)) * toward + math.sin(math.radians(phase)) * aside
    normal = sun + toward + 0.5 * random.normal(size=(200, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    seen = np.minimum((normal * sun).sum(axis=1), (normal * toward).sum(axis=1)) > 0.03
    assert seen.sum() > 20
    for n, s, o in zip(normal[seen], sun[seen], toward[seen], strict=True):
        there, back = (
            radiance_over_zenith(replace(FACES[face], spot=None), planet(face, sun=a, direction=-b), n, b) / (n @ a)
            for a, b in ((s, o), (o, s))
        )
        assert there == pytest.approx(back, rel=1e-9)


@pytest.mark.parametrize("phase", [0.0, 15.0, 30.0, 60.0, 64.0, 90.0, 120.0, 150.0])
def test_saturn_is_darker_at_its_limb_than_before_it(phase):
    """On the Sun's side of the equator, in each band: an exponent below 1 would make the rim bright."""
    toward = np.array([0.0, 0.0, 1.0])
    sun = np.array([math.sin(math.radians(phase)), 0.0, math.cos(math.radians(phase))])
    shown = planet("SATURN", sun=sun, direction=-toward, flattening=0.0)
    emission = np.linspace(MIN_COSINE, 1.0, 200)
    normal = np.stack([np.sqrt(1 - emission**2), 0 * emission, emission], axis=1)
    light = radiance_over_zenith(FACES["SATURN"], shown, normal, np.broadcast_to(toward, normal.shape))
    assert (np.diff(light[:5], axis=0) > 0).all()


def test_saturn_in_full_light_has_the_profile_of_half_barkstroms_exponents():
    """The law is Minnaert's there. Its exponents are those of Dones et al. 1993, 1.48 in red and 1.11 in blue."""
    shown = planet("SATURN", sun=np.array([0.0, 0.0, 1.0]), direction=np.array([0.0, 0.0, -1.0]), flattening=0.0)
    normal = np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 1.0]])
    limb, middle = radiance_over_zenith(FACES["SATURN"], shown, normal, np.array([0.0, 0.0, 1.0]))
    for band, k in ((0, 0.74), (2, 0.555)):
        assert limb[band] / middle[band] == pytest.approx(0.8 ** (2 * k - 1), rel=1e-9)


def test_a_planet_that_is_new_or_has_no_light_is_dark_and_finite():
    for shown in (
        planet("SATURN", sun=(0.3, 0.0, 1.0)),
        planet("JUPITER", sun_irradiance_wm2=0.0),
        planet("SATURN", geometric_albedo=0.0),
    ):
        _, solid_angle, place = rays_to(shown, 40)
        radiance = face_radiance(shown, place)[solid_angle > 0]
        assert np.isfinite(radiance).all()
        assert radiance.min() >= 0


@pytest.mark.parametrize(
    ("height", "radius", "dip"), [(1.6, 252100.0, 0.2041), (1.6, 1560800.0, 0.0820), (0.0, 252100.0, 0.0)]
)
def test_the_horizon_dips_by_the_angle_whose_cosine_is_the_ratio_of_radii(height, radius, dip):
    assert dip_deg(height, radius) == pytest.approx(math.degrees(math.acos(radius / (radius + height))), abs=1e-6)
    assert dip_deg(height, radius) == pytest.approx(dip, abs=1e-4)


def test_the_shared_nodes_of_a_planet_do_not_depend_on_its_sun():
    shown = planet("SATURN", flattening=0.0)
    nodes = make_cap_nodes(VisibleCap(shown))
    assert make_cap_nodes(VisibleCap(replace(shown, sun=unit(1.0, 0.0, 0.2)))) is nodes
    elsewhere = unit(0.0, 0.6, 0.8)
    moved = make_cap_nodes(VisibleCap(replace(shown, direction=elsewhere)))
    cone_sr = 2 * math.pi * (1 - math.cos(math.radians(shown.angular_diameter_deg / 2)))
    assert moved.solid_angle.sum() == pytest.approx(cone_sr, rel=1e-4)  # a globe above the horizon fills a cone
    middle = (moved.ray * moved.solid_angle[..., None]).sum(axis=(0, 1))
    assert middle / np.linalg.norm(middle) == pytest.approx(elsewhere, abs=1e-4)
    with pytest.raises(ValueError, match="read-only"):
        nodes.ray[0, 0, 0] = 1.0
