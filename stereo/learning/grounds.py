"""Grounds for training pairs: their random choices, the held-out grounds, and the triangles that rays meet.

A ground is a terrain preset with its own seed, rocks, and shapes that no ice has, meshed in rings around one standing
place. Many crops share it. The seed, the split and the ground's number determine everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from ...physics.mesh.vertex_rings import VertexRings
from ...physics.random_numbers.seeds import make_generator
from ...physics.rocks.place_rocks import draw_footprints, make_instance_matrices, scatter_rocks
from ...physics.rocks.rock_shapes import FAMILIES, RockShape, make_rock_shapes
from ...physics.surfaces.hapke import bidirectional_reflectance, hapke_from_settings
from ...physics.surfaces.photometry import Law, lunar_lambert
from ...physics.surfaces.snow import snow_law
from ...physics.terrain.skirts import Skirts, build_skirts
from ...physics.terrain.terrain import Terrain, make_terrain
from ...rays.engine import open_tracer
from ...rays.shapes import Hits, Placed, Shape, World, normalize
from ...rays.stereo_truth import Stage
from ...rays.surface import Tracer
from ...settings.description import defaults, merged
from ...settings.preset_files import load_preset
from ...settings.topics.declaration import Parts
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from .patterns import Pattern, draw_pattern

#: A function that gives the reflectance law for albedos (n,): ``law(albedo)(incidence, emission, azimuth)``.
LawOfAlbedo = Callable[[Numbers], Law]

#: Terrains in training.
TERRAINS = (
    "brash_ice",
    "chaos",
    "europa_ridged_plain",
    "high_1",
    "high_2",
    "high_3",
    "low_1",
    "low_2",
    "low_3",
    "medium_1",
    "medium_2",
    "medium_3",
    "medium_4",
    "rough",
    "smooth",
    "sublimation_pits",
    "very_high",
)
#: Landforms that no training pair shows.
HELD_OUT_LANDFORMS = ("block_field", "penitentes")
#: Terrains of Enceladus, the body that no training pair shows.
HELD_OUT_BODY = ("fresh_snow_plain", "settled_snow", "suncups", "tiger_stripe_flank")
#: Range of the Sun's elevation, in degrees, in which no training pair is lit.
HELD_OUT_SUN_DEG = (10.0, 16.0)
#: Range of the Sun's elevation, in degrees, in all pairs.
SUN_DEG = (3.0, 65.0)
#: The splits and their children of the seed. No two splits share a ground. Training never shows the landforms, bodies
#: and Suns of the last three.
SPLITS = {"train": 0, "ground": 1, "landform": 2, "body": 3, "sun": 4}

#: The name of a terrain by the user's settings.
OWN = "own"
#: Label of ground, of rocks, and of shapes that no ice has.
GROUND, ROCK, OTHER_SHAPE = 1, 2, 3
#: Radius of the first ring of vertices, m, and the ratio of the vertices' spacing to their distance from the centre.
_FIRST_RING_M, _SPACING = 0.45, 0.012
#: Distance in metres at which the ground ends.
_LAST_RING_M = 70.0
#: Number of odd shapes on a ground is below the first; range of their distances from the standing place, m.
_MAX_SHAPES, _SHAPE_DISTANCE_M = 28, (0.9, 9.0)
#: Level of detail of rocks: about 1280 triangles for broken ice, 320 for others.
_ROCK_LEVEL = 2
_CLEAR_M = 0.5
#: Snow ends at an edge, as on the grounds on which the shipped weights were trained and judged.
_SHARP_SNOW: Parts = {"mantle": {"feather_m": 0.0}}
#: East and north of an azimuth, counted from east.
_CIRCLE: tuple[Callable[[Array], Array], ...] = (np.cos, np.sin)


@dataclass(frozen=True)
class Variety:
    """The differences between training pairs, which a study may narrow.

    They are the ``terrains``, the range ``suns_deg`` of the Sun's elevation, whether the albedo varies over a ground,
    and whether the sensor has noise and stray pixels. ``own`` are complete settings whose terrain, landforms and rocks
    all grounds have, in place of presets.
    """

    terrains: tuple[str, ...] = TERRAINS
    suns_deg: tuple[float, float] = SUN_DEG
    has_patterns: bool = True
    has_noise: bool = True
    own: Settings | None = None


#: All differences that training pairs can have.
FULL = Variety()


@dataclass(frozen=True)
class Recipe:
    """The random choices that determine a ground.

    ``terrain`` is a preset's name or ``OWN``, ``bare`` the settings without rocks and ``rocks`` with them, or None.
    ``place_m`` (2,) is the standing place, ``shapes`` the number of shapes that no ice has. ``law`` is the surface's
    reflectance law, named ``law_name``; ``albedo`` its mean parameter (Bond albedo, spherical albedo of snow, w of
    Hapke).
    """

    seed: int
    split: str
    number: int
    terrain: str
    bare: Settings
    rocks: Settings | None
    place_m: tuple[float, float]
    shapes: int
    law_name: str
    law: LawOfAlbedo
    albedo: float
    pattern: Pattern


@dataclass(frozen=True)
class ShadingTables:
    """Normals of all triangles of a world, for one look-up per ray.

    ``normals`` (k, 3) float32 are the normals, ``corners`` (m, 3) the indices of each triangle's three normals; a flat
    triangle has one normal three times. The triangles of place p begin at ``first`` (places,). ``turns`` (places, 3, 3)
    float32 rotate normals into the world. ``label`` (places,) and ``number`` (places,) describe the shape there.
    """

    normals: Array
    corners: Array
    first: Array
    turns: Array
    label: Array
    number: Array

    def find_normals(self, hits: Hits, rays: Array) -> Array:
        """Find the unit shading normals (n, 3) float32, outward, where the ``rays`` (n,) met the world."""
        place = hits.place[rays]
        corners = self.corners[self.first[place] + hits.triangle[rays]]
        u, v = hits.u[rays, None], hits.v[rays, None]
        a, b, c = (np.take(self.normals, corners[:, k], axis=0) for k in range(3))
        found = a + u * (b - a) + v * (c - a)
        turned = np.flatnonzero(self.label[place] != GROUND)
        found[turned] = np.einsum("nij,nj->ni", self.turns[place[turned]], found[turned])
        return np.asarray(found / np.sqrt(np.einsum("ij,ij->i", found, found))[:, None])


def make_shading_tables(world: World) -> ShadingTables:
    """Make the tables of a world whose shapes each have one label and are smooth or flat throughout."""
    normals, corners, first, count, triangles = [], [], [], 0, 0
    for each in world.placed:
        shape = each.shape
        if shape.smooth.all():
            normals.append(shape.normals)
            corners.append(shape.triangles.astype(np.int64) + count)
        else:
            number = np.arange(len(shape.triangles))
            normals.append(normalize(shape.planes(number)[:, :3]))
            corners.append(np.repeat(number[:, None], 3, axis=1) + count)
        count += len(normals[-1])
        first += [triangles] * len(each.places)
        triangles += len(shape.triangles)
    turns = np.linalg.inv(world.places[:, :3, :3]).swapaxes(1, 2)
    label = np.concatenate([np.repeat(each.shape.label[:1], len(each.places)) for each in world.placed])
    return ShadingTables(
        np.concatenate(normals).astype(np.float32),
        np.concatenate(corners),
        np.array(first),
        turns.astype(np.float32),
        label,
        world.numbers,
    )


@dataclass(frozen=True)
class Ground:
    """A ground with its tracer.

    ``height_m`` is the greatest height around the standing place, on which a camera stands.
    """

    recipe: Recipe
    world: World
    tracer: Tracer
    height_m: float
    shading: ShadingTables

    @property
    def stage(self) -> Stage:
        """The ground under an empty sky."""
        return Stage(self.world, self.tracer, World([]), self.tracer)


def check_split(split: str) -> None:
    """Raise IcyMoonError if the split is unknown."""
    if split not in SPLITS:
        raise IcyMoonError(f"There is no split {split!r} of made pairs; choose one of {', '.join(SPLITS)}.")


def make_split_generator(seed: int, split: str, *index: int) -> np.random.Generator:
    """Make the random generator of a ground or sample of a split."""
    return make_generator(seed, "training", 1, SPLITS[split], *index)


def draw_recipe(seed: int, split: str, number: int, variety: Variety = FULL) -> Recipe:
    """Draw the ground of this number. Raises IcyMoonError for an unknown split."""
    check_split(split)
    random = make_split_generator(seed, split, number)
    terrain = str(random.choice({"landform": HELD_OUT_LANDFORMS, "body": HELD_OUT_BODY}.get(split, variety.terrains)))
    rocks = str(random.choice(["", "rocks/sparse", "rocks/golombek_10", "rocks/golombek_20"]))
    place = random.uniform(-4.0, 4.0, 2)
    shapes = int(random.integers(0, _MAX_SHAPES)) if random.random() < 0.55 else 0
    name, law, albedo = _draw_law(random)
    pattern = draw_pattern(random)
    if not variety.has_patterns:
        pattern = replace(pattern, albedo=np.zeros_like(pattern.albedo))
    return Recipe(
        seed,
        split,
        number,
        terrain if variety.own is None else OWN,
        *_choose_settings(terrain, rocks, variety.own),
        (float(place[0]), float(place[1])),
        shapes,
        name,
        law,
        albedo,
        pattern,
    )


def _choose_settings(terrain: str, rocks: str, own: Settings | None) -> tuple[Settings, Settings | None]:
    """Return the complete settings of a ground without rocks, and with rocks or None if it has none."""
    if own is not None:
        return own, own if own.rocks.coverage else None
    bare = merged(defaults(), load_preset(f"terrains/{terrain}"), _SHARP_SNOW)
    if terrain == "block_field":
        rocks = "rocks/block_field"
    return bare, merged(bare, load_preset(rocks)) if rocks else None


def _draw_law(random: np.random.Generator) -> tuple[str, LawOfAlbedo, float]:
    """Draw a reflectance law: its name, the law, and its mean albedo."""
    name = str(random.choice(["LAMBERT", "LUNAR_LAMBERT", "SNOW", "HAPKE"], p=[0.4, 0.25, 0.2, 0.15]))
    if name == "SNOW":
        return name, snow_law, float(random.uniform(0.85, 0.99))
    if name == "HAPKE":
        surface = (
            f"surfaces/hapke_{random.choice(['europa_bright_plains', 'enceladus_global', 'europa_bands', 'rhea'])}"
        )
        chosen = merged(defaults(), load_preset(surface))
        return name, partial(_vary_hapke, chosen), float(chosen.hapke.w)
    share = float(random.uniform(0.2, 1.0)) if name == "LUNAR_LAMBERT" else 0.0
    return name, partial(lunar_lambert, share=share), float(random.uniform(0.3, 0.97))


def _vary_hapke(settings: Settings, w: Numbers) -> Law:
    """Return Hapke's law of a surface with another single-scattering albedo ``w``."""
    parameters = hapke_from_settings(settings.hapke)
    fields = {name: getattr(parameters, name) for name in parameters.__dataclass_fields__} | {"w": w}
    return partial(bidirectional_reflectance, parameters=type(parameters)(**fields))


