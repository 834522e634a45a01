"""Sunlight and planetshine against tables, limits and integrals worked out another way."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.physics.light.eclipse import compute_hidden_share
from icymoon.physics.light.planetshine import (
    Planet,
    Ring,
    irradiance_wm2,
    lambert_phase,
    make_disc_mesh,
    phase_function,
)
from icymoon.physics.light.sky import azimuth_deg, check_body, compute_sky, describe_sky, elevation_deg
from icymoon.physics.light.sunlight import apparent_diameter_deg, sun_colour, sun_diameter_deg, sun_irradiance_wm2
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import description, preset_files
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from planet_radiance import face_radiance

pytestmark = pytest.mark.filterwarnings("error")

UP = np.array([0.0, 0.0, 1.0])
SATURN = (14.82, apparent_diameter_deg(60268, 238040), 0.499)
JUPITER = (50.27, apparent_diameter_deg(71492, 671100), 0.538)


def planet(phase=0.0, values=SATURN, law="LAMBERT", direction=UP, flattening=0.0, pole=(0.0, 1.0, 0.0)):
    """A planet in ``direction`` with the Sun at a phase angle from behind the site, towards east."""
    irradiance, diameter, albedo = values
    side = np.cross([0.0, 1.0, 0.0], direction)
    side /= np.linalg.norm(side)
    sun = -math.cos(math.radians(phase)) * direction + math.sin(math.radians(phase)) * side
    return Planet(direction, diameter, flattening, np.array(pole), sun, irradiance, albedo, law)


def test_the_sun_at_both_moons():
    assert sun_irradiance_wm2(9.5826) == pytest.approx(14.82, abs=0.005)
    assert sun_irradiance_wm2(5.2038) == pytest.approx(50.26, abs=0.005)
    assert sun_diameter_deg(9.5826) == pytest.approx(0.0556, abs=5e-5)
    assert sun_diameter_deg(5.2038) == pytest.approx(0.1024, abs=5e-5)
    assert sun_diameter_deg(1.0) == pytest.approx(0.533, abs=5e-4)


def test_apparent_sizes_are_those_of_a_sphere():
    assert SATURN[1] == pytest.approx(29.33, abs=0.005)  # the small-angle form gives 29.01
    assert JUPITER[1] == pytest.approx(12.23, abs=0.005)
    assert apparent_diameter_deg(1.0, 1.0) == apparent_diameter_deg(1.0, 0.5) == 180.0


def test_planets_are_equal_by_their_values_and_each_value_counts():
    one = planet(30.0)
    assert (one, hash(one)) == (planet(30.0), hash(planet(30.0)))
    rings = replace(one, rings=(Ring(1.2, 1.5, 0.1, 0.5),))
    others = [
        planet(31.0),
        planet(30.0, JUPITER),
        planet(30.0, law="SATURN"),
        planet(30.0, direction=UP[[2, 0, 1]]),
        planet(30.0, flattening=0.1),
        planet(30.0, pole=(1.0, 0.0, 0.0)),
        rings,
    ]
    assert one not in others
    assert irradiance_wm2(others[0]) < irradiance_wm2(one)  # which asks again for what was asked before


def test_colour_is_white_for_the_sun_and_warm_below():
    np.testing.assert_allclose(sun_colour(5772.0), 1.0, rtol=1e-12)
    red, green, blue = sun_colour(4000.0)
    assert red > green > blue
    assert sun_colour(4000.0).mean() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("values", "expected"),
    [(SATURN, (0.558, 0.484, 0.305, 0.1255, 0.026)), (JUPITER, (0.331, 0.289, 0.1915, 0.091, 0.026))],
)
def test_irradiance_by_phase_is_the_tabulated_one(values, expected):
    found = [irradiance_wm2(planet(phase, values)) for phase in (0, 30, 60, 90, 120)]
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_jupiter_is_darker_than_a_matt_globe_at_partial_phases():
    """Cassini's images: "roughly 25 %" for all filters together (Mayorga et al. 2016). In green it is 13 to 18 % here,
    and the crescent is brighter than a matt globe's."""
    ratio = np.array([phase_function("JUPITER", phase) / lambert_phase(phase) for phase in (30.0, 60.0, 90.0, 120.0)])
    np.testing.assert_allclose(ratio[:3], 0.8, atol=0.07)
    assert ratio[3] > 1


def far_field_irradiance_wm2(planet: Planet) -> float:
    """Irradiance of a facing surface by the formula for a distant point."""
    return (
        planet.geometric_albedo
        * phase_function(planet.phase_law, planet.phase_deg)
        * planet.sun_irradiance_wm2
        * math.sin(math.radians(planet.angular_diameter_deg / 2)) ** 2
    )


