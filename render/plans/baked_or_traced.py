"""Decides whether indirect light is baked or traced, by the estimated cost of both. Imports no Blender.

``quality.indirect`` AUTO is decided when a data set is planned, so that a pair's settings and its id state the method.
The same plan always gives the same decision.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache

import numpy as np

from ...physics.camera.eyes import find_light_px
from ...physics.light.baked_rocks import POINTS_BY_DETAIL
from ...physics.mesh.vertex_spacing import choose_vertex_spacing
from ...physics.rig.seen_points import is_in_view
from ...physics.rocks.debris import count_debris
from ...physics.rocks.place_rocks import LEVEL_RANKS
from ...physics.rocks.rock_table import TABLE
from ...physics.rocks.size_laws import make_size_law
from ...physics.scene_requirements import can_be_baked, count_images_per_bake, make_direct_quality
from ...physics.terrain.terrain import make_terrain
from ...settings import rebuilt_parts
from ...settings.description import merged
from ...settings.topics.camera import RigSettings
from ...settings.topics.rendering import QualitySettings
from ...settings.topics.scene import Settings
from ...settings.topics.stand_ins import find_mesh_item
from ...settings.user_files import has_surroundings
from ...support.errors import IcyMoonError
from .triangle_count import count_triangles

#: Processor seconds (2-core x86 server, Blender 5.0) of a million paths from the corners of a flat mesh; the seconds
#: that ground of this steepness, or with layers of noise, adds, since fewer paths end in the sky; and of the start of
#: the bakes.
_S_PER_MPATH, _STEEP_S, _STEEP_DEG, _START_S = 0.45, 0.5, 25.0, 0.8
#: Processor seconds per million pixels: of a sample of direct light on Lambert ground with fine relief, of a bounce,
#: and of the denoiser.
_DIRECT_S_PER_MPX, _BOUNCE_S_PER_MPX, _DENOISE_S_PER_MPX = 1.76, 0.17, 3.5
#: Facet corners per vertex of a uniform grid and of triangles, and corners of a triangle.
_CORNERS_PER_GRID_VERTEX, _CORNERS_PER_VERTEX, _CORNERS_PER_TRIANGLE = 4.0, 6.0, 3.0
#: Processor seconds of a point of a rock: three texels with their samples, among other rocks.
_S_PER_ROCK_POINT = 2.5e-4
#: Ratio of all rocks to the rocks on the patch, if there are rocks beyond the patch.
_FAR_ROCKS_FACTOR = 2.8
#: Parts of the law of sizes in which fragments are counted.
_LAW_PARTS = 1024
#: Processor seconds per million pixels and sample that images on the ground add, and that a mesh's own image adds.
_IMAGES_S, _OWN_IMAGE_S = 0.95, 0.1
#: Bytes in a file of baked light: of a vertex with light, and of a rock.
_BYTES_PER_VERTEX, _BYTES_PER_ROCK = 11.0, 140.0
#: Most points along a side of a uniform grid from which the visible share is estimated.
_MAX_POINTS_PER_SIDE = 129


def choose_indirect(settings: Sequence[Settings]) -> list[Settings]:
    """Return the settings of all pairs of a data set, with BAKED or TRACED in place of AUTO."""
    keys = [make_light_key(each) if each.quality.indirect == "AUTO" else "" for each in settings]
    images = Counter(keys)
    enough: dict[str, int] = {}
    found = []
    for each, key in zip(settings, keys, strict=True):
        if key and key not in enough:
            enough[key] = find_break_even(each) if can_be_baked(each) else 0
        if key:
            baked = 0 < enough[key] <= images[key]
            each = merged(each, {"quality": {"indirect": "BAKED" if baked else "TRACED"}})
        found.append(each)
    return found


def resolve_auto_indirect(settings: Settings, images: int) -> Settings:
    """Replace AUTO by BAKED or TRACED in settings, for ``images`` images of one ground under one Sun, in different
    directions."""
    return choose_indirect([settings] * count_images_per_bake(settings, images))[0]


def make_light_key(settings: Settings) -> str:
    """Make a cache key of light: equal texts for pairs that can share baked light."""
    quality = settings.quality
    seen = [rebuilt_parts.select_camera(settings)] if quality.bake_area == "VIEW" else []
    return json.dumps(
        [
            rebuilt_parts.select_scene(settings),
            rebuilt_parts.select_appearance(settings),
            rebuilt_parts.select_light(settings),
            quality.diffuse_bounces,
            quality.bake_samples,
            quality.bake_noise,
            *seen,
        ]
    )


def find_break_even(settings: Settings) -> int:
    """Find the smallest number of images of a ground under one Sun for which baked light costs less than traced light;
    0 if it always costs more."""
    saved = _pair_seconds(settings, settings.quality) - _pair_seconds(settings, make_direct_quality(settings.quality))
    return 0 if saved <= 0 else max(1, round(0.5 + estimate_bake_seconds(settings) / saved))


def estimate_bake_seconds(settings: Settings) -> float:
    """Estimate the processor seconds to bake the light of a ground and its rocks, with the planet's light, at the full
    number of samples."""
    paths = settings.quality.bake_samples * _count_corners(settings)
    steep = 1.0 if settings.terrain.layers else min(1.0, settings.terrain.rms_slope_deg / _STEEP_DEG)
    images = {"NONE": 0.0, "MESH": _OWN_IMAGE_S}.get(settings.textures.set, _IMAGES_S)
    once = (
        _START_S
        + (_S_PER_MPATH + _STEEP_S * steep + images) * paths / 1e6
        + _S_PER_ROCK_POINT * _count_points(settings)
    )
    return once * (1 + settings.light.planet)


def estimate_light_bytes(settings: Settings) -> float:
    """Estimate the bytes of the baked light of a ground and its rocks, with the planet's light."""
    triangular = _is_of_triangles(settings) or settings.mesh.kind == "GRADED"
    vertices = _count_corners(settings) / (_CORNERS_PER_VERTEX if triangular else _CORNERS_PER_GRID_VERTEX)
    return (_BYTES_PER_VERTEX * vertices + _BYTES_PER_ROCK * _count_rocks(settings)) * (1 + settings.light.planet)


