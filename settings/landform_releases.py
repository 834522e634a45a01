"""The release of the plug-in package that makes a landform; every description with such a landform states it.

The table of such a landform, ``[landform_NAME]``, has the setting ``made_by``. It is filled in if the landform is on,
and empty if it is off. It counts in the pair's id with all settings of the table, because another release may make
other ground.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..plugins.landforms import PREFIX, RELEASE, describe_missing_landform
from ..support.errors import IcyMoonError
from ..support.file_schemas import is_number
from .table import TOPICS
from .topics.declaration import Table
from .topics.scene import Settings

#: Longest name of a release that is read from a file, in characters.
_LONGEST_RELEASE = 200


def fill_in_releases(settings: Settings) -> Settings:
    """Fill in ``made_by`` of each plug-in landform in settings, complete or partial. Changes and returns these
    settings."""
    for topic, values in settings.items():
        known = TOPICS.get(topic)
        if known is None or not known.plugin or known.settings[0].key not in values:
            continue
        if values[known.settings[0].key] == 0:
            values |= {RELEASE: ""} if RELEASE in values else {}
        elif not values.get(RELEASE):
            values[RELEASE] = known.plugin
    return settings


def check_release(topic: str, values: Mapping[str, Any], where: str) -> None:
    """Raise IcyMoonError if a table states a release other than the installed one; ``where`` names the origin of the
    table.
    """
    stated, installed = values.get(RELEASE), TOPICS[topic].plugin
    if stated and stated != installed:
        raise IcyMoonError(
            f"{where}: {topic} was made by {stated}, and {installed} is installed; install {stated}, or "
            f"leave {topic}.{RELEASE} out for the ground of {installed}."
        )


def keep_missing_table(topic: str, values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the stored table of a landform that is not installed here; empty if the landform was off.

    It is kept unchecked, so that the pair can be read and keeps its id. Raises IcyMoonError if it contains anything
    other than numbers and the release.
    """
    release = values.get(RELEASE, "")
    if release == "":
        return {}
    if (
        not isinstance(release, str)
        or len(release) > _LONGEST_RELEASE
        or not all(
            isinstance(key, str) and (isinstance(value, bool) or is_number(value))
            for key, value in values.items()
            if key != RELEASE
        )
    ):
        raise IcyMoonError(f"{where}: [{topic}] is damaged; restore the file, or render the pair again.")
    return dict(values)


def refuse_missing_landforms(settings: Mapping[str, Mapping[str, Any]], where: str) -> None:
    """Raise IcyMoonError if a description has a landform that is not installed in this Python."""
    for topic, values in settings.items():
        if topic.startswith(PREFIX) and topic not in TOPICS:
            raise IcyMoonError(f"{where}: {describe_missing_landform(topic, str(values.get(RELEASE, '')))}")


def list_counted_landforms(settings: Mapping[str, Mapping[str, Any]]) -> list[list[Any]]:
    """List [name, value] of every setting of plug-in landforms that are on, for the id of a pair."""
    tables = {topic: Table(values) for topic, values in settings.items() if topic.startswith(PREFIX)}
    return [
        [f"{topic}.{key}", value]
        for topic, values in fill_in_releases(Settings(tables)).items()
        if values.get(RELEASE)
        for key, value in values.items()
    ]
