"""Develop a pair: from linear radiance to the images of its camera, and to the grey images for matchers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...physics.camera import colour, exposure_brackets
from ...physics.camera.blur import check_rows_of_lens, warn_on_blur_mismatch
from ...physics.camera.calibration_error import describe_errors
from ...physics.camera.colour import (
    apply_mosaic,
    can_balance,
    compute_channel_rates,
    compute_white_gains,
    compute_white_rates,
    mix_to_grey,
)
from ...physics.camera.deposits import apply_deposits, compute_blocked_share
from ...physics.camera.particle_hits import draw_hits
from ...physics.camera.point_spread import apply_point_spread
from ...physics.camera.sensor import (
    black_dn,
    capacity_e,
    choose_exposure_s,
    collect_electrons,
    convert_to_digital,
    draw_pattern,
    gain_dn_per_e,
    make_noise_generator,
    top_dn,
    warn_on_exposure,
)
from ...physics.camera.stereo_camera import StereoCamera
from ...physics.light.lamps import find_light_factors
from ...physics.light.photons import electron_rate, pixel_pitch_m
from ...physics.scene_requirements import emits, surface_topics
from ...render.pairs.pair_folder import EYES, Pair
from ...settings.topics.camera import SensorSettings
from ...settings.topics.light import LightSettings
from ...settings.topics.scene import Settings
from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.labels import LIGHT_GROUPS
from .exr import Light
from .lens import Lens, make_lens, make_rectification, rectify

#: OpenCV names a mosaic by the second and third pixel of its second row.
_OPENCV = {"RGGB": "BG", "BGGR": "RG", "GRBG": "GB", "GBRG": "GR"}


@dataclass(frozen=True)
class Exposure:
    """One exposure of both eyes: uint16 (H, W) digital numbers with the bits of the sensor. A colour sensor gives its
    mosaic.
    """

    seconds: float
    left: Array
    right: Array


@dataclass(frozen=True)
class DevelopedImages:
    """A developed pair, uint16 (H, W) digital numbers of ``bits`` bits: one exposure, or several merged.

    ``left`` and ``right`` of a colour sensor are its grey images, see ``colour.mix_to_grey``.
    """

    left: Array  # rectified, on the pixels of the truth
    right: Array
    # On the sensor: a colour sensor's mosaic; else the same as the rectified image, unless the lens distorts, the eyes
    # are toed in or calibrated, or the calibration errs.
    detected_left: Array
    detected_right: Array
    bits: int
    frames: tuple[Exposure, ...]  # the exposures, longest first
    exposure_s: float  # duration of the metered exposure
    gain_dn_per_e: float
    electron_rate: float  # electrons per second per W/(m² sr); of white ground, in the channel that sees most of it
    saturation_radiance: float  # W/(m² sr) at the top of the images; infinite if no radiance reaches it
    saturated: float  # share of the left pixels at the converter's top, in the shortest exposure
    encoding: str
    warnings: tuple[str, ...]  # about blur in the render and about the exposure
    colour_left: Array | None = None  # (H, W, 3), R, G, B, rectified; None for a monochrome sensor
    colour_right: Array | None = None
    white_gains: tuple[float, ...] = ()  # factors of the white balance on R, G, B
    #: By eye, uint8 (H, W), rectified: 255 times the share of the light that deposits block. Empty without deposits.
    blocked: Mapping[str, Array] = field(default_factory=dict)

    @property
    def is_mosaic(self) -> bool:
        """Whether the image of the sensor is a Bayer mosaic."""
        return self.colour_left is not None

    @property
    def is_rectified(self) -> bool:
        """Whether the images of the sensors differ from the images for matchers."""
        return self.detected_left is not self.left or self.detected_right is not self.right

    def seen(self, eye: str) -> Array:
        """Return the rectified image of an eye: R, G, B (H, W, 3) of a colour sensor, or grey (H, W)."""
        colours = self.colour_left if eye == "left" else self.colour_right
        if colours is not None:
            return colours
        return self.left if eye == "left" else self.right

    def for_files(self, eye: str) -> Array:
        """Return the image of an eye in the order B, G, R, in which OpenCV writes colours."""
        image = self.seen(eye)
        return image[..., ::-1] if image.ndim == 3 else image

    def for_matchers(self) -> tuple[Array, Array]:
        """Return left and right as uint8, the only type that OpenCV's matchers take; more bits are scaled down."""
        return to_8_bit(self.left, self.bits, self.encoding), to_8_bit(self.right, self.bits, self.encoding)


