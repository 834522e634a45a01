"""Ray-traced training pairs: both images of a crop, its exact disparity, and the pixels hidden from the right eye.

A sample depends only on the seed, the split and its number, not on the process that makes it. Samples
``CROPS_PER_GROUND`` k to ``CROPS_PER_GROUND`` (k + 1) - 1 share ground k.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np

from ...physics.camera import rotations
from ...physics.camera.point_spread import apply_point_spread
from ...physics.camera.sensor import (
    choose_exposure_s,
    collect_electrons,
    convert_to_digital,
    draw_pattern,
)
from ...physics.light.directions import camera_axes, direction_toward
from ...rays.stereo_truth import Eye, find_hidden, list_squares, to_world
from ...settings.description import defaults, merged
from ...settings.topics.camera import SensorSettings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ..images.develop import to_8_bit
from . import CROP_PX
from .grounds import (
    FULL,
    Ground,
    Variety,
    build_ground,
    check_split,
    draw_recipe,
    draw_sun_elevation_deg,
    make_split_generator,
    release_ground,
)
from .radiance import Lighting, compute_radiance, measure_indirect

#: Number of samples that share a ground.
CROPS_PER_GROUND = 24
#: Range of the greatest disparity of a sample, px.
_REACH_PX = (10.0, 120.0)
#: Baselines in metres.
_BASELINE_M = (0.03, 0.6)
#: Quantile of the disparities that counts as the greatest.
_REACH_QUANTILE = 0.97
#: Share of samples whose images have two rays per pixel; the others have one.
_SHARE_OF_TWO_RAYS = 0.15
#: Side of a square of pixels that shares its indirect light, and number of bounced rays for it.
_SQUARE_PX, _BOUNCES_PER_SQUARE = 8, 8
#: Standard deviation of the pixel's filter in pixels, close to the Blackman-Harris window of Cycles.
_FILTER_PX = 0.33
_NEAR_M, _FAR_M = 1e-3, 1e4
#: A sensor without noise. The shot noise of such a full well is negligible.
_NO_NOISE = {"read_noise_e": 0.0, "prnu": 0.0, "dsnu_e": 0.0, "row_noise_e": 0.0, "full_well_e": 1e7}
#: Irradiance by the Sun, W/m², and its angular diameter, degrees, at Enceladus and Europa.
_SUNS = ((14.82, 0.0556), (50.26, 0.1024))
#: Electrons per second per W/(m² sr). The exposure follows the light, so that any value gives the same images.
_RATE = 1e5


@dataclass(frozen=True)
class Faults:
    """Deviations of the right eye from a rectified eye.

    ``turn_rad`` (3,) is a small rotation about its axes, ``shift_px`` a vertical shift, and ``gain`` the ratio of its
    exposure to the left eye's.
    """

    turn_rad: Array
    shift_px: float
    gain: float


@dataclass(frozen=True)
class View:
    """Cameras and light of a sample.

    ``right`` is the rectified eye, to which disparities refer; ``right_imaged`` is the eye with its ``faults``.
    """

    left: Eye
    right: Eye
    right_imaged: Eye
    baseline_m: float
    light: Lighting
    faults: Faults


@dataclass(frozen=True)
class MadePairs:
    """Pairs of a split. ``crop_px`` are width and height, multiples of 8.

    Raises IcyMoonError for an unknown split or other sizes.
    """

    split: str = "train"
    seed: int = 0
    crop_px: tuple[int, int] = CROP_PX
    variety: Variety = FULL

    def __post_init__(self) -> None:
        check_split(self.split)
        if min(self.crop_px) < 32 or any(side % _SQUARE_PX for side in self.crop_px):
            raise IcyMoonError(
                f"Crops of made pairs are {self.crop_px[0]} x {self.crop_px[1]} px; give multiples of 8 from 32 on."
            )

    @property
    def name(self) -> str:
        """Name for files, which differs where the samples differ."""
        narrowed = "" if self.variety == FULL else f"-{sha256(repr(self.variety).encode()).hexdigest()[:8]}"
        return f"{self.split}-{self.seed}{narrowed}"

    def iterate(self, first_ground: int = 0, step: int = 1) -> Iterator[dict[str, Any]]:
        """Yield samples without end, ground by ground: ``first_ground``, then every ``step``-th after it."""
        number = first_ground
        while True:
            yield from self.list_ground(number)
            number += step

    def list_ground(self, number: int) -> Iterator[dict[str, Any]]:
        """Yield the samples of one ground, as arrays; see ``make_sample``."""
        ground = build_ground(draw_recipe(self.seed, self.split, number, self.variety))
        try:
            for each in range(CROPS_PER_GROUND):
                yield self.make_sample(ground, number * CROPS_PER_GROUND + each)
        finally:
            release_ground(ground)

    def make_sample(self, ground: Ground, number: int) -> dict[str, Any]:
        """Make the sample of this number on its ground, like a sample of ``icymoon.torch.Dataset``, as NumPy arrays.

        It has ``left`` and ``right`` float32 (1, H, W) from 0 to 1, ``disparity_px`` float32 (H, W), 0 in the sky,
        ``valid`` and ``occluded`` bool (H, W), the numbers ``focal_px``, ``baseline_m``, ``cx_px`` and ``cy_px``, and
        the texts ``pair`` and ``scene``.
        """
        random = make_split_generator(self.seed, self.split, number // CROPS_PER_GROUND, 3, number)
        view = draw_view(ground, self.split, self.crop_px, random, self.variety)
        depth, hidden = trace_truth(ground, view)
        with np.errstate(divide="ignore"):
            disparity = view.left.focal_px * view.baseline_m / depth
        column = np.arange(self.crop_px[0]) + 0.5
        outside = column - disparity < 0
        rays = 2 if random.random() < _SHARE_OF_TWO_RAYS else 1
        light = [render_eye(ground, view.light, eye, rays, random) for eye in (view.left, view.right_imaged)]
        images = _develop(light, view.faults, random, self.variety.has_noise)
        return {
            "left": images[0][None],
            "right": images[1][None],
            "disparity_px": disparity.astype(np.float32),
            "valid": np.isfinite(depth),
            "occluded": hidden | (outside & np.isfinite(depth)),
            "focal_px": view.left.focal_px,
            "baseline_m": view.baseline_m,
            "cx_px": view.left.cx_px,
            "cy_px": view.left.cy_px,
            "pair": f"{self.split}-{self.seed}-{number}",
            "scene": f"{self.split}-{self.seed}-{ground.recipe.number}",
        }


def trace_truth(ground: Ground, view: View) -> tuple[Array, Array]:
    """Trace the planar depth (rows, columns), m, at pixel centres of the left eye, infinite for the sky.

    Also return whether the right eye sees something else there. Embree's single precision errs by 2.4e-7 of the depth.
    """
    depth, hidden = np.empty(view.left.rows * view.left.columns), np.empty(view.left.rows * view.left.columns, bool)
    for pixels in list_squares(view.left.rows, view.left.columns):
        direction = view.left.directions(pixels)
        along = ground.tracer.intersect(view.left.position, direction, _NEAR_M, _FAR_M).along
        depth[pixels] = along
        hidden[pixels] = find_hidden(
            ground.tracer, view.left, view.right, pixels, direction, along, view.baseline_m, _NEAR_M
        )
    shape = view.left.rows, view.left.columns
    return depth.reshape(shape), hidden.reshape(shape)


def draw_view(
    ground: Ground, split: str, crop_px: tuple[int, int], random: np.random.Generator, variety: Variety = FULL
) -> View:
    """Draw the cameras and the light of a sample. The baseline follows from the greatest disparity, which is drawn."""
    columns, rows = crop_px
    focal = columns * float(np.exp(random.uniform(np.log(0.7), np.log(3.5))))
    pitch, heading, roll = random.uniform(2.0, 38.0), random.uniform(0, 360), random.normal(0, 2.0)
    height = ground.height_m + random.uniform(0.6, 2.2)
    axes = camera_axes(heading, pitch, roll)
    position = np.array([*(np.array(ground.recipe.place_m) + random.uniform(-0.15, 0.15, 2)), height])
    left = Eye(
        columns, rows, focal, columns / 2 + random.normal(0, 20), rows / 2 + random.normal(0, 20), axes, position
    )
    depth = _measure_depths(ground, left)
    reach = np.exp(random.uniform(*np.log(_REACH_PX)))
    near = np.quantile(depth, 1 - _REACH_QUANTILE) if len(depth) else 5.0
    baseline = float(np.clip(reach * near / focal, *_BASELINE_M))
    right = Eye(columns, rows, focal, left.cx_px, left.cy_px, axes, position + baseline * axes[:, 0])
    faults = _draw_faults(focal, random)
    turned = axes @ rotations.from_vector(faults.turn_rad)
    imaged = Eye(columns, rows, focal, left.cx_px, left.cy_px + faults.shift_px, turned, right.position)
    return View(left, right, imaged, baseline, draw_light(split, random, variety), faults)


def _measure_depths(ground: Ground, eye: Eye) -> Array:
    """Measure the planar depths, m, at a sparse grid of pixels with ground."""
    row, column = np.meshgrid(np.arange(4, eye.rows, 12), np.arange(4, eye.columns, 12), indexing="ij")
    direction = eye.directions((row * eye.columns + column).ravel())
    along = ground.tracer.intersect(eye.position, direction, _NEAR_M, _FAR_M).along
    return along[np.isfinite(along)]


def _draw_faults(focal_px: float, random: np.random.Generator) -> Faults:
    """Draw the faults of the right eye. In half of the samples its pose has none."""
    crooked = random.random() < 0.5
    turn = random.normal(0, 0.25, 3) * [1.0, 0.3, 1.0] / focal_px * crooked
    gain = float(np.exp(random.normal(0, 0.06))) if random.random() < 0.7 else 1.0
    return Faults(turn, float(random.normal(0, 0.25)) * crooked, gain)


def draw_light(split: str, random: np.random.Generator, variety: Variety) -> Lighting:
    """Draw the light of a sample of a split."""
    irradiance, diameter_deg = _SUNS[int(random.integers(len(_SUNS)))]
    elevation, azimuth = draw_sun_elevation_deg(split, random, variety.suns_deg), float(random.uniform(0, 360))
    sky = float(random.uniform(0, 0.02)) if random.random() < 0.7 else float(random.uniform(0.02, 0.3))
    return Lighting(
        direction_toward(azimuth, elevation),
        irradiance,
        np.radians(diameter_deg) / 2,
        sky,
        random.uniform(0.15, 0.98, 32),
    )


def render_eye(ground: Ground, light: Lighting, eye: Eye, rays_per_pixel: int, random: np.random.Generator) -> Array:
    """Render the radiance (rows, columns), W/(m² sr), that an eye sees, with the noise of few rays per pixel."""
    count = eye.rows * eye.columns
    (squares,) = list_squares(eye.rows, eye.columns)
    indirect = _render_indirect(ground, light, eye, random).reshape(-1)[squares]
    total = np.zeros(count)
    for _ in range(rays_per_pixel):
        direction = _draw_directions(eye, squares, random)
        total[squares] += compute_radiance(ground, light, eye.position, direction, 1.0 / eye.focal_px, indirect, random)
    return (total / rays_per_pixel).reshape(eye.rows, eye.columns)


def _draw_directions(eye: Eye, pixels: Array, random: np.random.Generator) -> Array:
    """Draw rays (n, 3) through random points of the filters of pixels (n,), scaled to a planar depth of 1."""
    row, column = np.divmod(pixels, eye.columns)
    aside = random.normal(0, _FILTER_PX, (2, len(pixels)))
    own = np.stack(
        [
            (column + 0.5 + aside[0] - eye.cx_px) / eye.focal_px,
            (row + 0.5 + aside[1] - eye.cy_px) / eye.focal_px,
            np.ones(len(pixels)),
        ],
        axis=1,
    )
    return to_world(own, eye.axes)


def _render_indirect(ground: Ground, light: Lighting, eye: Eye, random: np.random.Generator) -> Array:
    """Render the irradiance (rows, columns), W/m², by other ground and the sky.

    It is traced for the middle of each square, smoothed over three squares, and linear between them.
    """
    rows, columns = eye.rows // _SQUARE_PX, eye.columns // _SQUARE_PX
    row, column = np.divmod(np.arange(rows * columns), columns)
    middle = (row * _SQUARE_PX + _SQUARE_PX // 2) * eye.columns + column * _SQUARE_PX + _SQUARE_PX // 2
    found = measure_indirect(ground, light, eye.position, eye.directions(middle), _BOUNCES_PER_SQUARE, random)
    coarse = _smooth(found.reshape(rows, columns))
    return _stretch(_stretch(coarse, eye.rows).T, eye.columns).T


def _smooth(image: Array) -> Array:
    """Average an image (H, W) over 3 x 3 neighbours; border pixels are repeated."""
    for axis in (0, 1):
        padded = np.pad(image, [(1, 1) if axis == k else (0, 0) for k in (0, 1)], mode="edge")
        length = image.shape[axis]
        image = sum(np.take(padded, np.arange(k, k + length), axis) for k in range(3)) / 3.0
    return image


def _stretch(image: Array, rows: int) -> Array:
    """Stretch an image (h, w) to ``rows`` rows, linearly between the middles of the image's rows."""
    place = np.clip((np.arange(rows) + 0.5) * len(image) / rows - 0.5, 0, len(image) - 1)
    first = np.minimum(place.astype(np.intp), len(image) - 2)
    share = (place - first)[:, None]
    return np.asarray((1 - share) * image[first] + share * image[first + 1])


