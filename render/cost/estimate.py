"""Estimates a plan before it starts: processor time, disk space, and their uncertainty. Imports no Blender.

The processor seconds of a pair are a sum of a few terms, in proportion to pixels, samples and triangles. Their
coefficients are measured (``python benchmarks plan_cost``). Pairs of the data set that are complete correct the sum for
this machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from ...formats.calibrations.head_file import read_head
from ...physics.camera.eyes import EYE_TOPICS, find_light_px, is_calibrated
from ...physics.camera.stereo_camera import StereoCamera
from ...physics.scene_requirements import (
    choose_image_quality,
    follows_each_light,
    is_baked,
    only_camera_meets_relief,
    simplify_surface,
    surface_topics,
)
from ...settings import rebuilt_parts
from ...settings.topics.scene import Settings
from ...settings.topics.stand_ins import find_mesh_item
from ...settings.user_files import has_surroundings
from ...support.errors import IcyMoonError
from ...support.labels import IMAGE_PASS, NORMAL_PASS, list_rounded_passes
from ...support.number_text import format_count
from ...support.system import count_processors
from ..pairs.pair_folder import is_complete, read_pair
from ..plans.baked_or_traced import estimate_bake_seconds, estimate_light_bytes, make_light_key
from ..plans.planned_pair import PlannedPair
from ..plans.render_order import (
    DEFAULT_MAX_SCENES,
    choose_worker_count,
    cut_into_jobs,
    make_settings_key,
    order_pairs,
)
from ..plans.triangle_count import count_triangles
from .machine_speed import Speed, to_wall_seconds

#: Processor seconds for the process that starts workers, and for the start of a worker. These and the next numbers are
#: measured on a 2-core x86 server with Blender 5.0 (``python benchmarks plan_cost``).
_PROCESS_START_S, _WORKER_START_S = 1.0, 1.5
#: Processor seconds to build a scene, to build ground per million triangles, to build rocks, and to build ground from a
#: file.
_SCENE_S, _BUILD_S_PER_MTRI, _ROCKS_BUILD_S, _FILE_BUILD_S = 0.2, 0.7, 0.6, 1.15
#: Processor seconds of a pair in a built scene, without its pixels: fixed, per million triangles, and for rocks.
_PAIR_S, _PAIR_S_PER_MTRI, _ROCKS_PAIR_S = 0.05, 0.6, 0.4
#: Processor seconds of a megapixel: fixed, per sample, and of the denoiser.
_S_PER_MPX, _SAMPLE_S_PER_MPX, _DENOISE_S_PER_MPX = 2.1, 2.06, 3.5
#: Processor seconds of a megapixel of truth by ``quality.truth_by``, and of the trees for rays, once a scene (``python
#: benchmarks truth_cost``).
_TRUTH_S_PER_MPX, _RAYS_S_PER_MTRI = {"CYCLES": 5.6, "RAYS": 1.7}, 1.0


@dataclass(frozen=True)
class _LightBytes:
    """Bytes of light per pixel that shows ground, of images of 160 columns (``python benchmarks disk``). Light of ice
    in sunlight is the same in three bands, so it takes a third of its full size. Samples add bytes, up to ``most``."""

    one_sample: float
    per_doubling: float
    most: float
    denoised: float
    sun: float  # the factor of a light group on the bytes of the whole light
    planet: float
    coloured: float  # the same for a planet in colours, whose light differs between the three bands


@dataclass(frozen=True)
class _NormalBytes:
    """Bytes of normals per pixel that shows ground. The normal of a facet is the same on all its pixels. With edges of
    e pixels on the screen, normals take the fraction 1 - exp(-a e^b) of ``most``, where a is ``edges`` and b is
    ``power``.
    """

    shading: float
    most: float
    edges: float
    power: float
    grid: float  # factor on ``most`` where the ground is a grid


#: Bytes of light and of normals, by whether they are stored as 16-bit floats.
_LIGHT = {
    False: _LightBytes(2.6, 0.4, 4.2, 12.0, 0.97, 0.7, 1.9),
    True: _LightBytes(0.84, 0.25, 1.87, 3.87, 0.93, 1.04, 1.95),
}
_NORMALS = {False: _NormalBytes(11.9, 10.35, 10.8, -1.21, 0.9), True: _NormalBytes(4.3, 4.9, 7.7, -0.987, 0.87)}
#: Ground images with colours and detail in each pixel, so that light has as many values as noise gives it.
_DETAILED_IMAGES = ("STAND_IN", "OWN", "MESH")
#: Bytes per pixel: of depth, of the labels and normals that rocks add, of loose material, and of the rest.
_DEPTH_BYTES, _ROCK_LABEL_BYTES, _LOOSE_BYTES, _OTHER_BYTES = 4.0, 1.0, 2.3, 0.2
#: Bytes of one ``pair.json``.
STATED_BYTES = 25e3
#: Least pitch below the horizon in degrees for which visible facets are counted; a camera that looks farther up is
#: counted with this pitch.
_SHALLOWEST_PITCH_DEG = 15.0
#: Bytes of a facet's normals in truth by rays, as a fraction of Cycles' truth, which also has an alpha of 1.
_RAY_NORMALS_RATIO = 0.87
#: Neighbours in larger images are more alike: factor on the bytes per pixel for twice the columns.
_BYTES_RATIO_FOR_DOUBLE_WIDTH = 0.982
#: Cost of a sample with each law of light, relative to Lambert's law with shaded relief, without the relief. Bounces
#: count for little, since on open ground most paths end in the sky.
_COST_BY_MODEL = {
    "LAMBERT": 0.75,
    "LOMMEL_SEELIGER": 0.75,
    "LUNAR_LAMBERT": 0.8,
    "PRINCIPLED": 0.95,
    "HAPKE": 2.65,
    "SNOW": 0.8,
}
#: The same for Hapke's law by nodes and by the reference.
_HAPKE_NODES_COST, _HAPKE_REFERENCE_COST = 1.15, 3.45
#: Relative cost that shaded relief adds, and that it adds where only the camera meets it.
_RELIEF_COST, _RELIEF_CAMERA_COST = 0.25, 0.21
#: Relative cost that clear ice and rocks add.
_TRANSMISSION_COST, _ROCKS_COST = 0.3, 0.6
#: Relative cost that a veil adds: measured in one run with optical depth 0.5 on rough ice.
_VEIL_COST = 1.7
#: Relative cost that images on the ground add: with any law, and with Lambert's law, which reads only their colour and
#: normals. The last number is the added share for a mesh's own image.
_IMAGES_COST, _LAMBERT_IMAGES_COST, _OWN_IMAGE_SHARE = 2.9, 0.6, 0.3
#: Relative cost that subsurface scattering adds (random walk, Burley) at any length, and the weight at which it adds
#: half.
_WALK_COST, _BURLEY_COST, _HALF_COST_WEIGHT = 12.0, 0.5, 0.5
#: Cycles takes at least 16 t^-0.3 samples under a noise threshold t. Beyond them a pixel takes (s / t)², where s is the
#: noise of one sample: here the mean over the pixels of bare ice in sunlight.
_MIN_SAMPLES, _MIN_SAMPLES_POWER, _SAMPLE_NOISE = 16.0, -0.3, 0.2
#: Most scenes whose triangles are counted; other scenes are taken to have the mean of these.
_MAX_COUNTED_SCENES = 6
#: Number of triangles assumed for a ground that was not counted. The time depends little on it.
ASSUMED_TRIANGLES = 1e6
#: Most complete pairs of the data set whose times are read.
_MAX_TIMED_PAIRS = 400
#: Standard deviations of the logarithm of seconds: of the whole plan on another machine and on this one, before a pair
#: is known, and of one pair.
_PLAN_SPREAD, _PLAN_SPREAD_HERE, _PAIR_SPREAD = math.log(3.0) / 2, math.log(1.6) / 2, 0.25
#: The same on a graphics card.
_CARD_SPREAD = math.log(30.0) / 2


@dataclass(frozen=True)
class Work:
    """The work of a pair: pixels of both eyes, samples, cost of a sample relative to Lambert's law, whether the image
    is denoised, the processor seconds per megapixel of truth, and whether there are rocks.
    """

    pixels: int
    samples: float
    relative: float
    denoised: bool
    truth_s_per_mpx: float
    rocks: bool = False

    def seconds(self, triangles: float) -> float:
        """Return the processor seconds of the pair in a scene of ``triangles`` triangles that is already built."""
        mpx = self.pixels / 1e6
        return (
            _PAIR_S
            + _ROCKS_PAIR_S * self.rocks
            + _PAIR_S_PER_MTRI * triangles / 1e6
            + mpx
            * (
                _S_PER_MPX
                + self.truth_s_per_mpx
                + _DENOISE_S_PER_MPX * self.denoised
                + self.samples * self.relative * _SAMPLE_S_PER_MPX
            )
        )


def estimate_work(settings: Settings) -> Work:
    """Estimate the work of a pair with these complete settings."""
    quality = choose_image_quality(settings)
    topics, coverage = surface_topics(settings), settings.rocks.coverage
    weights = (1.0,) if len(topics) == 1 else (1.0 - coverage, coverage)
    relative = sum(weight * _sample_cost(settings, topic) for weight, topic in zip(weights, topics, strict=True))
    relative += _ROCKS_COST * (coverage > 0)
    samples = estimate_mean_samples(quality.samples, quality.noise_threshold)
    truth = _TRUTH_S_PER_MPX[quality.truth_by] if quality.truth == "FULL" else 0.0
    if follows_each_light(settings) and quality.denoiser == "NONE":
        relative *= 1 + len(settings.light.lamps)  # one render for each
    return Work(count_pixels(settings), samples, relative, quality.denoiser != "NONE", truth, coverage > 0)


def count_pixels(settings: Settings) -> int:
    """Count the pixels of the light of both eyes, margins included, and of the cameras beside them."""
    width, height = find_light_px(settings)
    eyes = 2 * width * height if settings.rig.images == "PAIR" else 0
    return eyes + count_head_pixels(str(settings.rig.head_file))


def count_head_pixels(file: str) -> int:
    """Count the pixels that are rendered for the cameras of a head; 0 for an unreadable head, which others report."""
    try:
        return _count_head_pixels(Path(file), Path(file).stat().st_mtime_ns) if file else 0
    except (OSError, IcyMoonError):
        return 0


@lru_cache(maxsize=64)
def _count_head_pixels(path: Path, _modified_ns: int) -> int:
    return sum(math.prod(camera.rendered.size_px) for camera in read_head(path).cameras)


def estimate_bytes(settings: Settings) -> float:
    """Estimate the bytes of the images of a pair with these complete settings, before any pair of the scene is
    known."""
    quality, light = choose_image_quality(settings), settings.light
    rounded = list_rounded_passes(quality.files, quality.half_floats)
    stored = _LIGHT[IMAGE_PASS in rounded]
    samples = estimate_mean_samples(quality.samples, quality.noise_threshold)
    noisy = min(stored.most, stored.one_sample + stored.per_doubling * math.log2(samples))
    if settings.textures.set in _DETAILED_IMAGES:
        noisy = stored.most * stored.coloured
    coloured = (light.planet and light.planet_face != "PLAIN") or bool(light.lamps)
    denoised = quality.denoiser != "NONE"
    seen = stored.denoised if denoised else noisy * (stored.coloured if coloured else 1.0)
    if light.planet or light.stars or light.lamps:
        beside = 0.0 if quality.files == "COMPACT" and not denoised else seen
        seen = beside + (stored.sun + (stored.coloured if coloured else stored.planet)) * noisy
        seen += len(light.lamps) * stored.coloured * noisy
    # One more copy of the truth for the rectified rig of eyes that are turned in.
    copies = 1.0 + (settings.rig.toe_in_deg != 0)
    truth = (
        _DEPTH_BYTES
        + _bytes_of_shape(settings, _NORMALS[NORMAL_PASS in rounded])
        + _LOOSE_BYTES * settings.quality.loose_thickness
        if quality.truth == "FULL"
        else _DEPTH_BYTES
    )
    larger = _BYTES_RATIO_FOR_DOUBLE_WIDTH ** math.log2(settings.rig.width_px / 160.0)
    if is_calibrated(settings.rig):  # and one more for the truth on the sensors
        sensors = sum(settings[topic].width_px * settings[topic].height_px for topic in EYE_TOPICS)
        copies += sensors / max(1, count_pixels(settings))
    return count_pixels(settings) * (
        larger * (1.0 - compute_sky_fraction(settings)) * (seen + copies * truth) + _OTHER_BYTES
    )


def _bytes_of_shape(settings: Settings, stored: _NormalBytes) -> float:
    """Compute the bytes per pixel of normals and labels. Cycles' truth has normals of shading too."""
    graded = settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED"
    fraction = 1.0 if graded else stored.grid
    if edge_px := settings.mesh.edge_px if graded else _edge_px(settings):
        fraction *= 1.0 - math.exp(-stored.edges * edge_px**stored.power)
    labels = _ROCK_LABEL_BYTES * (settings.rocks.coverage > 0)
    if settings.quality.truth_by == "RAYS":
        return stored.most * fraction + labels
    return stored.shading + stored.most * fraction / _RAY_NORMALS_RATIO + labels


