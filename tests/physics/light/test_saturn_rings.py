"""Saturn's rings against integrals, rays and what is seen of them from Enceladus."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.light.planetshine import Planet, Ring, irradiance_wm2, make_disc_mesh, unshaded_share
from icymoon.physics.light.saturn_rings import RINGS, make_ring_mesh, phase_function, ring_brightness, shadow_half_angle
from icymoon.physics.light.sky import compute_sky
from icymoon.settings import description, preset_files
from planet_radiance import face_radiance

pytestmark = pytest.mark.filterwarnings("error")

ENCELADUS = description.merged(description.defaults(), preset_files.load_preset("bodies/enceladus")).light


def dated(date, latitude):
    return compute_sky(
        ENCELADUS | {"directions_from": "DATE", "date_utc": date, "latitude_deg": latitude, "planet_rings": True}
    )


def opened(height_deg, sun_deg, sun_azimuth_deg=140.0):
    """Saturn seen level in the north, the site above the plane of its rings; the Sun above it too."""
    height, sun, azimuth = (math.radians(a) for a in (height_deg, sun_deg, sun_azimuth_deg))
    direction = np.array([0.0, 1.0, 0.0])
    pole = np.array([0.0, -math.sin(height), math.cos(height)])
    flat = np.array([0.0, math.cos(height), math.sin(height)])
    toward = math.cos(sun) * (math.cos(azimuth) * flat + math.sin(azimuth) * np.array([1.0, 0.0, 0.0]))
    return Planet(
        direction, 29.33, 0.098, pole, toward + math.sin(sun) * pole, 14.82, 0.499, "SATURN", tuple(RINGS.values())
    )


def light_of(mesh):
    """Irradiance on a surface that faces each part, and solid angle."""
    corners = mesh.vertices[mesh.faces]
    area = (
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        + np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 0])
    ) / 2
    middle = corners.mean(axis=1)
    solid_angle = np.abs((area * middle).sum(axis=1)) / np.linalg.norm(middle, axis=1) ** 3
    return (mesh.radiance[mesh.faces].mean(axis=1) * solid_angle).sum(), solid_angle.sum()


def test_a_layer_is_the_integral_over_its_depth():
    x, weight = np.polynomial.legendre.leggauss(200)
    phase = np.array([0.7])
    for depth, sun, seen in ((0.1, 0.4, 0.2), (1.5, 0.05, 0.3), (0.6, 0.3, 0.002), (1.0, 0.3, 0.3)):
        # Substituting the depth from the side where it is seen keeps the nodes where the light comes from.
        near = -seen * np.log1p(-(x + 1) / 2 * -np.expm1(-depth / seen))
        scale = -np.expm1(-depth / seen) / 2
        lit = (weight * scale * 0.5 / 4 * phase_function(phase)[0] * np.exp(-near / sun)).sum()
        unlit = (weight * scale * 0.5 / 4 * phase_function(phase)[0] * np.exp(-(depth - near) / sun)).sum()
        ring = Ring(1.0, 2.0, depth, 0.5)
        assert ring_brightness(ring, sun, np.array([seen]), phase, True)[0] == pytest.approx(lit, rel=1e-4)
        assert ring_brightness(ring, sun, np.array([seen]), phase, False)[0] == pytest.approx(unlit, rel=1e-4)
    assert ring_brightness(RINGS["B"], 0.0, np.array([0.1]), phase, True)[0] == 0.0


def test_particles_scatter_back_and_lose_nothing():
    x, weight = np.polynomial.legendre.leggauss(64)
    angle = math.pi * (x + 1) / 2
    assert (weight * math.pi / 2 * phase_function(angle) * np.sin(angle)).sum() / 2 == pytest.approx(1.0)
    assert (np.diff(phase_function(np.linspace(0, math.pi, 50))) < 0).all()
    # Ring B in opposition, as seen from Earth at 26°, has I/F 0.5 to 0.7 (Cuzzi et al. 2002, Icarus 158, 199); single
    # scattering alone gives two thirds.
    sine = math.sin(math.radians(26))
    assert 0.25 < ring_brightness(RINGS["B"], sine, np.array([sine]), np.array([0.02]), True)[0] < 0.5


def test_the_shadow_is_where_rays_to_the_sun_meet_the_planet():
    for elevation, flattening in ((0.0, 0.098), (10.0, 0.098), (26.7, 0.098), (26.7, 0.3)):
        sun = np.array([math.cos(math.radians(elevation)), 0.0, math.sin(math.radians(elevation))])
        shape = np.diag([1.0, 1.0, 1 / (1 - flattening) ** 2])
        for radius in (1.24, 1.6, 2.27):
            half = shadow_half_angle(np.array([radius]), math.radians(elevation), flattening)[0]
            around = np.linspace(0, math.pi, 4001)
            point = radius * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
            b, c = point @ shape @ sun, np.einsum("ni,ij,nj->n", point, shape, point) - 1
            dark = (b < 0) & (b**2 > sun @ shape @ sun * c)
            assert dark.mean() * math.pi == pytest.approx(half, abs=2e-3)
            assert (dark == (math.pi - around < half + 1e-3)).mean() > 0.999
    assert shadow_half_angle(np.array([2.27]), math.radians(30.0), 0.0)[0] == 0.0  # a planet's shadow that falls short


def test_from_enceladus_they_are_a_line_that_gives_no_light_to_speak_of():
    for date, latitude in (
        ("2032-06-01", -80.0),
        ("2032-06-01T20:00", -80.0),
        ("2032-06-01T20:00", 85.0),
        ("2038-06-01", 30.0),
    ):
        shown = dated(date, latitude)
        mesh = make_ring_mesh(shown.planet)
        ray = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
        off = np.degrees(np.arcsin(np.abs(ray @ shown.planet.pole)))
        assert off.max() < 0.15
        # The site is that far off the plane through the middle of Enceladus: 248 km at 80° over 238 000 km.
        expected = 248.3 * math.sin(math.radians(latitude)) / 238040
        assert math.radians(shown.above_ring_plane_deg) == pytest.approx(expected, rel=0.05)
        light, solid_angle = light_of(mesh)
        assert solid_angle < 1.5e-3
        assert light < 2e-4 * shown.sun_irradiance_wm2
        full = replace(shown.planet, sun=-shown.planet.direction)
        assert light < 0.006 * irradiance_wm2(full)
    assert make_ring_mesh(dated("2032-06-01", 0.0).planet) is None


def test_the_rings_shade_saturn_as_rays_to_the_sun_find():
    """The light of level ground by random rays, each followed from the planet back through the rings to the Sun."""
    shown = replace(opened(20.0, 20.0, 200.0), direction=np.array([0.0, 0.8, 0.6]))  # and a little from above
    random = np.random.default_rng(3)
    n, limit = 400_000, math.radians(15.0)
    z = 1 - (1 - math.cos(limit)) * random.random(n)
    around = 2 * np.pi * random.random(n)
    y = np.cross(shown.direction, [1.0, 0.0, 0.0])
    ray = z[:, None] * shown.direction + np.sqrt(1 - z**2)[:, None] * (
        np.cos(around)[:, None] * np.array([1.0, 0.0, 0.0]) + np.sin(around)[:, None] * y
    )
    radius = math.sin(math.radians(29.33 / 2))
    shape = (np.eye(3) + ((1 / 0.902) ** 2 - 1) * np.outer(shown.pole, shown.pole)) / radius**2
    a, b = np.einsum("ni,ij,nj->n", ray, shape, ray), -ray @ shape @ shown.direction
    c = shown.direction @ shape @ shown.direction - 1
    point = ((-b - np.sqrt(np.maximum(b**2 - a * c, 0))) / a)[:, None] * ray - shown.direction
    normal = point @ shape
    lit = np.maximum(normal @ shown.sun, 0) / np.linalg.norm(normal, axis=1) * (b**2 > a * c) * ray[:, 2]
    crossing = -(point @ shown.pole) / (shown.sun @ shown.pole)
    off = np.linalg.norm(point + crossing[:, None] * shown.sun, axis=1) / radius
    depth = sum(ring.optical_depth * ((crossing > 0) & (off > ring.inner) & (off < ring.outer)) for ring in shown.rings)
    passed = lit * np.exp(-depth / abs(shown.sun @ shown.pole))
    share = unshaded_share(shown)
    assert 0.7 < share < 0.95
    assert share == pytest.approx(passed.sum() / lit.sum(), abs=3e-3)
    up = np.array([0.0, 0.0, 1.0])
    mesh = make_disc_mesh(shown, 1e-6, 144)
    corners = mesh.vertices[mesh.faces]
    area = (
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        + np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 0])
    ) / 2
    middle = corners.mean(axis=1)
    solid_angle = -(area * middle).sum(axis=1) / np.linalg.norm(middle, axis=1) ** 3
    radiance = face_radiance(shown, middle)[:, 0]
    seen = (radiance * solid_angle * middle[:, 2] / np.linalg.norm(middle, axis=1)).sum()
    assert seen == pytest.approx(irradiance_wm2(shown, up), rel=5e-3)
    assert unshaded_share(replace(shown, rings=())) == 1.0
    assert unshaded_share(opened(20.0, 0.0)) == 1.0


def test_the_side_away_from_the_sun_is_dark_where_the_ring_is_dense():
    lit, unlit = make_ring_mesh(opened(15.0, 20.0)), make_ring_mesh(opened(15.0, -20.0))
    for mesh in (lit, unlit):
        assert np.isfinite(mesh.radiance).all()
        assert ((mesh.transmission >= 0) & (mesh.transmission <= 1)).all()
        radius = np.linalg.norm(mesh.vertices - [0.0, 1.0, 0.0], axis=1) / math.sin(math.radians(29.33 / 2))
        assert radius.min() * 60268 == pytest.approx(74658)
        assert radius.max() * 60268 == pytest.approx(136780)
        assert 0.02 < (mesh.radiance == 0).mean() < 0.3  # the planet's shadow
    radius = np.linalg.norm(lit.vertices - [0.0, 1.0, 0.0], axis=1) / math.sin(math.radians(29.33 / 2)) * 60268
    b = (radius > 92500) & (radius < 117000) & (lit.radiance > 0)
    assert unlit.radiance[b].mean() < 0.1 * lit.radiance[b].mean()
    assert lit.radiance[b].mean() > 2 * lit.radiance[radius < 91000].mean()  # than ring C


@pytest.mark.parametrize(
    ("height", "sun"),
    [(0.001, 0.0), (90.0, 90.0), (-90.0, 90.0), (5.0, 90.0), (30.0, 1e-6), (20.0, 20.0), (-20.0, 20.0)],
)
def test_no_geometry_is_too_much(height, sun):
    mesh = make_ring_mesh(opened(height, sun))
    assert np.isfinite(mesh.vertices).all()
    assert np.isfinite(mesh.radiance).all()
    assert (mesh.radiance >= 0).all()


def test_only_saturn_has_rings():
    assert dated("2032-06-01", -80.0).planet.rings
    europa = compute_sky(ENCELADUS | {"directions_from": "DATE", "body": "EUROPA", "planet_rings": True})
    assert not europa.planet.rings
    assert europa.above_ring_plane_deg is None
    raised = compute_sky(ENCELADUS | {"planet_rings": True, "planet_elevation_deg": 20.0})
    assert raised.above_ring_plane_deg == pytest.approx(10.0)
    assert compute_sky(ENCELADUS | {"planet_rings": True, "planet": False}).above_ring_plane_deg is None