def build_ground(recipe: Recipe) -> Ground:
    """Build the triangles of a ground and their tracer.

    Raises IcyMoonError without Embree, MemoryError without memory.
    """
    seed = int(make_split_generator(recipe.seed, recipe.split, recipe.number, 1).integers(2**31 - 1))
    terrain, placed = make_terrain(recipe.bare, seed, with_skirts=False), []
    if recipe.rocks is not None:
        placed = _lay_rocks(recipe.rocks, terrain, seed, recipe.place_m)
        terrain = replace(terrain, skirts=_make_skirts(recipe.rocks, terrain, seed, recipe.place_m))
    placed.insert(0, _mesh_terrain(terrain, recipe.place_m))
    if recipe.shapes:
        placed += _place_odd_shapes(recipe, terrain)
    world = World(placed)
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    x, y = (centre + 0.4 * f(around) for centre, f in zip(recipe.place_m, _CIRCLE, strict=True))
    return Ground(
        recipe, world, open_tracer(world), float(terrain.heights(x, y, 0.05).max()), make_shading_tables(world)
    )


@lru_cache(maxsize=1)
def _make_rings() -> tuple[VertexRings, Array]:
    """Make rings of vertices whose spacing grows with their distance, and their triangles."""
    ratio = 1.0 + _SPACING * np.sqrt(0.75)
    count = int(np.ceil(np.log(_LAST_RING_M / _FIRST_RING_M) / np.log(ratio)))
    radius = _FIRST_RING_M * ratio ** np.arange(count)
    rings = VertexRings.of(radius, _SPACING * radius)
    return rings, rings.faces().astype(np.uint32)


