"""Workspaces of a lander on ray-traced grounds: its images, its truth, and the decisions by the functions of
``decide``.

The complete settings of a lander give its camera, its sensor and its workspace. It stands at a ground's standing place.
There is no arm, so every cell is in reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...physics.camera.stereo_camera import StereoCamera
from ...physics.light.directions import camera_axes
from ...physics.light.scene_sun import SceneSun
from ...rays.engine import open_tracer
from ...rays.shapes import World
from ...rays.stereo_truth import Eye
from ...render.pairs.pair_folder import Pair
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ..decisions.dem import Grid
from ..decisions.rules import Rules
from ..decisions.safe_sites import RULE_NAMES, SAFE
from ..decisions.workspace import (
    DecisionMaps,
    Workspace,
    compare_with_truth,
    count_map_errors,
    decide_from_depth,
    make_workspace,
    measure_features,
)
from ..fusion.match_prepared import match_prepared
from ..images import colours
from ..images.develop import DevelopedImages, develop
from ..images.exr import Light
from ..learning.grounds import FULL, Ground, Recipe, Variety, draw_recipe
from ..learning.made_pairs import Faults, View, render_eye, trace_truth
from ..learning.radiance import Lighting
from ..matchers.methods import Method
from ..measure.by_pixel_class import MATERIAL, measure_texture
from ..measure.prepare_pair import PreparedPair
from ..measure.row_metrics import disparity_to_depth
from ..measure.self_check import SelfCheck

#: Height from which rays measure true heights, m.
_ABOVE_M = 30.0
_NO_FAULTS = Faults(np.zeros(3), 0.0, 1.0)
_NO_SELF_CHECK = SelfCheck(None, None, None, None, None, ())
#: The entries of ``sites`` that no table needs.
_LEFT_OUT = ("roc",)


def draw_recipes(seed: int, split: str, count: int, variety: Variety = FULL) -> list[Recipe]:
    """Draw the recipes of the first grounds of a split that have no hanging shapes."""
    found: list[Recipe] = []
    number = 0
    while len(found) < count:
        recipe = draw_recipe(seed, split, number, variety)
        found += [recipe] if not recipe.shapes else []
        number += 1
    return found


def name_pair(recipe: Recipe) -> str:
    """Name the pair of a ground."""
    return f"{recipe.split}-{recipe.seed}-{recipe.number}"


def place_camera(ground: Ground, lander: Settings) -> Array:
    """Return the position (3,), m, of the left camera of a lander that stands on the ground."""
    return np.array([*ground.recipe.place_m, ground.height_m + lander.rig.height_m])


def make_view(ground: Ground, lander: Settings, light: Lighting) -> View:
    """Make the view of a lander that stands on the ground."""
    rig, camera = lander.rig, StereoCamera.from_settings(lander.rig)
    axes, position = camera_axes(rig.heading_deg, rig.pitch_deg), place_camera(ground, lander)
    left, right = (
        Eye(
            camera.width_px,
            camera.height_px,
            camera.focal_px,
            camera.cx_px,
            camera.cy_px,
            axes,
            position + aside * axes[:, 0],
        )
        for aside in (0.0, camera.baseline_m)
    )
    return View(left, right, right, camera.baseline_m, light, _NO_FAULTS)


def state_pair(recipe: Recipe, lander: Settings, view: View) -> Pair:
    """Make the entries of ``pair.json`` that decisions read, as a worker would write them."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = view.left.axes, view.left.position
    sun = SceneSun(view.light.sun, view.light.irradiance_wm2, 2 * float(np.degrees(view.light.sun_radius_rad)))
    data = {
        "poses_rectified_to_world": {"left": pose.tolist()},
        "light": {"sun": sun.to_json()},
        "edited_by_hand": True,  # the settings do not describe the ground
    }
    name = name_pair(recipe)
    return Pair(Path(name), name, lander, StereoCamera.from_settings(lander.rig), data)


def prepare_made_pair(
    ground: Ground, lander: Settings, light: Lighting, rays_per_pixel: int, random: np.random.Generator
) -> PreparedPair:
    """Prepare the pair of a ground: its images by the sensor of the settings, and its truth.

    ``random`` draws the noise of the rays; the noise of the sensor follows from the settings.
    """
    view = make_view(ground, lander, light)
    depth, hidden = trace_truth(ground, view)
    pair = state_pair(ground.recipe, lander, view)
    images = _render_images(ground, pair, view, rays_per_pixel, random)
    left, right = images.for_matchers()
    truth = np.where(np.isfinite(depth), depth, np.nan)
    in_both = np.arange(pair.camera.width_px) + 0.5 >= pair.camera.disparity(truth)
    return PreparedPair(
        pair,
        left,
        right,
        truth,
        in_both & ~hidden,
        measure_texture(left),
        {MATERIAL.key: np.zeros(truth.shape, np.int8)},
        _NO_SELF_CHECK,
        colours.make_depth_scale(truth),
        {"settings": lander},
        images=images,
    )


