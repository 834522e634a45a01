"""Pixels that a lander takes for lit, beside those that the Sun reaches: grounds by rays under low and under high Suns.

    python benchmarks lit_pixels --grounds 40

A pixel is lit in truth if the middle of the Sun is visible from the ground in its middle. Each ground has one image
under a Sun of each range, from one side, by the lander's camera at half its resolution. The rules are the shipped one,
a share of the median of the ground; the same share of a high quantile; and Otsu's threshold of the logarithm, with all
ground lit where the means of both classes are less than ``_APART`` times apart. Shadows are lit by other ground, and by
a sky as bright as a full Jupiter over Europa. Terrains and rocks are as in training.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from icymoon.benchmarks.common.ray_grounds import RULES
from icymoon.physics.light.directions import direction_toward
from icymoon.settings.description import merged
from icymoon.stereo.decisions.workspace import find_lit_pixels, measure_levels
from icymoon.stereo.design.default_lander import LANDER, RAYS_PER_PIXEL
from icymoon.stereo.design.made_workspaces import draw_recipes, make_view, prepare_made_pair
from icymoon.stereo.learning.grounds import FULL, Ground, Recipe, build_ground, make_split_generator, release_ground
from icymoon.stereo.learning.made_pairs import draw_light
from icymoon.stereo.learning.radiance import Lighting, compute_radiance
from icymoon.stereo.measure.prepare_pair import PreparedPair
from icymoon.support.arrays import Array

SMALL = merged(LANDER, {"rig": {"width_px": 160, "height_px": 120}})
#: Elevations of the Suns, degrees.
LOW, HIGH = RANGES = ((5.0, 8.0), (16.0, 65.0))
#: Irradiance by a full Jupiter on Europa over the Sun's: its geometric albedo, 0.538, times the square of its radius of
#: 71492 km over its distance of 670900 km.
_SKY = 0.006
#: A brightness that most lit ground exceeds where little is lit.
_QUANTILE = 0.9
#: Least ratio of the mean levels of lit and of shaded ground.
_APART = 4.0
#: Share of the ground in shadow that divides the images.
_HALF = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--grounds", type=int, default=40, help="grounds (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the grounds (%(default)s)")


def find_above_quantile(prepared: PreparedPair) -> Array:
    """The pixels (H, W) above the share ``lit_level`` of a high quantile of the ground."""
    level = measure_levels(prepared)
    return np.asarray(level > RULES.site.lit_level * np.quantile(level[prepared.known], _QUANTILE))


def find_above_otsu(prepared: PreparedPair) -> Array:
    """The pixels (H, W) above Otsu's threshold of the logarithm of the ground's levels; all where it is even."""
    level = np.log(np.maximum(measure_levels(prepared), 1.0))
    own = level[prepared.known]
    grey = np.rint(255 * (own - own.min()) / max(float(np.ptp(own)), 1e-9)).astype(np.uint8)
    at, _ = cv2.threshold(grey.reshape(-1, 1), 0, 255, cv2.THRESH_OTSU)
    bright = grey > at
    if bright.all() or not bright.any() or own[bright].mean() - own[~bright].mean() < np.log(_APART):
        return np.ones(level.shape, bool)
    return np.asarray(level > own[~bright].max())


#: The rules by name.
FINDERS: dict[str, Callable[[PreparedPair], Array]] = {
    "median": lambda prepared: find_lit_pixels(prepared, RULES.site.lit_level),
    "quantile": find_above_quantile,
    "Otsu": find_above_otsu,
}


def find_sunlit(ground: Ground, light: Lighting) -> Array:
    """Whether the middle of the Sun is visible, for each pixel (H, W) of the left image: the ground is brighter than
    black in its light alone.
    """
    eye = make_view(ground, SMALL, light).left
    pixels = np.arange(eye.rows * eye.columns)
    alone = replace(light, sun_radius_rad=0.0, sky=0.0)
    nothing, random = np.zeros(len(pixels)), np.random.default_rng(0)
    radiance = compute_radiance(ground, alone, eye.position, eye.directions(pixels), 1 / eye.focal_px, nothing, random)
    return np.asarray(radiance > 0).reshape(eye.rows, eye.columns)


def count(lit: Array, sunlit: Array) -> tuple[float, float, float]:
    """The shares of the pixels (n,) that are judged wrong, of the shaded ones taken for lit, and of the lit ones taken
    for shaded; NaN without such pixels.
    """
    false, missed = lit & ~sunlit, ~lit & sunlit
    return (
        float((false | missed).mean()),
        float(false.sum() / (~sunlit).sum()) if not sunlit.all() else np.nan,
        float(missed.sum() / sunlit.sum()) if sunlit.any() else np.nan,
    )


def measure_ground(recipe: Recipe) -> list[tuple[float, Array]]:
    """For the Sun of each range the share of the seen ground in shadow, and ``count`` of each rule, (rules, 3)."""
    random = make_split_generator(recipe.seed, recipe.split, recipe.number, 5)
    light, azimuth = draw_light(recipe.split, random, FULL), float(random.uniform(0, 360))
    found = []
    ground = build_ground(recipe)
    try:
        for low, high in RANGES:
            own = replace(light, sky=_SKY, sun=direction_toward(azimuth, float(random.uniform(low, high))))
            prepared = prepare_made_pair(ground, SMALL, own, RAYS_PER_PIXEL, random)
            seen, sunlit = prepared.known, find_sunlit(ground, own)
            counts = [count(find(prepared)[seen], sunlit[seen]) for find in FINDERS.values()]
            found.append((1 - float(sunlit[seen].mean()), np.array(counts)))
    finally:
        release_ground(ground)
    return found


def print_group(title: str, counts: list[Array]) -> None:
    """A line for each rule: the means over images, and how many images it judges wrong in more than a tenth."""
    print(f"{title}: {len(counts)} images")
    for k, name in enumerate(FINDERS if counts else ()):
        own = np.array([each[k] for each in counts])
        wrong, false, missed = np.nanmean(own, axis=0)
        print(f"  {name:<10}{wrong:10.3f}{false:10.3f}{missed:10.3f}{int((own[:, 0] > 0.1).sum()):10d}")


def main(options: argparse.Namespace) -> None:
    """Measure and print a table."""
    start = time.process_time()
    found = [measure_ground(recipe) for recipe in draw_recipes(options.seed, "ground", options.grounds)]
    print(f"  {'rule':<10}{'wrong':>10}{'of shade':>10}{'of light':>10}{'over 0.1':>10}")
    for k, (low, high) in enumerate(RANGES):
        for dark in (True, False):
            title = f"Sun at {low:g} to {high:g} degrees, {'over' if dark else 'at most'} half of the ground in shadow"
            print_group(title, [counts for share, counts in (each[k] for each in found) if (share > _HALF) == dark])
    print(f"{time.process_time() - start:.0f} CPU s")
