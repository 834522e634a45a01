"""Requirements of a scene on the renderer, and parts that a render omits because they would be invisible.

All functions take complete ``settings``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..settings.topics.rendering import QualitySettings
from ..settings.topics.scene import Settings
from ..settings.topics.surfaces import SurfaceSettings
from .light.sky import Sky
from .mesh.finer_in_view import nearest_ground_m
from .rig.focal_length import focal_px
from .surfaces.principled import lets_light_through

#: Samples of a bake below which its noise makes matchers look better than they are. In ``python benchmarks bake_noise``
#: with the Sun 24° high, the wrong or missing pixels of JPLV are 1.4 percentage points fewer with 64 samples than with
#: 256, and 3.1 points fewer with 16.
FEWEST_BAKE_SAMPLES = 64
#: Topics that describe a surface.
SURFACE_TOPICS = ("surface", "rock_surface")


def surface_topics(settings: Settings) -> tuple[str, ...]:
    """List the topics of the surfaces in the scene; rocks may have a separate surface."""
    return SURFACE_TOPICS if settings.rocks.coverage > 0 and settings.rocks.own_surface else SURFACE_TOPICS[:1]


def are_rocks_clear(settings: Settings) -> bool:
    """Return whether rocks transmit light."""
    topic = "rock_surface" if settings.rocks.own_surface else "surface"
    return settings.rocks.coverage > 0 and lets_light_through(settings[topic])


def random_walk_px(settings: Settings, topic: str) -> float:
    """Compute the radius of subsurface scattering, in pixels of the nearest level ground; 0 if no light enters the
    surface.
    """
    surface = settings[topic]
    if surface["model"] != "PRINCIPLED" or surface["subsurface_weight"] <= 0:
        return 0.0
    return float(surface["subsurface_radius_m"]) * focal_px(settings.rig) / nearest_ground_m(settings.rig)


def traces_random_walk(settings: Settings, topic: str) -> bool:
    """Return whether subsurface light is traced through a surface, see ``quality.walk_px``."""
    length = random_walk_px(settings, topic)
    return length > 0 and length >= settings.quality.walk_px


def simplify_surface(settings: Settings, topic: str) -> SurfaceSettings:
    """Return the settings of a surface as it is rendered, without subsurface scattering that is not traced."""
    surface: SurfaceSettings = settings[topic]
    return surface if traces_random_walk(settings, topic) else surface | {"subsurface_weight": 0.0}


def only_camera_meets_relief(surface: SurfaceSettings, quality: QualitySettings) -> bool:
    """Return whether indirect light sees a surface as smooth, see ``quality.fine_relief``. ``surface`` is from
    ``simplify_surface``. A surface with subsurface scattering always keeps its relief, because camera rays also see
    light that leaves it after a random walk.
    """
    law = surface.model
    return quality.fine_relief == "CAMERA" and (
        law == "LAMBERT" or (law == "PRINCIPLED" and surface.subsurface_weight == 0)
    )


def is_relief_for_camera_alone(settings: Settings, topic: str) -> bool:
    """Return whether a surface has fine relief, from noise or from images, that only camera rays see."""
    surface = simplify_surface(settings, topic)
    shaded = (surface.relief != "DISPLACEMENT" and surface.grain_amplitude_m > 0) or (settings.textures.set != "NONE")
    return shaded and only_camera_meets_relief(surface, settings.quality)


def emits(surface: SurfaceSettings) -> bool:
    """Return whether a surface emits light."""
    return surface.model in ("PRINCIPLED", "LAMBERT") and surface.emitted_w_m2_sr > 0.0


def needs_elevation(surface: SurfaceSettings) -> bool:
    """Return whether the ground needs the heights of its vertices above its mean plane, for dirt or emitted light."""
    return surface.trough_dirt != 0.0 or (emits(surface) and surface.emitted_from == "HOLLOWS")


def find_elevation_mark(surface: SurfaceSettings) -> bool | float:
    """Find the reference above which the heights of the ground's vertices are marked. True is the mean plane; a number
    is the width in metres of the surroundings whose mean is the reference; False is no marks.
    """
    return needs_elevation(surface) and (float(surface.trough_width_m) or True)


def needs_shelter(surface: SurfaceSettings) -> bool:
    """Return whether an object with this surface needs the share of falling grains that other objects keep away."""
    return surface.frost_from == "FALL"


def follows_each_light(settings: Settings) -> bool:
    """Return whether lamps light a surface whose law depends on the direction of the light. Such a scene is rendered
    once for each light, unless a denoiser is used.
    """
    laws = {settings[topic]["model"] for topic in surface_topics(settings)}
    return bool(settings.light.lamps) and not laws <= {"LAMBERT", "PRINCIPLED"}


def find_why_not_baked(settings: Settings) -> str:
    """Return a clause on why indirect light cannot be baked to the ground; empty if it can.

    Baked light assumes a diffuse surface, which looks the same from all directions. Only the planet's lamp gives light;
    the visible planet, rings and stars give none.
    """
    if settings.surface.model != "LAMBERT":
        return "the ground is not Lambert's (surface.model)"
    if settings.rocks.coverage > 0 and settings.rocks.own_surface and settings.rock_surface.model != "LAMBERT":
        return "the rocks are not Lambert's (rock_surface.model)"
    for topic in surface_topics(settings):
        if emits(settings[topic]):
            return f"emitted light of the ground is not baked ({topic}.emitted_w_m2_sr)"
    if settings.light.lamps:
        return "light of lamps is not baked (light.lamps)"
    if settings.veil.optical_depth > 0:
        return "light that a veil scatters or absorbs is not baked (veil.optical_depth)"
    if settings.lander.kind != "NONE":
        return "there is a lander, which is not part of the ground (lander.kind)"
    return ""


def explain_traced_light(why: str) -> str:
    """Return the sentence for the user that light is ray traced although the settings ask for baked light; ``why`` is a
    clause.
    """
    return f"light: indirect light is traced although quality.indirect is BAKED, because {why}."


def can_be_baked(settings: Settings) -> bool:
    """Return whether indirect light may be baked: the settings ask for it and the scene allows it."""
    return settings.quality.indirect != "TRACED" and not find_why_not_baked(settings)


def is_baked(settings: Settings) -> bool:
    """Return whether the images of a pair have baked light. For a planned pair ``quality.indirect`` is never AUTO."""
    return settings.quality.indirect == "BAKED" and not find_why_not_baked(settings)


def advise_on_bake(settings: Settings) -> list[str]:
    """Return a sentence, in a list, on light that is baked with too few samples for evaluation; else an empty list."""
    few = settings.quality.bake_samples
    if not can_be_baked(settings) or few >= FEWEST_BAKE_SAMPLES:
        return []
    return [
        f"Indirect light is baked with only {few} samples. The noise is fixed to the ground, alike in both eyes, "
        "so matchers take it for texture and look better than they are; raise quality.bake_samples to "
        f"{FEWEST_BAKE_SAMPLES} or more."
    ]


def count_images_per_bake(settings: Settings, images: int) -> int:
    """Count the images, of ``images`` of one ground under one Sun, that share a bake: all of them, or 1 if a bake
    covers the view of one image only.
    """
    return images if settings.quality.bake_area == "GROUND" else 1


def choose_image_quality(settings: Settings) -> QualitySettings:
    """Return the quality settings of a pair's images; for direct light only, if indirect light is baked."""
    return make_direct_quality(settings.quality) if is_baked(settings) else settings.quality