def test_far_away_the_integral_is_the_formula():
    for law in ("LAMBERT", "SATURN", "JUPITER"):
        for phase in (0.0, 5.0, 40.0, 90.0, 120.0, 160.0):
            small = planet(phase, (1.0, 0.1, 0.5), law)
            assert irradiance_wm2(small) == pytest.approx(far_field_irradiance_wm2(small), rel=2e-2)
    # Near by it is not: the error that the formula would make.
    ratio = [irradiance_wm2(planet(p)) / far_field_irradiance_wm2(planet(p)) for p in (0, 90, 120)]
    np.testing.assert_allclose(ratio, (1.18, 0.83, 0.50), atol=0.006)


def test_irradiance_is_that_of_random_rays():
    """The same integral by rays from the site against an ellipsoid in space, not by points on the ellipsoid."""
    direction = np.array([0.3, 0.2, 0.6])
    direction /= np.linalg.norm(direction)
    shown = planet(70.0, direction=direction, flattening=0.2, pole=(0.0, 0.6, 0.8))
    random = np.random.default_rng(5)
    limit = math.radians(15.0)
    n = 400_000
    z = 1 - (1 - math.cos(limit)) * random.random(n)
    around = 2 * np.pi * random.random(n)
    x_axis = np.cross(direction, UP) / np.linalg.norm(np.cross(direction, UP))
    y_axis = np.cross(direction, x_axis)
    ray = z[:, None] * direction + np.sqrt(1 - z**2)[:, None] * (
        np.cos(around)[:, None] * x_axis + np.sin(around)[:, None] * y_axis
    )
    radius = math.sin(math.radians(shown.angular_diameter_deg / 2))
    shape = (np.eye(3) + ((1 / 0.8) ** 2 - 1) * np.outer(shown.pole, shown.pole)) / radius**2  # xᵀ A x = 1
    a, b, c = (np.einsum("ni,ij,nj->n", ray, shape, ray), -ray @ shape @ direction, direction @ shape @ direction - 1)
    hit = b**2 > a * c
    t = (-b - np.sqrt(np.maximum(b**2 - a * c, 0))) / a
    normal = (t[:, None] * ray - direction) @ shape
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    albedo = 1.5 * shown.geometric_albedo
    radiance = albedo * shown.sun_irradiance_wm2 / np.pi * np.maximum(normal @ shown.sun, 0) * hit
    value = radiance * np.maximum(ray @ UP, 0) * 2 * np.pi * (1 - math.cos(limit))
    assert irradiance_wm2(shown, UP) == pytest.approx(value.mean(), abs=5 * value.std() / math.sqrt(n))


def test_phase_curves_are_continuous_and_fall():
    for law in ("LAMBERT", "SATURN", "JUPITER"):
        assert phase_function(law, 0.0) == pytest.approx(1.0, abs=1e-6)
        values = np.array([phase_function(law, a) for a in np.arange(0, 180.1, 0.25)])
        assert np.isfinite(values).all()
        assert (np.diff(values) < 2e-3).all()
        assert np.abs(np.diff(values)).max() < 0.02  # no step where two curves meet
        assert values[-1] == pytest.approx(0.0, abs=1e-3)
    assert lambert_phase(90.0) == pytest.approx(1 / math.pi)


def test_below_the_horizon_there_is_nothing_and_half_of_it_at_the_horizon():
    down = np.array([math.cos(math.radians(16)), 0.0, -math.sin(math.radians(16))])
    assert irradiance_wm2(planet(0.0, direction=down), UP) == 0.0
    east = np.array([1.0, 0.0, 0.0])
    level = irradiance_wm2(planet(0.0, direction=east), east)
    assert level == pytest.approx(0.558 / 2, rel=5e-3)
    for phase in (0.0, 180.0):
        assert np.isfinite(irradiance_wm2(planet(phase)))
    assert irradiance_wm2(planet(180.0)) == 0.0
    assert irradiance_wm2(planet(0.0, (14.82, 0.0, 0.5))) == 0.0


