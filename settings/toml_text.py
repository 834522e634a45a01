"""Writes settings as TOML text, and reads the raw content of TOML files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..plugins.landforms import PREFIX, RELEASE
from ..support.errors import IcyMoonError
from ..support.files import read_text
from ..support.foreign_bytes import describe_reason, make_path_hint, parse_toml
from .topics.declaration import Value


def read_toml_and_text(path: Path) -> tuple[dict[str, Any], str]:
    """Read the raw content of a TOML file, and its text. Raises IcyMoonError if it cannot be read or parsed."""
    try:
        text = read_text(path)
        return parse_toml(text), text
    except OSError as error:
        raise IcyMoonError(f"{path}: cannot be read ({describe_reason(error)}).") from None
    except ValueError as error:  # no TOML, or no UTF-8
        raise IcyMoonError(f"{path}: is not valid TOML ({error}){make_path_hint(error)}.") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Read the raw content of a TOML file. Raises IcyMoonError if it cannot be read or parsed."""
    return read_toml_and_text(path)[0]


def to_toml(settings: Mapping[str, Mapping[str, Value]]) -> str:
    """Write a description as TOML text that ``load`` reads back to the same values.

    A plug-in's landform that is off is left out, so that the text can be read without the plug-in.
    """
    lines = []
    for topic, values in settings.items():
        if topic.startswith(PREFIX) and values.get(RELEASE) == "":
            continue
        lines.append(f"[{topic}]")
        # The lists of tables come last, because all lines after a [[table]] header belong to that table.
        lines += [
            f"{key} = {to_toml_value(value)}"
            for key, value in values.items()
            if not isinstance(value, list) or not value
        ]
        for key, value in values.items():
            for entry in value if isinstance(value, list) else ():
                lines += ["", f"[[{topic}.{key}]]", *(f"{k} = {to_toml_value(v)}" for k, v in entry.items())]
        lines.append("")
    return "\n".join(lines)


def to_toml_value(value: object) -> str:
    # JSON writes numbers, booleans and texts as TOML does, except for one control character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