def _mesh_terrain(terrain: Terrain, place_m: tuple[float, float]) -> Placed:
    rings, triangles = _make_rings()
    x, y = rings.map_positions()
    shortest = rings.spread_to_vertices(2.0 * _SPACING * rings.radius_m, 2.0 * _SPACING * _FIRST_RING_M)
    heights = terrain.heights(x + place_m[0], y + place_m[1], shortest)
    vertices = np.stack([x + place_m[0], y + place_m[1], heights], axis=1).astype(np.float32)
    return _make_instances(vertices, triangles, GROUND, np.eye(4)[None], smooth=True)


def _make_instances(vertices: Array, triangles: Array, label: int, places: Array, smooth: bool) -> Placed:
    """Make a shape with one label, and its instances."""
    count = len(triangles)
    shape = Shape(
        vertices.astype(np.float32),
        triangles.astype(np.uint32),
        np.full(count, smooth),
        np.full(count, label, np.uint8),
    )
    return Placed(shape, places, np.arange(len(places), dtype=np.int64))


def _lay_rocks(settings: Settings, terrain: Terrain, seed: int, place_m: tuple[float, float]) -> list[Placed]:
    """Scatter the rocks of a ground; only those that look largest from the standing place remain."""
    shapes = make_rock_shapes(settings.rocks.family, float(settings.rocks.angularity), 0)
    surface = partial(terrain.heights, shortest_m=0.05)
    rocks = scatter_rocks(
        settings.rocks, terrain.size_m, seed, surface, shapes, (*place_m, _CLEAR_M), most_seen=_MAX_ROCKS
    )
    if not len(rocks.shape):
        return []
    matrices = make_instance_matrices(rocks.position_m, rocks.rotation, rocks.scale_m)
    return _place_shapes(shapes[_ROCK_LEVEL], rocks.shape, matrices, ROCK)


