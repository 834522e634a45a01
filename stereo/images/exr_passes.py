"""Removing passes from an EXR file before it is decoded, since decoding takes most of the time of reading.

Blender 5 writes a part for each pass. In a file of Blender 4 the passes of a layer share a part, so only whole layers
can be removed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from ...formats.exr_parts import assemble, keep_rows, read_pieces, strip_passing


def only_passes(data: bytes, passes: Collection[str]) -> bytes:
    """The EXR file ``data`` with only those parts that contain ``passes`` (``LAYER.PASS``); with all if none does.

    Raises ValueError, KeyError or OverBudgetError if it is no EXR file of scan lines.
    """
    # A part has the name of its pass, in some versions with "-VIEW" at the end, or of its layer.
    layers = {name.split(".")[0] for name in passes}
    return _only_parts(data, lambda name: name.split("-")[0] in passes or name in layers)


def without_passes(data: bytes, passes: Collection[str]) -> bytes:
    """The EXR file ``data`` without the parts that contain one of ``passes`` (``LAYER.PASS``) and nothing else.

    Raises as ``only_passes`` does.
    """
    return _only_parts(data, lambda name: name.split("-")[0] not in passes)


def _only_parts(data: bytes, is_wanted: Callable[[str], bool]) -> bytes:
    parts = read_pieces(data)
    wanted = [part for part in parts if is_wanted(part.name)]
    return data if len(wanted) in (0, len(parts)) else assemble(wanted)


def only_rows(data: bytes, rows: range) -> tuple[bytes, int]:
    """The EXR file ``data`` with only those chunks that contain some of ``rows``, and how many rows come before them.

    Raises as ``only_passes`` does, and ValueError for a file of parts that are not cut alike, or without these rows.
    """
    cut = [keep_rows(part, rows) for part in read_pieces(data)]
    if len({before for _, before in cut}) != 1:
        raise ValueError("its parts are compressed in unequal chunks")
    return assemble([strip_passing(part, part.name or "image") for part, _ in cut]), cut[0][1]
