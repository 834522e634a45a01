"""Remove passes from an EXR file before it is decoded, because decoding takes most of the time of reading.

Blender 5 writes a part for each pass. In a file of Blender 4 the passes of a layer share a part, so only whole layers
can be removed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

from ...formats.exr_parts import Piece, assemble, keep_part_attributes, keep_rows, read_pieces
from ...support.labels import GROUP_PASSES, IMAGE_PASS


def keep_passes(data: bytes, passes: Collection[str]) -> bytes:
    """Return the EXR file ``data`` with only the parts that contain ``passes`` (``LAYER.PASS``), or with all parts if
    no part does.

    If no image is stored, the light groups count as the image. Raises ValueError, KeyError or OverBudgetError if it is
    no EXR file of scan lines.
    """
    parts = read_pieces(data)
    wanted = {*passes, *(GROUP_PASSES if IMAGE_PASS in passes and not _has_image(parts) else ())}
    layers = {name.split(".")[0] for name in passes}
    return _keep_parts(data, parts, lambda name: _get_pass_name(name) in wanted or name in layers)


def remove_passes(data: bytes, passes: Collection[str]) -> bytes:
    """Return the EXR file ``data`` without the parts that contain only ``passes`` (``LAYER.PASS``).

    The light groups stay if the image is not stored. Raises as ``keep_passes`` does.
    """
    parts = read_pieces(data)
    unwanted = set(passes) - set(() if _has_image(parts) else GROUP_PASSES)
    return _keep_parts(data, parts, lambda name: _get_pass_name(name) not in unwanted)


def _get_pass_name(name: str) -> str:
    """Return the name of the pass or layer from a part's name. Some versions of Blender append "-VIEW" to the part's
    name.
    """
    return name.split("-")[0]


def _has_image(parts: Sequence[Piece]) -> bool:
    return any(_get_pass_name(part.name) == IMAGE_PASS for part in parts)


def _keep_parts(data: bytes, parts: Sequence[Piece], is_wanted: Callable[[str], bool]) -> bytes:
    wanted = [part for part in parts if is_wanted(part.name)]
    return data if len(wanted) in (0, len(parts)) else assemble(wanted)


def keep_row_chunks(data: bytes, rows: range) -> tuple[bytes, int]:
    """Return the EXR file ``data`` with only the chunks that contain some of ``rows``, and the number of rows before
    the first chunk.

    Raises as ``keep_passes`` does, and ValueError for parts with different chunks, or without these rows.
    """
    cut = [keep_rows(part, rows) for part in read_pieces(data)]
    if len({before for _, before in cut}) != 1:
        raise ValueError("its parts are compressed in unequal chunks")
    return assemble([keep_part_attributes(part, part.name or "image") for part, _ in cut]), cut[0][1]
