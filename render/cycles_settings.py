"""The settings of Cycles for the radiance images. Every setting that affects them is set, so they never depend on
Blender's defaults.
"""

from __future__ import annotations

from typing import Any

import bpy

from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..support.blender import compat
from ..support.errors import IcyMoonError
from .cost.blender_abilities import Abilities, describe_lack, explain_unavailable_quality
from .graphics_cards import select_cards

_GLOSSY_BOUNCES = 2
#: Refractions of one path in clear ice: into a rock, out of it, and through a second rock.
_CLEAR_BOUNCES = 6
#: Settings of Cycles at all qualities.
_CYCLES_SETTINGS: dict[str, Any] = {
    "use_animated_seed": False,
    "adaptive_min_samples": 0,  # 0: Cycles takes 16 threshold^-0.3, which is 64 samples at 0.01
    "time_limit": 0.0,
    "sample_clamp_direct": 0.0,
    "sample_clamp_indirect": 0.0,
    "light_sampling_threshold": 0.0,
    # A light tree by power samples the planet once for fifty samples of the Sun; lights in turn are stratified: 15x
    # less noise.
    "use_light_tree": False,
    "glossy_bounces": _GLOSSY_BOUNCES,
    "volume_bounces": 0,
    "transparent_max_bounces": 8,
    "caustics_reflective": False,
    "caustics_refractive": False,
    "blur_glossy": 0.0,
    "film_exposure": 1.0,
    "pixel_filter_type": "BLACKMAN_HARRIS",
    "filter_width": 1.5,
    "use_fast_gi": False,
    "shading_system": False,
}
#: Settings of the render at all qualities; most would otherwise change radiance on its way to the file.
_RENDER_SETTINGS: dict[str, Any] = {
    "threads_mode": "AUTO",
    "film_transparent": False,
    "use_motion_blur": False,
    "use_simplify": False,
    "use_compositing": False,
    "use_sequencer": False,
    "use_border": False,
    "use_freestyle": False,
    "dither_intensity": 0.0,
    "use_stamp": False,
}


def detect_abilities(quality: QualitySettings) -> Abilities:
    """Detect the abilities of this Blender. Graphics cards are looked for only if the quality asks for them, because
    the search selects them."""
    return Abilities(compat.has_osl(), compat.has_oidn(), quality.device != "GPU" or bool(select_cards()))


def find_missing_feature(settings: Settings) -> str:
    """Find a feature that this Blender lacks for complete settings, as a sentence with the fix; empty if it has all."""
    return describe_lack(settings, detect_abilities(settings.quality))


def check_possible(quality: QualitySettings) -> None:
    """Raise IcyMoonError if this Blender cannot render at this quality."""
    if lack := explain_unavailable_quality(quality, detect_abilities(quality)):
        raise IcyMoonError(lack)


def apply_quality(
    scene: bpy.types.Scene, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False
) -> None:
    """Set the render engine of a scene from ``quality`` settings; ``blurred`` if lens or movement blur the image,
    ``through`` if light passes through clear ice.

    Fixed at all qualities: no clamping (clamp 5 loses 5 to 12 % of Europa's light), no light-sampling threshold (its
    roulette puts up to 32x errors at grazing light), no caustics, exposure 1, and a stated pixel filter.
    """
    if scene.render.engine != "CYCLES":  # setting the engine frees all data that Cycles has kept
        scene.render.engine = "CYCLES"
    for of, values in (
        (scene.cycles, _cycles(quality, seed, blurred, through)),
        (
            scene.render,
            _RENDER_SETTINGS | ({"threads_mode": "FIXED", "threads": quality.threads} if quality.threads else {}),
        ),
        (scene.view_settings, {"exposure": 0.0, "gamma": 1.0}),
    ):
        for name, value in values.items():
            # Blender announces an equal value as a change too, and its module 5.0 has crashed in such an assignment. A
            # value that is not set is a default, which other releases change.
            if getattr(of, name) != value or not of.is_property_set(name):
                setattr(of, name, value)


def _cycles(quality: QualitySettings, seed: int, blurred: bool, through: bool) -> dict[str, Any]:
    clear_bounces = _CLEAR_BOUNCES if through else 0
    denoised = {
        "denoiser": "OPENIMAGEDENOISE",
        "denoising_input_passes": "RGB_ALBEDO_NORMAL" if quality.denoiser == "OIDN" else "RGB",
        # The denoiser's guide images have no noise unless lens or movement blur the image; cleaning them would cost
        # matchers detail (``python benchmarks guiss_cost``).
        "denoising_prefilter": "FAST" if blurred else "NONE",
    }
    clean = quality.denoiser == "NONE"
    return _CYCLES_SETTINGS | {
        "device": quality.device,
        "samples": quality.samples,
        "seed": seed,
        # Blue noise leaves less work to a denoiser. Blue noise of both eyes correlates a little, so images without a
        # denoiser get white noise.
        "sampling_pattern": "TABULATED_SOBOL" if clean else "BLUE_NOISE",
        "use_adaptive_sampling": quality.noise_threshold > 0,
        "adaptive_threshold": quality.noise_threshold,
        "use_denoising": not clean,
        **({} if clean else denoised),
        "diffuse_bounces": quality.diffuse_bounces,
        "transmission_bounces": clear_bounces,
        "max_bounces": max(quality.diffuse_bounces, _GLOSSY_BOUNCES, clear_bounces),
    }
