"""The cost of layers of snow and ice: processor seconds of a pair, and ratios within one run.

    python benchmarks snow_and_ice [--width PX] [--samples N]

Renders rocks on broken ground with each layer, and without. ``icymoon trade --vary glints`` measures the effect of
glints on matchers.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from icymoon.benchmarks.common.renders import measure_render_seconds, settings_of, start_blender
from icymoon.settings import description
from icymoon.settings.topics.declaration import Parts
from icymoon.settings.topics.scene import Settings

PLAIN: Parts = {"surface": {"albedo": 0.8, "albedo_variation": 0.1}, "light": {"planet": False}}
_CLEAR: Parts = {"rocks": {"own_surface": True}, "rock_surface": {"transmission": 0.7}}
LAYERS: dict[str, Parts] = {
    "none": {},
    "glints": {"surface": {"glint_share": 0.03}},
    "crust": {"surface": {"crust_share": 0.45}},
    "frost": {"surface": {"frost_share": 0.5}},
    "bubbles": {"surface": {"bubble_share": 0.02}},
    "bubbles in bands": {"surface": {"bubble_share": 0.02, "bubble_band_m": 0.5}},
    "fractures in bubbly ice": {"surface": {"bubble_share": 0.004, "fracture_share": 0.3}},
    "frost with glints on bubbles in bands": {
        "surface": {"bubble_share": 0.02, "bubble_band_m": 0.5, "frost_share": 0.5, "glint_share": 0.03}
    },
    "rocks with transmission, lost": _CLEAR,
    "rocks with transmission, through": description.merged(_CLEAR, {"rock_surface": {"transmitted": "THROUGH"}}),
}


def small(preset: str, width: int, samples: int, *parts: Parts) -> Settings:
    """A preset's settings for an image this wide, without a denoiser, with changes."""
    image: Parts = {
        "rig": {"width_px": width, "height_px": width * 3 // 4},
        "quality": {"samples": samples, "denoiser": "NONE", "threads": 2},
    }
    return settings_of((preset,), image, *parts)


def costs(width: int, samples: int) -> Iterator[str]:
    """Lines of a table of each layer's cost."""
    plain = 0.0
    for name, part in LAYERS.items():
        took = measure_render_seconds(small("gallery/block_field", width, samples, PLAIN, part))
        plain = plain or took
        yield f"| {name} | {took:.1f} | {took / plain:.2f} |"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--samples", type=int, default=16)


def main(options: argparse.Namespace) -> None:
    """Print the table."""
    start_blender()
    for line in costs(options.width, options.samples):
        print(line, flush=True)