def _edge_px(settings: Settings) -> float:
    """Compute the edge in pixels of a facet of ungraded ground at the centre of the view; 0 if unknown before the
    ground is read."""
    rig, source = settings.rig, settings.source
    if source.kind == "PROCEDURAL":
        edge_m = math.sqrt(2.0) * settings.terrain.size_m / (settings.terrain.resolution - 1)
    elif source.kind == "STAND_IN":
        item = find_mesh_item(source.stand_in)
        edge_m = item.size_m * math.sqrt(2.0 / item.triangles)
    else:
        return 0.0
    away_m = rig.height_m / math.sin(math.radians(max(_SHALLOWEST_PITCH_DEG, abs(rig.pitch_deg))))
    return edge_m / away_m * StereoCamera.from_settings(rig).focal_px


def compute_sky_fraction(settings: Settings) -> float:
    """Compute the fraction of an image above the edge of level ground, which is the horizon or the rim of a patch."""
    rig, source = settings.rig, settings.source
    camera = StereoCamera.from_settings(rig)
    endless = source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED"
    edge_m = max(settings.terrain.size_m / 2, settings.source.surroundings_m if has_surroundings(settings) else 0.0)
    down_deg = 0.0 if endless else math.degrees(math.atan2(rig.height_m, edge_m))
    above = math.radians(max(-89.0, min(89.0, rig.pitch_deg - down_deg)))  # pitch of the axis, below the edge
    row = camera.cy_px - camera.focal_px * math.tan(above)
    return min(1.0, max(0.0, (row + camera.margin_y_px) / camera.rendered_px[1]))


