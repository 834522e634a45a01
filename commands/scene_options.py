"""The options by which verbs take the settings of a scene."""

from __future__ import annotations

import argparse

from ..settings import description, preset_files
from ..settings.topics.scene import Settings
from ..support.terminal import add_repeatable_option, as_path


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--preset``, ``--settings`` and ``--set`` to a parser."""
    add_repeatable_option(parser, "--preset", None, "shipped preset, see icymoon presets; may repeat")
    add_repeatable_option(parser, "--settings", None, "TOML file; may repeat", type=as_path)
    add_repeatable_option(parser, "--set", "TOPIC.KEY=VALUE", "one setting; may repeat", dest="overrides")


def read_settings(options: argparse.Namespace) -> Settings:
    """Read the complete settings that the options describe. Raises IcyMoonError for an invalid setting."""
    return description.merged(
        description.defaults(),
        *(preset_files.load_preset(name) for name in options.preset),
        *(preset_files.load(path) for path in options.settings),
        *(description.override(text) for text in options.overrides),
    )
