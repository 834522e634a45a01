"""The snow of the GUISS paper's public code, and the steps from its settings to Icy Moon's.

Ramchander Bhaskara et al., "Icy Moon Surface Simulation and Stereo Depth Estimation for Sampling Autonomy", IEEE
Aerospace Conference 2024.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from icymoon.render.plans.planned_pair import PlannedPair, expand_headings
from icymoon.settings import description, preset_files
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings
from icymoon.stereo.trade.measure_variants import scale_view

PRESETS = ("rigs/guiss", "sensors/default", "qualities/guiss", "lights/guiss_enceladus")
#: The paper's snow: lamp, ground and material of its public code. The code states no subsurface radius, so the radius
#: here is an assumption.
SNOW: dict[str, Any] = {
    "light": {"sun_irradiance_wm2": 10.0, "sun_elevation_deg": 24.0, "sun_azimuth_deg": 0.0},
    "terrain": {
        "size_m": 20.0,
        "resolution": 258,
        "rms_slope_deg": 0.0,
        "layers": [
            {
                "basis": "VORONOI_F2",
                "fractal": "HETERO",
                "amplitude_m": 0.45,
                "scale_m": 2.0,
                "octaves": 8,
                "lacunarity": 2.0,
                "roughness": 0.574,
            }
        ],
    },
    "mesh": {"kind": "GRID"},
    "surface": {
        "model": "PRINCIPLED",
        "albedo": 0.8,
        "roughness": 0.5,
        "specular": 0.5,
        "subsurface_weight": 1.0,
        "subsurface_radius_m": 0.005,
        "grain_size_m": 0.5,
        "grain_amplitude_m": 0.02,
    },
}
#: Changes of the paper's scene by name, of ground on which SGBM, StereoBM and JPLV all measure most of the pixels.
GROUNDS: dict[str, Parts] = {
    "paper": {},
    "gentle": {
        "light": {"sun_elevation_deg": 30.0, "sun_azimuth_deg": 90.0},
        "terrain": {"layers": [SNOW["terrain"]["layers"][0] | {"amplitude_m": 0.2}]},
        "mesh": {"kind": "GRADED", "error_px": 2.0, "edge_px": 12.0},
    },
}
#: Settings of Cycles in which the public code differs from Icy Moon; the last four are Blender's defaults.
PAPER: dict[str, Any] = {
    "max_bounces": 100,
    "glossy_bounces": 4,
    "transmission_bounces": 4,
    "transparent_max_bounces": 64,
    "sample_clamp_indirect": 5.0,
    "blur_glossy": 5.0,
    "light_sampling_threshold": 0.01,
    "use_light_tree": True,
    "denoising_prefilter": "ACCURATE",
    "sampling_pattern": "TABULATED_SOBOL",
}
CLEANED = {key: PAPER[key] for key in ("denoising_prefilter", "sampling_pattern")}
#: The row that all rows below it start from.
LAMBERT = "relief for the camera alone"
CLASSIC = {"sampling_pattern": PAPER["sampling_pattern"]}


@dataclass(frozen=True)
class Rung:
    """A row: the changed settings, and the changes in Cycles that no setting describes."""

    name: str
    settings: Parts = field(default_factory=dict)
    cycles: Mapping[str, Any] = field(default_factory=dict)
    apart: bool = False  # each eye a render of its own, nothing kept


def ladder() -> list[Rung]:
    """The rows, each with the changes of all rows above it."""
    both: Parts = {"quality": {"truth_by": "CYCLES"}}
    bounces: Parts = {"quality": {**both["quality"], "diffuse_bounces": 3, "noise_threshold": 0.0}}
    solid: Parts = {**bounces, "surface": {"subsurface_weight": 0.0}}
    few: Parts = {**solid, "quality": {**bounces["quality"], "samples": 9}}
    rays: Parts = {**few, "quality": {**few["quality"], "truth_by": "RAYS"}}
    plain: Parts = {**rays, "surface": {"model": "LAMBERT"}}
    camera: Parts = {**plain, "quality": {**rays["quality"], "fine_relief": "CAMERA"}}
    return [
        Rung("paper's settings, two renders", {}, PAPER, apart=True),
        Rung("both eyes in one render, geometry kept", both, PAPER),
        Rung("3 bounces, no clamp", bounces, CLEANED),
        Rung("no subsurface scattering, same albedo", solid, CLEANED),
        Rung("the denoiser's guides not cleaned", solid, CLASSIC),
        Rung("blue noise", solid),
        Rung("9 samples", few),
        Rung("truth by rays", rays),
        Rung("Lambert, same albedo", plain),
        Rung(LAMBERT, camera),
        Rung("7 samples", with_quality(camera, {"samples": 7})),
        *(
            Rung(
                f"light {how} by {most}, {n} direct samples",
                with_quality(
                    camera,
                    {
                        "indirect": "BAKED",
                        "bake_area": area,
                        "bake_samples": most,
                        "bake_noise": 0.0,
                        "direct_samples": n,
                    },
                ),
            )
            for how, area, numbers in (
                ("baked", "GROUND", ((64, 2), (64, 4), (256, 2), (256, 4))),
                ("baked where seen", "VIEW", ((64, 2), (64, 4), (128, 2), (256, 2))),
            )
            for most, n in numbers
        ),
        Rung(
            "graded mesh of 4 px: finer ground",
            {**camera, "mesh": {"kind": "GRADED", "error_px": 4.0, "edge_px": 24.0}},
        ),
    ]


def with_quality(parts: Parts, quality: dict[str, Any]) -> Parts:
    """The parts with changes of ``quality``."""
    return {**parts, "quality": {**parts["quality"], **quality}}


def snow(scale: float, ground: str = "paper") -> Settings:
    """Complete settings of the scene with the paper's quality, on one of ``GROUNDS``."""
    made = description.merged(
        description.defaults(),
        *(preset_files.load_preset(p) for p in PRESETS),
        *(description.check(dict(part), "benchmark") for part in (SNOW, GROUNDS[ground])),
    )
    return scale_view(made, scale)


def make_lambert_snow(scale: float, *changes: Parts) -> Settings:
    """Complete settings of the row ``LAMBERT`` with changes."""
    rung = next(each for each in ladder() if each.name == LAMBERT)
    parts = (dict(rung.settings), *changes)
    return description.merged(snow(scale), *(description.check(dict(part), "benchmark") for part in parts))


def planned(settings: Settings, quality: dict[str, Any], heading_deg: float) -> PlannedPair:
    """A pair with this quality and heading."""
    part = {"quality": {"bake_noise": 0.0, "truth": "SEMANTIC", **quality}, "rig": {"heading_deg": heading_deg}}
    (pair,) = expand_headings(description.merged(settings, description.check(part, "benchmark")))
    return PlannedPair(pair.id, pair.settings, 0.0)
