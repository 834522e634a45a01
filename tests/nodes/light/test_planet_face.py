"""The planet in images, against rays that are cast by formulas of the test's own, and where it ends at the horizon."""

import math
from dataclasses import replace

import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.nodes import preview
from icymoon.physics.light.planet_face import face_tint
from icymoon.physics.light.planetshine import irradiance_wm2
from icymoon.physics.light.sky import compute_sky
from icymoon.stereo.images.exr import read_view
from icymoon.support.labels import PLANET
from planet_radiance import face_radiance
from rendering import complete, empty_scene, render

FLAT = {"terrain": {"rms_slope_deg": 0.0, "size_m": 40.0}, "mesh": {"kind": "GRID"}, "quality": {"samples": 16}}
#: Of a site in the plane of the rings only their shadow is seen, if they are Saturn's.
LIGHT = {
    "planet": True,
    "planet_angular_diameter_deg": 29.33,
    "planet_flattening": 0.098,
    "latitude_deg": 0.0,
    "planet_elevation_deg": 40.0,
    "planet_azimuth_deg": 90.0,
    "sun_elevation_deg": -30.0,
    "sun_azimuth_deg": 300.0,
}
RIG = {"width_px": 240, "height_px": 180, "pitch_deg": -40.0, "heading_deg": 90.0, "focal_length_mm": 80.0}