def prepare_pair_again(
    prepared: PreparedPair,
    ground: Ground,
    light: Lighting,
    rays_per_pixel: int,
    random: np.random.Generator,
    noise_seed: int,
) -> PreparedPair:
    """Prepare the pair under another light, or with other noise, by the same camera in the same pose.

    The fixed pattern of the sensor stays.
    """
    lander = merged(prepared.facts["settings"], {"sensor": {"noise_seed": noise_seed}})
    view = make_view(ground, lander, light)
    pair = state_pair(ground.recipe, lander, view)
    images = _render_images(ground, pair, view, rays_per_pixel, random)
    left, right = images.for_matchers()
    facts, gradient = {"settings": lander}, measure_texture(left)
    return replace(prepared, pair=pair, left=left, right=right, gradient=gradient, facts=facts, images=images)


def _render_images(
    ground: Ground, pair: Pair, view: View, rays_per_pixel: int, random: np.random.Generator
) -> DevelopedImages:
    """Render the images of a view by the sensor of the pair's settings."""
    radiance = [render_eye(ground, view.light, eye, rays_per_pixel, random) for eye in (view.left, view.right)]
    left, right = (Light(np.repeat(each[..., None], 3, axis=2).astype(np.float32), {}) for each in radiance)
    return develop(pair, left, right, pair.settings)


def look_down(ground: Ground, x_m: Array, y_m: Array) -> Array:
    """Find the height (n,), m, of the highest surface at positions (n,)."""
    start = np.stack([x_m, y_m, np.full(x_m.size, _ABOVE_M)], 1)
    down = np.tile([0.0, 0.0, -1.0], (x_m.size, 1))
    return np.asarray(_ABOVE_M - ground.tracer.intersect(start, down, 0.0, 1e3).along)


def find_top_heights(ground: Ground, grid: Grid) -> Array:
    """Find the mean height (rows, columns), m, of the highest surface at 3 x 3 points of each cell."""
    x, y = (each.ravel() for each in grid.centres())
    total = np.zeros(x.size)
    for east in (-1, 0, 1):
        for north in (-1, 0, 1):
            total += look_down(ground, x + east * grid.cell_m / 3, y + north * grid.cell_m / 3)
    return (total / 9).reshape(grid.rows, grid.columns)


@contextmanager
def open_bare_ground(ground: Ground) -> Iterator[Ground]:
    """Yield the ground without its rocks."""
    bare = open_tracer(World(ground.world.placed[:1]))
    try:
        yield replace(ground, tracer=bare)
    finally:
        bare.close()


def measure_true_heights(ground: Ground, lander: Settings) -> tuple[Grid, Array]:
    """Return the cells of a lander's workspace, and their exact heights (2, rows, columns), m, with rocks and without.

    Heights are measured by rays from above.
    """
    asked, (east, north) = lander.workspace, ground.recipe.place_m
    side = round(asked.size_m / asked.cell_m)
    half = asked.size_m / 2
    grid = Grid(asked.cell_m, side, side, east + asked.east_m - half, north + asked.north_m + half)
    with open_bare_ground(ground) as bare:
        return grid, np.stack([find_top_heights(each, grid) for each in (ground, bare)])


def open_made_workspace(ground: Ground, prepared: PreparedPair, rules: Rules) -> Workspace:
    """Return the workspace of a pair with the true heights of its ground."""
    return make_workspace(prepared, rules, *measure_true_heights(ground, prepared.facts["settings"]))


def match_disparity(prepared: PreparedPair, method: Method) -> tuple[Array, float]:
    """Match a pair. Return the disparity (H, W), px, NaN where unknown, and the processor seconds that it took."""
    disparity, info = match_prepared(method, prepared)
    return disparity, float(info["seconds"])


def match_depth(prepared: PreparedPair, method: Method) -> tuple[Array, float]:
    """Match a pair. Return the planar depth (H, W), m, NaN where unknown, and the processor seconds that it took."""
    disparity, seconds = match_disparity(prepared, method)
    return disparity_to_depth(prepared, disparity), seconds


def summarise_decisions(workspace: Workspace, found: DecisionMaps) -> dict[str, Any]:
    """Return the numbers of decisions as in a row of ``icymoon decide``.

    ``fails`` is the first rule that the chosen site fails in truth, or None.
    """
    compared = compare_with_truth(workspace, found)
    sites = compared["sites"]
    code = SAFE if sites["chosen"] is None else workspace.truth.sites.failed[tuple(sites["chosen"])]
    return {
        "dem": compared["dem"],
        "sites": {key: value for key, value in sites.items() if key not in _LEFT_OUT},
        "fails": None if code == SAFE else RULE_NAMES[code - 1],
        "features": measure_features(workspace, found),
        "errors": count_map_errors(workspace, found),
    }


def decide(workspace: Workspace, method: Method | None) -> dict[str, Any]:
    """Return the numbers of decisions by a method, or by the true depth without one, see ``summarise_decisions``."""
    prepared = workspace.prepared
    depth = prepared.truth if method is None else match_depth(prepared, method)[0]
    return summarise_decisions(workspace, decide_from_depth(workspace, depth))
