"""Data sets that released versions have made, and settings as a later version may have them."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import Setting

DATA = Path(__file__).parents[1] / "data"
OLD = [folder.name for folder in sorted(DATA.glob("v*"))]


def copied(name: str, to: Path) -> Path:
    """A copy of a data set, to do something to."""
    shutil.copytree(DATA / name / "dataset", to / "dataset")
    return to / "dataset"


def make_setting(
    key: str, default: bool | float, effect: str, before: bool | float | None = None, maximum: float = math.inf
) -> Setting:
    """A setting of a later release."""
    return Setting(
        key=key,
        label=key,
        default=default,
        description=f"Some {key}",
        effect=effect,
        since="9.0",
        before=before,
        minimum=0.0,
        maximum=maximum,
    )


def upgrade(monkeypatch: pytest.MonkeyPatch, topic: str, *settings: Setting) -> None:
    """Have a version with more settings in a topic, which stand first."""
    monkeypatch.setitem(TOPICS, topic, replace(TOPICS[topic], settings=(*settings, *TOPICS[topic].settings)))


def upgrade_entries(monkeypatch: pytest.MonkeyPatch, topic: str, key: str, part: Setting) -> None:
    """Have a version whose tables of a list have one setting more."""
    entry = TOPICS[topic][key].entry
    assert entry
    lists = replace(TOPICS[topic][key], entry=type(entry.__name__, (entry,), {part.key: part}))
    monkeypatch.setitem(
        TOPICS,
        topic,
        replace(
            TOPICS[topic],
            settings=tuple(lists if setting.key == key else setting for setting in TOPICS[topic].settings),
        ),
    )


def upgrade_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a version with more settings of several kinds, some of which do something else by default than before."""
    upgrade(monkeypatch, "quality", make_setting("extra_pass", True, "sampling", before=False))
    upgrade(monkeypatch, "rig", make_setting("wobble_deg", 0.3, "camera", before=0.0, maximum=5.0))
    upgrade(monkeypatch, "sensor", make_setting("hum_e", 7.0, "response", before=0.0, maximum=99.0))
    upgrade_entries(monkeypatch, "terrain", "layers", make_setting("skew", 0.5, "geometry", before=0.0, maximum=1.0))