def cast(pair, rows, columns):
    """Unit vectors (..., 3) in the world through places of the left image, in pixels from its upper left corner."""
    camera = pair.camera
    x, y = (columns - camera.cx_px) / camera.focal_px, (rows - camera.cy_px) / camera.focal_px
    ray = np.stack(np.broadcast_arrays(x, y, np.ones(1)), axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    return ray @ np.array(pair.data["poses_camera_to_world"]["left"])[:3, :3].T


def rays(pair):
    """Unit vectors (H, W, 3) of the pixels in the world, and their solid angles."""
    camera = pair.camera
    ray = cast(pair, np.arange(camera.height_px)[:, None] + 0.5, np.arange(camera.width_px)[None, :] + 0.5)
    ahead = np.array(pair.data["poses_camera_to_world"]["left"])[:3, 2]
    return ray, (ray @ ahead) ** 3 / camera.focal_px**2


def nearest(shown, ray):
    """Distance (...) along rays (..., 3) to the globe, NaN beside it."""
    radius = math.sin(math.radians(shown.angular_diameter_deg / 2))
    shape = (np.eye(3) + ((1 - shown.flattening) ** -2 - 1) * np.outer(shown.pole, shown.pole)) / radius**2
    a, b = np.einsum("...i,ij,...j->...", ray, shape, ray), ray @ shape @ shown.direction
    with np.errstate(invalid="ignore"):
        return (b - np.sqrt(b**2 - a * (shown.direction @ shape @ shown.direction - 1))) / a


@pytest.mark.long
@pytest.mark.parametrize(("face", "rings"), [("PLAIN", True), ("SATURN", True), ("JUPITER", False)])
def test_the_image_of_the_planet_is_what_rays_find(tmp_path, face, rings):
    pair, _ = render(
        tmp_path,
        FLAT,
        {"rig": RIG, "light": LIGHT | {"planet_face": face, "planet_rings": rings, "planet_spot_longitude_deg": 10.0}},
    )
    view, shown = read_view(pair.image("left")), compute_sky(pair.settings.light).planet
    ray, solid_angle = rays(pair)
    distance = nearest(shown, ray)
    hit = np.isfinite(distance)
    truth = np.nan_to_num(face_radiance(shown, distance[..., None] * ray))
    # Pixels whose neighbours are all on the globe, without edges of the shadow, of belts and of the spot between them.
    neighbours = [np.roll(truth[..., 1], move, axis) for axis in (0, 1) for move in (-1, 1)]
    flat = np.ptp([truth[..., 1], *neighbours], axis=0) < 0.03 * truth.max()
    inner = hit & np.logical_and.reduce([np.roll(hit, move, axis) for axis in (0, 1) for move in (-2, 2)]) & flat
    assert inner.sum() > 2000
    off = np.abs(view.radiance - truth)[inner].max(axis=-1) / truth.max()
    # Ripples move Jupiter's edges by a third of a degree; elsewhere no pixel is off, at the terminator neither.
    assert np.mean(off > 0.01) < (0.08 if face == "JUPITER" else 0.001)
    seen = (view.radiance * (solid_angle * (ray @ shown.direction))[..., None]).sum(axis=(0, 1))
    assert seen == pytest.approx(irradiance_wm2(shown) * face_tint(shown), rel=5e-3)


def test_the_limb_has_no_stairs_at_few_light_paths_and_its_label_ends_on_it(tmp_path):
    light = LIGHT | {"sun_azimuth_deg": 180.0, "sun_elevation_deg": 0.0}  # at the right limb in its zenith
    pair, _ = render(tmp_path, FLAT, {"rig": RIG, "light": light, "quality": {"samples": 8}})
    view, shown = read_view(pair.image("left")), compute_sky(pair.settings.light).planet
    ray, _ = rays(pair)
    hit = np.isfinite(nearest(shown, ray))
    assert hit.sum() > 5000
    # A chord of the mesh is up to 4e-5 radii off, of about 120 px: the label is that of a globe 1e-4 larger or smaller.
    smaller, larger = (
        np.isfinite(nearest(replace(shown, angular_diameter_deg=shown.angular_diameter_deg * scale), ray))
        for scale in (1 - 1e-4, 1 + 1e-4)
    )
    assert (view.semantic == PLANET)[smaller].all()
    assert not (view.semantic == PLANET)[~larger].any()
    rows = np.arange(60, 121)  # where the limb is steep in the image
    last = np.array([np.flatnonzero(hit[row]).max() for row in rows])
    # Light of thirteen pixels about the limb, in pixels of full brightness, against forty rays for each.
    fine = (np.arange(13 * 40) + 0.5) / 40 - 6
    errors = []
    for row, column in zip(rows, last, strict=True):
        many = cast(pair, row + 0.5, column + fine)
        distance = nearest(shown, many)
        truth = np.nan_to_num(face_radiance(shown, distance[:, None] * many)[:, 0]).sum() / 40
        errors.append((view.radiance[row, column - 6 : column + 7, 0].sum() - truth) / view.radiance[..., 0].max())
    # A rim without width had 0.106 px here, the soft one 0.049 px.
    assert np.sqrt(np.mean(np.square(errors))) < 0.07
    assert abs(np.mean(errors)) < 0.02


def test_a_face_changes_the_colour_of_the_light_on_the_ground_but_not_its_amount():
    lamps = {}
    for face in ("PLAIN", "SATURN"):
        built = scenes.build_scene(empty_scene(), complete({"light": LIGHT | {"planet_face": face}}))
        lamp = next(item for item in built.collection.all_objects if item.name.endswith("Planetshine"))
        lamps[face] = lamp.data.energy, np.array(lamp.data.color)
    assert lamps["SATURN"][0] == lamps["PLAIN"][0]
    assert lamps["SATURN"][1].mean() == pytest.approx(lamps["PLAIN"][1].mean(), rel=1e-6)
    assert lamps["SATURN"][1][0] > 1.5 * lamps["SATURN"][1][2]


def test_the_planet_reaches_down_to_the_horizon_of_the_moon(tmp_path):
    light = LIGHT | {"planet_elevation_deg": 0.0}
    pair, built = render(
        tmp_path,
        FLAT,
        {
            "light": light,
            "terrain": {"body_radius_m": 10000.0},
            "rig": {"width_px": 64, "height_px": 240, "pitch_deg": 0.0, "heading_deg": 90.0, "sensor_width_mm": 3.0},
        },
    )
    rows = np.nonzero((read_view(pair.image("left")).semantic == PLANET).any(axis=1))[0]
    dip = math.acos(10000.0 / 10001.6)
    # The flat ground of the test ends lower: a planet cut at eye level would leave a black strip of 13 rows.
    expected = pair.camera.cy_px + pair.camera.focal_px * math.tan(dip)
    assert expected - pair.camera.cy_px > 12
    assert rows.max() + 0.5 == pytest.approx(expected, abs=1.0)
    # Raising the camera lowers the horizon, in the live view too.
    item = next(i for i in built.collection.all_objects if i.name.endswith("Planet"))
    before = min(v.co.z for v in item.data.vertices)
    preview.show_settings(built, complete(pair.settings, {"rig": {"height_m": 6.4}}), 65)
    item = next(i for i in built.collection.all_objects if i.name.endswith("Planet"))
    assert min(v.co.z for v in item.data.vertices) == pytest.approx(2 * before, rel=0.01)