def _sample_cost(settings: Settings, topic: str) -> float:
    """Compute the cost of a sample that hits a surface, relative to Lambert's law with shaded relief."""
    surface, hapke = simplify_surface(settings, topic), settings.hapke
    relative = _COST_BY_MODEL[surface.model]
    if surface.model == "HAPKE":
        relative = {"REFERENCE": _HAPKE_REFERENCE_COST}.get(hapke.accuracy, relative)
        relative = {"NODES": _HAPKE_NODES_COST}.get(hapke.backend, relative)
    if surface.model == "PRINCIPLED":
        under, burley = surface.subsurface_weight, surface.subsurface_method == "BURLEY"
        relative += (_BURLEY_COST if burley else _WALK_COST) * under / (
            under + _HALF_COST_WEIGHT
        ) + _TRANSMISSION_COST * surface.transmission
    if surface.relief != "DISPLACEMENT" and surface.grain_amplitude_m > 0:
        relative += _RELIEF_CAMERA_COST if only_camera_meets_relief(surface, settings.quality) else _RELIEF_COST
    if settings.veil.optical_depth > 0:
        relative += _VEIL_COST
    if settings.textures.set == "NONE":
        return relative
    images = _LAMBERT_IMAGES_COST if surface.model == "LAMBERT" else _IMAGES_COST
    return relative + images * (_OWN_IMAGE_SHARE if settings.textures.set == "MESH" else 1.0)


