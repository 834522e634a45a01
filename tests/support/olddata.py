"""Data sets that released versions have made, and settings as a later version may have them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from icymoon.settings import pair_ids
from icymoon.settings.table import TOPICS, Setting

DATA = Path(__file__).parents[1] / "data"
OLD = [folder.name for folder in sorted(DATA.glob("v*"))]


def copied(name: str, to: Path) -> Path:
    """A copy of a data set, to do something to."""
    shutil.copytree(DATA / name / "dataset", to / "dataset")
    return to / "dataset"


def upgrade(monkeypatch: pytest.MonkeyPatch, topic: str, *settings: Setting, before: object = None) -> None:
    """Have a version with more settings in a topic, which stand first, the others in reversed order."""
    for setting in settings:
        monkeypatch.setitem(pair_ids.SCHEMA["later"], f"{topic}.{setting.key}",
                            setting.default if before is None else before)
    monkeypatch.setitem(TOPICS, topic, replace(TOPICS[topic], settings=(*settings, *TOPICS[topic].settings[::-1])))


def upgrade_entries(monkeypatch: pytest.MonkeyPatch, topic: str, key: str, part: Setting, before: object) -> None:
    """Have a version whose tables of a list have one setting more."""
    monkeypatch.setitem(pair_ids.SCHEMA["later"], f"{topic}.{key}.{part.key}", before)
    lists = replace(TOPICS[topic][key], entries=(part, *TOPICS[topic][key].entries))
    monkeypatch.setitem(TOPICS, topic, replace(TOPICS[topic], settings=tuple(
        lists if setting.key == key else setting for setting in TOPICS[topic].settings)))


def upgrade_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a version with more settings of several kinds, some of which do something else by default than before."""
    upgrade(monkeypatch, "quality", Setting("extra_pass", "Extra Pass", True, "Some pass more", "sampling"),
            before=False)
    upgrade(monkeypatch, "rig", Setting("wobble_deg", "Wobble", 0.3, "Some motion of the rig", "camera", "deg", 0.0,
                                        5.0), before=0.0)
    upgrade(monkeypatch, "sensor", Setting("hum_e", "Hum", 7.0, "Some noise of the sensor", "response", "e-", 0.0,
                                           99.0), before=0.0)
    upgrade_entries(monkeypatch, "terrain", "layers",
                    Setting("skew", "Skew", 0.5, "Some skewness of the layer", "geometry", "1", 0.0, 1.0), 0.0)
