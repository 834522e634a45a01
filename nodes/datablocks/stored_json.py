"""JSON in custom properties of a .blend file. Icy Moon writes it, but anyone may have changed or made it."""

from __future__ import annotations

from typing import Any

import bpy

from ...support.errors import IcyMoonError
from ...support.file_schemas import Shape, check_record
from ...support.foreign_bytes import MAX_TEXT_BYTES, parse_json

_BUILD_AGAIN = "press Build Scene to build it again"


def read_stored(owner: bpy.types.ID, key: str, shape: Shape, absent: str = "{}") -> Any:
    """Read the content of the property ``key`` of a data-block; ``absent`` replaces a missing text.

    Raises IcyMoonError if the content does not have the ``shape``.
    """
    return parse_stored(owner.get(key, absent), f"{owner.name}: the property {key}", shape)


def parse_stored(text: object, where: str, shape: Shape) -> Any:
    """Parse a JSON text of this shape; ``where`` names it in errors. Raises IcyMoonError for any other text."""
    try:
        if not isinstance(text, str) or len(text) > MAX_TEXT_BYTES:
            raise ValueError("it is not a text, or too long")
        data = parse_json(text)
    except ValueError as error:
        raise IcyMoonError(f"{where} is damaged ({error}); {_BUILD_AGAIN}.") from None
    return check_record(data, shape, where, _BUILD_AGAIN)
