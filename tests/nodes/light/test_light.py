"""Rendered light against what is known of it: irradiance, penumbra, planet, groups."""

import math

import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.physics.light.planetshine import irradiance_wm2
from icymoon.physics.light.sky import compute_sky, describe_sky
from icymoon.physics.scene_checks import find_reasons_in_settings
from icymoon.physics.surfaces import photometry
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.disparity_and_occlusion import find_scene_depth
from icymoon.stereo.images.exr import read_view
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import PLANET, TERRAIN
from lit_scenes import JUPITER, NIGHT, SATURN
from rendering import complete, empty_scene, render

LAMBERT = {
    "terrain": {"rms_slope_deg": 0.0, "size_m": 40.0},
    "surface": {"grain_amplitude_m": 0.0, "albedo_variation": 0.0, "specular": 0.0, "albedo": 0.8},
    "quality": {"diffuse_bounces": 0},
}
DOWN = {"rig": {"pitch_deg": 90.0, "width_px": 48, "height_px": 36}}


def lit(folder, light, *parts):
    """The left view of a Lambert plane, albedo 0.8, seen from above."""
    pair, _ = render(folder, LAMBERT, DOWN, {"light": light}, *parts)
    return pair, read_view(pair.image("left"))


@pytest.mark.long
@pytest.mark.parametrize("planet", [SATURN, JUPITER], ids=["Saturn", "Jupiter"])
def test_a_plane_in_planetshine_has_the_radiance_of_the_integral(tmp_path, planet):
    pair, view = lit(tmp_path, planet | NIGHT, {"quality": {"samples": 256}})
    expected = compute_sky(pair.settings["light"]).ground_irradiance_wm2
    assert expected[0] == 0
    # 1728 pixels of 256 paths, each of which picks a direction in the disc: sampling leaves less than 1e-3.
    assert view.radiance.mean() == pytest.approx(expected[1] * 0.8 / math.pi, rel=1e-3)
    assert pair.data["light"]["planet"]["ground_irradiance_wm2"] == pytest.approx(expected[1])
    assert view.groups["Sun"].max() == 0


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("irradiance", "diameter"),
    [(14.82, 0.0556), (50.26, 0.1024), (4.14, 0.57296)],
    ids=["Enceladus", "Europa", "paper"],
)
def test_a_plane_in_sunlight_has_the_radiance_of_lambert_at_every_elevation(tmp_path, irradiance, diameter):
    for elevation in (-5.0, 0.0, 0.01, 12.0, 90.0):
        _, view = lit(
            tmp_path,
            {"sun_irradiance_wm2": irradiance, "sun_angular_diameter_deg": diameter, "sun_elevation_deg": elevation},
            {"quality": {"samples": 16}},
        )
        assert np.isfinite(view.radiance).all()
        expected = irradiance * math.sin(math.radians(elevation)) * 0.8 / math.pi
        if elevation < 0:
            assert view.radiance.max() == 0
        elif elevation < diameter:
            # Of a Sun that is half set only the upper part shines, at angles up to half its diameter.
            assert 0 <= view.radiance.mean() < irradiance * math.radians(diameter) * 0.8 / math.pi
        else:
            assert view.radiance.mean() == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(
    ("surface", "law"),
    [
        ({}, photometry.lunar_lambert(0.8, 0.0)),
        ({"model": "LUNAR_LAMBERT", "lommel_seeliger_share": 0.6}, photometry.lunar_lambert(0.8, 0.6)),
    ],
    ids=["Lambert", "by nodes"],
)
def test_a_lamp_near_the_ground_lights_each_point_from_its_own_side(tmp_path, surface, law):
    """Irradiance by the inverse square of each point's distance, direction by the lamp's place: E (D/d)² cos i."""
    pair, view = lit(
        tmp_path,
        {"sun_distance_m": 2.0, "sun_elevation_deg": 35.0, "sun_azimuth_deg": 120.0, "sun_angular_diameter_deg": 0.0},
        {"quality": {"samples": 16}, "surface": surface},
    )
    camera, pose = pair.camera, np.array(pair.data["poses_camera_to_world"]["left"])
    u, v = (
        (np.arange(n) + 0.5 - c) / camera.focal_px
        for n, c in ((camera.width_px, camera.cx_px), (camera.height_px, camera.cy_px))
    )
    ray = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)
    point = (ray * view.depth[..., None]) @ pose[:3, :3].T + pose[:3, 3]
    sun = pair.data["light"]["sun"]
    assert sun["distance_m"] == 2.0
    assert sun["irradiance_wm2"] == pytest.approx(14.82)
    way, eye = np.array(sun["direction_to_world"]) * 2.0 - point, pose[:3, 3] - point
    far = np.linalg.norm(way, axis=-1)
    i, e = np.arccos(way[..., 2] / far), np.arccos(eye[..., 2] / np.linalg.norm(eye, axis=-1))
    azimuth = np.abs(
        np.angle(np.exp(1j * (np.arctan2(way[..., 1], way[..., 0]) - np.arctan2(eye[..., 1], eye[..., 0]))))
    )
    expected = 14.82 * (2.0 / far) ** 2 * law(i, e, azimuth)
    assert far.max() / far.min() > 1.3  # a Sun far away would be off by 1.7 times
    # A pixel spans 3 % of the distance to the lamp; its mean is that of its centre but for the curvature, 1e-3.
    assert view.radiance.mean(axis=-1) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("part", "word"),
    [
        ({"light": {"planet": True}}, "without a date or a planet"),
        ({"surface": {"model": "HAPKE"}}, "to NODES"),
        ({"surface": {"model": "SNOW"}, "hapke": {"backend": "OSL"}}, "to NODES"),
    ],
)
def test_what_a_lamp_near_the_ground_cannot_light_is_refused(part, word):
    near = {"light": {"sun_distance_m": 2.0, **part.get("light", {})}}
    assert any(word in reason for reason in find_reasons_in_settings(complete(part, near)))
    assert not find_reasons_in_settings(complete(part, {"hapke": {"backend": "NODES"}}))


