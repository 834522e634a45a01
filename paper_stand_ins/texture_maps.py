"""The maps of the stand-in textures: snow, firn and ice, made by code.

Each texture is a relief in metres and a material. The six that stand in for photographs have light and shadow in their
albedo image, as photographs do, so their other maps are optional. The statistics are in ``items``; the rest is a
guess.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..physics.random_numbers.seeds import make_generator
from ..settings.topics.stand_ins import TextureItem, find_texture_item
from ..support.arrays import Array
from . import periodic_fields
from .ice_colours import ice_albedo, snow_albedo
from .periodic_fields import FieldGenerator
from .shown_items import TEXTURE_SIDE_PX

#: The stand-ins are the same in every data set, so that their pairs can be compared.
STAND_IN_SEED = 0
DIRT_COLOUR = np.array([0.10, 0.085, 0.065])  # a guess: dark silt; only its ratio to the ice matters


@dataclass(frozen=True)
class Maps:
    """The maps of a texture, row 0 at the bottom.

    ``albedo`` (n, n, 3) linear, 0 to 1. ``height_m`` (n, n) metres. ``normal`` (n, n, 3) unit, x right, y up, z out.
    ``roughness`` and ``transmission`` (n, n), 0 to 1; ``transmission`` may be None.
    """

    albedo: Array
    roughness: Array
    height_m: Array
    normal: Array
    transmission: Array | None


@dataclass(frozen=True)
class _RecipeResult:
    """A recipe's result: relief in metres, colour (n, n, 3), roughness, transmission, and the Sun of a photograph
    (azimuth and elevation in degrees)."""

    height_m: Array
    colour: Array
    roughness: Array
    transmission: Array | None = None
    sun_deg: tuple[float, float] | None = None
    glint: Array | None = None
    scatter_m: float = 0.004  # a guess: how far light spreads in fresh snow


def make_maps(key: str, seed: int = STAND_IN_SEED, size: int = TEXTURE_SIDE_PX) -> Maps:
    """The maps of the stand-in texture ``key``. Raises KeyError for another name."""
    item = find_texture_item(key)
    random = make_generator(seed, "stand_ins", 0, item.number)
    made = _RECIPES[key](FieldGenerator(random, size), item)
    pixel_m = item.width_m / size
    height_m = made.height_m - made.height_m.mean()
    relief = height_m / pixel_m
    picture = made.colour
    if made.sun_deg is not None:
        lit = periodic_fields.light_relief(relief, made.sun_deg, scatter_px=made.scatter_m / pixel_m)
        picture = picture * lit[..., None]
    elif item.occluded:
        picture = picture * (periodic_fields.estimate_openness(relief, 48.0) ** 1.5)[..., None]
    if made.glint is not None:
        picture = picture + made.glint[..., None]
    transmission = made.transmission if "transmission" in item.kinds else None
    return Maps(
        _scale_to_mean(picture, item.mean),
        np.clip(made.roughness, 0.05, 1.0),
        height_m,
        periodic_fields.find_normals(relief),
        None if transmission is None else np.clip(transmission, 0.0, 1.0),
    )


def _scale_to_mean(picture: Array, mean: float) -> Array:
    """The picture scaled to this mean in green, and clipped to 0 to 1."""
    for _ in range(6):  # clipping at 1 darkens it again
        picture = np.clip(picture * (mean / picture[..., 1].mean()), 0.0, 1.0)
    return picture


def mix_colours(a: Array, b: Array, share: Array) -> Array:
    """Colours ``a`` where ``share`` is 0, ``b`` where it is 1."""
    return a + (b - a) * share[..., None]


def _make_grain(draw: FieldGenerator) -> Array:
    """Fine grain of snow: the smallest waves that an image can hold."""
    return draw.waves(1.0, 2.5 / draw.n, 1 / 40)


def make_bend(draw: FieldGenerator, cells: float) -> tuple[Array, Array]:
    """A smooth random shift (rows, columns) of ``cells`` cells."""
    return cells * draw.waves(5.0, 1 / 16, 1 / 2), cells * draw.waves(5.0, 1 / 16, 1 / 2)


def _make_snow_crystals(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Loose plates and columns of old crystals, a few millimetres wide, lying on each other.
    plates = np.maximum(draw.facets(40, 1.0), 0.7 * draw.facets(64, 1.2) + 0.15)
    heap = draw.waves(3.4, 1 / 16, 1 / 2)
    height = 0.0024 * np.clip(plates, -0.2, 1.6) + 0.004 * heap + 0.00003 * _make_grain(draw)
    x, y = periodic_fields.find_gradients(height * n / item.width_m)
    # A facet mirrors the Sun where it is tilted right: some crystals in a hundred are bright as a whole.
    glint = 1.1 * np.exp(-((x + 0.42) ** 2 + (y - 0.15) ** 2) / 0.006)
    tone = snow_albedo(0.0004 * np.exp(0.4 * draw.waves(2.0, 1 / 64, 1 / 3)))
    return _RecipeResult(
        height,
        tone,
        0.45 - 0.12 * np.clip(plates, 0, 1),
        sun_deg=(160.0, 38.0),
        glint=periodic_fields.blur(glint, 0.8),
        scatter_m=0.0006,
    )


def _make_hoar_frost(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Feathers of hoar: barbs slant away from a quill on both sides, the direction changing from feather to feather.
    across = 7
    cells = draw.cells(across, make_bend(draw, 0.2))
    turn, place = 2 * math.pi * draw.draw_per_cell(cells), draw.draw_per_cell(cells)
    x, y = cells.x / across, cells.y / across
    spread = 0.085
    quill = np.abs(
        ((np.cos(turn) * y - np.sin(turn) * x) / spread + place + 0.05 * draw.waves(3.0, 1 / 60, 1 / 8)) % 1.0 - 0.5
    )
    along = np.cos(turn) * x + np.sin(turn) * y
    barb = (along + 1.1 * spread * quill) / 0.0125 + 0.18 * draw.waves(2.4, 6 / n, 1 / 20)
    blades = (0.5 + 0.5 * np.cos(2 * math.pi * barb)) ** 1.5 * periodic_fields.smooth_step(
        draw.waves(2.0, 8 / n, 1 / 16), -1.4, 0.6
    )
    stem, tip = 1.0 - periodic_fields.smooth_step(quill, 0.0, 0.06), 1.0 - periodic_fields.smooth_step(quill, 0.28, 0.5)
    body = np.maximum(0.8 * blades * (0.25 + 0.75 * tip), stem)
    height = 0.0019 * body + 0.0016 * tip + 0.004 * draw.waves(3.8, 1 / 12, 1 / 2) + 0.00005 * _make_grain(draw)
    thick = periodic_fields.smooth_step(0.9 * body + 0.6 * tip + 0.5 * draw.waves(3.2, 1 / 30, 1 / 2), -0.3, 1.2)
    colour = mix_colours(0.7 * ice_albedo(draw.make_uniform(0.006)), snow_albedo(draw.make_uniform(0.0002)), thick)
    return _RecipeResult(
        periodic_fields.blur(height, 0.8), colour, 0.75 - 0.2 * body, sun_deg=(35.0, 34.0), scatter_m=0.001
    )


def _make_snow_drift(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Wind ripples, gentle to the wind and steep to the lee, that fork and fade, on low drifts.
    drift = draw.waves(4.4, 1 / 6, 1.0)
    bend = 0.9 * draw.waves(4.0, 1 / 4, 1.0) + 0.07 * draw.waves(3.2, 1 / 30, 1 / 5)
    saw = (14.0 * np.arange(n)[None, :] / n + bend) % 1.0
    ripple = np.where(
        saw < 0.72, periodic_fields.smooth_step(saw, 0.0, 0.72), 1.0 - periodic_fields.smooth_step(saw, 0.72, 1.0)
    )
    strength = periodic_fields.smooth_step(draw.waves(3.6, 1 / 6, 1 / 2), -1.4, 1.0)
    fine = draw.waves(2.6, 4 / n, 1 / 30, 3.0, math.pi / 2)
    height = (
        0.07 * drift + 0.016 * strength * periodic_fields.blur(ripple, 4.0) + 0.0008 * fine + 0.0003 * _make_grain(draw)
    )
    return _RecipeResult(
        height, snow_albedo(draw.make_uniform(0.0002)), draw.make_uniform(0.7), sun_deg=(180.0, 22.0), scatter_m=0.006
    )


def _make_crusted_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # A wind crust, broken: smooth plates at several levels over a rough layer of lumps.
    cells = draw.cells(7, make_bend(draw, 0.22))
    level = draw.draw_per_cell(cells)
    lumps = draw.waves(2.6, 5 / n, 1 / 20) + 0.5 * periodic_fields.normalise(draw.facets(40, 0.6).clip(-0.2))
    ragged = 0.10 * draw.waves(2.6, 5 / n, 1 / 8)
    plate = periodic_fields.smooth_step(level + ragged, 0.40, 0.43)
    crack = periodic_fields.smooth_step(cells.second - cells.first + 0.25 * ragged, 0.0, 0.06)
    crust = 0.005 + 0.010 * level + 0.0022 * draw.waves(3.6, 1 / 40, 1 / 4)
    whole = plate * crack
    height = (
        whole * crust
        + (1 - whole) * 0.0028 * periodic_fields.normalise(lumps)
        + 0.014 * draw.waves(4.4, 1 / 8, 1.0)
        + 0.00022 * _make_grain(draw)
    )
    tone = snow_albedo(np.where(whole > 0.5, 0.0003, 0.0008))
    return _RecipeResult(
        periodic_fields.blur(height, 1.0), tone, 0.7 - 0.25 * whole, sun_deg=(120.0, 28.0), scatter_m=0.005
    )


def _make_cracked_ice(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Dark clear ice of a lake: white cracks, some seen aslant as sheets, strings of bubbles, and blown snow.
    long = draw.lines(7, 0.9, 3.6, 0.35, 3)
    fine = draw.lines(26, 0.25, 1.6, 0.5, 1)
    lines = np.maximum(long, 0.6 * fine)
    sheet = np.zeros((n, n))
    for k in range(1, 22):
        sheet = np.maximum(sheet, np.roll(long, (k, k // 2), (0, 1)) * (1.0 - k / 22))
    patch = periodic_fields.smooth_step(draw.waves(3.0, 1 / 30, 1 / 3), 0.6, 2.2)
    bubbles = draw.discs(3200, 1.2, 10.0, 0.04 + patch)
    share = 0.0012 * np.exp(0.55 * draw.waves(3.6, 1 / 30, 1.0))
    streaks = draw.waves(2.2, 4 / n, 1 / 4, 3.0, 0.4)
    dust = periodic_fields.smooth_step(streaks, 0.9, 2.4) * (
        0.6 + 0.4 * periodic_fields.smooth_step(_make_grain(draw), -1, 1)
    )
    white = np.clip(
        0.9 * lines
        + 0.28 * sheet * (0.7 + 0.3 * periodic_fields.smooth_step(streaks, -1, 1))
        + 0.5 * bubbles
        + 0.75 * dust,
        0.0,
        1.0,
    )
    height = -0.0012 * lines + 0.0012 * draw.waves(4.4, 1 / 20, 1.0) + 0.0006 * dust
    dark = 0.45 * ice_albedo(share) + 0.02  # clear ice over dark water
    return _RecipeResult(
        height,
        mix_colours(dark, snow_albedo(draw.make_uniform(0.0003)), white),
        0.12 + 0.4 * white,
        sun_deg=(60.0, 45.0),
    )


def _make_powder_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Powder that has just fallen: soft swells, small clots that fell off a branch, and grain.
    swells = draw.waves(4.4, 1 / 40, 1.0)
    clots = np.maximum(draw.waves(3.0, 6 / n, 1 / 40), 0.0)
    scattered = periodic_fields.smooth_step(draw.waves(3.2, 1 / 20, 1 / 3), -0.2, 1.8)
    height = (
        0.016 * swells
        + 0.0008 * draw.waves(3.0, 4 / n, 1 / 16)
        + 0.0016 * clots * scattered
        + 0.00016 * _make_grain(draw)
    )
    return _RecipeResult(
        height, snow_albedo(draw.make_uniform(0.0001)), draw.make_uniform(0.85), sun_deg=(140.0, 26.0), scatter_m=0.004
    )


def _make_ground_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Thin snow that leaves stones and silt bare on raised ground.
    cells = draw.cells(24, make_bend(draw, 0.15))
    big = draw.draw_per_cell(cells) ** 3
    stones = np.sqrt(np.clip(0.32 - cells.first**2, 0.0, 1.0)) * big
    soil = 0.02 * draw.waves(3.4, 1 / 60, 1 / 2) + 0.03 * stones + 0.0008 * draw.waves(2.0, 4 / n, 1 / 40)
    cover = periodic_fields.blur(soil, 14.0) + 0.004 + 0.006 * draw.waves(3.4, 1 / 40, 1 / 3)
    snow = periodic_fields.smooth_step(cover - soil, -0.0015, 0.0015)
    height = np.maximum(soil, cover + 0.0006 * draw.waves(2.4, 4 / n, 1 / 30))
    tint = np.exp(0.35 * draw.waves(1.6, 3 / n, 1 / 8) + 0.6 * (draw.draw_per_cell(cells) - 0.5))
    return _RecipeResult(
        periodic_fields.blur(height, 0.7),
        mix_colours(1.6 * DIRT_COLOUR * tint[..., None], snow_albedo(draw.make_uniform(0.0003)), snow),
        0.85 - 0.2 * snow,
        0.25 * snow,
    )


def _make_lumpy_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Snow that fell in clumps, from a roof or a slope: round lumps of all sizes, half sunk.
    height = 0.020 * draw.waves(4.4, 1 / 12, 1.0)
    for across, share in ((8, 0.30), (17, 0.35), (36, 0.4), (70, 0.4)):
        cells = draw.cells(across, make_bend(draw, 0.05))
        size = draw.draw_per_cell(cells) ** 2.2
        lump = np.sqrt(np.clip((0.6 * size) ** 2 - cells.first**2, 0.0, None))
        height = height + share * item.width_m / across * lump
    height = periodic_fields.blur(height, 2.5) + 0.0007 * draw.waves(2.8, 5 / n, 1 / 20) + 0.0002 * _make_grain(draw)
    return _RecipeResult(height, snow_albedo(draw.make_uniform(0.0003)), draw.make_uniform(0.75))


def _make_firn(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    # Coarse round grains that froze together, and pits where they melted out.
    cells = draw.cells(64)
    small = draw.cells(128).first
    grains = np.sqrt(np.clip(0.6 - cells.first**2, 0.0, 1.0)) * (0.6 + 0.6 * draw.draw_per_cell(cells))
    pits = periodic_fields.smooth_step(draw.waves(3.4, 1 / 24, 1 / 5), 0.7, 2.4)
    height = (
        0.0026 * grains * (1.0 - 0.5 * pits) - 0.0006 * small - 0.011 * pits + 0.006 * draw.waves(3.4, 1 / 24, 1 / 2)
    )
    radius = 0.0012 * np.exp(0.5 * (draw.draw_per_cell(cells) - 0.5))
    wet = periodic_fields.smooth_step(cells.second - cells.first, 0.0, 0.2)
    return _RecipeResult(
        periodic_fields.blur(height, 1.0), snow_albedo(radius) * (0.88 + 0.12 * wet)[..., None], 0.5 - 0.2 * wet
    )


def _make_glacier_ice(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Bare glacier ice, scalloped by melt: crystals the size of a hand, foliation of bubbles, healed cracks, grit.
    cells = draw.cells(15, make_bend(draw, 0.2))
    edge = periodic_fields.smooth_step(cells.second - cells.first, 0.02, 0.08)
    healed = draw.lines(5, 0.8, 4.0, 0.25, 2)
    foliation = draw.waves(2.6, 1 / 80, 1 / 3, 8.0, 0.5)
    band = periodic_fields.smooth_step(foliation, -0.4, 1.6)
    scallop = draw.cells(6, make_bend(draw, 0.2), 0.2).first
    height = (
        0.05 * np.minimum(scallop, 0.9) ** 2
        + 0.0016 * edge
        + 0.0012 * periodic_fields.blur(healed, 1.0)
        + 0.008 * draw.waves(3.8, 1 / 30, 1 / 2)
        + 0.0012 * foliation
        + 0.0007 * draw.waves(2.6, 5 / n, 1 / 20)
    )
    share = 0.004 * np.exp(0.5 * (draw.draw_per_cell(cells) - 0.5)) + 0.03 * band**2
    white = np.clip(0.8 * healed + 0.3 * (1 - edge) * (0.4 + band) + 0.18 * band, 0.0, 1.0)
    colour = mix_colours(ice_albedo(share), snow_albedo(draw.make_uniform(0.0005)), white)
    low = periodic_fields.smooth_step(0.35 - scallop, 0.0, 0.35)  # grit gathers in the bowls
    grit = low * periodic_fields.smooth_step(draw.waves(1.2, 4 / n, 1 / 60), 1.2, 2.2)
    colour = mix_colours(colour, np.broadcast_to(DIRT_COLOUR, colour.shape), 0.8 * grit)
    return _RecipeResult(periodic_fields.blur(height, 1.0), colour, 0.22 + 0.35 * white + 0.2 * band)


def _make_mixed_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Snow with chips of ice and grit in it, as where it was dug or has fallen off a wall.
    height = 0.022 * draw.waves(4.0, 1 / 30, 1.0) + 0.0012 * draw.waves(2.8, 5 / n, 1 / 12) + 0.0003 * _make_grain(draw)
    colour, rough, clear = snow_albedo(draw.make_uniform(0.0004)), draw.make_uniform(0.8), draw.make_uniform(0.1)
    there = draw.waves(3.0, 1 / 16, 1 / 2)
    for across, kept in ((11, 0.30), (24, 0.28), (50, 0.2)):
        cells = draw.cells(across, make_bend(draw, 0.04))
        chance, tilt = draw.draw_per_cell(cells), draw.random.standard_normal((across**2, 2))[cells.number]
        # A convex chip: the lowest of three planes over each cell, cut off where it meets the snow.
        turn = 2 * math.pi * draw.draw_per_cell(cells)
        grown = np.full((n, n), np.inf)
        for k in range(3):
            angle = turn + 2.1 * k + 0.3 * tilt[..., 0]
            grown = np.minimum(grown, 0.34 - np.cos(angle) * cells.x - np.sin(angle) * cells.y)
        chip = np.minimum(grown, 0.16 + 0.25 * (np.cos(turn) * cells.x + np.sin(turn) * cells.y))
        chip = np.where((chance < kept + 0.12 * there) & (cells.first < 0.6), chip, -1.0) * item.width_m / across
        chip = np.minimum(chip, (cells.second - cells.first) * 0.5 * item.width_m / across)
        shown = periodic_fields.smooth_step(chip, 0.0, 0.0015)
        height = height + 0.55 * np.maximum(chip, 0.0)
        share = 0.006 * np.exp(0.8 * tilt[..., 1])
        colour = mix_colours(colour, ice_albedo(share), 0.8 * shown)
        rough, clear = rough - 0.5 * shown * rough, np.maximum(clear, 0.6 * shown)
    grit = periodic_fields.smooth_step(draw.waves(1.0, 4 / n, 1 / 90), 2.2, 2.8) * periodic_fields.smooth_step(
        draw.waves(3.0, 1 / 20, 1 / 2), -0.5, 1.0
    )
    return _RecipeResult(
        periodic_fields.blur(height, 0.7) + 0.0005 * grit,
        mix_colours(colour, np.broadcast_to(1.3 * DIRT_COLOUR, colour.shape), 0.85 * grit),
        rough,
        clear,
    )


def _make_settled_snow(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Windless settled snow: one smooth surface, dimpled where it sank.
    cells = draw.cells(5, make_bend(draw, 0.2))
    dimple = cells.first
    height = (
        0.022 * draw.waves(4.6, 1 / 20, 1.0)
        + 0.020 * np.minimum(dimple, 0.8) ** 2
        + 0.0005 * draw.waves(3.4, 6 / n, 1 / 16)
        + 0.00006 * _make_grain(draw)
    )
    return _RecipeResult(height, snow_albedo(draw.make_uniform(0.0002)), draw.make_uniform(0.8), draw.make_uniform(0.3))


def _make_suncups(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Bowls side by side with sharp rims between them; dust gathers on the rims.
    cells = draw.cells(8, make_bend(draw, 0.1), 0.3)
    depth = 0.15 + 0.09 * draw.draw_per_cell(cells)
    height = (
        periodic_fields.blur(np.minimum(cells.first, 0.85) ** 2 * depth, 3.0)
        + 0.006 * draw.waves(4.0, 1 / 24, 1 / 4)
        + 0.0008 * draw.waves(3.0, 5 / n, 1 / 24)
        + 0.00015 * _make_grain(draw)
    )
    rim = 1.0 - periodic_fields.smooth_step(cells.second - cells.first, 0.0, 0.16)
    dust = rim * periodic_fields.smooth_step(draw.waves(2.0, 4 / n, 1 / 12), -0.6, 1.6)
    colour = mix_colours(
        snow_albedo(draw.make_uniform(0.0007)), np.broadcast_to(3.5 * DIRT_COLOUR, (n, n, 3)), 0.12 * dust
    )
    return _RecipeResult(height, colour, 0.65 + 0.1 * rim, 0.3 - 0.1 * rim)


def _make_sastrugi(draw: FieldGenerator, item: TextureItem) -> _RecipeResult:
    n = draw.n
    # Tongues that the wind cut: long along it, steep toward it, at a few levels.
    shape = draw.waves(3.6, 1 / 30, 1 / 2, 3.0, 0.15)
    fine = draw.waves(2.6, 5 / n, 1 / 16, 5.0, 0.15)
    # The windward side, to the left, is cut back: steps are pulled toward what lies behind them.
    layers = np.zeros((n, n))
    for k, threshold in enumerate((-1.0, 0.0, 0.9)):
        edge = periodic_fields.warp_field(shape + 0.12 * fine, 0.0 * shape, 4.0 * fine)
        layers += (1.0 + 0.3 * (k % 2)) * periodic_fields.smooth_step(edge, threshold, threshold + 0.6)
    height = 0.016 * layers + 0.020 * shape + 0.0008 * fine + 0.0002 * _make_grain(draw)
    return _RecipeResult(
        periodic_fields.blur(height, 1.2),
        snow_albedo(draw.make_uniform(0.0002)),
        draw.make_uniform(0.72),
        draw.make_uniform(0.2),
    )


_RECIPES: dict[str, Callable[[FieldGenerator, TextureItem], _RecipeResult]] = {
    "SNOW_CRYSTALS": _make_snow_crystals,
    "HOAR_FROST": _make_hoar_frost,
    "SNOW_DRIFT": _make_snow_drift,
    "CRUSTED_SNOW": _make_crusted_snow,
    "CRACKED_ICE": _make_cracked_ice,
    "POWDER_SNOW": _make_powder_snow,
    "GROUND_SNOW": _make_ground_snow,
    "LUMPY_SNOW": _make_lumpy_snow,
    "FIRN": _make_firn,
    "GLACIER_ICE": _make_glacier_ice,
    "MIXED_SNOW": _make_mixed_snow,
    "SETTLED_SNOW": _make_settled_snow,
    "SUNCUPS": _make_suncups,
    "SASTRUGI": _make_sastrugi,
}
