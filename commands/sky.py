"""The verb ``sky``: Sun, planet and eclipse over a site at dates, without a render."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from ..formats.map_site import read_site_place
from ..physics.light.ephemeris import format_date, parse_date
from ..physics.light.scene_sun import sun_from_facts
from ..physics.light.sky import SkyPlace, check_body, compute_sky, describe_sky
from ..physics.light.sky_over_map import find_sky_place, uses_sky_of_site
from ..settings.description import check, merged
from ..settings.preset_files import preset_names
from ..settings.topics.scene import Settings
from ..settings.user_files import find_used_files
from ..support.errors import IcyMoonError
from ..support.number_text import show_place
from ..support.printer import emit_json, print_table, say
from .scene_options import add_scene_options, read_settings

#: Largest number of dates in a table.
_MAX_ROWS = 1000
#: Characters of a row in a pipe.
_PIPE_WIDTH = 132
_TABLE_COLUMNS = (
    "Date (UTC)",
    "Sun el.°",
    "az.°",
    "W/m²",
    "level",
    "hidden %",
    "Planet el.°",
    "az.°",
    "size°",
    "phase°",
    "W/m²",
    "level",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``sky``."""
    add_scene_options(parser)
    parser.add_argument(
        "--body",
        help="light.body with its preset: ENCELADUS or EUROPA; with kernels any body, "
        "with its planet as --set light.parent=NAME",
    )
    parser.add_argument("--latitude", type=float, metavar="DEG", help="light.latitude_deg, north")
    parser.add_argument("--longitude", type=float, metavar="DEG", help="light.longitude_deg, east")
    parser.add_argument("--date", help="light.date_utc, such as 2035-03-01T12:00:00")
    parser.add_argument("--kernels", help="light.kernels: a SPICE meta-kernel or a folder, in place of own elements")
    parser.add_argument("--hours", type=float, default=0.0, help="a table from the date to this many hours after it")
    parser.add_argument(
        "--every", type=float, default=1.0, metavar="HOURS", help="hours between its rows (%(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print facts as JSON, a line for each date")
    parser.set_defaults(run=_run_sky)


def _make_settings(options: argparse.Namespace) -> Settings:
    """Make the settings with the options' position on the body and time."""
    by_date = bool(options.date or options.kernels)
    stated = {
        "body": options.body,
        "latitude_deg": options.latitude,
        "longitude_deg": options.longitude,
        "date_utc": options.date,
        "kernels": options.kernels,
        "directions_from": "KERNELS" if options.kernels else "DATE" if options.date else None,
        "planet": True if by_date else None,
    }
    options.preset += _find_body_preset(options.body)
    settings = merged(
        read_settings(options),
        check({"light": {key: value for key, value in stated.items() if value is not None}}, "sky"),
    )
    if settings.light.directions_from == "ANGLES":
        _check_dated(options)
    if options.body is None:
        name = settings.light.body.strip().upper()
        check_body(
            settings,
            f"give --body {name} for the sky of {name.title()}, with its preset, or set light.body to "
            "what the ground is of.",
        )
    return settings


def _check_dated(options: argparse.Namespace) -> None:
    """Raise IcyMoonError for an option that acts only on the sky of a date. A body with a preset has its own light,
    also without a date."""
    given = {
        "--body": options.body if not _find_body_preset(options.body) else None,
        "--latitude": options.latitude,
        "--longitude": options.longitude,
    }
    if unused := [
        f"{name} {value if isinstance(value, str) else f'{value:g}'}"
        for name, value in given.items()
        if value is not None
    ]:
        raise IcyMoonError(
            f"{unused[0]} has no effect without a date; give --date for Enceladus or Europa, or --kernels for any body."
        )


def _run_sky(options: argparse.Namespace) -> int:
    settings = _make_settings(options)
    place = None if options.latitude is not None or options.longitude is not None else _find_site(settings)
    rows = []
    for date in _list_dates(settings.light.date_utc, settings.light.directions_from, options.hours, options.every):
        light = merged(settings, {"light": {"date_utc": date}}).light
        dated = light.directions_from != "ANGLES"
        facts = describe_sky(compute_sky(light, place=place))
        facts["sun"] = sun_from_facts(facts["sun"], light.directions_from).to_json()
        if options.json:
            emit_json({"date_utc": date if dated else None, "body": light.body, **facts})
        rows.append(_make_row(date.replace("T", " ").removesuffix(":00") if dated else "by angles", facts))
    if not options.json:
        print_table(_TABLE_COLUMNS, rows, narrowest=_PIPE_WIDTH)
        site = (place.latitude_deg, place.longitude_deg) if place else (light.latitude_deg, light.longitude_deg)
        where = (
            f"{light.body.title()}, {show_place(*site)}, by "
            + ("SPICE kernels. " if light.directions_from == "KERNELS" else "mean orbits. ")
            if dated
            else ""
        )
        say(
            f"{where}W/m² are on a surface that faces the light, and on level ground. Hidden is the share of the Sun's "
            "disc behind the planet; its W/m² are without that share, and 0 by night."
        )
    return 0


def _find_site(settings: Settings) -> SkyPlace | None:
    """Find the site of a map whose coordinates the settings state; azimuths are then from true north. None without
    coordinates."""
    if not uses_sky_of_site(settings):
        return None
    found = read_site_place(find_used_files(settings)["source.file"], settings)
    place = find_sky_place(settings, found.to_json() if found else None)
    return place and replace(place, north_deg=0.0)


def _find_body_preset(body: str | None) -> list[str]:
    """Find the shipped preset of a body, with the planet and its light; empty without such a preset."""
    name = f"bodies/{(body or '').strip().lower()}"
    return [name] if name in preset_names("bodies") else []


def _list_dates(first: str, source: str, hours: float, every: float) -> list[str]:
    """List the dates of the rows, in UTC. Raises IcyMoonError for an invalid date and for invalid steps."""
    if hours == 0:
        return [first if source == "ANGLES" else format_date(parse_date(first))]
    if source == "ANGLES":
        raise IcyMoonError("--hours needs a date; give --date, or set light.directions_from to DATE.")
    if not (0 < hours < np.inf and 0 < every < np.inf) or hours / every > _MAX_ROWS:
        raise IcyMoonError(
            f"--hours is {hours:g} and --every {every:g}; give numbers above 0 that make at most {_MAX_ROWS} rows."
        )
    start = parse_date(first).astype("datetime64[s]")
    steps = np.arange(0.0, hours + every / 1e6, every)
    return [format_date(start + np.timedelta64(round(3600 * step), "s")) for step in steps]


def _make_row(date: str, facts: dict[str, Any]) -> tuple[str, ...]:
    sun, planet = facts["sun"], facts["planet"]
    cells = [
        date,
        f"{sun['elevation_deg']:.2f}",
        f"{sun['azimuth_deg']:.2f}",
        f"{sun['irradiance_wm2']:.3f}",
        f"{sun['ground_irradiance_wm2']:.3f}",
        f"{100 * sun['eclipse']:.0f}",
    ]
    if planet is None:
        return (*cells, *["–"] * 6)
    return (
        *cells,
        f"{planet['elevation_deg']:.2f}",
        f"{planet['azimuth_deg']:.2f}",
        f"{planet['angular_diameter_deg']:.2f}",
        f"{planet['phase_deg']:.1f}",
        f"{planet['irradiance_wm2']:.4f}",
        f"{planet['ground_irradiance_wm2']:.4f}",
    )