def estimate_mean_samples(samples: int, threshold: float) -> float:
    """Estimate the mean number of samples per pixel under a noise threshold (0: no threshold), with at most ``samples``
    each.

    Measured by ``python benchmarks plan_cost``.
    """
    if threshold <= 0:
        return float(samples)
    return min(float(samples), max(_MIN_SAMPLES * threshold**_MIN_SAMPLES_POWER, (_SAMPLE_NOISE / threshold) ** 2))


def build_seconds(settings: Settings, triangles: float) -> float:
    """Return the processor seconds of building a scene."""
    traced = _RAYS_S_PER_MTRI * (settings.quality.truth == "FULL" and settings.quality.truth_by == "RAYS")
    return (
        _SCENE_S
        + (_BUILD_S_PER_MTRI + traced) * triangles / 1e6
        + _ROCKS_BUILD_S * (settings.rocks.coverage > 0)
        + _FILE_BUILD_S * (settings.source.kind != "PROCEDURAL")
    )


@dataclass(frozen=True)
class Estimate:
    """The work of a plan, and its remaining part.

    ``geometries``, ``surfaces`` and ``lights`` count distinct geometries, surfaces and lights; ``scenes`` is the number
    of builds. ``seconds`` are the processor seconds of all pairs. ``left_s`` are the processor seconds of the pairs
    still to render, and ``left_wall_s`` is the time for these by the clock. In 19 of 20 cases the true value lies
    between ``left_s`` divided by ``factor`` and ``left_s`` times ``factor``. ``measured`` is the number of complete
    pairs that corrected the estimate; with 0, the estimate rests on ``basis``.
    """

    pairs: int
    there: int
    geometries: int
    scenes: int
    surfaces: int
    lights: int
    seconds: float
    left_s: float
    left_wall_s: float
    left_bytes: float
    factor: float
    measured: int
    processors: int
    basis: str

    def lines(self) -> list[str]:
        """Describe the estimate in words, one line per item."""
        left = self.left_wall_s
        low, high = left / self.factor, left * self.factor
        basis = (
            f"corrected by {format_count(self.measured, 'rendered pair')}" if self.measured else f"from {self.basis}"
        )
        there = f", {self.there} already rendered" if self.there else ""
        lines = [
            f"{format_count(self.pairs, 'pair')}{there}",
            f"{format_count(self.geometries, 'ground')}, {format_count(self.surfaces, 'surface')}, "
            f"{format_count(self.lights, 'light')}; {format_count(self.scenes, 'scene')} to build",
        ]
        if self.there < self.pairs:
            lines += [
                f"{format_duration(left)} on {format_count(self.processors, 'processor')} ({format_duration(low)} to "
                f"{format_duration(high)}; {basis}), {format_duration(self.left_s)} of a processor",
                f"{format_size(self.left_bytes)} on the disk",
            ]
        return lines

    def to_json(self) -> dict[str, Any]:
        """Return the estimate as a JSON object."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__} | {"lines": self.lines()}


def format_duration(seconds: float) -> str:
    """Format a duration, as '40 s', '12 min', '5.5 h' or '3.2 days'."""
    for unit, length, limit in (("s", 1.0, 99.0), ("min", 60.0, 99.0), ("h", 3600.0, 48.0)):
        if seconds <= limit * length:
            return f"{seconds / length:.2g} {unit}"
    return f"{seconds / 86400.0:.2g} days"


def format_size(count: float) -> str:
    """Format a number of bytes, as '12 MB' or '3.4 GB'."""
    return f"{count / 1e6:.3g} MB" if count < 1e9 else f"{count / 1e9:.3g} GB"


def estimate_plan(pairs: Sequence[PlannedPair], dataset: Path | None = None, speed: Speed | None = None) -> Estimate:
    """Estimate the cost of planned pairs on a machine of a known ``speed``. Complete pairs cost nothing more, and their
    times correct the estimate."""
    pairs = order_pairs(pairs)
    keys = [
        tuple(
            make_settings_key(part, pair)
            for part in (rebuilt_parts.select_scene, rebuilt_parts.select_appearance, rebuilt_parts.select_light)
        )
        for pair in pairs
    ]
    triangles = _count_triangles_of_all({each[0]: pair for each, pair in zip(keys, pairs, strict=True)})
    there = {pair.id for pair in pairs if dataset is not None and is_complete(pair.folder(dataset))}
    scenes = {pair.id: each[0] for each, pair in zip(keys, pairs, strict=True)}
    expected = {
        pair.id: estimate_work(pair.settings).seconds(triangles[each[0]])
        for each, pair in zip(keys, pairs, strict=True)
    }
    ratios = _read_ratios(pairs, dataset, there, expected)
    factor, spread = _correct_by_pairs(ratios, speed, any(pair.settings.quality.device == "GPU" for pair in pairs))
    left = [pair for pair in pairs if pair.id not in there]
    lit = {make_light_key(pair.settings) for pair in pairs if pair.id in there and is_baked(pair.settings)}
    seconds = factor * _processor_seconds(pairs, scenes, triangles, expected, set())
    left_s = factor * _processor_seconds(left, scenes, triangles, expected, lit) if there else seconds
    return Estimate(
        pairs=len(pairs),
        there=len(there),
        geometries=len({make_settings_key(rebuilt_parts.select_geometry, pair) for pair in pairs}),
        scenes=len({k[0] for k in keys}),
        surfaces=len({k[1] for k in keys}),
        lights=len({k[2] for k in keys}),
        seconds=seconds,
        left_s=left_s,
        left_wall_s=to_wall_seconds(left_s, speed),
        left_bytes=_count_bytes(pairs, left, dataset, there),
        factor=math.exp(2.0 * spread),
        measured=len(ratios),
        processors=count_processors(),
        basis=speed.basis if speed else "another machine's times",
    )


def _processor_seconds(
    pairs: Sequence[PlannedPair],
    scenes: Mapping[str, str],
    triangles: Mapping[str, float],
    expected: Mapping[str, float],
    lit: Set[str],
) -> float:
    """Compute the processor seconds of ordered pairs on the machine where the coefficients were measured.

    ``scenes`` is the scene of each pair, ``triangles`` the number of triangles of each scene, and ``expected`` the
    seconds of each pair in a scene that is already built. A worker starts for each job and builds the scenes of that
    job. Light is baked once, unless ``lit`` names it as baked already.
    """
    seconds = _PROCESS_START_S if pairs else 0.0
    baked = set(lit)
    for job in cut_into_jobs(pairs, choose_worker_count(), DEFAULT_MAX_SCENES):
        seconds += _WORKER_START_S
        before = ""
        for pair in job:
            scene = scenes[pair.id]
            seconds += expected[pair.id]
            if scene != before:
                seconds += build_seconds(pair.settings, triangles[scene])
            before = scene
            if is_baked(pair.settings) and (light := make_light_key(pair.settings)) not in baked:
                seconds += estimate_bake_seconds(pair.settings)
                baked.add(light)
    return seconds


def estimate_roughly(some: Sequence[Settings], pairs: int, grounds: float, speed: Speed | None) -> tuple[float, float]:
    """Estimate the seconds on this machine and the bytes of a number of ``pairs`` and ``grounds``, from the settings of
    ``some`` pairs.

    This takes some milliseconds, because no triangles are counted and no pair of the data set is read.
    """
    work = sum(estimate_work(each).seconds(ASSUMED_TRIANGLES) for each in some) / len(some) * pairs
    work += grounds * build_seconds(some[0], ASSUMED_TRIANGLES) + _PROCESS_START_S + _WORKER_START_S
    return (
        to_wall_seconds((speed.factor if speed else 1.0) * work, speed),
        (sum(map(estimate_bytes, some)) / len(some) + STATED_BYTES) * pairs,
    )


def _count_triangles_of_all(scenes: Mapping[str, PlannedPair]) -> dict[str, float]:
    """Count the triangles of a few scenes, evenly chosen; the other scenes get their mean."""
    names = list(scenes)
    counted: dict[str, float] = {}
    for k in range(min(_MAX_COUNTED_SCENES, len(names))):
        name = names[k * len(names) // min(_MAX_COUNTED_SCENES, len(names))]
        try:
            counted[name] = count_triangles(scenes[name].settings)
        except IcyMoonError:
            continue  # a file that cannot be read; the build reports why
    mean = sum(counted.values()) / len(counted) if counted else ASSUMED_TRIANGLES
    return {name: counted.get(name, mean) for name in names}


def _read_pairs(
    pairs: Sequence[PlannedPair], dataset: Path, there: set[str]
) -> list[tuple[PlannedPair, dict[str, Any]]]:
    """Read the ``pair.json`` of up to ``_MAX_TIMED_PAIRS`` complete pairs."""
    found = []
    for pair in [pair for pair in pairs if pair.id in there][:_MAX_TIMED_PAIRS]:
        with suppress(IcyMoonError):  # verify reports the fault of such a pair
            found.append((pair, read_pair(pair.folder(dataset)).data))
    return found


def _read_ratios(
    pairs: Sequence[PlannedPair], dataset: Path | None, there: set[str], expected: Mapping[str, float]
) -> list[float]:
    """Read the measured processor seconds of pairs, and divide them by the expected seconds."""
    ratios = []
    for pair, facts in _read_pairs(pairs, dataset, there) if dataset is not None else ():
        taken, quality = facts.get("seconds", {}), facts["settings"].get("quality", {})
        threads = int(quality.get("threads") or count_processors())
        seconds = float(taken.get("render", 0.0)) * threads + float(taken.get("write", 0.0))
        if quality.get("device", "CPU") == "CPU":
            seconds = float(facts.get("cpu_seconds", {}).get("pair", seconds))
        if seconds > 0:
            ratios.append(seconds / expected[pair.id])
    return ratios


def estimate_prior_spread(speed: Speed | None, gpu: bool) -> float:
    """Estimate the standard deviation of the logarithm of the seconds, before the first pair is measured."""
    return _PLAN_SPREAD_HERE if speed else _CARD_SPREAD if gpu else _PLAN_SPREAD


def _correct_by_pairs(ratios: Sequence[float], speed: Speed | None, gpu: bool) -> tuple[float, float]:
    """Estimate the factor on the expected seconds, and the standard deviation of its logarithm.

    The logarithm is the weighted mean of normal distributions: one known before, and one for each pair.
    """
    before = estimate_prior_spread(speed, gpu) ** -2
    each = _PAIR_SPREAD**-2
    weight = before + each * len(ratios)
    known = math.log(speed.factor) if speed else 0.0
    mean = (before * known + each * sum(math.log(ratio) for ratio in ratios)) / weight
    return math.exp(mean), weight**-0.5


def estimate_remaining_bytes(pairs: Sequence[PlannedPair], dataset: Path, again: bool = False) -> float:
    """Estimate the bytes that rendering these pairs will write. Complete pairs correct the estimate; they count only if
    they are rendered ``again``."""
    there = {pair.id for pair in pairs if is_complete(pair.folder(dataset))}
    left = [pair for pair in pairs if again or pair.id not in there]
    return _count_bytes(pairs, left, dataset, there)


def _count_bytes(
    pairs: Sequence[PlannedPair], left: Sequence[PlannedPair], dataset: Path | None, there: set[str]
) -> float:
    """Count the bytes that are still to be written: the expected bytes of the remaining pairs, corrected by the
    complete pairs, and of the baked light of the remaining pairs."""
    known = [
        (sum(float(f["bytes"]) for f in facts["files"].values()), estimate_bytes(pair.settings))
        for pair, facts in (_read_pairs(pairs, dataset, there) if dataset is not None else ())
    ]
    expected = sum(estimate_bytes(pair.settings) for pair in left)
    if known:
        expected *= sum(a for a, _ in known) / sum(b for _, b in known)
    lights = {make_light_key(pair.settings): pair.settings for pair in left if is_baked(pair.settings)}
    return expected + STATED_BYTES * len(left) + sum(map(estimate_light_bytes, lights.values()))
