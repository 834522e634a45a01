"""The real albedo of Blender's Principled surface, and the base colour that gives a wanted albedo.

The base colour of the Principled surface is not its albedo: specular reflection adds to it, the random walk under the
surface has a different albedo, at most 0.92, and transmitted light is lost. The bihemispherical reflectance of a flat
surface (light from all sides, to all sides) was measured in a white furnace (``python benchmarks furnace``). It is the
same from Blender 4.3 to 5.0. 4.2 loses less light on steep bumps; 5.2 returns up to 2.4 % less of the light that goes
under the surface. So 4.2, 5.0 and 5.2 each have a table, which is interpolated and inverted here.
"""

from __future__ import annotations

import functools
import json
import math
from pathlib import Path

import numpy as np

from ...settings.topics.surfaces import SurfaceSettings
from ...support.arrays import Array

#: Files of the measured tables by Blender version; ``use_table`` chooses one.
TABLE_FILES = {"4.2": "principled_4_2.json", "5.0": "principled.json", "5.2": "principled_5_2.json"}
#: Relative difference above which the real albedo is reported.
REPORTED_FROM = 0.01


class _TableInUse:
    """The table in use, a key of ``TABLE_FILES``."""

    blender = "5.0"


def use_table(blender: str) -> None:
    """Use the table of a Blender version, a key of ``TABLE_FILES``, from now on. The default is the table of 5.0."""
    _TableInUse.blender = blender


def _get_table() -> dict[str, Array]:
    return _read_table(TABLE_FILES[_TableInUse.blender])


@functools.cache
def _read_table(name: str) -> dict[str, Array]:
    read = json.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))
    return {k: np.array(v) for k, v in read.items() if isinstance(v, list)}


def root_f0(refractive_index: float, specular: float) -> float:
    """Compute the square root of the reflectance at normal incidence, from the refractive index and Blender's specular
    level. The level scales the reflectance; 0.5 leaves it unchanged.
    """
    plain = ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
    return math.sqrt(plain * 2.0 * specular)


def lets_light_through(surface: SurfaceSettings) -> bool:
    """Return whether rocks with this surface transmit light."""
    return surface.model == "PRINCIPLED" and surface.transmission > 0.0 and surface.transmitted == "THROUGH"


def diffuse_fresnel_reflectance(refractive_index: float) -> float:
    """Compute the share of light from all sides that a smooth surface of this refractive index reflects, by Fresnel's
    formula.
    """
    nodes, weights = np.polynomial.legendre.leggauss(32)
    # Substitute cos i = x^2, because reflection rises steeply near grazing.
    x = (nodes + 1) / 2
    mu = x**2
    refracted = np.sqrt(1 - (1 - mu**2) / refractive_index**2)
    across = ((mu - refractive_index * refracted) / (mu + refractive_index * refracted)) ** 2
    along = ((refractive_index * mu - refracted) / (refractive_index * mu + refracted)) ** 2
    return float(np.sum(weights / 2 * 2 * x * 2 * mu * (across + along) / 2))


def _interpolate(values: Array, root: float, roughness: float) -> Array:
    """Interpolate bilinearly in the first two axes of a table."""
    table = _get_table()

    def weights(axis: Array, value: float) -> tuple[int, float]:
        k = int(np.clip(np.searchsorted(axis, value) - 1, 0, len(axis) - 2))
        return k, float(np.clip((value - axis[k]) / (axis[k + 1] - axis[k]), 0.0, 1.0))

    i, u = weights(table["root_f0"], root)
    j, v = weights(table["roughness"], roughness)
    low, high = (values[k, j] + v * (values[k, j + 1] - values[k, j]) for k in (i, i + 1))
    return low + u * (high - low)


def albedo_curve(surface: SurfaceSettings) -> tuple[Array, Array]:
    """Return base colours (n,) from 0 to 1 and the reflectances (n,) that they give with the other ``surface``
    settings.

    Between them the reflectance is linear in the base colour.
    """
    table = _get_table()
    root = root_f0(surface.refractive_index, surface.specular)
    # With Burley's profile as much light leaves as from a diffuse surface.
    walks = surface.subsurface_radius_m > 0.0 and surface.subsurface_method == "RANDOM_WALK"
    roughness, weight = surface.roughness, surface.subsurface_weight * walks
    base = table["base"]
    specular = _interpolate(table["specular"], root, roughness)
    diffuse = specular + (1.0 - specular) * base
    walk = np.maximum.accumulate(_interpolate(table["subsurface"], root, roughness))
    entered = (1.0 - weight) * diffuse + weight * walk
    share = surface.transmission
    reflectance = (1.0 - share) * entered + share * _interpolate(table["transmission"], root, roughness)
    # Bumps lose the light that they send downward. Moved vertices light each other and lose none.
    steepness = surface.grain_amplitude_m / surface.grain_size_m * (surface.relief != "DISPLACEMENT")
    return base, reflectance * np.interp(steepness, table["steepness"], table["bump"])


def base_colour_curve(surface: SurfaceSettings) -> tuple[Array, Array]:
    """Return reflectances (n,) from 0 to 1, and the base colours (n,) with these or the nearest possible reflectances.
    Between them the base colour is linear.
    """
    base, reflectance = albedo_curve(surface)
    # On a flat part of the curve, take its first point.
    rising = np.concatenate([[True], np.diff(reflectance) > 1e-9])
    base, reflectance = base[rising], reflectance[rising]
    below, above = int(reflectance[0] > 0.0), int(reflectance[-1] < 1.0)
    return (
        np.concatenate([[0.0] * below, reflectance, [1.0] * above]),
        np.concatenate([base[:1]] * below + [base] + [base[-1:]] * above),
    )


def base_colour(surface: SurfaceSettings, albedo: float) -> float:
    """Find the base colour, 0 to 1, with the reflectance ``albedo`` or the nearest possible one."""
    return float(np.interp(albedo, *base_colour_curve(surface)))


def real_albedo(surface: SurfaceSettings) -> float:
    """Find the bihemispherical reflectance of clean, flat ice with ``surface`` settings: the set albedo, or the nearest
    possible one.
    """
    _, reflectance = albedo_curve(surface)
    return float(np.clip(surface.albedo, reflectance[0], reflectance[-1]))


def advise_on_albedo(surface: SurfaceSettings) -> str:
    """Return a sentence if the surface cannot have the set albedo; else an empty text."""
    asked, real = float(surface.albedo), real_albedo(surface)
    if abs(real - asked) <= REPORTED_FROM * asked:
        return ""
    if real > asked:
        return f"The albedo is really {real:.2f}: the specular reflection alone is that bright; lower it."
    lost, key = _find_largest_loss(surface)
    return f"The albedo is really {real:.2f}, not {asked:.2f}: {lost}; lower {key}."


def _find_largest_loss(surface: SurfaceSettings) -> tuple[str, str]:
    """Find the largest loss of light at a surface, as a phrase, and the setting to lower."""
    causes = {
        "transmission": "transmitted light is lost",
        "grain_amplitude_m": "steep bumps lose light",
        "subsurface_weight": "snow under the surface absorbs",
    }
    most = max(causes, key=lambda k: float(albedo_curve(surface | {k: 0.0})[1][-1]))
    return causes[most], most
