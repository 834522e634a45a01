"""The origin of the numbers of a scene: the preset that states each number, and the preset's source.

Settings contain values only, not who set them. So a value is traced to a shipped preset that states the same value. A
preset counts if the settings have at least half of its values that are not defaults. The most similar preset and the
presets that it includes come first, then the presets with the largest share.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..paper_stand_ins.shown_items import describe_item, list_items
from ..render.pairs.pair_folder import find_pair_folders, read_pair
from ..settings import description, preset_files, toml_text
from ..settings.table import TOPICS, list_all_settings
from ..settings.topics.declaration import Setting, Value
from ..settings.topics.scene import Settings
from ..settings.topics.stand_ins import MeshItem
from ..support.errors import IcyMoonError

#: Texts in place of a preset where no preset states the value.
DEFAULT, BY_HAND, STAND_IN = "default", "stated", "stand-in"


@dataclass(frozen=True)
class Origin:
    """The origin of a setting's value: ``preset`` is the name of a preset, ``DEFAULT``, ``BY_HAND`` or ``STAND_IN``."""

    name: str
    value: Value
    unit: str
    preset: str
    source: str

    @property
    def lines(self) -> str:
        """Two lines of text: the value with its unit, then the preset and its source."""
        value = f"{self.value:g}" if isinstance(self.value, float) else str(self.value)
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        return f"{self.name} = {value}{unit}\n    {self.preset}: {self.source}"


@dataclass(frozen=True)
class _Preset:
    name: str
    stated: Settings
    sources: dict[str, str]
    included: tuple[str, ...]


def _read_preset(name: str) -> _Preset:
    """Read a shipped preset without the presets that it includes."""
    path = preset_files.find_preset(name)
    raw = toml_text.read_toml(path)
    stated = {topic: values for topic, values in raw.items() if topic in TOPICS}
    return _Preset(
        name, description.check(stated, str(path)), raw.get("sources", {}), tuple(raw["preset"].get("include", ()))
    )


def _measure_likeness(stated: Settings, settings: Settings, defaults: Settings) -> tuple[float, int]:
    """Return the share of the ``stated`` values that the settings contain, and the number of these values.

    Values that are defaults count only if all stated values are defaults.
    """
    listed = [(topic, key, value) for topic, values in stated.items() for key, value in values.items()]
    telling = [each for each in listed if defaults[each[0]][each[1]] != each[2]] or listed
    met = sum(settings[topic][key] == value for topic, key, value in telling)
    return met / max(len(telling), 1), met


def _rank_presets(settings: Settings) -> list[_Preset]:
    """Rank the presets that apply: first the preset most similar to the settings, and the presets that it includes."""
    defaults, known = description.defaults(), {name: _read_preset(name) for name in preset_files.preset_names()}
    whole = {name: preset_files.load_preset(name) for name in known}
    family = [max(known, key=lambda name: _measure_likeness(whole[name], settings, defaults))]
    for name in family:  # grows by the presets that each one includes
        family += known[name].included
    likeness = {name: _measure_likeness(preset.stated, settings, defaults) for name, preset in known.items()}
    order = sorted(known, key=lambda name: (name in family, likeness[name]), reverse=True)
    return [known[name] for name in order if likeness[name][0] >= 0.5]


def _find_origin(topic: str, setting: Setting, value: Value, default: Value, presets: list[_Preset]) -> Origin:
    name = f"{topic}.{setting.key}"
    for preset in presets:
        if preset.stated.get(topic, {}).get(setting.key) == value:
            return Origin(name, value, setting.unit, preset.name, preset.sources.get(name, "no source is given"))
    if value == default:
        return Origin(name, value, setting.unit, DEFAULT, setting.description)
    return Origin(name, value, setting.unit, BY_HAND, "in no such preset; from the window, a plan, a file or --set")


def find_origins(settings: Settings, asked: Iterable[str] = ()) -> Iterator[Origin]:
    """Find the origin of each setting of a complete description, in the order of the sidebar.

    ``asked`` are topics (``light``) or settings (``light.planet``) to list. If it is empty, all settings that differ
    from their defaults are listed. Raises IcyMoonError for an unknown name.
    """
    wanted, defaults = list(asked), description.defaults()
    names = {f"{topic}.{setting.key}" for topic, setting in list_all_settings()} | set(TOPICS)
    for word in wanted:
        if word not in names:
            raise IcyMoonError(
                f"{word!r} is neither a topic nor a setting; give for example light, or light.planet_albedo."
            )
    presets = _rank_presets(settings)
    stand_ins = {
        "source.stand_in" if isinstance(item, MeshItem) else "textures.stand_in": item for item in list_items(settings)
    }
    for topic, setting in list_all_settings():
        if wanted and topic not in wanted and f"{topic}.{setting.key}" not in wanted:
            continue
        value = settings[topic][setting.key]
        if item := stand_ins.get(f"{topic}.{setting.key}"):
            yield Origin(f"{topic}.{setting.key}", value, "", STAND_IN, describe_item(item))
            continue
        origin = _find_origin(topic, setting, value, defaults[topic][setting.key], presets)
        if wanted or origin.preset != DEFAULT:
            yield origin


def read_pair_settings(path: Path) -> Settings:
    """Read the complete settings of the pair at ``path``. Raises IcyMoonError if there is not exactly one pair."""
    folders = find_pair_folders(path)
    if len(folders) != 1:
        raise IcyMoonError(f"{path} has {len(folders)} pairs; name one of them, such as {folders[0]}.")
    return read_pair(folders[0]).settings
