"""Hapke parameters of icy moons from measured albedos, as the presets ``surfaces/hapke_…`` have them.

    python benchmarks fit_albedos

Enceladus: w and the amplitude of coherent backscatter from the geometric and the Bond albedo. Of the phase functions
with b in steps of 0.05 and c of 0.5, the one whose equigonal albedo is nearest to the measured one. The south polar
terrain differs in w, which has the equigonal albedo at the upper end of the measured one. The other moons have the
phase function, widths and roughness of Enceladus; w and the amplitude are from the equigonal and the geometric albedo.

Europa has the published fit of its whole disc (Domingue et al. 1991). Bright plains: w from the Bond albedo, and a
surge such that the opposition effect, from 5° to 0°, is 1.5 times that of the whole disc. Dark lineae: w from
I/F at 5°, with the largest amplitude of shadow hiding. Ridges and bands: w such that I/F at 5° is that of plains with a
quarter and a half of dark matter.

Prints the parameters and the albedos that follow. Needs no Blender.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from functools import partial

import numpy as np
from icymoon.physics.surfaces import photometry
from icymoon.physics.surfaces.hapke import HapkeParameters, bidirectional_reflectance
from icymoon.support.arrays import Array
from icymoon.validation.moon_albedos import compute_opposition_effect, compute_radiance_factor_at_5_deg

#: Geometric and equigonal albedo: Verbiscer et al. 2007, as others quote it; Filacchione et al. 2022.
MOONS = {"Mimas": (0.962, 0.63), "Tethys": (1.229, 0.74), "Dione": (0.998, 0.65), "Rhea": (0.949, 0.60)}
#: Geometric, Bond and equigonal albedo, and the upper end of the last one's error.
GEOMETRIC, BOND, EQUIGONAL, BRIGHTEST = 1.375, 0.81, 0.89, 0.92


def make_law(w: float, b: float, c: float, b_c0: float) -> photometry.Law:
    """Shadow hiding at its maximum, both surges equally wide, roughness 6 degrees: chosen values, see the presets."""
    return partial(
        bidirectional_reflectance,
        parameters=HapkeParameters(
            w=w, b=b, c=c, b_s0=1.0, h_s=0.014, b_c0=b_c0, h_c=0.014, theta_bar=math.radians(6.0)
        ),
    )


def solve(excess: Callable[[float, float], tuple[float, float]]) -> tuple[float, float]:
    """w and amplitude for which both values of ``excess`` are 0, by Newton's method in ln(1 - w)."""
    x = np.array([math.log(0.02), 0.6])

    def at(point: Array) -> Array:
        return np.array(excess(1 - math.exp(point[0]), float(np.clip(point[1], 0.0, 1.0))))

    for _ in range(12):
        found = at(x)
        slope = np.stack([(at(x + step) - found) / 1e-5 for step in 1e-5 * np.eye(2)], axis=1)
        x = x - np.linalg.solve(slope, found)
    return 1 - math.exp(x[0]), float(x[1])


def report(name: str, w: float, b: float, c: float, b_c0: float) -> None:
    """Print the parameters and the derived numbers."""
    law = make_law(w, b, c, b_c0)
    print(
        f"{name:20s} w {w:.5f}  b {b:.2f}  c {c:.1f}  b_c0 {b_c0:.4f}   geometric "
        f"{photometry.geometric_albedo(law):.4f}  Bond {photometry.bond_albedo(law):.4f}  equigonal "
        f"{photometry.equigonal_albedo(law):.4f}",
        flush=True,
    )


def make_europa_law(w: float, b_s0: float) -> photometry.Law:
    """Europa's whole disc after Domingue et al. 1991, with another w and surge."""
    return partial(
        bidirectional_reflectance,
        parameters=HapkeParameters(
            w=w,
            b=0.429,
            c=0.113,
            b_s0=b_s0,
            h_s=0.0016,
            b_c0=0.0,
            h_c=0.0,
            theta_bar=math.radians(10.0),
            h_function="1981",
        ),
    )


def fit_europa() -> None:
    """Print Europa's terrains."""
    wanted = 1.5 * compute_opposition_effect(make_europa_law(0.964, 0.5))
    found = {
        "bright plains": solve(
            lambda w, surge: (
                photometry.bond_albedo(make_europa_law(w, surge)) - 0.68,
                compute_opposition_effect(make_europa_law(w, surge)) - wanted,
            )
        )
    }
    surge, plains, dark = (
        found["bright plains"][1],
        compute_radiance_factor_at_5_deg(make_europa_law(*found["bright plains"])),
        0.17,
    )
    for name, amplitude, share in (("dark lineae", 1.0, 1.0), ("ridges", surge, 0.25), ("bands", surge, 0.5)):
        mixed = (1 - share) * plains + share * dark
        low, high = 0.1, 0.999
        for _ in range(40):  # w, by halving: I/F grows with it
            middle = (low + high) / 2
            low, high = (
                (middle, high)
                if compute_radiance_factor_at_5_deg(make_europa_law(middle, amplitude)) < mixed
                else (low, middle)
            )
        found[name] = low, amplitude
    for name, (w, amplitude) in found.items():
        law = make_europa_law(w, amplitude)
        print(
            f"Europa, {name:14s} w {w:.5f}  b_s0 {amplitude:.4f}   "
            f"I/F at 5° {compute_radiance_factor_at_5_deg(law):.4f}  "
            f"geometric {photometry.geometric_albedo(law):.4f}  Bond {photometry.bond_albedo(law):.4f}",
            flush=True,
        )


def main(options: argparse.Namespace) -> None:
    """Print the fits."""
    fit_europa()
    found = []
    for b in (0.2, 0.25, 0.3, 0.35, 0.4):
        for c in (0.0, 0.5, 1.0):
            w, b_c0 = solve(
                lambda w, amplitude, b=b, c=c: (  # type: ignore[misc]
                    photometry.bond_albedo(make_law(w, b, c, amplitude)) - BOND,
                    photometry.geometric_albedo(make_law(w, b, c, amplitude)) - GEOMETRIC,
                )
            )
            found.append((abs(photometry.equigonal_albedo(make_law(w, b, c, b_c0)) - EQUIGONAL), w, b, c, b_c0))
            report("", w, b, c, b_c0)
    _, w, b, c, b_c0 = min(found)
    report("Enceladus", w, b, c, b_c0)
    south, _ = solve(
        lambda w, amplitude: (photometry.equigonal_albedo(make_law(w, b, c, b_c0)) - BRIGHTEST, amplitude - b_c0)
    )
    report("south polar terrain", south, b, c, b_c0)
    for name, (geometric, equigonal) in MOONS.items():
        w, amplitude = solve(
            lambda w, amplitude, g=geometric, e=equigonal: (  # type: ignore[misc]
                photometry.geometric_albedo(make_law(w, b, c, amplitude)) - g,
                photometry.equigonal_albedo(make_law(w, b, c, amplitude)) - e,
            )
        )
        report(name, w, b, c, amplitude)
