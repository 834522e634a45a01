"""The stand-in meshes: ground like a reconstruction from photographs, made by code.

First there is a true ground, relief and colour. It is "photographed" (light and shadow, exposures that differ from
photograph to photograph) into one image, and "reconstructed": few irregular triangles; fine relief lost; a doming of
the whole (James and Robson 2014, Earth Surf. Process. Landforms 39, 1413) and slow warps; noise; holes where the
ground was hidden; a ragged rim. All sizes of these errors are guesses. The last part of the module is what each
ground looks like.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..physics.mesh.mesh_faults import examine_mesh, label_components
from ..physics.random_numbers.seeds import make_generator
from ..settings.topics.stand_ins import MeshItem, find_mesh_item
from ..support.arrays import Array
from . import periodic_fields
from .ice_colours import ice_albedo, snow_albedo
from .periodic_fields import FieldGenerator
from .shown_items import MESH_IMAGE_SIDE_PX
from .texture_maps import DIRT_COLOUR, STAND_IN_SEED, make_bend, mix_colours
from .triangulation import triangulate

#: Pixels along a side of the true ground; the mesh has every second of its points.
_GROUND_SIDE_PX = 1024
#: Height of the doming, as a share of a mesh's width.
_DOMING_SHARE = 0.004
#: Standard deviation of the warps, as a share of the width.
_WARP_SHARE = 0.0015
#: Standard deviation of the noise, as a share of an edge.
_NOISE_SHARE = 0.02
#: Least distance of a hole from a site, in metres.
_SITE_TO_HOLE_M = 2.5
#: Least distance between holes and from the rim, in radii of a hole.
_HOLE_DISTANCE = 3.0


@dataclass(frozen=True)
class Reconstruction:
    """Vertices (k, 3) in metres, faces (m, 3), texture coordinates (k, 2) of the vertices, and the image (n, n, 3).

    The image is linear, 0 to 1, row 0 at the bottom.
    """

    positions: Array
    faces: Array
    uv: Array
    image: Array


@dataclass(frozen=True)
class _TrueGround:
    """A true ground: heights in metres and colour (n, n, 3), and the Sun in degrees (azimuth from east, elevation)."""

    height_m: Array
    colour: Array
    sun_deg: tuple[float, float]


def reconstruct(key: str, seed: int = STAND_IN_SEED) -> Reconstruction:
    """The stand-in mesh ``key``. Raises KeyError for another name."""
    item = find_mesh_item(key)
    random = make_generator(seed, "stand_ins", 1, item.number)
    draw = FieldGenerator(random, _GROUND_SIDE_PX)
    ground = _RECIPES[key](draw, item)
    pixel_m = item.size_m / _GROUND_SIDE_PX
    image = _photograph(draw, ground, pixel_m, surveyed=item.holes > 0)
    coarse = ground.height_m[::2, ::2] / (2 * pixel_m)
    places, faces = triangulate(random, np.pad(coarse, ((0, 1), (0, 1)), mode="wrap"), item.triangles, 0.03)
    edge_m = 2 * pixel_m * (_GROUND_SIDE_PX / 2) / math.sqrt(len(places))
    uv = places / (_GROUND_SIDE_PX / 2)
    xy = (uv - 0.5) * item.size_m
    height = periodic_fields.sample_wrapped(periodic_fields.blur(coarse, 0.7), places[:, 1], places[:, 0]) * 2 * pixel_m
    keep = _find_within_rim(random, xy[faces].mean(axis=1), item)
    keep = _find_largest_sheet(places, faces, keep)
    if item.holes:
        openness = periodic_fields.sample_wrapped(
            periodic_fields.estimate_openness(coarse, 24.0), places[:, 1], places[:, 0]
        )
        keep = _cut_holes(random, xy, faces, keep, openness, item)
    positions: Array = np.column_stack([xy, height])
    if item.holes:
        positions += _make_drift(random, xy, item.size_m)
        positions[:, 2] += _NOISE_SHARE * edge_m * random.standard_normal(len(positions))
    used, faces = np.unique(faces[keep], return_inverse=True)
    positions, uv, faces = positions[used], uv[used], faces.reshape(-1, 3)
    low, high = positions.min(axis=0), positions.max(axis=0)
    positions = positions - np.array([*(low + high)[:2] / 2, np.median(positions[:, 2])])
    return Reconstruction(positions.astype(np.float32), faces.astype(np.int32), uv.astype(np.float32), image)


def _make_drift(random: np.random.Generator, xy: Array, size_m: float) -> Array:
    """The doming and the slow distortion (k, 3) at positions (k, 2), in metres."""
    at = xy / size_m
    moved = np.zeros((len(xy), 3))
    moved[:, 2] = _DOMING_SHARE * size_m * (1.0 - 8.0 * (at**2).sum(axis=1))
    for _ in range(6):
        wave = random.standard_normal(2) * 1.2
        phase = 2 * math.pi * (at @ wave + random.random())
        way = random.standard_normal(3) * [1.0, 1.0, 2.0]
        moved += _WARP_SHARE * size_m * math.sqrt(2 / 6) * np.sin(phase)[:, None] * way
    return moved


def _find_within_rim(random: np.random.Generator, xy: Array, item: MeshItem) -> Array:
    """The positions within the ragged rim of the photographed ground."""
    turn = np.arctan2(xy[:, 1], xy[:, 0])
    radius = np.full(len(xy), 0.46)
    for k in range(2, 24):
        radius += 0.035 / k**0.9 * random.standard_normal() * np.cos(k * turn + 2 * math.pi * random.random())
    square = np.abs(xy).max(axis=1) < 0.495 * item.size_m
    if item.holes == 0:  # a terrain made by a program is square
        return square
    # A survey is flown over a rectangle: the rim is between a circle and a square.
    far = (np.abs(xy) ** 4).sum(axis=1) ** 0.25
    return np.asarray((far < radius * item.size_m) & square)


def _find_rim_edges(faces: Array) -> tuple[Array, Array]:
    """Start and end vertices of the boundary edges, which belong to only one face."""
    begin, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(begin, end).astype(np.int64) * (int(faces.max()) + 1) + np.maximum(begin, end)
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    alone = first[count == 1]
    return begin[alone], end[alone]


def _find_largest_sheet(places: Array, faces: Array, keep: Array) -> Array:
    """The faces to keep that belong to the largest part, without faces that touch others only at a corner."""
    keep = keep.copy()
    while True:
        kept = np.flatnonzero(keep)
        some = faces[kept]
        begin, end = some.ravel(), some[:, [1, 2, 0]].ravel()
        key = np.minimum(begin, end).astype(np.int64) * len(places) + np.maximum(begin, end)
        order = np.argsort(key, kind="stable")
        pair = np.flatnonzero(key[order][1:] == key[order][:-1])
        part = label_components(len(some), order[pair] // 3, order[pair + 1] // 3)
        largest = np.bincount(part).argmax()
        keep[kept[part != largest]] = False
        # Where two rims meet in a corner, and where a face hangs by one edge.
        starts = np.bincount(_find_rim_edges(faces[keep])[0], minlength=len(places))
        touching = np.flatnonzero(starts > 1)
        if part.max() == largest == part.min() and not len(touching):
            return keep
        keep &= ~np.isin(faces, touching).any(axis=1)


def _cut_holes(
    random: np.random.Generator,
    xy: Array,
    faces: Array,
    keep: Array,
    openness: Array,
    item: MeshItem,
) -> Array:
    """Return the faces that remain when ``item.holes`` holes are cut where the openness to the sky is least, away from
    sites and rim.
    """
    middle = xy[faces].mean(axis=1)
    rim = xy[_find_rim_edges(faces[keep])[0]]
    order = np.argsort(openness[faces].mean(axis=1) + 0.05 * random.random(len(faces)))
    made: list[tuple[Array, float]] = []
    for k in order:
        if len(made) == item.holes:
            break
        radius = item.size_m * (0.008 + 0.014 * random.random() ** 2)
        at = middle[k]
        near_site = min(math.dist(at, site) for site in item.sites) < _SITE_TO_HOLE_M + 2 * radius
        near_hole = any(math.dist(at, other) < _HOLE_DISTANCE * (radius + more) for other, more in made)
        near_rim = np.hypot(*(rim - at).T).min() < _HOLE_DISTANCE * radius
        if not keep[k] or near_site or near_hole or near_rim:
            continue
        turn = np.arctan2(middle[:, 1] - at[1], middle[:, 0] - at[0])
        ragged = 1.0 + 0.25 * np.cos(2 * turn + 6.3 * random.random()) + 0.2 * np.cos(5 * turn + 6.3 * random.random())
        before = keep
        keep = _find_largest_sheet(xy, faces, keep & (np.hypot(*(middle - at).T) > radius * ragged))
        if examine_mesh(_add_zero_heights(xy), faces[keep]).boundary_loops == len(made) + 2:
            made.append((at, radius))
        else:
            keep = before
    return keep


def _add_zero_heights(xy: Array) -> Array:
    return np.column_stack([xy, np.zeros(len(xy))])


def _photograph(draw: FieldGenerator, ground: _TrueGround, pixel_m: float, surveyed: bool) -> Array:
    """The image of a mesh: the colour in the light of its day, put together from photographs."""
    n = len(ground.height_m)
    lit = periodic_fields.light_relief(ground.height_m / pixel_m, ground.sun_deg, sky=0.5)
    picture = ground.colour * lit[..., None]
    if surveyed:
        shift = (0.2 * draw.waves(4.0, 1 / 20, 1 / 3), 0.2 * draw.waves(4.0, 1 / 20, 1 / 3))
        cells = draw.cells(4, shift, 0.4)
        exposure = np.exp(0.05 * draw.draw_normal_per_cell(cells))
        picture = picture * periodic_fields.blur(exposure, 4.0)[..., None]
    large = np.repeat(np.repeat(picture, MESH_IMAGE_SIDE_PX // n, axis=0), MESH_IMAGE_SIDE_PX // n, axis=1)
    large = np.stack([periodic_fields.blur(large[..., k], 0.9) for k in range(3)], axis=-1)
    fine = FieldGenerator(draw.random, MESH_IMAGE_SIDE_PX).waves(1.6, 2.5 / MESH_IMAGE_SIDE_PX, 1 / 60)
    large = large * np.exp(0.06 * fine)[..., None]
    return np.asarray(np.clip(large * (0.5 / large[..., 1].mean()), 0.0, 1.0))


# What each ground looks like


def _weight_away_from_sites(n: int, item: MeshItem) -> Array:
    """0 where a camera can stand, 1 from some metres away."""
    metres = ((np.arange(n) + 0.5) / n - 0.5) * item.size_m
    apart = [np.hypot(metres[None, :] - x, metres[:, None] - y) for x, y in item.sites]
    return periodic_fields.smooth_step(np.minimum.reduce(apart), 2.0, 4.5)


def _uniform_colour(colour: Array, n: int) -> Array:
    return np.broadcast_to(colour, (n, n, 3))


def _make_boulders(draw: FieldGenerator, across: int, share: float, there: Array | None = None) -> Array:
    """Heights of angular boulders in cells, 0 between them; ``there`` raises and lowers their number."""
    n = draw.n
    cells = draw.cells(across, make_bend(draw, 0.05))
    size = 0.12 + 0.4 * draw.draw_per_cell(cells) ** 3
    turn = 2 * math.pi * draw.draw_per_cell(cells)
    top = np.full((n, n), np.inf)
    for k in range(5):
        angle = turn + 1.257 * k + 0.5 * draw.draw_normal_per_cell(cells)
        top = np.minimum(top, size - (np.cos(angle) * cells.x + np.sin(angle) * cells.y))
    lean = 0.25 * (np.cos(turn) * cells.x + np.sin(turn) * cells.y)
    shape = np.minimum(1.5 * top, 0.7 * size + lean)
    chance = draw.draw_per_cell(cells) - (0.0 if there is None else 0.3 * there)
    return np.where((chance < share) & (cells.first < 0.6), np.maximum(shape, 0.0), 0.0) / across


def _draw_channel_shares(draw: FieldGenerator, count: int, turns: int, width_px: float) -> Array:
    """Share, 0 to 1, of each point in meandering channels with smooth banks; a column of pixels crosses ``count`` of
    them, a row ``turns``."""
    n = draw.n
    phase = (count * np.arange(n)[:, None] + turns * np.arange(n)[None, :]) / n
    bend = 0.3 * draw.waves(4.4, 1 / 4, 1.0) + 0.05 * draw.waves(3.6, 1 / 16, 1 / 5)
    apart = np.abs((phase + bend) % 1.0 - 0.5) * n / count
    return 1.0 - periodic_fields.smooth_step(
        apart * (1.0 + 0.4 * draw.waves(3.0, 1 / 12, 1 / 3)), 0.2 * width_px, width_px
    )


def _make_athabasca(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # Melting glacier surface: foliation, little channels, cryoconite holes, dust.
    w = item.size_m
    foliation = draw.waves(2.8, 1 / 120, 1 / 4, 8.0, 0.35)
    runnel = _draw_channel_shares(draw, 3, 1, 34.0)
    holes = draw.discs(260, 3.0, 14.0)
    bumps = draw.waves(3.2, 1 / 200, 1 / 6)
    height = (
        0.02 * w * draw.waves(4.4, 1 / 6, 1.0)
        + 0.04 * bumps
        + 0.02 * foliation
        - 0.16 * runnel
        - 0.08 * periodic_fields.blur(holes, 1.5)
    )
    share = 0.012 * np.exp(0.7 * foliation) * (1.0 - 0.6 * runnel)
    dust = np.clip(0.20 + 0.14 * bumps + 0.08 * foliation + 0.1 * draw.waves(1.8, 1 / 300, 1 / 10), 0, 1)
    colour = mix_colours(ice_albedo(share), _uniform_colour(1.6 * DIRT_COLOUR, n), np.maximum(dust, 0.9 * holes))
    return _TrueGround(height, colour, (140.0, 38.0))


def _make_glacier_42m(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # Crevasses across the flow, some open, with snow bridges, on swelling ice.
    w = item.size_m
    phase = 7.0 * np.arange(n)[:, None] / n + 0.0 * np.arange(n)[None, :]
    bend = 0.5 * draw.waves(4.4, 1 / 5, 1.0) + 0.06 * draw.waves(3.2, 1 / 40, 1 / 6)
    lane = phase + bend
    apart = np.abs(lane % 1.0 - 0.5) * w / 7.0
    gape = 0.75 * np.clip(draw.waves(3.6, 1 / 8, 1 / 2) + 0.1, 0.0, 2.0) * _weight_away_from_sites(n, item)
    wall = periodic_fields.smooth_step(gape - apart, 0.0, 0.35)
    swell = 0.9 * draw.waves(4.4, 1 / 6, 1.0)
    bumps = draw.waves(3.2, 1 / 160, 1 / 10)
    height = swell + 0.07 * bumps - 4.2 * wall * np.minimum(gape, 1.0) - 0.25 * np.exp(-((apart / 1.2) ** 2))
    layer = draw.waves(2.6, 1 / 200, 1 / 6, 6.0, 0.2)
    snow = periodic_fields.smooth_step(draw.waves(3.2, 1 / 60, 1 / 3), -0.7, 0.9) * (1.0 - wall)
    colour = mix_colours(ice_albedo(0.006 * np.exp(0.6 * layer)), snow_albedo(draw.make_uniform(0.0006)), snow)
    dirt = np.clip(0.12 + 0.12 * layer + 0.10 * bumps, 0.0, 0.8) * (1.0 - snow)
    return _TrueGround(height, mix_colours(colour, _uniform_colour(1.5 * DIRT_COLOUR, n), dirt), (60.0, 40.0))


def _make_bloodfalls(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # The front of a glacier, a cliff with flutes, from which iron stains run over an apron of ice and moraine.
    across, along = np.broadcast_to(np.arange(n)[:, None] / n, (n, n)), np.arange(n)[None, :] / n
    line = 0.40 + 0.04 * draw.waves(4.4, 1 / 5, 1.0)[n // 2][None, :]
    behind = line - across + 0.006 * draw.waves(3.0, 1 / 40, 1 / 8, 3.0, math.pi / 2)
    cliff = periodic_fields.smooth_step(behind, 0.0, 0.07) * periodic_fields.smooth_step(
        across, 0.0, 0.06
    )  # the square's edges meet
    low = 1.0 - cliff
    stones = (_make_boulders(draw, 46, 0.3) + 0.6 * _make_boulders(draw, 90, 0.35)) * low
    height = (
        4.5 * cliff
        + 0.3 * draw.waves(4.4, 1 / 8, 1.0)
        + 0.03 * draw.waves(3.0, 1 / 200, 1 / 12)
        + item.size_m * 0.5 * stones
    )
    below = across - line
    run = periodic_fields.smooth_step(draw.waves(3.0, 1 / 80, 1 / 5, 5.0, math.pi / 2), -0.7, 0.9)
    fan = np.exp(-(((along - 0.5) / (0.06 + 0.35 * np.maximum(below + 0.1, 0.0))) ** 2))
    stain = (
        0.9
        * run
        * fan
        * periodic_fields.smooth_step(below, -0.10, -0.04)
        * (1.0 - periodic_fields.smooth_step(below, 0.15, 0.5))
    )
    ice = ice_albedo(0.02 * np.exp(0.5 * draw.waves(2.6, 1 / 120, 1 / 6, 5.0, 0.0)))
    soil = 1.9 * DIRT_COLOUR * np.exp(0.3 * draw.waves(1.6, 1 / 300, 1 / 10))[..., None]
    bare = low * periodic_fields.smooth_step(draw.waves(3.0, 1 / 40, 1 / 3) + 60 * stones, -0.4, 0.6)
    colour = mix_colours(mix_colours(ice, soil, bare), _uniform_colour(np.array([0.36, 0.15, 0.06]), n), stain)
    return _TrueGround(height, colour, (250.0, 34.0))


def _make_seaice(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    # Floes pressed together: ridges of blocks along their edges, snow dunes with the wind, frozen ponds.
    w = item.size_m
    cells = draw.cells(4, make_bend(draw, 0.16))
    edge = cells.second - cells.first
    level = 0.12 * draw.draw_per_cell(cells)
    pressed = np.exp(-((edge / 0.10) ** 2)) * periodic_fields.smooth_step(draw.waves(3.4, 1 / 10, 1 / 2), -0.5, 1.0)
    blocks = np.maximum(_make_boulders(draw, 56, 0.75), 0.7 * _make_boulders(draw, 100, 0.7))
    dunes = np.maximum(draw.waves(3.4, 1 / 60, 1 / 6, 3.5, 0.2), -0.4)
    fine = draw.waves(2.8, 1 / 250, 1 / 30, 3.0, 0.2)
    snow = periodic_fields.smooth_step(dunes, -0.35, 0.5)
    height = (
        level + 0.09 * dunes + 0.008 * fine + pressed * (0.55 + w * 1.3 * blocks) + 0.05 * draw.waves(4.0, 1 / 8, 1.0)
    )
    pond = periodic_fields.smooth_step(-draw.waves(3.6, 1 / 16, 1 / 3), 0.9, 1.3) * (1.0 - pressed)
    grey = mix_colours(ice_albedo(draw.make_uniform(0.015)), ice_albedo(draw.make_uniform(0.002)) * 0.6, pond)
    colour = mix_colours(grey, snow_albedo(draw.make_uniform(0.0004)), snow * (1.0 - pond))
    colour = mix_colours(
        colour, ice_albedo(draw.make_uniform(0.006)), np.clip(pressed * 60 * blocks, 0, 1) * (1 - 0.5 * snow)
    )
    return _TrueGround(height * (1 - pond) + pond * (level - 0.05), colour, (200.0, 24.0))


def _make_matanuska_a1(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # Hummocks of ice under debris, bare on their steep sides.
    w = item.size_m
    hummock = draw.waves(4.0, 1 / 20, 1 / 3)
    stones = np.maximum(_make_boulders(draw, 40, 0.5), 0.8 * _make_boulders(draw, 100, 0.7))
    fine = draw.waves(2.4, 1 / 300, 1 / 30)
    height = 0.9 * hummock + 0.015 * fine
    x, y = periodic_fields.find_gradients(periodic_fields.blur(height, 3.0) * n / w)
    bare = periodic_fields.smooth_step(np.hypot(x, y) + 0.12 * draw.waves(2.6, 1 / 100, 1 / 12), 0.42, 0.62)
    height = height + w * 0.8 * stones * (1.0 - bare)
    tint = np.exp(0.3 * fine + 0.3 * draw.waves(1.6, 1 / 400, 1 / 60))
    layer = draw.waves(2.6, 1 / 160, 1 / 8, 7.0, 1.1)
    ice = mix_colours(
        ice_albedo(0.008 * np.exp(0.6 * layer)),
        _uniform_colour(1.4 * DIRT_COLOUR, n),
        np.clip(0.25 + 0.2 * layer, 0, 0.8),
    )
    return _TrueGround(height, mix_colours(2.0 * DIRT_COLOUR * tint[..., None], ice, bare), (150.0, 42.0))


def _make_matanuska_c1(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # White ice, weathered to a crust, with boulders, bands of debris, and a crevasse.
    w = item.size_m
    layer = draw.waves(2.8, 1 / 120, 1 / 4, 7.0, 0.8)
    crust = draw.waves(2.8, 1 / 250, 1 / 14)
    cracks = draw.lines(4, 0.7, 9.0, 0.4, 1)
    there = draw.waves(3.2, 1 / 20, 1 / 2)
    stones = np.maximum(_make_boulders(draw, 14, 0.16, there), 0.9 * _make_boulders(draw, 34, 0.16, there))
    height = (
        0.5 * draw.waves(4.4, 1 / 6, 1.0)
        + 0.02 * layer
        + 0.02 * crust
        - 0.4 * periodic_fields.blur(cracks, 1.5)
        + w * stones
    )
    grit = np.clip(periodic_fields.smooth_step(layer + 0.4 * draw.waves(1.6, 1 / 300, 1 / 30), 0.7, 1.9), 0, 0.9)
    ice = mix_colours(
        ice_albedo(0.03 * np.exp(0.5 * crust)), _uniform_colour(1.4 * DIRT_COLOUR, n), np.maximum(grit, 0.06)
    )
    rock = periodic_fields.smooth_step(stones * w, 0.0, 0.02)
    tint = np.exp(0.25 * draw.waves(1.8, 1 / 400, 1 / 20))
    return _TrueGround(height, mix_colours(ice, 1.7 * DIRT_COLOUR * tint[..., None], rock), (120.0, 40.0))


def _make_svalbard(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # Old snow in the lee of moraine ridges, cut by streams of meltwater.
    w = item.size_m
    ridge = -np.abs(draw.waves(4.2, 1 / 12, 1.0, 2.2, 0.6))
    stream = _draw_channel_shares(draw, 2, 1, 44.0)
    stones = np.maximum(_make_boulders(draw, 70, 0.45), _make_boulders(draw, 120, 0.5))
    soil = 2.2 * ridge + 0.03 * draw.waves(2.8, 1 / 250, 1 / 20) + w * 0.6 * stones - 0.5 * stream
    cover = periodic_fields.blur(soil, 26.0) + 0.28 + 0.3 * draw.waves(4.0, 1 / 16, 1 / 2) - 0.6 * stream
    snow = periodic_fields.smooth_step(cover - soil, -0.02, 0.04)
    ripple = 0.012 * draw.waves(3.0, 1 / 160, 1 / 20, 3.0, 0.2)
    height = np.maximum(soil, cover + ripple)
    tint = np.exp(0.35 * draw.waves(1.7, 1 / 400, 1 / 10))
    pink = 0.07 * periodic_fields.smooth_step(draw.waves(3.0, 1 / 40, 1 / 3), 0.3, 1.6)  # algae
    white = snow_albedo(draw.make_uniform(0.0008)) * (1.0 - pink[..., None] * np.array([0.0, 0.9, 0.6]))
    water = stream * (1.0 - snow)
    wet = 0.8 * periodic_fields.smooth_step(water, 0.5, 0.9)
    ground = mix_colours(2.1 * DIRT_COLOUR * tint[..., None], _uniform_colour(np.array([0.09, 0.16, 0.19]), n), wet)
    return _TrueGround(height, mix_colours(ground, white, snow), (220.0, 28.0))


def _make_gaea(draw: FieldGenerator, height: Array, rock: Array) -> _TrueGround:
    grey = mix_colours(snow_albedo(draw.make_uniform(0.0004)), ice_albedo(draw.make_uniform(0.02)) * 0.85, rock)
    return _TrueGround(height, grey, (180.0, 60.0))


def _make_gaea_ridgy(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    ridges = sum(0.4**k * (1.0 - np.abs(draw.waves(5.0, 1 / (6 * 2**k), 1 / (2 * 2**k), 1.7, 0.8))) for k in range(4))
    fine = draw.waves(2.8, 1 / 200, 1 / 24)
    height = 1.2 * np.asarray(ridges) + 0.012 * fine
    return _make_gaea(
        draw,
        height,
        periodic_fields.smooth_step(np.hypot(*periodic_fields.find_gradients(height * n / item.size_m)), 0.5, 0.9),
    )


def _make_gaea_rocky_perlin(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    swell = 1.0 * draw.waves(4.0, 1 / 20, 1 / 2)
    stones = np.maximum(_make_boulders(draw, 24, 0.3), _make_boulders(draw, 60, 0.4))
    height = swell + 0.03 * draw.waves(2.8, 1 / 200, 1 / 20) + 0.8 * item.size_m * stones
    return _make_gaea(draw, height, periodic_fields.smooth_step(item.size_m * stones, 0.0, 0.03))


def _make_gaea_rocky(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    height = 0.5 * draw.waves(4.4, 1 / 8, 1.0) + 0.012 * draw.waves(2.8, 1 / 200, 1 / 20)
    for across, rise in ((6, 0.8), (15, 0.35), (34, 0.12)):  # slabs, each tilted
        cells = draw.cells(across, make_bend(draw, 0.08))
        level = draw.draw_per_cell(cells)
        tilt = draw.random.standard_normal((across**2, 2))[cells.number]
        slab = level + 0.5 * (tilt[..., 0] * cells.x + tilt[..., 1] * cells.y)
        height = height + rise * slab * periodic_fields.smooth_step(cells.second - cells.first, 0.0, 0.10)
    height = periodic_fields.blur(height, 1.2)
    return _make_gaea(
        draw,
        height,
        periodic_fields.smooth_step(np.hypot(*periodic_fields.find_gradients(height * n / item.size_m)), 0.5, 1.0),
    )


def _make_matanuska_playground(draw: FieldGenerator, item: MeshItem) -> _TrueGround:
    n = draw.n
    # Smooth white ice, cut by deep blue channels of meltwater, with potholes.
    channel = _draw_channel_shares(draw, 2, 0, 46.0)
    pots = draw.discs(60, 6.0, 30.0)
    crust = draw.waves(2.9, 1 / 250, 1 / 14)
    layer = draw.waves(2.8, 1 / 120, 1 / 5, 6.0, 1.4)
    height = (
        0.7 * draw.waves(4.4, 1 / 6, 1.0)
        + 0.03 * crust
        + 0.03 * layer
        - 0.6 * channel
        - 0.25 * periodic_fields.blur(pots, 3.0)
    )
    blue = np.clip(channel + pots, 0.0, 1.0)
    ice = mix_colours(ice_albedo(0.04 * np.exp(0.4 * crust)), ice_albedo(draw.make_uniform(0.004)), blue)
    dust = np.clip(0.10 + 0.14 * layer, 0, 0.6) * (1 - blue)
    return _TrueGround(height, mix_colours(ice, _uniform_colour(1.4 * DIRT_COLOUR, n), dust), (80.0, 38.0))


_RECIPES: dict[str, Callable[[FieldGenerator, MeshItem], _TrueGround]] = {
    "ATHABASCA": _make_athabasca,
    "GLACIER_42M": _make_glacier_42m,
    "BLOODFALLS": _make_bloodfalls,
    "SEAICE1": _make_seaice,
    "MATANUSKA_A1": _make_matanuska_a1,
    "MATANUSKA_C1": _make_matanuska_c1,
    "SVALBARD1": _make_svalbard,
    "GAEA_RIDGY": _make_gaea_ridgy,
    "GAEA_ROCKY_PERLIN": _make_gaea_rocky_perlin,
    "GAEA_ROCKY": _make_gaea_rocky,
    "MATANUSKA_PLAYGROUND": _make_matanuska_playground,
}
