"""The ground of scenes and pairs as files for other programs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..render.pairs.pair_folder import read_pair
from ..render.plans.planned_pair import expand_headings
from ..settings import user_files
from ..stereo.export import ground
from ..support.errors import IcyMoonError
from ..support.suggestions import suggest_nearest
from ..support.temporary_folders import open_scratch_folder
from .rendered_pair import RenderedPair, open_pairs
from .renderers import find_blender_program
from .scene import Scene


def export_ground(
    of: Scene | RenderedPair | str | Path | Iterable[RenderedPair],
    out: str | Path,
    kind: str = "dem",
    *,
    cell_m: float | None = None,
    blender: str | Path | None = None,
) -> list[Path]:
    """Write the ground of a scene, a pair, pairs or a data set, and return the written folders in ``out``.

    ``kind`` is ``dem`` (GeoTIFF in cells of ``cell_m``: height of the ground, height of ground and rocks, both in
    metres, and albedo), ``ply``, ``obj``, ``usd`` or ``gltf`` (meshes). All are in metres in the site's frame: x east,
    y north, z up; glTF has y up. ``geometry.json`` beside them contains frame, units, and the parts of the render that
    the files lack. ``blender`` builds the ground, by default this one. Raises IcyMoonError for an unsupported format,
    for cells that are too small, and for pairs that were edited by hand.
    """
    if kind not in ground.FORMATS:
        raise IcyMoonError(f"There is no format {kind!r} of ground, {suggest_nearest(kind, ground.FORMATS)}")
    program, folder = str(blender or find_blender_program()), Path(out).absolute()
    if isinstance(of, Scene):
        with open_scratch_folder() as scratch:
            settings = of.stored(scratch)
            planned = expand_headings(settings, user_files.hash_content(settings))[:1]
            return ground.write_grounds(planned, folder, kind, program, cell_m)
    pairs = [of] if isinstance(of, RenderedPair) else open_pairs(of) if isinstance(of, str | Path) else of
    return ground.export_ground([read_pair(each.folder) for each in pairs], folder, kind, program, cell_m)
