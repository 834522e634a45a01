"""Developing a pair: from linear radiance to the grey images that matchers get."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import IcyMoonError
from ...labels import LIGHT_GROUPS
from ...physics.camera import brackets
from ...physics.camera.blur import developing_warnings
from ...physics.camera.particle_hits import draw_hits
from ...physics.camera.point_spread import apply_lens
from ...physics.camera.sensor import (
    capacity_e,
    digital_numbers,
    draw_pattern,
    electrons,
    exposure_s,
    exposure_warnings,
    gain_dn_per_e,
    noise_generator,
    top_dn,
)
from ...physics.light.photons import electron_rate, pixel_pitch_m
from ...render.pairs.pair_folder import EYES, Pair, StereoCamera
from ...typed_settings import LightSettings, Settings
from .exr import Light
from .lens import Lens, lens_of


@dataclass(frozen=True)
class Frame:
    """One exposure of both eyes: uint16 (H, W) digital numbers with the bits of the sensor."""

    seconds: float
    left: np.ndarray
    right: np.ndarray


@dataclass(frozen=True)
class Images:
    """A developed pair, uint16 (H, W) digital numbers of ``bits`` bits: one exposure, or several merged."""

    left: np.ndarray  # rectified, on the truth
    right: np.ndarray
    detected_left: np.ndarray  # on the sensor; the same unless the lens distorts or the eyes are toed in
    detected_right: np.ndarray
    bits: int
    frames: tuple[Frame, ...]  # the exposures, longest first
    exposure_s: float  # of the metered exposure
    gain_dn_per_e: float
    electron_rate: float  # electrons per second per W/(m² sr)
    saturation_radiance: float  # W/(m² sr) at the top of the images; infinite if none reaches it
    saturated: float  # share of the left pixels at the converter's top, in the shortest exposure
    encoding: str
    warnings: tuple[str, ...]  # about blur in the render and about the exposure

    def for_matchers(self) -> tuple[np.ndarray, np.ndarray]:
        """Left and right as uint8, the only type that OpenCV's matchers take; more bits are scaled down."""
        return to_8_bit(self.left, self.bits, self.encoding), to_8_bit(self.right, self.bits, self.encoding)


def grey(radiance: np.ndarray) -> np.ndarray:
    """Mean of the bands, float64 (H, W), of radiance (H, W, 3).

    A panchromatic camera weights the bands equally; luminance weights belong to the human eye. Icy surfaces are grey,
    so the choice matters only for coloured objects.
    """
    # Twice as fast as mean(), which adds up the short last axis one pixel at a time.
    return (radiance[..., 0].astype(np.float64) + radiance[..., 1] + radiance[..., 2]) / 3


def scaled_radiance(view: Light, pair: Pair, light: LightSettings) -> np.ndarray:
    """Radiance (H, W, 3) with the Sun and the planet scaled by ``sun_scale`` and ``planet_scale``.

    Light is linear, so a new render would give the same. A pair without light groups has one light, the Sun. Raises
    IcyMoonError if the image is not the sum of its groups.
    """
    scales = {group: float(light[key]) for group, key in LIGHT_GROUPS.items()}
    if not view.groups:
        return view.radiance * np.float32(scales["Sun"]) if scales["Sun"] != 1 else view.radiance
    changed = {group: scale for group, scale in scales.items() if scale != 1 and group in view.groups}
    if changed and pair.settings.quality.denoiser != "NONE":
        raise IcyMoonError(f"{pair.folder} was denoised, but its light groups were not; render it with "
                           f"quality.denoiser NONE to change light.{LIGHT_GROUPS[next(iter(changed))]}.")
    radiance = view.radiance
    for group, scale in changed.items():
        radiance = radiance + np.float32(scale - 1) * view.groups[group]
    return radiance


