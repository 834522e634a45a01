"""Variants of a scene's quality, from the fastest to the most accurate. Imports no Blender.

A variant changes one feature that the scene has. For example, subsurface scattering has no variants if no light enters
the surface, and the mesh error has none if the ground is from a file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from ...physics.light.sky import compute_sky
from ...physics.scene_requirements import (
    count_images_per_bake,
    find_why_not_baked,
    is_baked,
    is_relief_for_camera_alone,
    random_walk_px,
    surface_topics,
    traces_random_walk,
)
from ...physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from ...physics.surfaces.photometry import hemispherical_albedo
from ...settings.description import merged
from ...settings.topics.scene import Settings
from ...support.arrays import Array, Numbers
from ...support.errors import IcyMoonError
from ...support.number_text import format_count
from ..plans.baked_or_traced import estimate_bake_seconds
from .blender_abilities import Abilities, describe_lack
from .estimate import estimate_work

_FULL_BUILD = Abilities()
#: Topics of settings by the name of the variant.
_Parts = dict[str, dict[str, dict[str, Any]]]
#: Groups of variants, each with its meaning.
GROUPS = {
    "samples": "samples per pixel, with and without a denoiser",
    "bounces": "maximum number of diffuse bounces",
    "threshold": "more samples only for pixels that are still noisy",
    "indirect": "light between parts of the ground, traced in each image or baked once for all images",
    "shortcuts": "parts that may be left out: subsurface scattering, fine relief for rays other than the camera's, "
    "labels and normals",
    "files": "radiance and normals in 16 instead of 32 bits, and the image beside the lights that it is the sum of",
    "subsurface": "model of subsurface scattering",
    "glints": "facets of snow that mirror the Sun, most to one eye only",
    "mesh": "largest error of the ground's mesh",
    "relief": "fine relief as bump or as geometry",
    "hapke": "terms and accuracy of Hapke's law",
}
#: Groups that vary the shape of the ground. Their reference has a finer mesh.
SHAPES = ("mesh", "relief")
SAMPLES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
_MAX_DENOISED_SAMPLES = 64
_DIFFUSE_BOUNCES = (0, 1, 2, 3, 4, 8, 16)
_NOISE_THRESHOLDS = (0.2, 0.1, 0.05, 0.02, 0.01)
#: Maximum number of samples with a noise threshold, as a multiple of the scene's number of samples.
_THRESHOLD_SAMPLES_FACTOR = 4
#: Samples of direct light in an image with baked light, and samples of the bake.
_DIRECT_SAMPLES, _BAKE_SAMPLES = (1, 2, 4, 9), (64, 256)
_MESH_ERRORS_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_TRACED_LIGHT = {"indirect": "TRACED"}
_DENOISER_SUFFIXES = {"NONE": "", "OIDN": ", denoised", "OIDN_COLOUR": ", denoised by colour"}
#: Largest accepted value of ``quality.walk_px``.
_LONGEST_WALK_PX = 100.0
#: Bounces of the reference, the most samples of its two renders together, and a mesh error below the precision of
#: matchers.
_REFERENCE_BOUNCES = 32
_MAX_REFERENCE_SAMPLES = 2 * 65536
_REFERENCE_ERROR_PX = 0.25
#: Vertices to which the mesh of the reference is allowed to grow, at least.
_MIN_REFERENCE_VERTICES = 6_000_000


@dataclass(frozen=True)
class Variant:
    """A variant of a scene's quality: its group, its name, complete settings, and the number of renders."""

    group: str
    name: str
    settings: Settings
    repeats: int = 2

    @property
    def key(self) -> str:
        """The text that identifies the variant among the variants of a scene."""
        return f"{self.group}: {self.name}"