def make_direct_quality(quality: QualitySettings) -> QualitySettings:
    """Return the quality settings of images of direct light, to which baked light is added."""
    return quality | {
        "samples": quality.direct_samples,
        "denoiser": "NONE",
        "noise_threshold": 0.0,
        "diffuse_bounces": 0,
    }


def planet_gives_light(settings: Settings, sky: Sky) -> bool:
    """Return whether the planet lights the ground, see ``light.planet_least``."""
    return sky.planet_over_sun > 0 and sky.planet_over_sun >= settings.light.planet_least


def _find_omissions_of(topic: str, settings: Settings) -> Iterator[str]:
    """Yield the sentences of ``find_left_out`` on the surface of ground or rocks."""
    length = random_walk_px(settings, topic)
    if length > 0 and not traces_random_walk(settings, topic):
        yield (
            f"{topic}: no subsurface scattering, because its radius of "
            f"{1e3 * settings[topic]['subsurface_radius_m']:.3g} mm is {length:.2g} of the nearest "
            "pixel, which is below quality.walk_px."
        )
    if traces_random_walk(settings, topic) and settings[topic]["subsurface_method"] == "BURLEY":
        yield (
            f"{topic}: light under edges and thin plates is that of flat ground, because "
            f"{topic}.subsurface_method is BURLEY."
        )
    if (
        topic == "surface"
        and settings.source.kind != "PROCEDURAL"
        and settings.surface.relief == "REAL"
        and (settings.surface.grain_amplitude_m > 0)
    ):
        yield "surface: fine relief is bump, because ground from a file keeps its own vertices."
    if topic == "rock_surface" and emits(settings[topic]) and settings[topic]["emitted_from"] == "HOLLOWS":
        yield "rock_surface: no emitted light, because rocks have no hollows (rock_surface.emitted_from)."
    if is_relief_for_camera_alone(settings, topic):
        yield f"{topic}: fine relief for camera rays only, because quality.fine_relief is CAMERA."


