"""Writes the types of the settings, ``typed_settings.py``, and of changes of them, ``settings/overrides.py``, from the
table of settings.

    python -m icymoon.settings.make_types
"""

from __future__ import annotations

from pathlib import Path

from ..files import read_text, write_text
from .table import OUR_TOPICS, Setting, Topic

PATH = Path(__file__).resolve().parents[1] / "typed_settings.py"
OVERRIDES = Path(__file__).resolve().parent / "overrides.py"
MARK = "# MADE FROM HERE ON\n"
_WIDTH = 120


def class_name(topic: str) -> str:
    """The class of a topic, such as ``RockSurfaceSettings``. Names without the suffix are classes of physics."""
    return f"{_camel_case(topic)}Settings"


def entry_name(topic: str, key: str) -> str:
    """The class of an entry of a list, such as ``TerrainLayer`` of ``terrain.layers``."""
    return f"{_camel_case(topic)}{_camel_case(key).removesuffix('s')}"


def _camel_case(key: str) -> str:
    return "".join(word.capitalize() for word in key.split("_"))


def made() -> str:
    """The text of the file below the mark."""
    classes = []
    for topic in OUR_TOPICS.values():
        classes += [_class(entry_name(topic.key, s.key), topic.key, f"An entry of ``{topic.key}.{s.key}``.", s.entries)
                    for s in topic.settings if s.entries]
        classes.append(_topic(topic))
    lists = {topic.key: {s.key: entry_name(topic.key, s.key) for s in topic.settings if s.entries}
             for topic in OUR_TOPICS.values()}
    tables = [f"    {_quoted(key)}: {class_name(key)},\n" for key in OUR_TOPICS]
    entries = [f"    {_quoted(topic)}: {{{', '.join(f'{_quoted(key)}: {name}' for key, name in named.items())}}},\n"
               for topic, named in lists.items() if named]
    return "".join([
        *(f"\n\n{text}" for text in classes), "\n\nclass Settings(Table):\n",
        '    """All settings of a scene."""\n\n    __slots__ = ()\n',
        *(f"    {key}: {class_name(key)}\n" for key in OUR_TOPICS),
        "\n\nTABLES: dict[str, type[Table]] = {\n", *tables,
        "}\nENTRIES: dict[str, dict[str, type[Table]]] = {\n", *entries, "}\n"])


def _topic(topic: Topic) -> str:
    """The class of a topic, derived from the class of an earlier topic if that has the same settings."""
    for other in OUR_TOPICS.values():
        if other is topic:
            break
        if other.settings is topic.settings:
            return _class(class_name(topic.key), topic.key, f"{topic.description}.", (), class_name(other.key))
    return _class(class_name(topic.key), topic.key, f"{topic.description}.", topic.settings)


def _class(name: str, topic: str, doc: str, settings: tuple[Setting, ...], base: str = "Table") -> str:
    return "".join([f"class {name}({base}):\n", f'    """{doc}"""\n\n', "    __slots__ = ()\n",
                    *(_attribute(topic, s) for s in settings)])


def _attribute(topic: str, setting: Setting) -> str:
    """The declaration of a setting, with its unit as a comment."""
    if setting.kind == "choice":
        return _choice(setting)
    kind = "str" if setting.kind == "text" else setting.kind
    if setting.kind == "list":
        kind = f"list[{entry_name(topic, setting.key)}]"
    unit = f"  # {setting.unit}" if setting.unit not in ("", "1") else ""
    return f"    {setting.key}: {kind}{unit}\n"


def _choice(setting: Setting) -> str:
    names = [_quoted(choice[0]) for choice in setting.choices]
    line = f"    {setting.key}: Literal[{', '.join(names)}]\n"
    if len(line) <= _WIDTH:
        return line
    return f"    {setting.key}: Literal[\n" + "".join(f"        {name},\n" for name in names) + "    ]\n"


def _quoted(text: str) -> str:
    return f'"{text}"'


def override_name(topic: str) -> str:
    """The class of changes of a topic, such as ``RockSurfaceOverrides``."""
    return f"{_camel_case(topic)}Overrides"


def made_overrides() -> str:
    """The text of ``settings/overrides.py`` below the mark."""
    classes = []
    for topic in OUR_TOPICS.values():
        parts = {f"{entry_name(topic.key, s.key)}Overrides": s.entries for s in topic.settings if s.entries}
        for name, settings in {**parts, override_name(topic.key): topic.settings}.items():
            lines = (_attribute(topic.key, s) if s.kind != "list" else
                     f"    {s.key}: list[{entry_name(topic.key, s.key)}Overrides]\n" for s in settings)
            classes.append(f'class {name}(TypedDict, total=False):\n    """Changes of ``{topic.key}``."""\n\n'
                           + "".join(lines))
    return "".join([*(f"\n\n{text}" for text in classes), "\n\nclass Overrides(TypedDict, total=False):\n",
                    '    """Changes of some settings of a scene, by topic."""\n\n',
                    *(f"    {key}: {override_name(key)}\n" for key in OUR_TOPICS)])


def complete(text: str, below: str) -> str:
    """The text of a file, with the types of the present table, ``made`` or ``made_overrides``, below the mark."""
    return text[:text.index(MARK) + len(MARK)] + below


if __name__ == "__main__":
    write_text(PATH, complete(read_text(PATH), made()))
    write_text(OVERRIDES, complete(read_text(OVERRIDES), made_overrides()))
