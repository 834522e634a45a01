"""The workspace of a pair: its cells, its true heights, and the decisions from the truth and from a depth."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from ...physics.light.sky import elevation_deg
from ...render.pairs.pair_folder import Pair, refuse_rolling_shutter
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.labels import LANDER
from ..images.disparity_and_occlusion import find_scene_depth
from ..images.exr import read_depth
from ..measure.by_pixel_class import MATERIAL
from ..measure.prepare_pair import PreparedPair
from .cell_errors import CellErrors, fill_gaps, measure_sampling_variance, state_errors
from .dem import Dem, Grid, back_project_depth, make_dem, mean_by_cell, measure_height_errors, read_cells, read_grid
from .footprints import average_under_footprint, fit_planes
from .height_errors import ErrorShape, count_errors, state_shape
from .joint_margin import find_joint_margins_deg
from .materials import (
    Materials,
    compute_white_radiance,
    make_true_materials,
    measure_materials,
    refuse_lamps,
    scale_sun_irradiance,
)
from .rules import Rules
from .safe_sites import SiteLayers, Sites, find_lit_cells, find_rocks, judge_pads, judge_sites, measure_layers
from .scores import score_sites

#: Default side of a cell, m, of a pair that states none: at least three pixels of the paper's camera at its workspace.
DEFAULT_CELL_M = 0.02
#: Class of ``by_pixel_class.MATERIAL`` for pixels of the lander, which are no ground.
_LANDER_CLASS = 2
#: Distance from the lander, px, within which a depth may be the lander's: half of StereoBM's default window of 17.
_LANDER_MARGIN_PX = 8
#: Numbers that a lander knows without the truth, by which grounds are compared.
FEATURES = ("known share", "slope", "roughness", "share near rocks", "share in light", "contrast", "Sun's elevation")
#: Share from which on a footprint is inside the workspace: all of it, with a margin for rounding.
_WHOLE_SHARE = 1 - 1e-6


@dataclass(frozen=True)
class DecisionMaps:
    """Maps from one depth: elevation model, suitability of each cell, and places for a pad."""

    dem: Dem
    sites: Sites
    pads: Array
    errors: CellErrors | None = None  # of the heights; None for the truth


@dataclass(frozen=True)
class Workspace:
    """The workspace of a prepared pair, with the decisions from the truth."""

    prepared: PreparedPair
    pair: Pair
    pose: Array  # (4, 4), from the left eye of the parallel rig to the site
    rules: Rules
    exact: bool  # the true heights come from the meshes, not from the true depth of both eyes
    seen: Array  # boolean (rows, columns): the left image shows this cell
    inside: Array  # boolean: the whole footprint of a site is in the workspace
    reached: Array  # boolean: inside, and within the joint limits of the arm
    truth: DecisionMaps

    @property
    def grid(self) -> Grid:
        """The grid of cells of the workspace."""
        return self.truth.dem.grid


def open_workspace(prepared: PreparedPair, rules: Rules, cell_m: float | None = None) -> Workspace:
    """Return the workspace of a pair with the truth's decisions.

    ``cell_m`` is the side of a cell for a pair without true heights. Raises IcyMoonError for a pair of another program,
    without the camera's position, with a rolling shutter, or without visible ground.
    """
    pair, pose = _find_place(prepared)
    if stated := pair.data.get("workspace"):
        grid, heights = read_grid(stated), _read_heights(pair, stated)
        return make_workspace(prepared, rules, grid, heights)
    seen_points = _find_seen_points(prepared, pair, pose)
    grid = _make_grid_ahead(pair, seen_points, cell_m or DEFAULT_CELL_M)
    dem = make_dem(np.concatenate([seen_points, _find_points_of_right_eye(pair)]), grid, 1)
    rocks = find_rocks(dem.height_m, grid.cell_m, rules.site)
    return _judge_truth(prepared, rules, dem, rocks, seen_points, exact=False)


def make_workspace(prepared: PreparedPair, rules: Rules, grid: Grid, heights_m: Array) -> Workspace:
    """Return the workspace of a pair with the truth's decisions from exact heights (2, rows, columns).

    The first heights are with the rocks, the second of the ground alone. Raises IcyMoonError as ``open_workspace``.
    """
    dem = Dem(grid, heights_m[0], np.where(np.isfinite(heights_m[0]), 1, 0))
    rocks = heights_m[0] - heights_m[1] > rules.site.rock_height_m
    seen_points = _find_seen_points(prepared, *_find_place(prepared))
    return _judge_truth(prepared, rules, dem, rocks, seen_points, exact=True)


def _judge_truth(
    prepared: PreparedPair, rules: Rules, dem: Dem, rocks: Array, seen_points: Array, exact: bool
) -> Workspace:
    """Return the workspace with decisions from the true heights ``dem``.

    ``rocks`` (rows, columns) are the cells with a rock, ``seen_points`` (n, 3), m, the points that the left image
    shows.
    """
    pair, pose = _find_place(prepared)
    grid = dem.grid
    margin = _find_joint_margins(pair, pose, dem)
    lit = find_lit_cells(dem.height_m, grid.cell_m, read_sun_direction(pair))
    layers = measure_layers(dem, margin, lit, rules.site, rocks, _read_true_materials(pair, rules))
    maps = DecisionMaps(dem, judge_sites(layers, rules.site), _judge_pads(dem, rules))
    inside = average_under_footprint(np.ones(dem.height_m.shape, bool), grid.cell_m, rules.site.disc_m) > _WHOLE_SHARE
    return Workspace(
        prepared,
        pair,
        pose,
        rules,
        exact,
        make_dem(seen_points, grid, 1).known,
        inside,
        inside & (margin >= rules.site.joint_margin_deg),
        maps,
    )


def _find_place(prepared: PreparedPair) -> tuple[Pair, Array]:
    """Return the pair and the pose of its left eye. Raises IcyMoonError for a pair on which nothing can be decided."""
    pair, pose = prepared.pair, prepared.pair.rectified_pose("left")
    if not isinstance(pair, Pair) or pose is None:
        raise IcyMoonError(
            f"{prepared.pair.folder} does not state the place of its camera on a site; decisions need a "
            "pair that was rendered here."
        )
    refuse_rolling_shutter(pair, "a lander decides from images of one pose", "decide on a pair with rig.readout_s 0")
    return pair, pose


def _find_seen_points(prepared: PreparedPair, pair: Pair, pose: Array) -> Array:
    """Find the points (n, 3), m, of the ground that the left image shows. Raises IcyMoonError if it shows no ground."""
    known = np.where(find_ground_pixels(prepared), prepared.truth, np.nan)
    points, _ = back_project_depth(known, pair.camera.rectified, pose)
    if not len(points):
        raise IcyMoonError(f"{pair.folder} shows no ground, so there is nothing to decide; point the camera at some.")
    return points


def read_sun_direction(pair: Pair) -> Array:
    """Read the unit vector from the site to the Sun. Raises IcyMoonError if the pair lacks it."""
    if pair.sun is None:
        raise IcyMoonError(
            f"{pair.folder / 'pair.json'} does not contain the direction of the Sun; render the pair again."
        )
    return pair.sun.direction


def decide_from_depth(
    workspace: Workspace, depth_m: Array, pose: Array | None = None, disparity_error_px: float = 0.0
) -> DecisionMaps:
    """Return the maps from a planar depth (H, W) of the left image, NaN where unknown.

    ``pose`` is the pose that the lander assumes for its left eye; by default the true pose. ``disparity_error_px`` is
    the standard deviation of the disparities from which the depth was computed.
    """
    pose = workspace.pose if pose is None else pose
    ground = np.where(_find_pixels_apart_from_lander(workspace.prepared), depth_m, np.nan)
    position, index = back_project_depth(ground, workspace.pair.camera.rectified, pose)
    rules = workspace.rules
    dem, errors = _make_dem_with_errors(workspace, position, depth_m.ravel()[index], pose, disparity_error_px)
    margin = _find_joint_margins(workspace.pair, pose, dem)
    bright = find_lit_pixels(workspace.prepared, rules.site.lit_level).astype(np.float64)
    lit = mean_by_cell(position, bright.ravel()[index], dem.grid)
    found = _measure_materials(workspace, dem, bright, position, index) if rules.site.needs_materials else None
    layers = measure_layers(dem, margin, lit, rules.site, materials=found, errors=errors, debias=rules.cells.debias)
    return DecisionMaps(dem, judge_sites(layers, rules.site), _judge_pads(dem, rules), errors)


def _make_dem_with_errors(
    workspace: Workspace, position: Array, depth_m: Array, pose: Array, disparity_error_px: float
) -> tuple[Dem, CellErrors]:
    """Make the elevation model of points (n, 3), m, with depths (n,), m, and fill its small gaps.

    Return the model and the errors that the lander states for its heights.
    """
    cells, grid, disc_m = workspace.rules.cells, workspace.grid, workspace.rules.site.disc_m
    dem = make_dem(position, grid, round(cells.fewest_points))
    variance = measure_sampling_variance(position, grid, disc_m)
    if disparity_error_px > 0:
        camera = workspace.pair.camera.rectified
        depth_error = depth_m**2 * disparity_error_px / (camera.focal_px * camera.baseline_m)
        # An error of the depth moves the point along its ray. The height of the ray changes by ``rise`` per metre.
        rise = (position[:, 2] - pose[2, 3]) / depth_m
        variance = variance + mean_by_cell(position, (rise * depth_error) ** 2, grid)
    shared = cells.error_width_px**2 / np.maximum(dem.points, 1)
    most_m = workspace.rules.site.rock_height_m / 2  # so that a filled cell hides no rock
    return fill_gaps(dem, state_errors(dem, variance, shared), cells.gap_m, disc_m, most_m)


def compare_with_truth(workspace: Workspace, found: DecisionMaps) -> dict[str, Any]:
    """Compare decisions with the truth's: ``dem``, ``sites``, ``pads``, and if rules need them ``materials``.

    The elevation model without filled cells is compared over the cells in reach that the left image shows; its
    ``reached`` completeness is over all cells in reach. Sites are compared over the cells in reach with a known true
    height, but chosen from all cells whose footprint is inside. Pads are compared over all cells whose footprint is
    inside. Undefined numbers are None.
    """
    truth = workspace.truth
    among = workspace.reached & truth.dem.known
    filled = found.errors.filled if found.errors is not None else np.zeros(among.shape, bool)
    measured = replace(found.dem, height_m=np.where(filled, np.nan, found.dem.height_m))
    errors = measure_height_errors(measured, truth.dem.height_m, among & workspace.seen)
    errors["filled"] = float(filled[among].mean()) if among.any() else None
    errors["reached_completeness"] = measure_height_errors(measured, truth.dem.height_m, among)["completeness"]
    for name in ("slope_deg", "roughness_m"):
        off = (getattr(found.sites.layers, name) - getattr(truth.sites.layers, name))[among]
        off = off[np.isfinite(off)]
        errors[f"{name.partition('_')[0]}_rmse{name[name.rindex('_') :]}"] = (
            float(np.sqrt((off**2).mean())) if off.size else None
        )
    return {
        **_compare_materials(truth.sites.layers, found.sites.layers, among & workspace.seen),
        "dem": errors,
        "sites": score_sites(found.sites, truth.sites, among, workspace.rules.site.tolerance, workspace.inside),
        "pads": _score_pads(found.pads, truth.pads, truth.dem.known & workspace.inside),
    }


def measure_features(workspace: Workspace, found: DecisionMaps) -> dict[str, float]:
    """Measure the numbers ``FEATURES`` of a decision, over the cells whose whole footprint is in the workspace.

    They are means or medians: slope in degrees, roughness in mm, contrast as the ratio of standard deviation to mean of
    the image of the ground. Unknown numbers are 0. Numbers are rounded, so that rounding errors make no ground unlike
    others.
    """
    layers, inside = found.sites.layers, workspace.inside
    image = workspace.prepared.left.astype(np.float64)
    ground = image[workspace.prepared.known & find_ground_pixels(workspace.prepared)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of cells that are all unknown
        numbers = (
            layers.known_share[inside].mean(),
            np.nanmedian(layers.slope_deg[inside]),
            1000 * np.nanmedian(layers.roughness_m[inside]),
            (layers.rock_distance_m[inside] < workspace.rules.site.rock_distance_m).mean(),
            np.nanmean(layers.lit_share[inside]),
            ground.std() / ground.mean(),
            elevation_deg(read_sun_direction(workspace.pair)),
        )
    return {
        name: round(float(number), 3) if np.isfinite(number) else 0.0
        for name, number in zip(FEATURES, numbers, strict=True)
    }


def state_map_errors(workspace: Workspace, found: DecisionMaps) -> ErrorShape:
    """Return the errors of a map up to the scale of its matcher."""
    assert found.errors is not None
    return state_shape(found.dem, found.errors, found.sites.layers.slope_deg, workspace.rules.site.disc_m)


def count_map_errors(workspace: Workspace, found: DecisionMaps) -> dict[str, dict[str, Any]]:
    """Count the errors of heights, slopes and roughnesses in units of their shape, see ``height_errors.count_errors``.

    Heights are counted in all cells of known true height, the others in those whose footprint is in the workspace.
    """
    shape, truth = state_map_errors(workspace, found), workspace.truth
    known = truth.dem.known
    layers, true_layers = found.sites.layers, truth.sites.layers
    return {
        "height": count_errors(found.dem.height_m - truth.dem.height_m, shape.height, known),
        "slope": count_errors(layers.slope_deg - true_layers.slope_deg, shape.slope, known & workspace.inside),
        "roughness": count_errors(
            layers.roughness_m - true_layers.roughness_m, shape.roughness, known & workspace.inside
        ),
    }


def _compare_materials(truth: SiteLayers, found: SiteLayers, among: Array) -> dict[str, Any]:
    """Return the table ``materials`` if the rules need it: errors of the footprints' albedo and share of salt."""
    if truth.albedo is None or truth.salt_share is None or found.albedo is None or found.salt_share is None:
        return {}
    numbers: dict[str, float | None] = {}
    for name, off in (("albedo", found.albedo - truth.albedo), ("salt", found.salt_share - truth.salt_share)):
        known = off[among & np.isfinite(off)]
        numbers |= {
            f"{name}_bias": float(known.mean()) if known.size else None,
            f"{name}_rmse": float(np.sqrt((known**2).mean())) if known.size else None,
        }
    return {"materials": numbers}


