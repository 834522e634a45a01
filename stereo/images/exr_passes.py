"""Leaving out of an EXR file what is not needed before it is decoded, which is what reading costs.

Blender 5 writes a part for each pass. Of a file of Blender 4, where the passes of a layer share a part and its
chunks, whole layers are left out.
"""

from __future__ import annotations

from collections.abc import Collection

from ...formats.exr_parts import assemble, read_pieces


def only_passes(data: bytes, passes: Collection[str]) -> bytes:
    """The EXR file ``data`` with those parts only that hold ``passes`` (``LAYER.PASS``), all if none does.

    Raises ValueError, IndexError, KeyError or struct.error for what is no EXR file.
    """
    parts = read_pieces(data)
    # A part is called after its pass, in some versions with "-VIEW" at the end, or after its layer.
    layers = {name.split(".")[0] for name in passes}
    wanted = [part for part in parts if part.name.split("-")[0] in passes or part.name in layers]
    return data if len(wanted) in (0, len(parts)) else assemble(wanted)