def test_the_mesh_is_the_ellipsoid_in_size_light_and_side():
    shown = planet(60.0, flattening=0.1)
    mesh = make_disc_mesh(shown, 1e-6)
    corners = mesh.vertices[mesh.faces]
    area = (
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        + np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 0])
    ) / 2
    middle = corners.mean(axis=1)
    distance = np.linalg.norm(middle, axis=1)
    solid_angle = -(area * middle).sum(axis=1) / distance**3
    assert (solid_angle > -1e-9).all()  # all faces are turned to the observer
    radiance = face_radiance(shown, middle)
    assert radiance.shape == (len(middle), 3)
    light = (radiance[:, 0] * solid_angle * middle[:, 2] / distance).sum()
    assert light == pytest.approx(irradiance_wm2(shown, UP), rel=2e-3)
    assert radiance.min() == 0


@pytest.mark.parametrize("pixel", [2e-3, 8e-3])
def test_a_pixel_on_the_limb_is_covered_by_the_share_of_the_planet_in_it(pixel):
    shown = planet(60.0, flattening=0.1)
    outline = find_outline(shown)
    tangent = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    mesh = make_disc_mesh(shown, pixel)
    near = np.flatnonzero(mesh.transmission > 0)[::31]
    ray = mesh.vertices[near] / np.linalg.norm(mesh.vertices[near], axis=1, keepdims=True)
    nearest = np.array([((outline - each) ** 2).sum(axis=1).argmin() for each in ray])
    apart = np.linalg.norm(np.cross(tangent[nearest], ray - outline[nearest]), axis=1)
    beyond = np.linalg.norm(ray - shown.direction, axis=1) > np.linalg.norm(outline[nearest] - shown.direction, axis=1)
    expected = 0.5 + np.where(beyond, apart, -apart) / pixel
    # Neighbours on the outline are 4e-4 apart, so that a chord is within 1e-7 of it.
    assert mesh.transmission[near] == pytest.approx(expected, abs=1e-4)
    assert ((expected > 0.05) & (expected < 0.45)).sum() > 20
    assert (expected > 0.99).sum() > 10


def find_outline(shown):
    """Unit vectors (4000, 3) to the limb: by bisection, as a ray hits if its quadratic equation has a solution."""
    radius = math.sin(math.radians(shown.angular_diameter_deg / 2))
    shape = (np.eye(3) + ((1 - shown.flattening) ** -2 - 1) * np.outer(shown.pole, shown.pole)) / radius**2
    across = np.linalg.qr(np.column_stack([shown.direction, np.eye(3)[:, :2]]))[0][:, 1:]
    angle = np.arange(4000) * 2 * np.pi / 4000
    side = np.cos(angle)[:, None] * across[:, 0] + np.sin(angle)[:, None] * across[:, 1]
    inner, outer = np.zeros(len(side)), np.full(len(side), 0.5)
    for _ in range(50):
        middle = (inner + outer) / 2
        tried = shown.direction + np.tan(middle)[:, None] * side
        far = shown.direction @ shape @ shown.direction - 1
        hits = (tried @ shape @ shown.direction) ** 2 >= np.einsum("ni,ij,nj->n", tried, shape, tried) * far
        inner, outer = np.where(hits, middle, inner), np.where(hits, outer, middle)
    return np.cos(inner)[:, None] * shown.direction + np.sin(inner)[:, None] * side


@pytest.mark.parametrize(("per_radius", "off"), [(0.01, 1e-3), (0.1, 6e-3), (10.0, 6e-3)])
def test_a_soft_limb_leaves_the_planet_its_light(per_radius, off):
    shown = planet(40.0, flattening=0.1)
    sharp, soft = (
        make_disc_mesh(shown, pixel * math.sin(math.radians(shown.angular_diameter_deg / 2)), 192)
        for pixel in (1e-7, per_radius)
    )
    assert light_of(soft, shown) == pytest.approx(light_of(sharp, shown), rel=off)


def light_of(mesh, shown):
    """Irradiance from the faces of a disc's mesh on a surface that faces it."""
    corners = mesh.vertices[mesh.faces]
    middle = corners.mean(axis=1)
    area = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]) / 2
    facing = -(area * middle).sum(axis=1) * (middle @ shown.direction) / np.linalg.norm(middle, axis=1) ** 4
    covered = 1 - mesh.transmission[mesh.faces].mean(axis=1)
    return float((face_radiance(shown, middle)[:, 1] * covered * facing).sum())