def make_reference(settings: Settings, samples: int = 1024, fine: bool = False) -> Variant:
    """Make the variant with the most accurate light: no denoiser, no noise threshold, many bounces, full fine relief,
    Hapke's law at full accuracy.

    With ``fine``, its shape is accurate too: the finest mesh, and fine relief as geometry. There are two renders of
    half the ``samples`` each, so that the remaining noise can be measured. Raises IcyMoonError for fewer than two
    samples, and for more samples than two renders take.
    """
    if not 2 <= samples <= _MAX_REFERENCE_SAMPLES:
        raise IcyMoonError(
            f"A reference cannot have {samples} samples, half of them in each of two renders; choose 2 "
            f"to {_MAX_REFERENCE_SAMPLES}."
        )
    parts: list[dict[str, dict[str, Any]]] = [
        {
            "quality": {
                "samples": samples // 2,
                "denoiser": "NONE",
                "noise_threshold": 0.0,
                "fine_relief": "ALL",
                "indirect": "TRACED",
                "diffuse_bounces": max(_REFERENCE_BOUNCES, int(settings.quality.diffuse_bounces)),
            }
        }
    ]
    if settings.surface.model == "HAPKE":
        parts.append({"hapke": {"accuracy": "REFERENCE"}})
    if fine and _has_graded_mesh(settings):
        parts.append(
            {
                "mesh": {
                    "error_px": min(_REFERENCE_ERROR_PX, settings.mesh.error_px),
                    "most": max(_MIN_REFERENCE_VERTICES, settings.mesh.most),
                }
            }
        )
    if fine:
        parts.append({"surface": {"relief": "REAL"}})
    return Variant("reference", f"{samples} samples{', fine' * fine}", merged(settings, *parts))


def list_variants(settings: Settings, groups: Sequence[str] = (), able: Abilities = _FULL_BUILD) -> list[Variant]:
    """List the variants of complete settings in the named ``groups``, after the unchanged scene.

    Without ``groups``, all groups that the scene has are varied. Equal settings appear once for each kind of reference,
    see ``SHAPES``. Only variants that a Blender with the abilities ``able`` can render are listed. Raises IcyMoonError
    for an unknown group, or a group without variants in this scene.
    """
    unknown = [group for group in groups if group not in GROUPS]
    if unknown:
        raise IcyMoonError(f"There is no group {unknown[0]!r} to vary; there are {', '.join(GROUPS)}.")
    found = [Variant("scene", "as described", settings)]
    for group in groups or GROUPS:
        parts = _PARTS_BY_GROUP[group](settings).items()
        varied = (Variant(group, name, merged(settings, part)) for name, part in parts)
        own = [variant for variant in varied if not describe_lack(variant.settings, able)]
        if not own and group in groups:
            raise IcyMoonError(f"This scene has nothing to vary in {group} ({GROUPS[group]}); leave it out.")
        alike = [variant.settings for variant in found if (variant.group in SHAPES) == (group in SHAPES)]
        found += [variant for variant in own if variant.settings not in alike]
    return found


@dataclass(frozen=True)
class _Shortcut:
    """A feature that a render may omit for speed: the key in ``quality``, its value without (``lean``) and with the
    feature (``full``), and the names of both variants.
    """

    key: str
    lean: bool | float | str
    full: bool | float | str
    without: str
    whole: str


def list_baked_settings(settings: Settings, area: str = "GROUND") -> dict[str, Settings]:
    """List the ways to bake the light of a scene to a ``quality.bake_area``, by name; empty if its light cannot be
    baked."""
    return {name: merged(settings, part) for name, part in _baked_parts(settings, area).items()}


def _baked_parts(settings: Settings, area: str = "GROUND") -> _Parts:
    where = "baked where seen" if area == "VIEW" else "baked"
    fixed = {"indirect": "BAKED", "bake_area": area, "bake_noise": 0.0}
    return (
        {}
        if find_why_not_baked(settings)
        else {
            f"{where} by {format_count(most, 'sample')}, {format_count(n, 'direct sample')}": {
                "quality": {**fixed, "bake_samples": most, "direct_samples": n}
            }
            for most in _BAKE_SAMPLES
            for n in _DIRECT_SAMPLES
        }
    )