def test_the_planet_is_seen_where_it_stands_as_big_and_bright_as_it_is(tmp_path):
    light = SATURN | NIGHT
    pair, _ = render(
        tmp_path,
        LAMBERT,
        {
            "light": light,
            "quality": {"samples": 16},
            "rig": {"pitch_deg": -50.0, "heading_deg": 20.0, "width_px": 320, "height_px": 240},
        },
    )
    view, camera = read_view(pair.image("left")), pair.camera
    assert set(np.unique(view.semantic)) == {0, PLANET}
    on = view.semantic == PLANET
    width = on[camera.height_px // 2].sum() / camera.focal_px  # tangents of half the angle, twice
    assert 2 * math.degrees(math.atan(width / 2)) == pytest.approx(29.33, abs=0.5)  # three pixels
    assert np.isnan(find_scene_depth(view)).all()
    x = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    y = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    cosine = 1 / np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    # The disc as the camera sees it sheds on a facing surface what the integral says: pixels times their solid angle.
    seen = (view.radiance.mean(axis=-1) * cosine**4 / camera.focal_px**2).sum()
    assert seen == pytest.approx(irradiance_wm2(compute_sky(pair.settings.light).planet), rel=3e-3)
    # The terminator: the Sun is 30° below the southern horizon, so the planet's upper side is the bright one.
    rows = np.nonzero(on.any(axis=1))[0]
    upper, lower = (view.radiance[row][on[row]].mean() for row in (rows[8], rows[-8]))
    assert upper > 1.5 * lower


def test_sun_and_planet_add_up_to_the_image(tmp_path):
    pair, _ = render(tmp_path, {"light": SATURN | {"sun_elevation_deg": 10.0}, "rocks": {"coverage": 0.1}})
    for eye in ("left", "right"):
        view = read_view(pair.image(eye))
        assert view.groups["Sun"].max() > 0
        assert view.groups["Planet"].max() > 0
        total = sum(view.groups.values())
        assert np.abs(total - view.radiance).max() <= 1e-5 * view.radiance.max()
    assert set(np.unique(view.semantic)) <= {0, TERRAIN, 2, PLANET}


@pytest.mark.heavy
@pytest.mark.parametrize("accuracy", [pytest.param("FAST", marks=pytest.mark.long), "ACCURATE"])
def test_sun_and_planet_add_up_on_ice_that_traces_the_sun_itself(tmp_path, accuracy):
    pair, _ = render(
        tmp_path,
        {
            "light": SATURN | {"sun_elevation_deg": 10.0},
            "surface": {"model": "HAPKE"},
            "hapke": {"accuracy": accuracy},
            "rocks": {"coverage": 0.05},
        },
    )
    view = read_view(pair.image("left"))
    assert np.abs(sum(view.groups.values()) - view.radiance).max() <= 1e-5 * view.radiance.max()
    ground = view.semantic == TERRAIN
    assert view.groups["Sun"][ground].mean() > 5 * view.groups["Planet"][ground].mean() > 0


def test_a_scene_with_one_light_has_no_groups_and_a_lander_brings_them(tmp_path):
    pair, built = render(tmp_path, LAMBERT)
    assert read_view(pair.image("left")).groups == {}
    assert not built.several_lights


@pytest.mark.parametrize(
    "planet", [{"planet_elevation_deg": -15.0}, {"planet_angular_diameter_deg": 0.0}, {"planet_albedo": 0.0}]
)
def test_a_planet_that_is_down_or_dark_gives_nothing(tmp_path, planet):
    _, view = lit(tmp_path, SATURN | NIGHT | planet, {"quality": {"samples": 16}})
    assert view.radiance.max() == 0


@pytest.mark.parametrize(("elevation", "azimuth", "phase"), [(-50.0, 200.0, 0.0), (50.0, 20.0, 180.0)])
def test_full_and_new(tmp_path, elevation, azimuth, phase):
    light = SATURN | {"sun_elevation_deg": elevation, "sun_azimuth_deg": azimuth}
    pair, view = lit(tmp_path, light, {"quality": {"samples": 64}})
    assert pair.data["light"]["planet"]["phase_deg"] == pytest.approx(phase, abs=1e-3)
    assert np.isfinite(view.radiance).all()
    if phase:
        assert view.radiance.max() == 0  # the planet hides the Sun and shows its night
    else:
        assert view.radiance.mean() == pytest.approx(
            compute_sky(pair.settings["light"]).ground_irradiance_wm2[1] * 0.8 / math.pi, rel=2e-3
        )


def test_of_a_planet_on_the_horizon_the_upper_half_shines_and_is_seen(tmp_path):
    light = SATURN | NIGHT | {"planet_elevation_deg": 0.0, "latitude_deg": 90.0}
    pair, view = lit(tmp_path, light, {"quality": {"samples": 256}})
    expected = compute_sky(pair.settings["light"]).ground_irradiance_wm2[1]
    # Of the lamp half is below the ground, and what is above falls at a slant: twice the noise of a planet that is up.
    assert view.radiance.mean() == pytest.approx(expected * 0.8 / math.pi, rel=2e-3)
    pair, _ = render(tmp_path, LAMBERT, {"light": light, "rig": {"pitch_deg": 0.0, "heading_deg": 20.0}})
    rows = np.nonzero((read_view(pair.image("left")).semantic == PLANET).any(axis=1))[0]
    focal = pair.camera.focal_px
    assert rows.max() == pytest.approx(pair.camera.cy_px, abs=1.5)  # the ground ends 20 m away, 4.6° down
    polar = 0.902 * math.tan(math.radians(29.33 / 2))
    assert (rows.max() - rows.min()) / focal == pytest.approx(polar, abs=2 / focal)


def test_a_dark_sky_is_said_with_its_mend():
    def said(light):
        return " ".join(scenes.build_scene(empty_scene(), complete({"light": light})).warnings)

    assert "raise light.sun_elevation_deg" in said(NIGHT)
    assert "hides the Sun" in said(SATURN | {"sun_elevation_deg": 50.0, "sun_azimuth_deg": 20.0})
    dated = {"directions_from": "DATE", "body": "ENCELADUS", "latitude_deg": 0.0, "longitude_deg": 0.0}
    eclipsed = "2038-06-02T08:00:00"
    assert compute_sky(complete({"light": dated | {"date_utc": eclipsed}}).light).eclipse == 1
    assert "light.date_utc" in said(dated | {"date_utc": eclipsed})
    assert not said(SATURN | {"sun_elevation_deg": 10.0})
    assert not said({"sun_elevation_deg": 0.01})


def test_what_the_planet_hides_of_the_sun_the_ground_lacks(tmp_path):
    light = {
        "planet": True,
        "planet_elevation_deg": 30.0,
        "planet_azimuth_deg": 60.0,
        "sun_elevation_deg": 30.01,
        "planet_angular_diameter_deg": 0.05,
        "planet_albedo": 0.0,
    }
    pair, view = lit(tmp_path, light, {"quality": {"samples": 16}})
    hidden = pair.data["light"]["sun"]["eclipse"]
    assert 0.3 < hidden < 0.9
    expected = (1 - hidden) * 14.82 * math.sin(math.radians(30.01)) * 0.8 / math.pi
    assert view.radiance.mean() == pytest.approx(expected, rel=1e-3)


def turn_by_hand(lamp) -> None:
    lamp.rotation_euler = (0.0, math.radians(40.0), 0.0)  # toward the east, 50 degrees up
    lamp.data.energy = 10.0


@pytest.mark.parametrize(
    ("light", "source"),
    [
        ({"sun_elevation_deg": 20.0, "planet": False}, "ANGLES"),
        (
            {
                "directions_from": "DATE",
                "body": "ENCELADUS",
                "date_utc": "2027-03-01T12:00:00",
                "latitude_deg": 10.0,
                "longitude_deg": 20.0,
                "planet": False,
            },
            "DATE",
        ),
        (
            {
                "planet": True,
                "planet_elevation_deg": 30.0,
                "planet_azimuth_deg": 60.0,
                "sun_elevation_deg": 30.01,
                "planet_angular_diameter_deg": 0.05,
                "planet_albedo": 0.0,
            },
            "ANGLES",
        ),
        ({"sun_elevation_deg": 20.0, "planet": False}, "HAND"),
        ({"directions_from": "DATE", "body": "ENCELADUS", "date_utc": "2027-03-01T12:00:00", "planet": False}, "HAND"),
    ],
    ids=["angles", "date", "half hidden", "by hand", "date, by hand"],
)
def test_the_record_states_the_sun_that_the_images_have(tmp_path, light, source):
    """Lambert's law on a level plane turns the light of the images into the Sun's irradiance on level ground."""
    settings = complete(LAMBERT, DOWN, {"light": light, "quality": {"samples": 16}})
    scene = empty_scene()
    built = scenes.build_scene(scene, settings)
    if source == "HAND":
        turn_by_hand(built.sun)
    (folder,) = render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    pair = read_pair(folder)
    sun, radiance = pair.data["light"]["sun"], read_view(pair.image("left")).radiance.mean()
    assert sun["source"] == source
    assert sun["ground_irradiance_wm2"] == pytest.approx(radiance * math.pi / 0.8, rel=1e-3)
    up = sun["direction_to_world"][2]
    assert math.sin(math.radians(sun["elevation_deg"])) == pytest.approx(up, abs=1e-9)
    assert sun["ground_irradiance_wm2"] == pytest.approx(sun["irradiance_wm2"] * up)
    if source == "HAND":
        assert (sun["elevation_deg"], sun["azimuth_deg"]) == pytest.approx((50.0, 90.0), abs=1e-4)
        assert sun["irradiance_wm2"] == pytest.approx(10.0)
    else:
        assert sun["elevation_deg"] == pytest.approx(compute_sky(settings.light).sun_elevation_deg, abs=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("diameter", [0.5, 2.0])
def test_a_penumbra_is_as_wide_as_the_sun(tmp_path, diameter):
    """A wall's shadow under the Sun at 45°: from full light to none over the diameter seen from the wall's top."""
    import bpy

    settings = complete(
        LAMBERT,
        {
            "light": {
                "sun_elevation_deg": 45.0,
                "sun_azimuth_deg": 90.0,
                "sun_angular_diameter_deg": diameter,
                "sun_irradiance_wm2": 10.0,
            },
            "quality": {"samples": 256},
            "rig": {"pitch_deg": 90.0, "width_px": 128, "height_px": 16, "height_m": 0.6},
        },
    )
    scene = empty_scene()
    built = scenes.build_scene(scene, settings)
    height = 5.0
    wall = bpy.data.meshes.new("Wall")  # its top edge runs north at x = 5 m, so its shadow ends at x = 0
    wall.from_pydata([(height, -9, 0), (height, 9, 0), (height, 9, height), (height, -9, height)], [], [(0, 1, 2, 3)])
    built.collection.objects.link(bpy.data.objects.new("Wall", wall))
    pair = read_pair(render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)[0])
    view = read_view(pair.image("left"))
    level = view.groups["Sun"].mean(axis=(0, 2)) / (10.0 * math.sin(math.radians(45)) * 0.8 / math.pi)
    x = (np.arange(128) + 0.5 - 64) / pair.camera.focal_px * 0.6
    # A circle cut by a straight edge: the share that is lit is that of a circular segment.
    radius = math.radians(diameter / 2)
    along = np.clip(np.arctan2(height, height - x) - math.pi / 4, -radius, radius) / radius
    expected = 0.5 + (along * np.sqrt(1 - along**2) + np.arcsin(along)) / math.pi
    # The light falls on the side away from the Sun's: x < 0 is lit last.
    expected = min((expected, expected[::-1]), key=lambda e: np.abs(level - e).max())
    assert np.abs(level - expected).max() < 0.05

    # Its width, as the scatter of the slope about the edge: a disc's is half its radius. Within 4 %, a pixel or two.
    def scatter(profile):
        slope = np.abs(np.diff(profile))
        middle = (slope * np.arange(127)).sum() / slope.sum()
        return math.sqrt((slope * (np.arange(127) - middle) ** 2).sum() / slope.sum())

    assert scatter(np.clip(level, 0, 1)) == pytest.approx(scatter(expected), rel=0.04)


def test_planet_and_world_are_replaced_and_cleared():
    import bpy

    scene = empty_scene()
    for _ in "12":
        built = scenes.build_scene(scene, complete({"light": SATURN}))
        assert [item.name for item in bpy.data.objects if "Planet" in item.name] == [
            "Icy Moon Planet",
            "Icy Moon Planetshine",
        ]
        assert len(bpy.data.worlds) == 1
        assert not built.edited
    built = scenes.build_scene(scene, complete())
    assert not [m for m in bpy.data.materials if "Planet" in m.name]
    scenes.clear_scene(scene)
    assert not bpy.data.objects


def test_the_panel_says_what_is_in_the_sky_and_what_the_camera_resolves():
    from icymoon.operators import sidebar_text

    light = complete({"light": SATURN | {"sun_elevation_deg": 20.0}}).light
    text = "\n".join(sidebar_text.list_sky_lines(light))
    assert "Sun 20.00° high, azimuth 60.00°\n    0.0556° wide\n    14.8 W/m², 5.07 on flat ground" in text
    assert "Planet 50.00° high, azimuth 20.00°\n    29.3° wide, phase" in text
    assert not sidebar_text.find_sky_fault(light)
    undated = light | {"directions_from": "DATE", "date_utc": "soon"}
    assert "light.date_utc" in sidebar_text.find_sky_fault(undated)
    assert sidebar_text.list_sky_lines(undated) == ()
    assert max(map(len, sidebar_text.list_sky_lines(light))) <= 40
    rig = complete().rig | {"width_px": 640, "height_px": 480}
    lines = sidebar_text.list_rig_lines(rig)
    assert lines[:3] == ("Field of view 86.3° x 70.2°", "Focal length 341.3 px", "Depth × disparity 85.33 px·m")
    # 1.6 m above the ground, 45.84° down: 2.23 m deep in the middle, 2.23² x 0.25 / 85.333 = 1.5 cm.
    assert "Middle 2.23 m ± 1.5 cm" in lines
    assert "Far edge above the horizon" in sidebar_text.list_rig_lines(rig | {"pitch_deg": 10.0})


def test_a_camera_that_was_toed_in_or_focused_by_hand_is_refused(tmp_path):
    settings = complete(LAMBERT)
    built = scenes.build_scene(empty_scene(), settings)
    built.camera.data.stereo.convergence_mode = "TOE"
    with pytest.raises(IcyMoonError, match="Parallel"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    built.camera.data.stereo.convergence_mode = "PARALLEL"
    built.camera.data.dof.use_dof = True
    with pytest.raises(IcyMoonError, match="depth of field"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    built.camera.data.dof.use_dof = False
    for name, value, setting in (
        ("lens", 33.0, "rig.focal_length_mm"),
        ("shift_y", 0.01, "rig.principal_y_px"),
        ("type", "ORTHO", "rig.focal_length_mm"),
    ):
        before = getattr(built.camera.data, name)
        setattr(built.camera.data, name, value)
        with pytest.raises(IcyMoonError, match=setting):
            render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
        setattr(built.camera.data, name, before)
    built.camera.data.stereo.interocular_distance = 0.3
    with pytest.raises(IcyMoonError, match=r"rig\.baseline_m"):
        render_pairs(built, expand_headings(settings), tmp_path, 1, 0.0, lambda *a, **k: None)
    assert not list(tmp_path.iterdir())


def test_the_preview_moves_the_planet_and_takes_it_away():
    import bpy

    scene = empty_scene()
    built = scenes.build_scene(scene, complete({"light": SATURN}))
    for change in ({"planet_azimuth_deg": 200.0}, {"sun_elevation_deg": -20.0}, {"planet": False}):
        settings = complete({"light": SATURN | change})
        preview.show_settings(built, settings, 65)
        fresh = scenes.Built(built.collection, built.terrain, built.sun, built.camera, settings, scene)
        assert preview.read_notes(scene) == []
        assert not built.edited
        assert fresh.sky == describe_sky(compute_sky(settings.light))
        assert [o.name for o in bpy.data.objects if "Planet" in o.name] == (
            [] if "planet" in change else ["Icy Moon Planet", "Icy Moon Planetshine"]
        )
    preview.show_settings(built, complete({"light": {"directions_from": "DATE", "date_utc": "soon"}}), 65)
    assert "light.date_utc" in preview.read_notes(scene)[0]


def test_a_pair_is_named_by_what_its_kernels_hold(tmp_path):
    from icymoon.nodes.datablocks.blend_file_paths import hash_content, make_paths_absolute

    described = complete({"light": {"directions_from": "KERNELS", "kernels": str(tmp_path)}})
    (tmp_path / "a.tls").write_text("one")
    first = hash_content(described)
    (tmp_path / "a.tls").write_text("two, longer")
    assert hash_content(described) != first
    assert hash_content(complete({"light": {"kernels": str(tmp_path)}})) == ""  # which the angles do not need
    assert make_paths_absolute(described).light.kernels == str(tmp_path)
    with pytest.raises(IcyMoonError, match=r"light\.kernels"):
        hash_content(complete({"light": {"directions_from": "KERNELS", "kernels": str(tmp_path / "none")}}))