def test_the_sky_of_the_settings():
    light = description.merged(description.defaults(), preset_files.load_preset("bodies/enceladus")).light
    shown = compute_sky(light | {"sun_elevation_deg": 20.0, "sun_azimuth_deg": 300.0})
    assert (elevation_deg(shown.sun), azimuth_deg(shown.sun)) == pytest.approx((20.0, 300.0))
    assert shown.ground_irradiance_wm2[0] == pytest.approx(14.82 * math.sin(math.radians(20)))
    assert elevation_deg(shown.planet.pole) == pytest.approx(-80.0)
    said = describe_sky(shown)
    assert said["planet"]["phase_deg"] == pytest.approx(
        180 - math.degrees(math.acos(shown.sun @ [0, math.cos(math.radians(10)), math.sin(math.radians(10))]))
    )
    assert 0 < said["planet"]["ground_irradiance_wm2"] < 0.1
    assert compute_sky(light | {"planet": False}).planet is None


@pytest.mark.parametrize(("elevation", "up"), [(-5.0, False), (-0.02, True), (0.0, True), (0.01, True), (90.0, True)])
def test_the_sun_is_up_while_any_of_it_is(elevation, up):
    shown = compute_sky(description.defaults().light | {"sun_elevation_deg": elevation})
    assert shown.sun_is_up is up
    assert shown.ground_irradiance_wm2[0] == pytest.approx(14.82 * max(0.0, math.sin(math.radians(elevation))))


def circles_overlap(radius, other, apart):
    """Share of a circle that another covers, on a plane."""
    if apart >= radius + other:
        return 0.0
    if apart <= abs(radius - other):
        return min(1.0, (other / radius) ** 2)
    near = (apart**2 + radius**2 - other**2) / (2 * apart)  # from the centre to the common chord
    far = apart - near
    return (
        radius**2 * math.acos(near / radius)
        - near * math.sqrt(radius**2 - near**2)
        + other**2 * math.acos(far / other)
        - far * math.sqrt(other**2 - far**2)
    ) / (math.pi * radius**2)


@pytest.mark.parametrize(
    ("diameter", "sun"), [(0.05, 0.05), (2.0, 1.0), (12.23, 0.1024), (29.33, 0.0556), (120.0, 0.05)]
)
def test_of_a_sphere_an_eclipse_is_the_share_of_two_circles(diameter, sun):
    for apart in diameter / 2 + sun / 2 * np.linspace(-1.2, 1.2, 13):
        shown = planet(180.0 - max(apart, 0.0), (1.0, diameter, 0.5))
        # The sky is no plane: the limb of a large planet is less curved than a circle of its angular radius.
        assert compute_hidden_share(shown, sun) == pytest.approx(
            circles_overlap(sun / 2, diameter / 2, max(apart, 0.0)), abs=3e-4
        )


def test_a_planet_before_the_middle_of_the_sun_hides_its_own_size():
    assert compute_hidden_share(planet(180.0, (1.0, 0.02, 0.5)), 0.05) == pytest.approx(0.16, abs=5e-3)
    assert compute_hidden_share(planet(180.0, (1.0, 0.0, 0.5)), 0.05) == 0.0
    assert compute_hidden_share(planet(0.0), 0.0556) == 0.0  # behind the site
    for diameter in (0.0, 0.0556):
        assert compute_hidden_share(planet(180.0), diameter) == 1.0


def test_an_ellipsoid_hides_what_rays_meet():
    """The limb along the axis is nearer than along the equator; a share by 40 000 rays of the Sun's disc."""
    u = np.linspace(-1, 1, 225)
    u, v = (a[np.hypot(*np.meshgrid(u, u)) < 1] for a in np.meshgrid(u, u))
    for pole, offset, sun in (((0.0, 1.0, 0.0), 14.2, 2.0), ((1.0, 0.0, 0.0), 13.3, 1.0), ((0.6, 0.8, 0.0), 14.2, 0.8)):
        shown = planet(180.0 - offset, flattening=0.098, pole=pole)
        x = np.cross(shown.sun, [0.0, 1.0, 0.0])
        rays = shown.sun + math.tan(math.radians(sun / 2)) * (u[:, None] * x + v[:, None] * np.cross(shown.sun, x))
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        radius = math.sin(math.radians(shown.angular_diameter_deg / 2))
        shape = (np.eye(3) + ((1 / 0.902) ** 2 - 1) * np.outer(pole, pole)) / radius**2
        d = shown.direction
        hit = (rays @ shape @ d) ** 2 > np.einsum("ni,ij,nj->n", rays, shape, rays) * (d @ shape @ d - 1)
        assert 0.1 < hit.mean() < 0.9
        assert compute_hidden_share(shown, sun) == pytest.approx(hit.mean(), abs=4e-3)  # of the rays' raster