def _list_shortcuts(settings: Settings) -> list[_Shortcut]:
    """List the features of the scene that a render may omit: shaded relief, subsurface scattering, labels and
    normals."""
    found = []
    topics = surface_topics(settings)
    if any(
        is_relief_for_camera_alone(merged(settings, {"quality": {"fine_relief": "CAMERA"}}), each) for each in topics
    ):
        found.append(
            _Shortcut("fine_relief", "CAMERA", "ALL", "fine relief for camera rays only", "fine relief for all light")
        )
    walk = max(random_walk_px(settings, each) for each in topics)
    if 0 < walk < _LONGEST_WALK_PX:
        least = settings.quality.walk_px
        lean = least if least > walk else _LONGEST_WALK_PX
        found.append(_Shortcut("walk_px", lean, 0.0, "no subsurface scattering", "subsurface scattering"))
    return [*found, _Shortcut("truth", "DEPTH", "FULL", "depth only", "normals and labels")]


def list_settings_with_less_light(settings: Settings) -> dict[str, dict[str, dict[str, Any]]]:
    """List settings by name; each further one leaves out one more part of the scene's light."""
    return {
        part.without: {"quality": {part.key: part.lean}}
        for part in _list_shortcuts(settings)
        if part.key != "truth" and settings.quality[part.key] != part.lean
    }


def _make_isotropic_hapke(settings: Settings) -> dict[str, Any]:
    """Make Hapke settings with the surface's albedo for sunlight on level ground: isotropic, smooth, without surges."""
    incidence = math.radians(90.0 - min(max(compute_sky(settings.light).sun_elevation_deg, 1.0), 90.0))

    def albedo(w: float) -> float:
        def law(i: Numbers, e: Numbers, psi: Numbers) -> Array:
            return bidirectional_reflectance(i, e, psi, HapkeParameters(w, h_function="2002"))

        return float(hemispherical_albedo(law, incidence))

    low, high = 0.0, 1.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if albedo(middle) < settings.surface.albedo else (low, middle)
    return {
        "w": high,
        "b": 0.0,
        "c": 0.0,
        "b_s0": 0.0,
        "h_s": 0.0,
        "b_c0": 0.0,
        "h_c": 0.0,
        "theta_bar_deg": 0.0,
        "filling_factor": 0.0,
        "h_function": "2002",
        "accuracy": "FAST",
    }


def list_candidates(settings: Settings, able: Abilities = _FULL_BUILD, images: int = 1) -> list[Variant]:
    """List the ways in which a Blender with the abilities ``able`` can compute the light of a scene, cheapest by
    expected cost first. A search may stop at the first candidate that is good enough.

    ``images`` is the number of images of a ground under one Sun, which share the cost of baking; for one image alone,
    light is baked only in its view.
    """
    parts = _list_sample_counts(("NONE", "OIDN"), noise_threshold=0.0)
    found = [Variant("auto", name, merged(settings, part)) for name, part in parts.items()]
    area = "GROUND" if images > 1 else "VIEW"
    found += [Variant("auto", name, each) for name, each in list_baked_settings(settings, area).items()]
    return sorted(
        (variant for variant in found if not describe_lack(variant.settings, able)),
        key=lambda variant: _image_seconds(variant.settings, images),
    )


def _image_seconds(settings: Settings, images: int) -> float:
    """Compute the processor seconds of an image, with its share of the bake."""
    bake = estimate_bake_seconds(settings) / count_images_per_bake(settings, images) if is_baked(settings) else 0.0
    return estimate_work(settings).seconds(0.0) + bake


def _has_graded_mesh(settings: Settings) -> bool:
    return settings.source.kind == "PROCEDURAL" and settings.mesh.kind == "GRADED"


def _list_sample_counts(denoisers: Iterable[str], **quality: float) -> _Parts:
    """List the variants of the number of samples with each of these denoisers. Above some number of samples a denoiser
    costs more than it saves."""
    return {
        f"{format_count(n, 'sample')}{_DENOISER_SUFFIXES[denoiser]}": {
            "quality": {"samples": n, "denoiser": denoiser, **quality, **_TRACED_LIGHT}
        }
        for denoiser in denoisers
        for n in SAMPLES
        if denoiser == "NONE" or n <= _MAX_DENOISED_SAMPLES
    }


def _list_thresholds(settings: Settings) -> _Parts:
    most = _THRESHOLD_SAMPLES_FACTOR * int(settings.quality.samples)
    return {
        f"until {limit:g}": {"quality": {"noise_threshold": limit, "samples": most, **_TRACED_LIGHT}}
        for limit in _NOISE_THRESHOLDS
    }


