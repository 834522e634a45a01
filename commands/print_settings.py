"""The verbs that print settings: ``settings``, ``presets`` and ``sources``."""

from __future__ import annotations

import argparse

from ..settings import preset_files, toml_text
from ..support import printer
from ..support.terminal import as_path
from .renderer_options import add_blender_option
from .scene_options import add_scene_options, read_settings


def add_settings_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``settings``."""
    add_scene_options(parser)
    add_blender_option(parser)
    parser.set_defaults(run=_run_settings)


def add_presets_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``presets``."""
    parser.set_defaults(run=_run_presets)


def add_sources_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``sources``."""
    parser.add_argument("path", type=as_path, help="pair folder, or a data set of one pair")
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="topic such as light, or setting such as light.planet_albedo (all that are not defaults)",
    )
    parser.set_defaults(run=_run_sources)


def _run_settings(options: argparse.Namespace) -> int:
    printer.say(toml_text.to_toml(read_settings(options)).removesuffix("\n"))
    return 0


def _run_presets(options: argparse.Namespace) -> int:
    for name in preset_files.preset_names():
        title, text = preset_files.read_preset_header(name)
        printer.say(f"{name:32} {title}. {text}")
    return 0


def _run_sources(options: argparse.Namespace) -> int:
    from .sources import find_origins, read_pair_settings

    for origin in find_origins(read_pair_settings(options.path), options.names):
        printer.say(origin.lines)
    return 0