def draw_sensor(random: np.random.Generator) -> SensorSettings:
    """Draw a sensor: from clean to noisy, from sharp to soft."""
    bits = int(random.choice([8, 10, 12]))
    sensor = {
        "bits": bits,
        "read_noise_e": float(np.exp(random.uniform(np.log(1.0), np.log(40.0)))),
        "full_well_e": float(np.exp(random.uniform(np.log(4e3), np.log(5e4)))),
        "prnu": float(random.uniform(0, 0.02)),
        "dsnu_e": float(random.uniform(0, 10.0)),
        "row_noise_e": float(random.uniform(0, 4.0)) * (random.random() < 0.3),
        "black_level": float(random.uniform(0, 0.05)),
        "psf_sigma_px": float(random.uniform(0.1, 0.9)),
        "veiling_glare": float(random.uniform(0, 0.08)) * (random.random() < 0.4),
        "auto_exposure": True,
        "auto_percentile": float(random.uniform(0.9, 0.99)),
        "auto_target": float(random.uniform(0.35, 1.0)),
        "encoding": str(random.choice(["LINEAR", "SQUARE_ROOT"])),
    }
    return merged(defaults(), {"sensor": sensor}).sensor


def _change_sensor(sensor: SensorSettings, values: Mapping[str, Any]) -> SensorSettings:
    return merged(defaults(), {"sensor": {**dict(sensor), **values}}).sensor


