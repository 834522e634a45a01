"""Directions of Sun, planet and other moons from a site at a date, from the user's SPICE kernels.

Needs SpiceyPy (``pip install "icymoon[ephemeris]"``), which Blender's Python does not have; it is loaded only if
kernels are used. Kernels: leap seconds (naif0012.tls), constants (pck00011.tpc), the planets (de440s.bsp) and the
moon's system (sat441.bsp, jup365.bsp).
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from types import ModuleType

import numpy as np

from ...support.arrays import Array
from ...support.errors import IcyMoonError
from ...support.foreign_bytes import note_on_backslashes
from .ephemeris import Positions, format_date, local_axes, parse_date
from .kernels import find_kernels
from .moons import MOONS
from .sunlight import AU_KM


def has_spice() -> bool:
    """Return whether this Python has SpiceyPy."""
    return importlib.util.find_spec("spiceypy") is not None


def find_positions(
    kernels: Path,
    body: str,
    parent: str,
    date_utc: str,
    latitude_deg: float,
    longitude_deg: float,
    with_moons: bool = False,
) -> Positions:
    """Find the Sun and the planet above a site, and its other large moons ``with_moons``, with light time and stellar
    aberration.

    ``kernels`` is a meta-kernel, or a folder whose kernels are all loaded, see ``kernels.find_kernels``. ``body`` and
    ``parent`` are names that SPICE knows. Raises IcyMoonError if SpiceyPy, a kernel or data for the date is missing, or
    if the moon belongs to another planet.
    """
    if not has_spice():
        raise IcyMoonError(
            "This Python has no SpiceyPy, which light.kernels needs; install icymoon[ephemeris] in it "
            "or set light.directions_from to DATE."
        )
    if not kernels.exists():
        raise IcyMoonError(
            f"light.kernels names {kernels}, which does not exist{note_on_backslashes(kernels)}; give a "
            "meta-kernel or a folder of kernels."
        )
    date_utc = format_date(parse_date(date_utc))  # SPICE reads other texts too, and some of them as other dates
    spice = importlib.import_module("spiceypy")
    try:
        # The order of loading matters only if two kernels contain the same data.
        for path in find_kernels(kernels):
            spice.furnsh(str(path))
        return _find_positions(
            spice, body.strip().upper(), parent.strip().upper(), date_utc, latitude_deg, longitude_deg, with_moons
        )
    except spice.utils.exceptions.SpiceyError as error:
        said = " ".join((getattr(error, "long", "") or str(error)).split(". ")[0].split()).rstrip(".")
        raise IcyMoonError(
            f"{kernels} cannot give the sky of {body} at {date_utc}: {said}; add kernels "
            "that cover body and date, or set light.directions_from to DATE."
        ) from None
    finally:
        spice.kclear()


def _find_positions(
    spice: ModuleType,
    body: str,
    parent: str,
    date_utc: str,
    latitude_deg: float,
    longitude_deg: float,
    with_moons: bool,
) -> Positions:
    time = spice.str2et(date_utc)
    frame = f"IAU_{body}"
    _refuse_other_planet(spice, body, parent)
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    site = spice.srfrec(spice.bods2c(body), longitude, latitude)
    radii = spice.bodvrd(body, "RADII", 3)[1]
    axes = local_axes(np.asarray(spice.surfnm(*radii, site)), longitude, radii)

    def seen(target: str) -> Array:
        state, _ = spice.spkcpo(target, time, frame, "OBSERVER", "LT+S", site, body, frame)
        return axes @ state[:3]

    sun, planet = seen("SUN"), seen(parent)
    planet_radii = spice.bodvrd(parent, "RADII", 3)[1]
    axis = np.asarray(spice.pxform(f"IAU_{parent}", frame, time))[:, 2]
    sun_km, planet_km = float(np.linalg.norm(sun)), float(np.linalg.norm(planet))
    return Positions(
        sun / sun_km,
        sun_km / AU_KM,
        parent,
        planet / planet_km,
        planet_km,
        float(planet_radii[0]),
        float(planet_radii[2]),
        axes @ axis,
        axes @ np.asarray(spice.pxform("J2000", frame, time)),
        {name: seen(str(number)) for name, number in _list_other_moons(spice, body, parent)} if with_moons else {},
    )


def _list_other_moons(spice: ModuleType, body: str, parent: str) -> list[tuple[str, int]]:
    """List the names and NAIF's numbers of the large moons of the planet except the body."""
    own, planet = spice.bods2c(body), spice.bods2c(parent)
    return [
        (name, moon.number)
        for name, moon in MOONS.items()
        if moon.number // 100 == planet // 100 != 0 and moon.number != own
    ]


def _refuse_other_planet(spice: ModuleType, body: str, parent: str) -> None:
    """Raise IcyMoonError if the planet is not the moon's planet by NAIF's numbers, where 502 is a moon of 599."""
    number = spice.bods2c(body)
    planet = number // 100 * 100 + 99
    if 100 < number < 1000 and number % 100 not in (0, 99) and spice.bods2c(parent) != planet:
        name = spice.bodc2n(planet).upper()
        raise IcyMoonError(
            f"light.body is {body}, a moon of {name}, but light.parent is {parent}; set light.parent to {name}."
        )