def _make_skirts(settings: Settings, terrain: Terrain, seed: int, place_m: tuple[float, float]) -> Skirts | None:
    """Make the skirts of the rocks of ``_lay_rocks``; None if the settings have no skirts."""
    if settings.rocks.skirt == 0.0:
        return None
    shapes = make_rock_shapes(settings.rocks.family, float(settings.rocks.angularity), 0)
    clear = (*place_m, _CLEAR_M)
    outlines = draw_footprints(settings.rocks, terrain.size_m, seed, shapes, clear, most_seen=_MAX_ROCKS)
    return build_skirts(outlines, settings.rocks)


#: Most rocks on a ground.
_MAX_ROCKS = 600


def _place_shapes(shapes: tuple[RockShape, ...], which: Array, matrices: Array, label: int) -> list[Placed]:
    """Make instances (n, 4, 4) of the shapes ``which`` (n,)."""
    return [
        _make_instances(shape.vertices, shape.triangles, label, matrices[which == k], smooth=not shape.plane.any())
        for k, shape in enumerate(shapes)
        if (which == k).any()
    ]


def _place_odd_shapes(recipe: Recipe, terrain: Terrain) -> list[Placed]:
    """Place shapes that no ice has, for steps in depth: rods, plates and lumps that stand, lean and hang in the air."""
    random = make_split_generator(recipe.seed, recipe.split, recipe.number, 2)
    shapes = make_rock_shapes(str(random.choice(FAMILIES)), 0.8, 0)[_ROCK_LEVEL]
    n = recipe.shapes
    distance = np.exp(random.uniform(np.log(_SHAPE_DISTANCE_M[0]), np.log(_SHAPE_DISTANCE_M[1]), n))
    azimuth = random.uniform(0, 2 * np.pi, n)
    x, y = (centre + distance * f(azimuth) for centre, f in zip(recipe.place_m, _CIRCLE, strict=True))
    size = distance * np.exp(random.uniform(np.log(0.03), np.log(0.35), n))
    kinds = np.array([[0.08, 0.08, 1.6], [0.06, 0.8, 1.1], [0.7, 0.7, 0.7]])  # a rod, a plate, a lump
    scale = size[:, None] * kinds[random.integers(0, 3, n)] * np.exp(random.normal(0, 0.2, (n, 3)))
    above = np.where(random.random(n) < 0.5, random.uniform(0.0, 1.6, n), 0.2 * size)
    position = np.stack([x, y, terrain.heights(x, y, 0.05) + above], axis=1)
    rotation = random.uniform(-np.pi, np.pi, (n, 3)) * np.where(random.random((n, 1)) < 0.5, 1.0, [0.1, 0.1, 1.0])
    return _place_shapes(
        shapes, random.integers(0, len(shapes), n), make_instance_matrices(position, rotation, scale), OTHER_SHAPE
    )


def release_ground(ground: Ground) -> None:
    """Free the memory of a ground's tracer."""
    ground.tracer.close()


def draw_sun_elevation_deg(split: str, random: np.random.Generator, suns_deg: tuple[float, float] = SUN_DEG) -> float:
    """Draw the elevation of the Sun in degrees, evenly in its logarithm.

    It is inside the held-out range for the split "sun", else outside. A narrower ``suns_deg`` must lie above this range
    or contain it.
    """
    low, high = np.log(suns_deg)
    start, end = np.log(HELD_OUT_SUN_DEG)
    if split == "sun":
        return float(np.exp(random.uniform(start, end)))
    if suns_deg[0] >= HELD_OUT_SUN_DEG[1]:
        return float(np.exp(random.uniform(low, high)))
    drawn = random.uniform(low, high - (end - start))
    return float(np.exp(drawn + (end - start if drawn > start else 0.0)))