def _develop(light: list[Array], faults: Faults, random: np.random.Generator, has_noise: bool = True) -> list[Array]:
    """Develop both images, float32 (H, W) from 0 to 1 in steps of 1/255, from radiances (H, W) by a random sensor."""
    sensor = draw_sensor(random)
    noise = float(random.uniform(0, 0.04)) * (random.random() < 0.5)
    strays = float(np.exp(random.uniform(np.log(1e-5), np.log(3e-3)))) * (random.random() < 0.5)
    if not has_noise:
        sensor, noise, strays = _change_sensor(sensor, _NO_NOISE), 0.0, 0.0
    blur_differs = 0.4 * float(random.random() < 0.25)
    power = float(np.exp(random.normal(0, 0.2)))
    seconds = choose_exposure_s(light[0], _RATE, sensor)
    images = []
    for eye, (name, radiance) in enumerate(zip(("left", "right"), light, strict=True)):
        seen = _add_strays(radiance * (1.0 + noise * random.standard_normal(radiance.shape)), strays, random)
        own = sensor
        if eye:
            own = _change_sensor(sensor, {"psf_sigma_px": sensor.psf_sigma_px + blur_differs})
        seen = apply_point_spread(seen, own) * (faults.gain if eye else 1.0)
        pattern = draw_pattern(int(random.integers(2**31 - 1)), name, (seen.shape[0], seen.shape[1]), sensor)
        charge = collect_electrons(seen, seconds, _RATE, sensor, random, pattern)
        shown = to_8_bit(convert_to_digital(charge, sensor), int(sensor.bits), str(sensor.encoding))
        images.append((np.rint(255.0 * (shown / 255.0) ** power) / 255.0).astype(np.float32))
    return images


def _add_strays(radiance: Array, share: float, random: np.random.Generator) -> Array:
    """Return radiance with pixels that are far too bright or dark, such as fireflies of a render, glints and dead
    pixels.

    Each eye has its own.
    """
    count = int(random.poisson(share * radiance.size))
    if not count:
        return radiance
    place = random.integers(0, radiance.size, count)
    level = float(np.quantile(radiance, 0.9))
    changed = radiance.copy().reshape(-1)
    changed[place] = np.where(random.random(count) < 0.85, level * random.exponential(6.0, count), 0.0)
    return changed.reshape(radiance.shape)
