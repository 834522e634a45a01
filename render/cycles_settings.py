"""The settings of Cycles that make the image radiance. All that matter are set, so no default decides."""

from __future__ import annotations

import bpy

from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..support.blender import compat
from ..support.errors import IcyMoonError
from .cost.abilities import Abilities, lack_for, lack_for_quality
from .graphics_cards import select_cards

_GLOSSY_BOUNCES = 2
#: Refractions of one path in clear ice: into a rock, out of it, and through two more.
_CLEAR_BOUNCES = 6
_TRANSPARENT_BOUNCES = 8


def detect_abilities(quality: QualitySettings) -> Abilities:
    """What this Blender can do; graphics cards are looked for only if the quality asks for them, as that selects
    them."""
    return Abilities(compat.has_osl(), compat.has_oidn(), quality.device != "GPU" or bool(select_cards()))


def find_lack(settings: Settings) -> str:
    """What this Blender lacks for complete settings, as a sentence with the fix; empty if nothing."""
    return lack_for(settings, detect_abilities(settings.quality))


def check_possible(quality: QualitySettings) -> None:
    """Raise IcyMoonError if this Blender cannot render at the asked quality."""
    if lack := lack_for_quality(quality, detect_abilities(quality)):
        raise IcyMoonError(lack)


def apply(
    scene: bpy.types.Scene, quality: QualitySettings, seed: int, blurred: bool = False, through: bool = False
) -> None:
    """Set the render engine of a scene from ``quality`` settings; ``blurred`` if lens or movement blur the image,
    ``through`` if light passes through clear ice.

    Beside the settings: no clamping (clamp 5 loses 5 to 12 % of Europa's light), no light-sampling
    threshold (its roulette puts up to 32x errors at grazing light), no caustics, exposure 1, and a stated
    pixel filter.
    """
    if scene.render.engine != "CYCLES":  # setting it frees all that Cycles has kept
        scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = quality.device
    cycles.samples = quality.samples
    cycles.seed = seed
    cycles.use_animated_seed = False
    # Blue noise leaves a denoiser less to remove; of both eyes it is a little alike, so what stays noisy has none.
    cycles.sampling_pattern = "TABULATED_SOBOL" if quality.denoiser == "NONE" else "BLUE_NOISE"
    cycles.use_adaptive_sampling = quality.noise_threshold > 0
    cycles.adaptive_threshold = quality.noise_threshold
    cycles.adaptive_min_samples = 0  # as Cycles chooses: 16 threshold^-0.3, so 64 samples at 0.01
    cycles.time_limit = 0.0
    cycles.use_denoising = quality.denoiser != "NONE"
    if cycles.use_denoising:
        cycles.denoiser = "OPENIMAGEDENOISE"
        cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL" if quality.denoiser == "OIDN" else "RGB"
        # Guides are without noise unless the image is blurred; cleaning them costs matchers detail (guiss_cost.py).
        cycles.denoising_prefilter = "FAST" if blurred else "NONE"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    # By power the tree asks the planet once for fifty times the Sun; in turn they are stratified: 15x less noise.
    cycles.use_light_tree = False
    cycles.diffuse_bounces = quality.diffuse_bounces
    cycles.glossy_bounces = _GLOSSY_BOUNCES
    cycles.transmission_bounces = _CLEAR_BOUNCES if through else 0
    cycles.volume_bounces = 0
    cycles.max_bounces = max(quality.diffuse_bounces, _GLOSSY_BOUNCES, cycles.transmission_bounces)
    cycles.transparent_max_bounces = _TRANSPARENT_BOUNCES
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.blur_glossy = 0.0
    cycles.film_exposure = 1.0
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = 1.5
    cycles.use_fast_gi = False
    cycles.shading_system = False
    render = scene.render
    render.threads_mode = "FIXED" if quality.threads else "AUTO"
    if quality.threads:
        render.threads = quality.threads
    render.film_transparent = False
    render.use_motion_blur = False
    render.use_simplify = False
    render.use_compositing = False
    render.use_sequencer = False
    render.use_border = False
    render.use_freestyle = False
    render.dither_intensity = 0.0
    render.use_stamp = False
    scene.view_settings.exposure = 0.0
    scene.view_settings.gamma = 1.0