def develop(pair: Pair, left: Light, right: Light, settings: Settings) -> Images:
    """Develop both eyes with the same response and exposure, and with independent noise.

    ``left`` and ``right`` are the light that falls into the eyes, see ``views.read_eye``. The response in ``settings``
    may differ from the one that the pair was rendered with. The same pair, data set seed and noise seed always give
    the same noise.
    """
    sensor, rig = settings.sensor, settings.rig
    pitch_m = pixel_pitch_m(sensor, rig)
    rate = electron_rate(settings.light, sensor, pitch_m)
    lenses = {eye: lens_of(pair.camera, rig, eye) for eye in EYES}
    scaled = {eye: grey(scaled_radiance(view, pair, settings.light))
              for eye, view in (("left", left), ("right", right))}
    light = {eye: apply_lens(_on_sensor(scaled[eye], pair.camera, lenses[eye]), sensor) for eye in EYES}
    metered = exposure_s(light["left"], rate, sensor)
    times = brackets.exposure_times(metered, sensor)
    seed = int(pair.settings.dataset.seed)
    image = {eye: _exposures(light[eye], times, rate, settings, (seed, pair.id, eye), pitch_m) for eye in EYES}
    frames = tuple(Frame(*each) for each in zip(times, image["left"], image["right"], strict=True))
    full_s = capacity_e(sensor) / times[-1]  # electrons per second
    if len(frames) == 1:
        bits, final = int(sensor.bits), {eye: image[eye][0] for eye in EYES}
    else:
        merged = {eye: brackets.merge_exposures(image[eye], times, sensor) for eye in EYES}
        full_s = brackets.full_rate(merged["left"], times[-1], sensor)
        bits, final = brackets.MERGED_BITS, {eye: brackets.quantise(merged[eye], full_s) for eye in EYES}
    saturated = float(np.mean(image["left"][-1] == top_dn(sensor)))
    detected = final
    final = {eye: numbers if (lens := lenses[eye]) is None else lens.rectify(numbers)
             for eye, numbers in detected.items()}
    return Images(final["left"], final["right"], detected["left"], detected["right"], bits, frames, metered,
                  gain_dn_per_e(sensor), rate, full_s / rate if rate else float("inf"),
                  saturated, str(sensor.encoding),
                  (*developing_warnings(settings, pair.settings, times),
                   *exposure_warnings(metered, saturated, sensor)))


def _on_sensor(light: np.ndarray, camera: StereoCamera, lens: Lens | None) -> np.ndarray:
    return camera.cropped(light) if lens is None else lens.distort(light)


def _exposures(light: np.ndarray, times: list[float], rate: float, settings: Settings,
               stream: tuple[int, str, str], pitch_m: float) -> list[np.ndarray]:
    """Digital numbers of one eye, exposed for each of ``times``."""
    sensor, seed = settings.sensor, int(settings.sensor.noise_seed)
    shape = light.shape[0], light.shape[1]
    pattern = draw_pattern(stream[0], stream[2], shape, sensor)
    numbers = []
    for k, seconds in enumerate(times):
        freed = draw_hits(sensor, shape, pitch_m, seconds, noise_generator(
            *stream, seed, k, 1)) if sensor.radiation_flux_cm2_s > 0 else 0.0
        charge = electrons(light, seconds, rate, sensor, noise_generator(*stream, seed, k, 0), pattern, freed)
        numbers.append(digital_numbers(charge, sensor))
    return numbers


def exposure_facts(images: Images) -> Mapping[str, Any]:
    """How a pair was exposed, for reports; None for what is infinite."""
    return {"exposure_s": images.exposure_s, "exposures_s": [frame.seconds for frame in images.frames],
            "gain_dn_per_e": images.gain_dn_per_e, "electrons_per_s_per_radiance": images.electron_rate,
            "saturation_radiance": images.saturation_radiance if math.isfinite(images.saturation_radiance) else None,
            "saturated": images.saturated,
            "image_bits": images.bits, "warnings": list(images.warnings)}


def to_8_bit(numbers: np.ndarray, bits: int, encoding: str = "LINEAR") -> np.ndarray:
    """uint8 of digital numbers of ``bits`` bits; both ends of the range stay at the ends."""
    if bits == 8 and encoding == "LINEAR":
        return numbers.astype(np.uint8)
    level = numbers / (2.0 ** bits - 1)
    return np.rint(255.0 * (np.sqrt(level) if encoding == "SQUARE_ROOT" else level)).astype(np.uint8)
