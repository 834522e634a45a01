"""The options by which verbs take the settings of a scene."""

from __future__ import annotations

import argparse

from ..settings import description, preset_files
from ..settings.topics.scene import Settings
from ..support.terminal import as_path


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--preset``, ``--settings`` and ``--set``."""
    parser.add_argument("--preset", action="append", default=[], help="shipped preset, see icymoon presets; may repeat")
    parser.add_argument("--settings", type=as_path, action="append", default=[], help="TOML file; may repeat")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="TOPIC.KEY=VALUE",
        dest="overrides",
        help="one setting; may repeat",
    )


def read_settings(options: argparse.Namespace) -> Settings:
    """The complete settings that the options describe. Raises IcyMoonError for one that is wrong."""
    return description.merged(
        description.defaults(),
        *(preset_files.load_preset(name) for name in options.preset),
        *(preset_files.load(path) for path in options.settings),
        *(description.override(text) for text in options.overrides),
    )
