"""Reads and writes presets and other settings files.

A preset describes a whole scene or a part of one. The user's settings files have the same format.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from ..support.errors import IcyMoonError
from ..support.files import is_file, quote, shorten
from ..support.suggestions import suggest_nearest
from ..support.version import version
from .description import MIN_SIMILARITY, ask_to_update, check, merged
from .table import TOPICS
from .toml_text import read_toml, to_toml, to_toml_value
from .topics.scene import Settings

PRESETS_FOLDER = Path(__file__).resolve().parents[1] / "presets"
#: Folders of presets, whole scenes first, and the titles of their kinds.
PRESET_KINDS = {
    "scenes": "Scenes",
    "gallery": "Gallery",
    "bodies": "Moons",
    "terrains": "Terrains",
    "rocks": "Rocks",
    "surfaces": "Surfaces",
    "lights": "Lights",
    "rigs": "Stereo Cameras",
    "sensors": "Camera Responses",
    "qualities": "Qualities",
}
#: Kinds of presets that describe a whole scene. Others describe a part of one.
WHOLE_SCENE_KINDS = ("scenes", "gallery", "own")
_HEADER_KEYS = ("title", "description", "include", "made_with")
#: Shipped plans of data sets, which ``render.plans`` reads.
PLANS_FOLDER = PRESETS_FOLDER / "datasets"
#: Shipped heads of cameras, which ``formats.calibrations.head_file`` reads.
HEADS = PRESETS_FOLDER / "heads"
#: Shipped laser scanners, which ``formats.lidar_file`` reads.
LIDARS = PRESETS_FOLDER / "lidars"


def load(path: Path) -> Settings:
    """Load the partial description in a settings file. It overrides the presets that the file includes.

    A file may begin with ``[preset]``, which contains ``title``, ``description``, ``include = ["bodies/europa", …]``
    and ``made_with``, the version that wrote the file. It may end with ``[sources]``, the source of each number, and
    ``[measured]``, measured results. All other tables are topics. Raises IcyMoonError if the file cannot be read.
    """
    data = read_toml(path)
    header = data.pop("preset", {})
    data.pop("sources", None)
    data.pop("measured", None)
    with ask_to_update(str(path), str(header.get("made_with", "")) if isinstance(header, Mapping) else ""):
        included = [_load_included(name, path) for name in _check_header(header, path)]
        return merged(*included, make_paths_relative_to(path.parent, check(data, str(path))))


def load_preset(name: str) -> Settings:
    """Load the partial description of a shipped preset; see ``find_preset`` and ``load``."""
    return load(find_preset(name))


def load_named(name: str) -> Settings:
    """Load the partial description of a shipped preset, or of a file whose name ends with .toml."""
    return load(Path(name)) if name.endswith(".toml") else load_preset(name)


def _load_included(name: str, path: Path) -> Settings:
    """Load the shipped preset that the file at ``path`` includes."""
    if name.endswith(".toml") and name.removesuffix(".toml") not in preset_names():
        includes_itself = os.path.abspath(path.parent / name) == os.path.abspath(path)
        raise IcyMoonError(
            f"{path}: preset.include names "
            + (
                "this file itself; leave it out."
                if includes_itself
                else f"the file {quote(name)}, and only shipped presets can be included; leave it out, and give "
                "both files with --settings."
            )
        )
    try:
        return load_preset(name)
    except IcyMoonError as error:
        raise IcyMoonError(f"{path}: preset.include: {error}") from None


def _check_header(header: object, path: Path) -> list[str]:
    """Check the ``[preset]`` table of a file, and return the names of the presets that it includes."""
    if not isinstance(header, Mapping):
        raise IcyMoonError(f"{path}: [preset] must be a table, not {quote(header)}.")
    unknown = sorted(set(header) - set(_HEADER_KEYS))
    if unknown:
        raise IcyMoonError(
            f"{path}: unknown key preset.{unknown[0]}, {suggest_nearest(unknown[0], _HEADER_KEYS, MIN_SIMILARITY)}"
        )
    included = header.get("include", [])
    if not isinstance(included, list) or not all(isinstance(name, str) for name in included):
        raise IcyMoonError(f"{path}: preset.include must be a list of names in quotes, not {quote(included)}.")
    return included


def make_paths_relative_to(folder: Path, settings: Settings) -> Settings:
    """Resolve the relative paths of files in the settings against ``folder``, in place. Returns the settings."""
    for topic, values in settings.items():
        for key, value in values.items():
            if TOPICS[topic][key].subtype == "FILE_PATH" and value and not value.startswith(("~", "//")):
                values[key] = str(folder.absolute() / value)
    return settings


def preset_names(kind: str = "") -> list[str]:
    """List the names of the shipped presets, all or of one kind, such as ``scenes/europa_rough_ice``."""
    return sorted(
        p.relative_to(PRESETS_FOLDER).with_suffix("").as_posix()
        for p in (PRESETS_FOLDER / kind).rglob("*.toml")
        if p.parent not in (PLANS_FOLDER, HEADS, LIDARS)
    )


def is_whole_scene(name: str) -> bool:
    """Return whether a preset such as ``scenes/europa_rough_ice`` describes a whole scene."""
    return name.split("/")[0] in WHOLE_SCENE_KINDS


def plan_names() -> list[str]:
    """List the names of the shipped plans, such as ``datasets/guiss_rocks``."""
    return sorted(p.relative_to(PRESETS_FOLDER).with_suffix("").as_posix() for p in PLANS_FOLDER.glob("*.toml"))


def lidar_names() -> list[str]:
    """List the names of the shipped laser scanners, such as ``ouster_os1``."""
    return sorted(path.stem for path in LIDARS.glob("*.toml"))


def find_preset(name: str) -> Path:
    """Find the file of a shipped preset, ``kind/name``, or only the name of a scene preset.

    Raises IcyMoonError if the preset does not exist.
    """
    for candidate in (PRESETS_FOLDER / f"{name}.toml", PRESETS_FOLDER / "scenes" / f"{name}.toml"):
        if ".." not in name and is_file(candidate):
            return candidate
    raise IcyMoonError(
        f"Unknown preset {quote(name)}, "
        + suggest_nearest(shorten(name), preset_names(), MIN_SIMILARITY, "none of those that icymoon presets lists.")
    )


def find_preview(name: str) -> Path:
    """Find the picture of a shipped preset, or with 'choose' one picture of all scenes. The file may be missing.

    The picture of a preset that describes only a part of a scene is in a folder of its kind.
    """
    kind, _, stem = name.rpartition("/")
    return PRESETS_FOLDER / "previews" / ("" if not kind or is_whole_scene(name) else kind) / f"{stem}.jpg"


def read_preset_header(name: str) -> tuple[str, str]:
    """Read (title, description) of a shipped preset."""
    return read_header(find_preset(name), name)


def read_header(path: Path, name: str) -> tuple[str, str]:
    """Read (title, description) of a preset file, with ``name`` as default title. Raises IcyMoonError as ``read_toml``
    does."""
    header = read_toml(path).get("preset", {})
    if not isinstance(header, Mapping):
        return name, ""
    return str(header.get("title", name)), str(header.get("description", ""))


def make_preset_text(title: str, description: str, settings: Settings, sources: Mapping[str, str]) -> str:
    """Write the text of a preset file for ``load``, with the version that writes it and its sources by
    ``topic.key``."""
    header = {"title": title, "description": description, "made_with": version()}
    lines = ["[preset]", *(f"{key} = {to_toml_value(value)}" for key, value in header.items()), ""]
    source_lines = [f"{to_toml_value(name)} = {to_toml_value(source)}" for name, source in sources.items()]
    return "\n".join(lines) + "\n" + to_toml(settings) + "\n".join(["[sources]", *source_lines, ""])
