"""Every number at its limits, alone and in random combinations, from the build to the report; and named extremes."""

from __future__ import annotations

import json
import math
import warnings

import bpy
import extremes
import numpy as np
import pytest
from extremes import SHORT_AND_LONG, SWITCHED_ON_BY, complete, drawn, faults, is_sentence, numbers, rays, shot, story
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.nodes.surface.patches_and_grain import ELEVATION
from icymoon.physics.surfaces.photometry import LOMMEL_SEELIGER_BOND
from icymoon.render.pairs.pair_folder import EYES
from icymoon.settings import description
from icymoon.settings.blender import scene_properties
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.images.views import read_eye
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.prepare_pair import prepare_pair
from icymoon.support.errors import IcyMoonError
from icymoon.support.labels import PLANET, TERRAIN
from rendering import empty_scene

#: Charts of extremes are drawn in ``tests/stereo/test_extremes.py``.
pytestmark = pytest.mark.usefixtures("undrawn")
#: Random descriptions that every run tries, and those of a slow one.
FEW, MANY = 8, 40  # a description takes ten seconds of two processors
#: Share of the random descriptions that may be refused, so that the others still show something.
MAX_REFUSED = 0.5
GRID, GRADED = {"mesh": {"kind": "GRID"}}, {"mesh": {"kind": "GRADED"}}
FLAT = {"terrain": {"rms_slope_deg": 0.0}, "surface": {"grain_amplitude_m": 0.0}}
ZENITH = {"light": {"sun_elevation_deg": 90.0}, "rig": {"pitch_deg": 90.0}}
LAMBERT = {"surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0}}


def fine(settings, folder):
    """The pair and the built scene of a description, with nothing wrong from the build to the report."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # of numpy: what is not a number
        pair, built = shot(settings, folder)
        found = faults(pair, built, folder / "report")
    assert not found, f"{'; '.join(found)}\n\n{story(settings)}"
    return pair, built


def refused(settings, folder):
    """Whether a description is refused in a sentence; if it is not, nothing is wrong with it."""
    said = ""
    try:
        fine(settings, folder)
    except IcyMoonError as refusal:
        said = str(refusal)
    assert not said or is_sentence(said), f"{said}\n\n{story(settings)}"
    return bool(said)


def some(seeds, folder):
    without = [seed for seed in seeds if refused(complete(drawn(seed)), folder / str(seed))]
    assert len(without) <= MAX_REFUSED * len(seeds), without


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("first", range(0, FEW, 8))
def test_random_settings_at_their_limits(tmp_path, first):
    some(range(first, first + 8), tmp_path)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("first", range(FEW, MANY, 16))
def test_many_random_settings_at_their_limits(tmp_path, first):
    some(range(first, first + 16), tmp_path)


def test_blender_holds_every_limit_as_it_is_stated():
    group = empty_scene().icymoon
    for bound in ("minimum", "maximum"):
        limits = {}
        for topic, setting in list_all_settings():
            if setting.kind in ("int", "float"):
                value = getattr(setting, bound)
                limits.setdefault(topic, {})[setting.key] = int(value) if setting.kind == "int" else value
        stated = description.check(limits, "test")
        scene_properties.write_settings(group, stated)
        held = scene_properties.read_settings(group)
        assert {topic: {key: held[topic][key] for key in values} for topic, values in stated.items()} == stated


def _alone(topic, setting, bound):
    """The description with one setting at a limit, what it belongs to switched on, no length contradicting another."""
    value = getattr(setting, bound)
    on = {topic: dict([SWITCHED_ON_BY[topic]])} if topic in SWITCHED_ON_BY else {}
    both = {
        topic: {
            key: value
            for of, short, long in SHORT_AND_LONG
            for key in (short, long)
            if of == topic and (setting.key, bound) in ((short, "maximum"), (long, "minimum"))
        }
    }
    moves = setting.key.startswith(("speed_", "turn_", "roll_")) and topic == "rig"
    # Of a second that a motion of 10 km/s or 10^4 degrees/s lasts, the image shows nothing.
    seen = {"rig": {"motion_exposure_s": 0.008}} if moves else {}
    return complete(on, both, seen, {topic: {setting.key: int(value) if setting.kind == "int" else value}})


def _limits(of, *effects):
    return [
        pytest.param(topic, setting, bound, id=f"{topic}.{setting.key}-{bound}")
        for topic, setting in numbers()
        if setting.effect in effects and topic in of
        for bound in ("minimum", "maximum")
    ]


def _half_of(limits):
    """The limits, of which CI tries the maximum of every other setting; `make test-all` tries all."""
    return [
        pytest.param(*limit.values, id=limit.id, marks=() if number % 4 == 1 else pytest.mark.long)
        for number, limit in enumerate(limits)
    ]


_TOO_MANY_CRATERS = (
    ("coverage", "maximum"),
    ("smallest_m", "minimum"),
    ("largest_m", "minimum"),
    ("largest_m", "maximum"),
)
#: What is refused, and what the sentence names: more craters than ``craters.most``, rocks larger than any of the
#: default ground, and cameras in the ground.
_REFUSED = {
    **{("craters", key, bound): r"craters\.coverage" for key, bound in _TOO_MANY_CRATERS},
    ("rocks", "smallest_m", "maximum"): r"rocks\.coverage",
    ("rig", "height_m", "minimum"): r"rig\.height_m",
    ("terrain", "slope_baseline_m", "maximum"): r"rig\.height_m",
}


def _check_build(settings):
    built = scenes.build_scene(empty_scene(), settings)
    for item in built.collection.all_objects:
        assert extremes.is_finite(item), item.name
    assert not extremes.unused(built)


@pytest.mark.ci_takes(6)
@pytest.mark.heavy
@pytest.mark.parametrize(
    ("topic", "setting", "bound"), _half_of(_limits(("mesh", "rig", "terrain"), "geometry", "camera"))
)
def test_no_limit_breaks_a_build_that_follows_the_camera(topic, setting, bound):
    _check_build(description.merged(_alone(topic, setting, bound), GRADED))


@pytest.mark.ci_takes(4)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "setting", "bound"), _half_of(_limits(TOPICS, "geometry", "material", "light", "camera", "sampling"))
)
def test_no_limit_breaks_a_pair(tmp_path, topic, setting, bound):
    """Nothing is wrong from the build to the report, or a sentence names the setting that is too much."""
    settings = description.merged(_alone(topic, setting, bound), GRID)
    if name := _REFUSED.get((topic, setting.key, bound)):
        with pytest.raises(IcyMoonError, match=name):
            shot(settings, tmp_path)
    else:
        fine(settings, tmp_path)


@pytest.mark.long
def test_no_limit_of_the_response_breaks_an_image(tmp_path):
    """One pair, developed again with each limit; a lens that folds the image over itself is refused."""
    pair, _ = shot(complete({"rig": {"width_px": 40, "height_px": 24}}), tmp_path)
    response = [(topic, s) for topic, s in list_all_settings() if s.effect == "response" and s.kind in ("int", "float")]
    for topic, setting in response:
        for value in (setting.minimum, setting.maximum):
            value = int(value) if setting.kind == "int" else value
            prepared, said = None, ""
            try:
                prepared = prepare_pair(pair.folder, {topic: {setting.key: value}})
            except IcyMoonError as refusal:
                said = str(refusal)
            if prepared is None:
                assert f"{topic}.{'distortion_k1' if setting.key.startswith('distortion') else setting.key}" in said
                continue
            assert prepared.left.shape == prepared.right.shape == (24, 40)
            json.dumps(prepared.facts, allow_nan=False)


# What was asked for by name.


def depth_of_sphere(pair, eye, radius_m):
    """Planar depth (H, W) of a smooth body that the plane z = 0 touches at the origin, NaN above its horizon."""
    start, toward = rays(pair, eye)
    # |start + t toward - (0, 0, -R)|² = R², the nearer root, without the difference of nearly equal numbers.
    a, half_b = (toward**2).sum(axis=-1), toward @ (start + np.array([0.0, 0.0, radius_m]))
    c = start[:2] @ start[:2] + start[2] * (start[2] + 2 * radius_m)
    inside = half_b**2 - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((inside > 0) & (half_b < 0), c / (np.sqrt(np.maximum(inside, 0.0)) - half_b), np.nan)


@pytest.mark.parametrize("height_m", [1e-3, 1e4])
def test_the_camera_a_millimetre_and_ten_kilometres_above_flat_ground(tmp_path, height_m):
    settings = complete(
        GRADED, FLAT, {"rig": {"height_m": height_m}, "mesh": {"farthest_m": 1e6, "edge_px": 0.5, "most": 50_000}}
    )
    pair, built = fine(settings, tmp_path)
    for eye in EYES:
        _, view = read_eye(pair, eye)
        truth = depth_of_sphere(pair, eye, settings.terrain.body_radius_m)
        seen = np.isfinite(view.depth) & np.isfinite(truth)
        assert np.mean(np.isfinite(view.depth) != np.isfinite(truth)) < 0.02
        assert seen.mean() > 0.5
        # Edges of half a pixel, here up to 7 degrees, lie under the body's roundness; rays and heights keep 7 digits.
        assert np.median(np.abs(view.depth / truth - 1)[seen]) < 1e-4
    assert not [text for text in built.warnings if "rounded" in text]


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("mesh", [GRID, GRADED], ids=["grid", "graded"])
@pytest.mark.parametrize("size_m", [0.01, 1e5])
def test_ground_of_a_centimetre_and_of_a_hundred_kilometres(tmp_path, mesh, size_m):
    """The same scene at another scale: it looks the same, and all its depths are scaled."""
    depth = {}
    for size in (size_m, 20.0):
        scale = size / 20.0
        settings = complete(
            mesh,
            LAMBERT,
            {
                "terrain": {
                    "size_m": size,
                    "outer_scale_m": 8.0 * scale,
                    "inner_scale_m": 0.6 * scale,
                    "slope_baseline_m": 2.0 * scale,
                    "body_radius_m": 1e8,
                },
                "rig": {"height_m": 2.0 * scale, "baseline_m": min(0.2 * scale, 100.0)},
            },
        )
        pair, _ = fine(settings, tmp_path / str(size))
        depth[size] = read_eye(pair, "left")[1].depth / scale
    seen = np.isfinite(depth[20.0]) & np.isfinite(depth[size_m])
    assert seen.mean() > 0.5
    # Noise is a hash of the lattice cell, whose number does not depend on the scale. A graded mesh of few vertices
    # differs, as the baseline, of 100 m at most, is another share of the scene.
    assert np.median(np.abs(depth[size_m] / depth[20.0] - 1)[seen]) < (1e-4 if mesh is GRID else 0.05)


@pytest.mark.parametrize("relief_m", [0.0, 1e4])
def test_no_relief_and_ten_kilometres_of_it(tmp_path, relief_m):
    layer = {"basis": "GRADIENT", "amplitude_m": relief_m / 4, "scale_m": 4e4, "octaves": 4}
    settings = complete(
        GRID, {"terrain": {"size_m": 1e5, "rms_slope_deg": 0.0, "layers": [layer]}, "rig": {"height_m": 1000.0}}
    )
    _, built = fine(settings, tmp_path)
    heights = extremes.vertices(built.terrain.data)[:, 2]
    assert np.ptp(heights) == 0.0 if relief_m == 0 else np.ptp(heights) > relief_m / 2


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize("albedo", [0.0, 1.0])
@pytest.mark.parametrize("model", ["PRINCIPLED", "LAMBERT", "LOMMEL_SEELIGER", "LUNAR_LAMBERT", "HAPKE"])
def test_black_and_white_ground(tmp_path, model, albedo):
    """w of Hapke's law, else the albedo; seen from above with the Sun at the zenith, no more comes back than falls."""
    settings = complete(
        GRID,
        FLAT,
        ZENITH,
        {
            "surface": {"model": model, "albedo": albedo, "specular": 0.0},
            "rig": {"focal_length_mm": 2000.0},
            "hapke": {"w": albedo, "theta_bar_deg": 0.0, "b": 0.0, "b_s0": 0.0},
        },
    )
    pair, built = fine(settings, tmp_path)
    light, view = read_eye(pair, "left")
    assert (view.semantic == TERRAIN).all()
    if albedo == 0:
        assert not light.radiance.any()
        assert extremes.why_black(built, pair, view, "left") == "the surface reflects nothing"
        return
    factor = light.radiance * math.pi / settings.light.sun_irradiance_wm2
    # Of grains H(1)²/8, and H of 1981 is 3 there; of the simple laws Bond albedo 1 is this normal albedo.
    expected = {
        "HAPKE": 9 / 8,
        "LOMMEL_SEELIGER": 1 / LOMMEL_SEELIGER_BOND,
        "LUNAR_LAMBERT": 1 / (0.3 + 0.7 * LOMMEL_SEELIGER_BOND),
    }.get(model, 1.0)
    # The field is 3.4 degrees wide; Principled's table is good to a per cent.
    np.testing.assert_allclose(factor, expected, rtol=0.01 if model == "PRINCIPLED" else 2e-3)


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("backend", ["OSL", "NODES"])
@pytest.mark.parametrize("theta_bar_deg", [0.0, 60.0])
def test_smooth_and_rough_grains(tmp_path, backend, theta_bar_deg):
    settings = complete(
        {
            "surface": {"model": "HAPKE"},
            "hapke": {
                "theta_bar_deg": theta_bar_deg,
                "backend": backend,
                "accuracy": "REFERENCE" if backend == "OSL" else "FAST",
            },
        }
    )
    fine(settings, tmp_path)


@pytest.mark.parametrize("elevation_deg", [90.0, 0.0, -0.03, -90.0])
def test_the_sun_at_the_zenith_on_the_horizon_and_below(tmp_path, elevation_deg):
    """Flat ground of albedo 0.9; the Sun's disc, 0.0556 degrees wide, is up to -0.0278."""
    settings = complete(GRID, FLAT, LAMBERT, ZENITH, {"light": {"sun_elevation_deg": elevation_deg}})
    pair, built = fine(settings, tmp_path)
    radiance = read_eye(pair, "left")[0].radiance
    if elevation_deg == 90.0:
        assert radiance == pytest.approx(0.9 / math.pi * settings.light.sun_irradiance_wm2, rel=1e-3)
    if elevation_deg < -0.0278:
        assert not radiance.any()
        assert any("Neither Sun nor planet" in text for text in built.warnings)
    else:
        # Never more than of a Sun half a disc higher; Blender 5.2 has normals of 16 bits, 2.2e-5 rad off.
        highest = math.sin(math.radians(max(elevation_deg, 0.0) + 0.0278)) + 2.2e-5
        assert radiance.max() <= 1.001 * 0.9 / math.pi * settings.light.sun_irradiance_wm2 * min(highest, 1.0)


@pytest.mark.parametrize("width_px", [1, 3])
def test_an_image_too_small_for_blender_is_refused(width_px):
    with pytest.raises(IcyMoonError, match=r"rig\.width_px is \d px, outside 4 to 16384 px\."):
        complete({"rig": {"width_px": width_px}})


@pytest.mark.timeout(360)  # narrow images take Cycles 20 s and more of a whole core
@pytest.mark.parametrize("size", [(4, 4), (4096, 16), pytest.param((4, 4096), marks=pytest.mark.long)])
def test_the_smallest_image_and_long_ones(tmp_path, size):
    settings = complete({"rig": {"width_px": size[0], "height_px": size[1], "overscan": 0.0}, "mesh": {"most": 1000}})
    fine(settings, tmp_path)


def _far_mesh(path, offset_m):
    """A hilly mesh, PLY in double precision, its coordinates so far east and north of the origin."""
    axis = np.linspace(-10.0, 10.0, 33)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    z = 0.3 * np.sin(x) * np.cos(0.7 * y)
    corner = (np.arange(32)[:, None] * 33 + np.arange(32)).ravel()
    faces = np.stack([corner, corner + 1, corner + 34, corner + 33], axis=1)
    lines = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(x)}",
        *(f"property double {k}" for k in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    lines += [
        f"{a + offset_m!r} {b + offset_m!r} {c!r}" for a, b, c in zip(*map(np.ndarray.tolist, (x, y, z)), strict=True)
    ]
    lines += ["4 " + " ".join(map(str, face)) for face in faces.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return {"source": {"kind": "MESH", "file": str(path)}}


def test_a_mesh_a_thousand_kilometres_from_its_origin(tmp_path):
    """Centred it is what it is near the origin; where it is left, the camera has no ground, and that is said."""
    near, far = _far_mesh(tmp_path / "near.ply", 0.0), _far_mesh(tmp_path / "far.ply", 1e6)
    at = {}
    for name, parts in {
        "near": near,
        "far": far,
        "moved": {"source": {**far["source"], "centre": False, "origin_x_m": 1e6, "origin_y_m": 1e6}},
    }.items():
        settings = complete(parts)
        at[name] = extremes.vertices(fine(settings, tmp_path / name)[1].terrain.data)
    for name in ("far", "moved"):
        # The file's numbers have 52 bits: 1e6 m to 1e-10 m.
        np.testing.assert_allclose(at[name][:, :2], at["near"][:, :2], atol=1e-6)
    left = complete(far, {"source": {"centre": False}})
    _, built = fine(left, tmp_path / "left")
    assert any("no ground under the camera" in text for text in built.warnings)


@pytest.mark.parametrize(("x_m", "told"), [(100.0, False), (1000.0, False), (1e4, True), (5e4, True)])
def test_a_camera_far_from_the_origin_is_told_of(x_m, told):
    """With the default rig at 640 px; what is lost at each distance is in the manual."""
    built = scenes.build_scene(empty_scene(), complete({"rig": {"x_m": x_m, "width_px": 640, "height_px": 480}}))
    assert bool([text for text in built.warnings if "rounded" in text]) == told


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize("rig", [{"x_m": -5e4, "y_m": 5e4}, {"height_m": 1e4}], ids=str)
def test_the_sky_is_the_same_from_everywhere(tmp_path, rig):
    """Planet, rings and stars are at infinity for the cameras, wherever these stand."""
    sky = complete(
        {
            "light": {
                "planet": True,
                "planet_elevation_deg": 35.0,
                "planet_azimuth_deg": 5.0,
                "stars": True,
                "planet_rings": True,
                "latitude_deg": 20.0,
                "planet_phase_law": "SATURN",
            },
            "rig": {"width_px": 48, "height_px": 36, "pitch_deg": -30.0},
        }
    )
    views = []
    for k, parts in enumerate(({}, {"rig": rig})):
        pair, _ = shot(description.merged(sky, description.merged({"rig": sky.rig}, parts)), tmp_path / str(k))
        views.append(read_eye(pair, "right")[1].semantic == PLANET)
    assert views[0].sum() > 100
    assert np.count_nonzero(views[0] != views[1]) <= 2  # pixels whose centre the limb passes through


def test_dirt_in_the_troughs_of_round_ground_is_the_same_from_a_slider():
    """The ground's fall to the horizon is no trough."""
    dirty = complete(GRADED, {"surface": {"trough_dirt": 0.5}})

    def elevation(built):
        values = np.empty(len(built.terrain.data.vertices), np.float32)
        built.terrain.data.attributes[ELEVATION].data.foreach_get("value", values)
        return values

    wanted = elevation(scenes.build_scene(empty_scene(), dirty)).copy()
    built = scenes.build_scene(empty_scene(), complete(GRADED))
    preview.show_settings(built, dirty, 33)
    np.testing.assert_array_equal(elevation(scenes.find_built(bpy.context.scene)), wanted)


@pytest.mark.parametrize("rocks", [{"coverage": 0.0}, {"coverage": 0.3, "most": 0}], ids=["none", "none allowed"])
def test_no_rocks(tmp_path, rocks):
    settings = complete({"rocks": rocks})
    assert fine(settings, tmp_path)[1].rock_count == 0


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
def test_a_hundred_thousand_rocks(tmp_path):
    settings = complete(GRID, {"rocks": {"coverage": 0.3, "smallest_m": 0.02, "most": 100_000}})
    assert fine(settings, tmp_path)[1].rock_count == 100_000


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_finest_grid():
    _check_build(complete(GRID, {"terrain": {"resolution": 4097}}))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    "parts",
    [
        {"rig": {"overscan": 2.0}},
        {"quality": {"samples": 4096}},
        {"quality": {"diffuse_bounces": 128}},
        {"light": {"stars": True, "stars_faintest_mag": 8.0}, "rig": {"pitch_deg": -45.0}},
        {"craters": {"coverage": 0.1, "smallest_m": 0.03, "largest_m": 1.0, "most": 50_000}},
    ],
    ids=lambda p: str(p)[:60],
)
def test_what_only_costs_time(tmp_path, parts):
    fine(complete(parts), tmp_path)


@pytest.mark.parametrize("topic", sorted(SWITCHED_ON_BY))
def test_what_switches_a_topic_on_is_a_setting_of_it(topic):
    key, value = SWITCHED_ON_BY[topic]
    assert TOPICS[topic][key].default == 0.0 != value


def test_a_report_of_ground_that_reflects_nothing_says_nothing_of_its_phase_curve(tmp_path):
    pair, _ = shot(complete({"surface": {"model": "HAPKE"}, "hapke": {"w": 0.0}}), tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # of numpy: what is not a number
        evaluate([pair.folder], parse_methods("bm"), tmp_path / "out")