def average_bands(radiance: Array) -> Array:
    """Average the bands of radiance (H, W, 3) to float64 (H, W).

    A panchromatic camera weights the bands equally; luminance weights belong to the human eye. Clean ice is grey, so
    the choice matters only for coloured ground, see ``sensor.band_weights``.
    """
    # Twice as fast as mean(), which adds up the short last axis one pixel at a time.
    return (radiance[..., 0].astype(np.float64) + radiance[..., 1] + radiance[..., 2]) / 3


def scale_radiance(view: Light, pair: Pair, settings: Settings) -> Array:
    """Scale the radiance (H, W, 3) of Sun, planet and lamps by ``sun_scale``, ``planet_scale`` and ``lamp_scales``.

    Light is linear, so a new render would give the same. A pair without light groups has one light, the Sun. Raises
    IcyMoonError if the image is not the sum of its groups, or if the ground emits light and there are no groups.
    """
    scales = find_light_factors(settings)
    if not view.groups:
        if scales["Sun"] != 1 and any(emits(pair.settings[topic]) for topic in surface_topics(pair.settings)):
            raise IcyMoonError(
                f"{pair.folder} has light that its ground gives by itself, which light.sun_scale would scale too; "
                "change light.sun_irradiance_wm2 and render it again."
            )
        return view.radiance * np.float32(scales["Sun"]) if scales["Sun"] != 1 else view.radiance
    changed = {group: scale for group, scale in scales.items() if scale != 1 and group in view.groups}
    if changed and pair.settings.quality.denoiser != "NONE":
        raise IcyMoonError(
            f"{pair.folder} was denoised, but its light groups were not; render it with "
            f"quality.denoiser NONE to change light.{LIGHT_GROUPS.get(next(iter(changed)), 'lamp_scales')}."
        )
    radiance = view.radiance
    for group, scale in changed.items():
        radiance = radiance + np.float32(scale - 1) * view.groups[group]
    return radiance


def develop(pair: Pair, left: Light, right: Light, settings: Settings) -> DevelopedImages:
    """Develop both eyes with the same response and exposure, and with independent noise.

    ``left`` and ``right`` are the light at the eyes, see ``views.read_eye``. The response in ``settings`` may differ
    from the response with which the pair was rendered. The same pair, data set seed and noise seed always give the same
    noise.
    """
    sensor, seed = settings.sensor, int(pair.settings.dataset.seed)
    pitch_m = pixel_pitch_m(sensor, settings.rig)
    channels = Channels(settings.light, sensor, pitch_m)
    rate = channels.rate
    optics = {eye: _Optics.of(pair, settings, eye) for eye in EYES}
    planes = {
        eye: channels.planes(scale_radiance(view, pair, settings)) for eye, view in (("left", left), ("right", right))
    }
    light = {eye: channels.at_pixels([optics[eye].on_sensor(plane) for plane in planes[eye]]) for eye in EYES}
    metered = choose_exposure_s(channels.balanced(light["left"]), rate, sensor)
    times = exposure_brackets.list_exposure_times(metered, sensor)
    exposed = {eye: expose_eye(light[eye], times, rate, settings, (seed, pair.id, eye), pitch_m) for eye in EYES}
    bits, detected, full_s = merge_frames(exposed, times, channels, sensor)
    final, colours = _rectify_if_needed(detected, bits, black_dn(sensor) if len(times) == 1 else 0.0, channels, optics)
    saturated = float(np.mean(exposed["left"][-1] == top_dn(sensor)))
    return DevelopedImages(
        final["left"],
        final["right"],
        detected["left"],
        detected["right"],
        bits,
        tuple(Exposure(*each) for each in zip(times, exposed["left"], exposed["right"], strict=True)),
        metered,
        gain_dn_per_e(sensor),
        rate,
        full_s / rate if rate else float("inf"),
        saturated,
        str(sensor.encoding),
        (
            *warn_on_blur_mismatch(settings, pair.settings, times),
            *warn_on_exposure(metered, saturated, sensor),
            *channels.warnings,
            *describe_errors(settings.calibration_error),
        ),
        colours.get("left"),
        colours.get("right"),
        tuple(channels.gains.tolist()) if colours else (),
        {eye: share for eye in EYES if (share := optics[eye].blocked_8_bit()) is not None},
    )


