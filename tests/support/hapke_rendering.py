"""Renders of flat and smooth ground under one Sun, and what Hapke says of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from icymoon.nodes import build_scene as scenes
from icymoon.physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from icymoon.render.pairs.pair_folder import Pair, read_pair
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.render.worker import render_pairs
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from rendering import complete, empty_scene

#: A law of reflection: from incidence, emission and azimuth, in radians.
Law = Callable[[Array, Array, Array], Array]
FLAT = {"rms_slope_deg": 0.0, "multifractality": 0.0, "resolution": 129, "size_m": 60.0}
BARE = {"model": "HAPKE", "grain_amplitude_m": 0.0, "albedo_variation": 0.0}
POINT = {"sun_angular_diameter_deg": 0.0, "sun_irradiance_wm2": 50.26}
ONE = {"samples": 1, "diffuse_bounces": 0, "threads": 2}  # the first sample is taken at the pixel's centre


def slow(*values: object) -> list[Any]:
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


def long(*values: object) -> list[Any]:
    """Cases for `make test-all` only."""
    return [pytest.param(value, marks=[pytest.mark.slow, pytest.mark.long]) for value in values]


#: Relative error that facets may have: single precision in about a hundred operations, which partly cancel near the
#: horizon. Blender 5.2 keeps the normals of smooth meshes in 16 bits an axis, 2.2e-5 rad off at most, which the law
#: answers with no more than tan i + tan e, under 5 in these views.
FACETS = 1e-5
SMOOTH = FACETS + (5 * 2.2e-5 if bpy.app.version >= (5, 2, 0) else 0.0)


def picture(
    tmp_path: Path, *parts: dict[str, Any], change: Callable[[scenes.Built], object] | None = None
) -> tuple[Pair, scenes.Built]:
    """Build, let ``change`` touch what was built, render one pair, whose truth is of the same rays as its light, which
    is not rounded."""
    settings = complete(
        {
            "terrain": FLAT,
            "surface": BARE,
            "light": POINT,
            "quality": {**ONE, "truth_by": "CYCLES", "files": "FULL"},
            "rig": {"width_px": 128, "height_px": 96},
        },
        *parts,
    )
    built = scenes.build_scene(empty_scene(), settings)
    if change:
        change(built)
        bpy.context.view_layer.update()
    # By its name, not its address, so that the noise is the same in every run.
    planned = expand_headings(settings, getattr(change, "__name__", ""))
    (folder,) = render_pairs(built, planned, tmp_path, 1, 0.0, lambda *a, **k: None)
    return read_pair(folder), built


def rays(pair: Pair) -> Array:
    """Unit vectors (H, W, 3) from the surface toward the left eye, in world axes, from the rig alone."""
    camera = pair.camera
    u = (np.arange(camera.width_px) + 0.5 - camera.cx_px) / camera.focal_px
    v = (np.arange(camera.height_px) + 0.5 - camera.cy_px) / camera.focal_px
    local = np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)
    world = local @ np.array(pair.data["poses_camera_to_world"]["left"])[:3, :3].T
    return -world / np.linalg.norm(world, axis=-1, keepdims=True)


def angles(normal: Array, sun: Array, eye: Array) -> tuple[Array, Array, Array]:
    """Incidence, emission and azimuth in radians, without an arc cosine."""
    sun = np.broadcast_to(sun / np.linalg.norm(sun, axis=-1, keepdims=True), eye.shape)
    across: list[Any] = [np.cross(ray, normal) for ray in (sun, eye)]
    i, e = (
        np.arctan2(np.linalg.norm(c, axis=-1), (ray * normal).sum(-1))
        for c, ray in zip(across, (sun, eye), strict=True)
    )
    psi = np.arctan2(np.linalg.norm(np.cross(*across), axis=-1), (across[0] * across[1]).sum(-1))
    return i, e, psi


def expected(pair: Pair, law: Law | None = None) -> Array:
    """Radiance (H, W) of what the left eye sees, lit by the Sun alone."""
    view, light = read_view(pair.image("left")), pair.data["light"]["sun"]
    assert view.normal is not None
    normal = view.normal.astype(float)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    law = law or partial(bidirectional_reflectance, parameters=hapke_from_settings(pair.settings.hapke))
    r = law(*angles(normal / np.where(length > 0, length, 1), np.array(light["direction_to_world"]), rays(pair)))
    return np.where(np.isnan(view.depth), 0.0, light["irradiance_wm2"] * r)