def test_an_eclipse_takes_the_light_of_the_ground():
    light = description.defaults().light | {"planet": True, "planet_elevation_deg": 20.0, "planet_azimuth_deg": 60.0}
    assert compute_sky(light).eclipse == 1.0
    assert compute_sky(light).ground_irradiance_wm2 == (0.0, 0.0)
    part = compute_sky(light | {"planet_angular_diameter_deg": 0.05})
    assert 0 < part.eclipse < 1
    assert part.ground_irradiance_wm2[0] == pytest.approx((1 - part.eclipse) * 14.82 * math.sin(math.radians(20)))
    assert compute_sky(light | {"planet_elevation_deg": 60.0}).eclipse == 0.0
    assert (
        compute_sky(light | {"planet": False}).eclipse == 0.0
    )  # among angles there is no planet but one that is shown


def test_every_scene_preset_has_light():
    for name in preset_files.preset_names("scenes"):
        shown = compute_sky(description.merged(description.defaults(), preset_files.load_preset(name)).light)
        assert shown.eclipse == 0.0, name
        assert sum(shown.ground_irradiance_wm2) > (0.05 if name.endswith("shine") else 1.0), name


def described(*parts: dict) -> Settings:
    return description.merged(description.defaults(), *parts)


@pytest.mark.parametrize("name", ["europa", "enceladus"])
def test_a_body_has_the_same_planet_in_its_sky_by_angles_and_by_date(name):
    """But for what the planet swings, twice the eccentricity of the orbit and more (``ephemeris``), and for the lean
    of the ellipsoid's normal, which angles know not: 1.1° and 0.1° on Europa, 0.8° and 0.7° at 80° south on
    Enceladus. Of its apparent size the eccentricity, a hundredth and a two-hundredth, is left, and half of the moon."""
    light = described(preset_files.load_preset(f"bodies/{name}"))["light"]
    by_angles = describe_sky(compute_sky(light))["planet"]
    for day in range(0, 400, 9):
        date = str(np.datetime64("2031-01-01T00:00") + np.timedelta64(day * 1440 + 61 * day, "m"))
        by_date = describe_sky(compute_sky(light | {"directions_from": "DATE", "date_utc": date}))["planet"]
        off = math.degrees(math.acos(min(1.0, np.dot(by_date["direction_to_world"], by_angles["direction_to_world"]))))
        assert off < 1.5
        assert by_date["angular_diameter_deg"] == pytest.approx(by_angles["angular_diameter_deg"], rel=0.015)


GANYMEDE = {"terrain": {"body_radius_m": 2631200.0}}


@pytest.mark.parametrize("way", ["DATE", "KERNELS"])
@pytest.mark.parametrize(("body", "other"), [("europa", "enceladus"), ("enceladus", "europa")])
def test_ground_of_one_body_gets_no_sky_of_another(way, body, other):
    dated = {"light": {"directions_from": way}}
    of_body, of_other = (preset_files.load_preset(f"bodies/{name}") for name in (body, other))
    check_body(described(of_body, dated))
    for ground in (GANYMEDE, {"terrain": of_other.terrain}):
        check_body(described(of_body, ground))  # at angles, the sky is what is stated
        with pytest.raises(IcyMoonError, match=r"light\.body is E.* another sky; set light\.body to what this is"):
            check_body(described(of_body, ground, dated))
    check_body(described(of_body, GANYMEDE, dated, {"light": {"body": "GANYMEDE"}}))  # which kernels know


def test_the_manuals_ganymede_has_no_europas_sky(tmp_path):
    page = (preset_files.PRESETS_FOLDER.parent / "docs" / "howto" / "another-body.md").read_text(encoding="utf-8")
    (tmp_path / "ganymede.toml").write_text(page.split("```toml\n")[1].split("```")[0], encoding="utf-8")
    found = described(preset_files.load(tmp_path / "ganymede.toml"), {"light": {"directions_from": "DATE"}})
    check_body(found)
    with pytest.raises(IcyMoonError, match="'GANYMEDE'; without kernels only ENCELADUS and EUROPA"):
        compute_sky(found["light"])


def test_a_plan_refuses_such_ground_in_each_of_its_sweep(tmp_path):
    """One description after the other, of which only the radius differs."""
    (tmp_path / "plan.toml").write_text(
        '[plan]\ninclude = ["bodies/europa"]\n[light]\ndirections_from = "DATE"\n'
        '[[sweep]]\nkind = "grid"\nterrain.body_radius_m = [1.5608e6, 2.6312e6]\n',
        encoding="utf-8",
    )
    (said,) = read_plan(tmp_path / "plan.toml").refused().values()
    assert "of a body of 2631 km, which has another sky" in said