@dataclass(frozen=True)
class _Optics:
    """The optical path of an eye to its sensor, and the way back from the numbers to the rectified image."""

    camera: StereoCamera
    sensor: SensorSettings
    lens: Lens | None
    rectification: Array | None  # see ``make_rectification``
    blocked: Array | None  # (H, W), see ``blocked_share``

    @classmethod
    def of(cls, pair: Pair, settings: Settings, eye: str) -> _Optics:
        check_rows_of_lens(settings.rig)
        sensor, rig, camera = settings.sensor, settings.rig, pair.camera
        shape = camera.sensor_px(eye)[::-1]
        blocked = compute_blocked_share(sensor, rig, shape, int(pair.settings.dataset.seed), eye)
        return cls(
            camera,
            sensor,
            make_lens(camera, rig, eye),
            make_rectification(camera, rig, settings.calibration_error, eye),
            blocked,
        )

    def on_sensor(self, plane: Array) -> Array:
        """Return the light (H, W) of a channel on the sensor, from the light at the eye."""
        there = self.camera.cropped(plane) if self.lens is None else self.lens.distort(plane)
        return apply_point_spread(apply_deposits(there, self.blocked, self.sensor), self.sensor)

    def rectified(self, numbers: Array) -> Array:
        return numbers if self.rectification is None else rectify(numbers, self.rectification)

    def blocked_8_bit(self) -> Array | None:
        return None if self.blocked is None else self.rectified(np.rint(self.blocked * 255.0).astype(np.uint8))


def merge_frames(
    exposed: Mapping[str, list[Array]], times: list[float], channels: Channels, sensor: SensorSettings
) -> tuple[int, dict[str, Array], float]:
    """Merge all exposures of each eye. Return the bits and the digital numbers by eye, and the electrons per second at
    full scale, which the first eye sets.
    """
    if len(times) == 1:
        return int(sensor.bits), {eye: frames[0] for eye, frames in exposed.items()}, capacity_e(sensor) / times[0]
    merged = {eye: exposure_brackets.merge_exposures(frames, times, sensor) for eye, frames in exposed.items()}
    full_s = exposure_brackets.find_full_rate(channels.balanced(next(iter(merged.values()))), times[-1], sensor)
    return (
        exposure_brackets.MERGED_BITS,
        {eye: exposure_brackets.quantise_merged(rates, full_s) for eye, rates in merged.items()},
        full_s,
    )