def _find_omissions_of_veil(settings: Settings) -> Iterator[str]:
    depth, followed = settings.veil.optical_depth, 1 + settings.quality.diffuse_bounces
    if depth > 0:
        yield (
            "truth: no veil in depth, normals and hidden pixels, because they belong to the ground behind it "
            "(veil.optical_depth)."
        )
        yield (
            "light: irradiances are those above the veil, and I/F and albedos from images contain the light of its "
            "grains (veil.optical_depth)."
        )
    if depth > followed:
        yield (
            f"light: light that the veil scatters more than {followed} times is lost, and this optical depth scatters "
            "most light more often; raise quality.diffuse_bounces or lower veil.optical_depth."
        )


def find_left_out(settings: Settings, lights: Mapping[str, Any]) -> list[str]:
    """List a sentence, for the user and ``pair.json``, on each part of the settings that is not rendered, with the
    reason.

    ``lights`` is ``sky.describe_sky`` of the built scene.
    """
    sentences = [each for topic in surface_topics(settings) for each in _find_omissions_of(topic, settings)]
    if lets_light_through(settings.surface):
        sentences.append(
            "surface: light that enters the ground is lost, although surface.transmitted is THROUGH, "
            "because the ground has no other side."
        )
    share = lights["planet"].get("over_sun") if lights["planet"] else None  # None by night too
    if share is not None and (share == 0 or share < settings.light.planet_least):
        sentences.append(
            "light: no light from the planet, because "
            + (
                f"it is {share:.2g} of the Sun's, which is below light.planet_least."
                if share > 0
                else "the planet is below the horizon or unlit."
            )
        )
    if settings.quality.denoiser != "NONE" and follows_each_light(settings):
        sentences.append(
            "light: the reflectance law follows only one of the lights, because a denoised image is one render "
            "(quality.denoiser)."
        )
    if settings.quality.indirect == "BAKED" and (why := find_why_not_baked(settings)):
        sentences.append(explain_traced_light(why))
    if settings.quality.half_floats != "NONE":
        what = "radiance" if settings.quality.half_floats == "RADIANCE" else "radiance and normals"
        sentences.append(
            f"files: {what} rounded to 11 bits, because quality.half_floats is {settings.quality.half_floats}."
        )
    sentences += _find_omissions_of_veil(settings)
    if settings.quality.truth != "FULL":
        what = "labels" if settings.quality.truth == "DEPTH" else "labels of single rocks and objects"
        sentences.append(f"truth: no normals and no {what}, because quality.truth is {settings.quality.truth}.")
    return sentences