def _list_baked(settings: Settings) -> _Parts:
    found = _baked_parts(settings)
    return {"traced": {"quality": _TRACED_LIGHT}, **found} if found else {}


def _list_left_out(settings: Settings) -> _Parts:
    quality = settings.quality
    found = {}
    for part in _list_shortcuts(settings):
        has = quality[part.key] != part.lean
        found[part.without if has else part.whole] = {"quality": {part.key: part.lean if has else part.full}}
    labels = {"depth and semantic labels": {"quality": {"truth": "SEMANTIC"}}}
    return {**found, **(labels if quality.truth == "FULL" else {})}


def _list_subsurface_models(settings: Settings) -> _Parts:
    surface = settings.surface
    if surface.model != "PRINCIPLED" or not surface.subsurface_weight > 0:
        return {}
    other = {"RANDOM_WALK": "BURLEY", "BURLEY": "RANDOM_WALK"}[surface.subsurface_method]
    followed: _Parts = {
        "none": {"surface": {"subsurface_weight": 0.0}},
        other.replace("_", " ").capitalize(): {"surface": {"subsurface_method": other}},
    }
    return {
        **(followed if traces_random_walk(settings, "surface") else {}),
        "Hapke": {"surface": {"model": "HAPKE"}, "hapke": _make_isotropic_hapke(settings)},
        "Lambert": {"surface": {"model": "LAMBERT"}},
    }


def _list_glints(settings: Settings) -> _Parts:
    surface = settings.surface
    has = surface.model == "PRINCIPLED" and surface.glint_share > 0
    return {"none": {"surface": {"glint_share": 0.0}}} if has else {}


def _list_mesh_errors(settings: Settings) -> _Parts:
    return {f"{error:g} px": {"mesh": {"error_px": error}} for error in _MESH_ERRORS_PX * _has_graded_mesh(settings)}


def _list_reliefs(settings: Settings) -> _Parts:
    has = settings.source.kind == "PROCEDURAL" and settings.surface.grain_amplitude_m > 0
    return {"painted": {"surface": {"relief": "BUMP"}}, "real": {"surface": {"relief": "REAL"}}} if has else {}


_HAPKE_VARIANTS: _Parts = {
    "fast": {"hapke": {"accuracy": "FAST"}},
    "accurate": {"hapke": {"accuracy": "ACCURATE"}},
    "reference": {"hapke": {"accuracy": "REFERENCE"}},
    "as nodes": {"hapke": {"backend": "NODES"}},
    "smooth": {"hapke": {"theta_bar_deg": 0.0}},
    "without opposition": {"hapke": {"b_s0": 0.0, "b_c0": 0.0}},
    "Lommel-Seeliger": {"surface": {"model": "LOMMEL_SEELIGER"}},
    "Lambert": {"surface": {"model": "LAMBERT"}},
}
#: By group of ``GROUPS``: a function of settings that gives the variants by name, empty if the scene lacks the feature.
_PARTS_BY_GROUP: dict[str, Callable[[Settings], _Parts]] = {
    "samples": lambda _: _list_sample_counts(_DENOISER_SUFFIXES),
    "bounces": lambda _: {
        format_count(n, "bounce"): {"quality": {"diffuse_bounces": n, **_TRACED_LIGHT}} for n in _DIFFUSE_BOUNCES
    },
    "threshold": _list_thresholds,
    "indirect": _list_baked,
    "shortcuts": _list_left_out,
    # ``files`` does not count in ids, so these variants are of the same render; they differ by the precision that the
    # files lose.
    "files": lambda _: {
        "compact": {"quality": {"files": "COMPACT"}},
        "all in 32 bits": {"quality": {"files": "FULL", "half_floats": "NONE"}},
    },
    "subsurface": _list_subsurface_models,
    "glints": _list_glints,
    "mesh": _list_mesh_errors,
    "relief": _list_reliefs,
    "hapke": lambda settings: _HAPKE_VARIANTS if settings.surface.model == "HAPKE" else {},
}