def _rectify_if_needed(
    detected: Mapping[str, Array], bits: int, black: float, channels: Channels, optics: Mapping[str, _Optics]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return, by eye, the grey images on the pixels of the truth, and for a colour sensor the colours there."""
    if optics["left"].sensor.colour != "BAYER":
        return {eye: optics[eye].rectified(detected[eye]) for eye in EYES}, {}
    colours = {eye: optics[eye].rectified(channels.colours(detected[eye], bits, black)) for eye in EYES}
    grey_images = {eye: np.rint(mix_to_grey(colours[eye], optics[eye].sensor)).astype(np.uint16) for eye in EYES}
    return grey_images, colours


class Channels:
    """The channels of a sensor: one, or red, green and blue behind a Bayer mosaic."""

    def __init__(self, light: LightSettings, sensor: SensorSettings, pitch_m: float) -> None:
        self._sensor = sensor
        self.gains = np.ones(1)
        #: Sentences for the user about the sensor's bands.
        self.warnings: tuple[str, ...] = ()
        if sensor.colour == "MONO" and sensor.band_weights == "EQUAL":
            self._weights = None
            self.rate = electron_rate(light, sensor, pitch_m)
            return
        rates = compute_channel_rates(light, sensor, pitch_m)
        white = compute_white_rates(light, rates)
        #: Electrons per second per W/(m² sr) of white ground, in the channel that sees most of it.
        self.rate = float(white.max())
        self._weights = rates / self.rate if self.rate > 0 else np.zeros_like(rates)
        if sensor.colour == "BAYER":
            self.gains = compute_white_gains(white, sensor)
            if sensor.white_balance != "NONE" and self.rate > 0 and not can_balance(white):
                self.warnings = (
                    "There is no white balance, because a filter passes next to no light; check the "
                    "wavelengths of the filters, or set sensor.white_balance to NONE.",
                )

    def planes(self, radiance: Array) -> list[Array]:
        """Return the signal of each channel, float64 (H, W), from a radiance (H, W, 3). Times ``rate`` it is electrons
        per second.
        """
        if self._weights is None:
            return [average_bands(radiance)]
        # Avoids NaN from infinite light times a response of 0.
        red, green, blue = (np.minimum(radiance[..., k].astype(np.float64), 1e30) for k in range(3))
        return [r * red + g * green + b * blue for r, g, b in self._weights.tolist()]

    def at_pixels(self, planes: list[Array]) -> Array:
        """Return the signal (H, W) at the pixels of the sensor, from the signals of its channels."""
        return planes[0] if len(planes) == 1 else apply_mosaic(np.stack(planes), self._sensor.bayer_pattern)

    def balanced(self, values: Array) -> Array:
        """Multiply values (H, W) at the pixels of the sensor by the gains of the white balance."""
        if len(self.gains) == 1:
            return values
        gains = self.gains[:, None, None] * np.ones((1, *values.shape))
        return np.asarray(values * apply_mosaic(gains, self._sensor.bayer_pattern))

    def colours(self, numbers: Array, bits: int, black: float) -> Array:
        """Return R, G, B, uint16 (H, W, 3), with white balance, from a mosaic of digital numbers whose black level is
        ``black``.
        """
        found = demosaic(numbers, bits, self._sensor.bayer_pattern, self._sensor.demosaicing)
        return np.rint(np.clip((found - black) * self.gains + black, 0.0, 2.0**bits - 1)).astype(np.uint16)

    def matcher_level(self, radiance: Array, top: float) -> Array:
        """Return the grey image (H, W) of matchers, 1 at full scale, without noise. ``top`` is the saturation radiance
        of the developed images.
        """
        seen = [
            np.clip(gain * plane / top, 0.0, 1.0) for gain, plane in zip(self.gains, self.planes(radiance), strict=True)
        ]
        return seen[0] if len(seen) == 1 else mix_to_grey(np.stack(seen, axis=-1), self._sensor)


def expose_eye(
    light: Array, times: list[float], rate: float, settings: Settings, stream: tuple[int, str, str], pitch_m: float
) -> list[Array]:
    """Expose one eye for each of ``times``; return its digital numbers."""
    sensor, seed = settings.sensor, int(settings.sensor.noise_seed)
    shape = light.shape[0], light.shape[1]
    pattern = draw_pattern(stream[0], stream[2], shape, sensor)
    numbers = []
    for k, seconds in enumerate(times):
        freed = (
            draw_hits(sensor, shape, pitch_m, seconds, make_noise_generator(*stream, seed, k, 1))
            if sensor.radiation_flux_cm2_s > 0
            else 0.0
        )
        charge = collect_electrons(
            light, seconds, rate, sensor, make_noise_generator(*stream, seed, k, 0), pattern, freed
        )
        numbers.append(convert_to_digital(charge, sensor))
    return numbers


def describe_exposure(images: DevelopedImages) -> Mapping[str, Any]:
    """Describe the exposure of a pair, for reports; infinite values become None."""
    return {
        "exposure_s": images.exposure_s,
        "exposures_s": [frame.seconds for frame in images.frames],
        "gain_dn_per_e": images.gain_dn_per_e,
        "electrons_per_s_per_radiance": images.electron_rate,
        "saturation_radiance": images.saturation_radiance if math.isfinite(images.saturation_radiance) else None,
        "saturated": images.saturated,
        **({"white_gains": list(images.white_gains)} if images.white_gains else {}),
        **(
            {"blocked_share": {eye: float(share.mean()) / 255 for eye, share in images.blocked.items()}}
            if images.blocked
            else {}
        ),
        "image_bits": images.bits,
        "warnings": list(images.warnings),
    }


def to_8_bit(numbers: Array, bits: int, encoding: str = "LINEAR") -> Array:
    """Convert digital numbers of ``bits`` bits to uint8; both ends of the range stay at the ends."""
    if bits == 8 and encoding == "LINEAR":
        return numbers.astype(np.uint8)
    level = numbers / (2.0**bits - 1)
    return np.rint(255.0 * (np.sqrt(level) if encoding == "SQUARE_ROOT" else level)).astype(np.uint8)


def demosaic(numbers: Array, bits: int, pattern: str, method: str) -> Array:
    """Demosaic digital numbers (H, W), uint16, to R, G and B, float64 (H, W, 3) from 0 to the top of ``bits`` bits."""
    if method == "EDGE_AWARE":
        import cv2  # imported here, because Blender has no OpenCV and shows pairs with another method

        code = getattr(cv2, f"COLOR_Bayer{_OPENCV[pattern]}2RGB_EA")
        finer = 2 ** (16 - bits)  # OpenCV rounds each of its means
        return np.asarray(cv2.demosaicing(numbers * np.uint16(finer), code) / finer)
    return np.clip(colour.demosaic(numbers, pattern, method), 0.0, 2.0**bits - 1)
