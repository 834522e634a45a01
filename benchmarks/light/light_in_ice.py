"""Delay of laser light in snow and ice: the law against photon walks, and the range bias by medium, laser and pulse.

    python benchmarks light_in_ice          the table of biases
    python benchmarks light_in_ice --walk   mean paths of walks beside those of the law, in some minutes
    python benchmarks light_in_ice --choices   how much each assumption of the law changes the bias

Biases are in mm, along the beam, with the whole exit area seen and a gate of 1 m. Another field of view is given by
``--field`` in metres.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

from icymoon.physics.lidar import light_in_ice as ice
from icymoon.physics.lidar.light_in_ice import Medium, Receiver
from photon_walk import walk

#: Grain radius in m and density in kg/m³ of snow.
_SNOW = ((50e-6, 200.0), (200e-6, 300.0), (500e-6, 400.0), (1e-3, 500.0))
#: Radius in m and share of bubbles.
_BUBBLES = ((5e-4, 0.063), (5e-4, 0.015))
_LASERS_NM = (532.0, 905.0, 1064.0, 1550.0)
_PULSES_S = (1e-9, 5e-9)
#: μa l*, asymmetry, photons, refractive index behind a smooth surface.
_WALKS = (
    (0.01, 0.845, 120000, 1.0),
    (0.03, 0.845, 300000, 1.0),
    (0.1, 0.845, 300000, 1.0),
    (0.3, 0.845, 100000, 1.0),
    (0.5, 0.845, 300000, 1.0),
    (1.0, 0.845, 400000, 1.0),
    (3.0, 0.845, 400000, 1.0),
    (0.01, 0.79, 30000, 1.31),
    (0.03, 0.79, 60000, 1.31),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--walk", action="store_true", help="let photons walk")
    parser.add_argument("--choices", action="store_true", help="change one assumption after the other")
    parser.add_argument("--field", type=float, default=math.inf, help="radius of the field of view in m")


def main(options: argparse.Namespace) -> None:
    """Print one of the tables."""
    if options.walk:
        compare_walks()
        return
    if options.choices:
        compare_choices()
        return
    print("| medium | l*, mm | nm | 1 ns: edge / peak / centroid | 5 ns |\n|---|---|---|---|---|")
    for wavelength in _LASERS_NM:
        media = [ice.make_snow(radius, density, wavelength) for radius, density in _SNOW]
        media += [ice.make_bubbly_ice(radius, share, wavelength) for radius, share in _BUBBLES]
        for medium in media:
            print(
                f"| {medium.title} | {1e3 * medium.transport_m:.3g} | {wavelength:g} | {_row(medium, options.field)} |"
            )


def _row(medium: Medium, field_m: float) -> str:
    biases = (ice.measure_bias(medium, Receiver(pulse, field_radius_m=field_m)) for pulse in _PULSES_S)
    return " | ".join(
        " / ".join(f"{round(1e3 * x, 2):.3g}" for x in (b.edge_m, b.peak_m, b.centroid_m)) for b in biases
    )


def compare_choices() -> None:
    """Print biases of a pulse of 1 ns with one assumption after the other replaced by a simpler one."""
    steps = (
        ("as above", 0.845, False, ice.ALONG_BEAM),
        ("light in all directions, z = 5/3 l*", 0.845, False, ice.ALL_EXITS),
        ("and a delay index of 1 - φ + φ n", 0.845, True, ice.ALL_EXITS),
        ("and g = 0.86", 0.86, True, ice.ALL_EXITS),
    )
    print(
        "| assumption | nm | snow of 50 µm, 200 kg/m³ | snow of 1 mm, 500 kg/m³ | bubbly ice |\n|---|---|---|---|---|"
    )
    for words, g, by_volume, depth in steps:
        for wavelength in (532.0, 905.0):
            media = [ice.make_snow(*own, wavelength, g) for own in (_SNOW[0], _SNOW[-1])]
            media.append(ice.make_bubbly_ice(*_BUBBLES[0], wavelength))
            if by_volume:
                shares = (_SNOW[0][1] / ice.ICE_KG_M3, _SNOW[-1][1] / ice.ICE_KG_M3, 1.0 - _BUBBLES[0][1])
                media = [
                    replace(medium, delay_index=1.0 - share + share * 1.31)
                    for medium, share in zip(media, shares, strict=True)
                ]
            cells = (ice.measure_bias(medium, Receiver(_PULSES_S[0]), depth) for medium in media)
            texts = (f"{1e3 * b.edge_m:.3g} / {1e3 * b.peak_m:.3g} / {1e3 * b.centroid_m:.3g}" for b in cells)
            print(f"| {words} | {wavelength:g} | {' | '.join(texts)} |")


def compare_walks() -> None:
    """Print albedo and mean path of walks beside the law's, in l*."""
    print("| μa l* | g | n | albedo: walk, law | mean path: walk, law | within 20° of the beam: walk, law |")
    print("|---|---|---|---|---|---|")
    for absorbed, g, count, index in _WALKS:
        medium = Medium("unit", 1.0, absorbed, g, surface_index=index)
        found = walk(count, absorbed, g, seed=3, index=index)
        along = found.path[found.cosine > math.cos(math.radians(20.0))]
        error = along.std() / math.sqrt(len(along))
        shares = f"{found.albedo:.4f}, {ice.plane_albedo(medium):.4f}"
        paths = f"{found.path.mean():.2f}, {ice.mean_path_m(medium, ice.ALL_EXITS):.2f}"
        ahead = f"{along.mean():.2f} ± {error:.2f}, {ice.mean_path_m(medium):.2f}"
        print(f"| {absorbed:g} | {g:g} | {index:g} | {shares} | {paths} | {ahead} |", flush=True)
