"""The coarse ground of a preview is as rough, where the cameras look, as the fine ground that follows it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from icymoon.physics.light.directions import camera_axes
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.preview_ground import make_preview_ground
from icymoon.physics.rig.focal_length import focal_px
from icymoon.physics.rig.seen_points import is_in_view
from icymoon.physics.rocks.place_rocks import HeightAt, Rocks, euler_matrices, scatter_rocks
from icymoon.physics.rocks.rock_shapes import RockShape, make_rock_shapes
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged
from icymoon.settings.preset_files import load_preset
from icymoon.settings.topics.scene import Settings
from icymoon.support.arrays import Array

#: A small share of the pixels of a pair, and of the vertices of ``preview.MAX_VERTICES`` and of the fine ground.
FRAME, MOST = {"width_px": 96, "height_px": 72}, 2250


def describe(name: str, *changes: dict[str, dict[str, object]]) -> Settings:
    return merged(defaults(), load_preset(name), {"rig": FRAME}, *changes)


def measure_look(settings: Settings, positions: Array, faces: Array) -> tuple[float, float, float]:
    """RMS sine of the slope of the visible facets, and mean and standard deviation of the cosine of the Sun's incidence
    on them, each weighted by its area in the image, without shadows."""
    rig, light = settings.rig, settings.light
    corners = positions[faces].astype(np.float64)
    eye = np.array([rig.x_m, rig.y_m, positions[0, 2] + rig.height_m])  # vertex 0 is under the left eye
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    toward = eye - corners.mean(axis=1)
    distance = np.linalg.norm(toward, axis=1)
    seen = is_in_view(rig, *-toward.T)
    pixels = np.where(seen, np.maximum((normal * toward).sum(axis=1), 0.0) / distance**3, 0.0)
    unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    up, around = math.radians(light.sun_elevation_deg), math.radians(light.sun_azimuth_deg)
    sun = np.array([math.cos(up) * math.sin(around), math.cos(up) * math.cos(around), math.sin(up)])
    lit = np.maximum(unit @ sun, 0.0)
    mean = float(np.average(lit, weights=pixels))
    return (
        math.sqrt(np.average(1.0 - unit[:, 2] ** 2, weights=pixels)),
        mean,
        math.sqrt(float(np.average((lit - mean) ** 2, weights=pixels))),
    )


@pytest.mark.parametrize(
    "name",
    [
        "enceladus_block_field",
        pytest.param("europa_rough_ice", marks=pytest.mark.long),
        pytest.param("enceladus_fresh_snow", marks=pytest.mark.long),
        pytest.param("europa_chaos", marks=pytest.mark.long),
    ],
)
def test_where_the_cameras_look_it_is_as_rough_and_as_bright(name):
    """The facets of both grounds are 2 to 4 pixels wide before fine relief is added. The slopes of self-affine ground
    grow with the power H - 1 of the width, so with H of at least 0.7 they differ by less than 2^0.3 = 1.23. The mean
    shade is of the second order in them."""
    settings = describe(f"scenes/{name}")
    ground = make_terrain(settings, 1)
    fine = grade_ground(ground, settings).mesh_with_relief()
    coarse = make_preview_ground(ground, settings, MOST).mesh_with_relief()
    found, true = (measure_look(settings, made.positions, made.faces) for made in (coarse, fine))
    assert 0.7 * MOST < len(coarse.positions) < 1.3 * MOST < len(fine.positions) / 3
    ratio = np.array(found) / np.array(true)
    assert np.abs(ratio - 1.0).max() < 0.23
    assert abs(ratio[1] - 1.0) < 0.05


def test_the_default_view_is_lit_from_the_azimuth_that_the_window_chooses():
    """300 degrees, ``operators.build.LIT_AZIMUTH_DEG``, lights it more than a level plane."""
    ground = make_terrain(defaults(), 1)
    made = make_preview_ground(ground, merged(defaults(), {"rig": FRAME}), MOST).mesh_with_relief()
    found = [
        measure_look(merged(defaults(), {"light": {"sun_azimuth_deg": azimuth}}), made.positions, made.faces)[1]
        for azimuth in (defaults().light.sun_azimuth_deg, 300.0)
    ]
    assert found[0] < 0.5 * math.sin(math.radians(20.0)) < math.sin(math.radians(20.0)) < found[1]


def find_mask(
    settings: Settings, rock: Rocks, which: int, shapes: Sequence[Sequence[RockShape]], eye_m: Array
) -> Array:
    """The pixels of a rock in the left image, enlarged four times."""
    rig = settings.rig
    shape = shapes[rock.level[which]][rock.shape[which]]
    points = (shape.vertices * rock.scale_m[which]) @ euler_matrices(rock.rotation[which : which + 1])[0].T
    axes = camera_axes(rig.heading_deg, rig.pitch_deg, rig.roll_deg)
    x, y, z = axes.T @ (points + rock.position_m[which] - eye_m).T
    mask = np.zeros((4 * rig.height_px, 4 * rig.width_px), np.uint8)
    if z.min() > 0.1:
        scale = 4 * focal_px(rig)
        at = np.stack([scale * x / z + 2 * rig.width_px, scale * y / z + 2 * rig.height_px], axis=1)
        for triangle in np.rint(at[shape.triangles]).astype(np.int32):
            cv2.fillConvexPoly(mask, triangle, (1,))
    return mask.astype(bool)


def test_rocks_have_their_outlines_of_the_fine_ground():
    """Rocks of a preview are those of the scene, not others of the same law. Their outlines differ by the relief under
    their footprints, and with the coarsest shapes by the sagitta of an edge of 0.14 rad, a quarter of a per cent of the
    radius, and by chipped corners. Of a rock that is half a pixel off and 10 pixels wide, 0.94 is common."""
    settings = describe("scenes/enceladus_block_field")
    rocks, rig = settings.rocks, settings.rig
    shapes = make_rock_shapes(rocks.family, rocks.angularity, 1)
    ground = make_terrain(settings, 1)
    coarse = make_preview_ground(ground, settings, MOST)

    def lay(heights: HeightAt, shapes: Sequence[Sequence[RockShape]]) -> Rocks:
        site = rig.x_m, rig.y_m, rocks.clear_radius_m
        return scatter_rocks(rocks, ground.size_m, 1, heights, shapes, site, None, 100)

    # Vertices of the fine ground are about a centimetre apart at the site.
    true = lay(lambda x, y: ground.heights(x, y, 0.01), shapes)
    found = lay(coarse.compute_mesh_heights, [shapes[-1]] * 3)
    eye = np.array([rig.x_m, rig.y_m, float(ground.heights(rig.x_m, rig.y_m)) + rig.height_m])
    shares = []
    for k in np.argsort(-found.diameter_m / np.linalg.norm(found.position_m - eye, axis=1))[:30]:
        a, b = find_mask(settings, true, k, shapes, eye), find_mask(settings, found, k, [shapes[-1]] * 3, eye)
        if a.sum() > 16 * 25:  # 25 pixels of the image
            shares.append(float((a & b).sum() / (a | b).sum()))
    assert len(shares) > 5
    assert min(shares) > 0.7
    assert np.median(shares) > 0.94


@pytest.mark.parametrize("kind", ["GRADED", "GRID"])
def test_vertices_are_as_many_as_asked_and_most_are_in_view(kind):
    settings = describe("scenes/enceladus_fresh_snow", {"mesh": {"kind": kind}, "terrain": {"resolution": 257}})
    ground = make_terrain(settings, 1)
    coarse = make_preview_ground(ground, settings, MOST)
    made = coarse.mesh_with_relief()
    assert 0.7 * MOST < len(made.positions) < 1.3 * MOST
    assert made.fine is not None
    assert made.fine.mean() > 0.6
    across = np.ptp(made.positions[:, 0])
    assert across == ground.size_m if kind == "GRID" else across > 10 * ground.size_m
    if kind == "GRID":  # neither a hole nor an overlap; the corners of the patch may be cut off
        a, b, c = (made.positions[made.faces[:, k], :2] for k in range(3))
        area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
        assert area.min() > 0
        assert 0.95 * ground.size_m**2 < area.sum() < 1.0001 * ground.size_m**2