def _is_of_triangles(settings: Settings) -> bool:
    """Return whether the mesh of ground from a file has triangles instead of quadrilaterals."""
    return settings.source.kind in ("STAND_IN", "MESH") or has_surroundings(settings)


def _count_corners(settings: Settings) -> float:
    """Count the corners to which light is baked; with ``quality.bake_area`` VIEW as if the ground were level."""
    terrain, rig, source = settings.terrain, settings.rig, settings.source
    in_view = settings.quality.bake_area == "VIEW"
    if source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED":
        rings = choose_vertex_spacing(make_terrain(settings, int(settings.dataset.seed)), settings).rings
        corners = _CORNERS_PER_VERTEX * rings.vertices
        if in_view:
            east, north = rings.map_positions()
            corners *= is_in_view(rig, east, north, np.full(len(east), -rig.height_m)).mean()
        return float(corners)
    size_m, corners = terrain.size_m, _CORNERS_PER_GRID_VERTEX * terrain.resolution**2
    if source.kind == "STAND_IN":
        size_m = find_mesh_item(source.stand_in).size_m
    if _is_of_triangles(settings):
        with suppress(IcyMoonError):  # the build reports why a file cannot be read
            corners = _CORNERS_PER_TRIANGLE * count_triangles(settings)
    points = min(terrain.resolution, _MAX_POINTS_PER_SIDE)
    return corners * (_estimate_share_seen(size_m, points, tuple(rig.items())) if in_view else 1.0)


@lru_cache(maxsize=256)
def _estimate_share_seen(size_m: float, points: int, rig_items: tuple[tuple[str, float], ...]) -> float:
    """Estimate the share of a level square of ``size_m`` metres in the view of a rig, from ``points`` points along each
    side."""
    rig = RigSettings.from_values(rig_items)
    across = np.linspace(-size_m / 2, size_m / 2, points)
    east, north = (each.ravel() for each in np.meshgrid(across - rig.x_m, across - rig.y_m))
    return float(is_in_view(rig, east, north, np.full(len(east), -rig.height_m)).mean())


def _count_points(settings: Settings) -> float:
    """Count the points of rocks to which light is baked; for a table of rocks, an upper bound."""
    count = _count_rocks(settings)
    ends = (0.0, *(min(rank, count) for rank in LEVEL_RANKS), count)
    return sum(points * (end - start) for points, start, end in zip(POINTS_BY_DETAIL, ends, ends[1:], strict=False))


def _count_rocks(settings: Settings) -> float:
    """Count the rocks to which light is baked; for a table of rocks, an upper bound."""
    rocks = settings.rocks
    if rocks.coverage <= 0:
        return 0.0
    if rocks.law == TABLE:
        return float(rocks.most)
    far = settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED" and rocks.beyond_px > 0
    of_the_patch = make_size_law(rocks).total_per_m2 * settings.terrain.size_m**2
    count = min(float(rocks.most), of_the_patch * (_FAR_ROCKS_FACTOR if far else 1.0))
    return count + (_count_fragments(settings) if rocks.debris > 0 else 0.0)


def _count_fragments(settings: Settings) -> float:
    """Count the fragments around the rocks on the patch, from diameters in the middles of equal parts of the law."""
    rocks, law = settings.rocks, make_size_law(settings.rocks)
    area = settings.terrain.size_m**2
    count = min(float(rocks.most), law.total_per_m2 * area)
    parts = (np.arange(_LAW_PARTS) + 0.5) / _LAW_PARTS * count / area
    return min(float(rocks.debris_most), count * float(count_debris(rocks, law.diameter_m(parts)).mean()))


def _pair_seconds(settings: Settings, quality: QualitySettings) -> float:
    width, height = find_light_px(settings)
    sample = _DIRECT_S_PER_MPX + _BOUNCE_S_PER_MPX * quality.diffuse_bounces
    return 2e-6 * width * height * (quality.samples * sample + _DENOISE_S_PER_MPX * (quality.denoiser != "NONE"))