def compare_beside_lander(
    workspace: Workspace, found: DecisionMaps, depth_m: Array, pose: Array
) -> dict[str, float | None]:
    """Measure the pixels beside the lander, which the elevation model leaves out, over the visible cells in reach.

    ``beside_rmse_m`` and ``beside_bias_m`` are errors of the heights from these pixels alone. ``beside_share`` is the
    share of cells that have a height only from them.
    """
    prepared = workspace.prepared
    beside = find_ground_pixels(prepared) & ~_find_pixels_apart_from_lander(prepared)
    position, _ = back_project_depth(np.where(beside, depth_m, np.nan), workspace.pair.camera.rectified, pose)
    dem = make_dem(position, workspace.grid)
    truth = workspace.truth.dem
    among = workspace.reached & workspace.seen & truth.known
    errors = measure_height_errors(dem, truth.height_m, among)
    only = dem.known & ~found.dem.known & among
    return {
        "beside_rmse_m": errors["rmse_m"],
        "beside_bias_m": errors["bias_m"],
        "beside_share": float(only.sum() / among.sum()) if among.any() else None,
    }


def disturb_pose(pose: Array, error_mm: float, error_deg: float, random: np.random.Generator) -> Array:
    """Add a random error to a pose (4, 4): a shift and a rotation about the eye.

    Each of their three components is normal with these standard deviations.
    """
    turn = np.radians(error_deg) * random.standard_normal(3)
    shift = error_mm / 1000 * random.standard_normal(3)
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle else (0.0, 0.0, 1.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = pose.copy()
    result[:3, :3] = (np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross) @ pose[:3, :3]
    result[:3, 3] += shift
    return result


def _find_joint_margins(pair: Pair, pose: Array, dem: Dem) -> Array:
    """Find the margins, degrees, of the arm's joints, for a lander whose camera has this ``pose``."""
    return find_joint_margins_deg(
        pair.settings, float(pose[2, 3]) - pair.settings.rig.height_m, *dem.grid.centres(), dem.height_m
    )


def _score_pads(found: Array, truth: Array, among: Array) -> dict[str, float | None]:
    fits, taken = truth[among] == 0, found[among] == 0
    both = float((fits & taken).sum())
    return {
        "base_rate": float(fits.mean()) if fits.size else None,
        "false_safe": (taken.sum() - both) / float(taken.sum()) if taken.any() else None,
        "safe_lost": (fits.sum() - both) / float(fits.sum()) if fits.any() else None,
    }


def _judge_pads(dem: Dem, rules: Rules) -> Array:
    pad = rules.pad
    return judge_pads(dem, pad.disc_m, pad.slope_deg, pad.rock_height_m, pad.known_share)


def find_ground_pixels(prepared: PreparedPair) -> Array:
    """Find the pixels of the left image without the lander, bool (H, W)."""
    return np.asarray(prepared.classes[MATERIAL.key] != _LANDER_CLASS)


def _find_pixels_apart_from_lander(prepared: PreparedPair) -> Array:
    """Find the ground pixels (H, W) whose matching window contains no lander. A lander knows where its arm is."""
    lander = (~find_ground_pixels(prepared)).astype(np.uint8)
    side = 2 * _LANDER_MARGIN_PX + 1
    return np.asarray(cv2.dilate(lander, np.ones((side, side), np.uint8)) == 0)


def measure_levels(prepared: PreparedPair) -> Array:
    """Return the light (H, W) in the left image up to a factor: its grey levels, without the encoding of the sensor."""
    image = prepared.left
    grey = (image if image.ndim == 2 else image.mean(axis=2)).astype(np.float64)
    return np.asarray(grey**2 if prepared.facts["settings"].sensor.encoding == "SQUARE_ROOT" else grey)


def find_lit_pixels(prepared: PreparedPair, lit_level: float) -> Array:
    """Find the pixels, bool (H, W), that are brighter than ``lit_level`` times the median of the ground in the left
    image.
    """
    level, ground = measure_levels(prepared), prepared.known & find_ground_pixels(prepared)
    return np.asarray(level > lit_level * np.median(level[ground]))


def _read_true_materials(pair: Pair, rules: Rules) -> Materials | None:
    """Read the materials from a pair's file; None if the rules do not need them. Raises IcyMoonError if the pair lacks
    them.
    """
    if not rules.site.needs_materials:
        return None
    stated = pair.data.get("workspace") or {}
    if "materials" not in stated:
        raise IcyMoonError(
            f"{pair.folder} contains no true albedo and salts, but the rules need them; render the pair again with "
            "workspace.materials true and workspace.cell_m above 0, or leave out these rules."
        )
    return make_true_materials(
        read_cells(pair.folder / stated["materials"], (4, *stated["shape"]), "render the pair again")
    )


def _measure_materials(workspace: Workspace, dem: Dem, bright: Array, position_m: Array, index: Array) -> Materials:
    """Measure the materials as the lander does, see ``materials``, where ``bright`` (H, W) is 1.

    Raises IcyMoonError unless the Sun alone lights the pair, with one irradiance.
    """
    pair, prepared = workspace.pair, workspace.prepared
    settings, sun = prepared.facts["settings"], pair.sun
    assert prepared.images is not None
    assert sun is not None
    irradiance = scale_sun_irradiance(sun.irradiance_wm2, settings)
    if sun.distance_m or not irradiance > 0:
        raise IcyMoonError(
            f"{pair.folder}: an albedo can be measured in sunlight only, but the light is a lamp nearby or is absent; "
            "render with the Sun, or leave out the rules of albedo and salts."
        )
    refuse_lamps(pair.folder, settings)
    white = compute_white_radiance(prepared.images, settings)
    white = np.where(bright.reshape(bright.shape + (1,) * (white.ndim - 2)) > 0, white, np.nan)
    planes = fit_planes(dem.height_m, dem.grid.cell_m, workspace.rules.site.disc_m)
    return measure_materials(white, position_m, index, dem.grid, planes, sun.direction, irradiance, settings)


def _read_heights(pair: Pair, stated: Mapping[str, Any]) -> Array:
    """Read the true heights, float64 (2, rows, columns).

    Raises IcyMoonError if the file is missing, damaged, or of a different shape.
    """
    return read_cells(pair.folder / stated["file"], (2, *stated["shape"]), "render the pair again")


def _find_points_of_right_eye(pair: Pair) -> Array:
    pose = pair.rectified_pose("right")
    view = read_depth(pair.truth("right"), "right")
    ground = np.ones(view.depth.shape, bool) if view.semantic is None else view.semantic != LANDER
    depth = pair.camera.cropped(np.where(ground, find_scene_depth(view), np.nan))
    return back_project_depth(depth, pair.camera.rectified, pose)[0] if pose is not None else np.empty((0, 3))


def _make_grid_ahead(pair: Pair, points: Array, cell_m: float) -> Grid:
    """Make cells around the middle of the ground that the left image shows, as large as the settings' workspace."""
    workspace = pair.settings.workspace
    size = workspace.size_m
    count = max(1, math.ceil(size / cell_m - 1e-6))
    if count > 4096:
        raise IcyMoonError(f"Cells of {cell_m:g} m are {count} along a side; give {size / 4096:.2g} m or more.")
    east, north = np.median(points[:, 0]), np.median(points[:, 1])
    if dug := pair.data.get("excavation"):  # the same cells in all states, even if the camera moves a little
        west, south, last_east, last_north = dug["region_m"]
        east, north = (west + last_east) / 2, (south + last_north) / 2
    half = count * cell_m / 2
    return Grid(cell_m, count, count, float(east - half), float(north + half))
