"""A built scene in a .blend file. A separate Blender builds it, and the window uses it without building.

A build takes seconds of one processor, most of them for the ground's mesh and for rocks at rest on it. Reading the
stored build takes 0.1 s, most of it in the call by which Blender reads the file. The edges of the ground are in a file
beside it, see ``ground.mesh_edges``.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..support.errors import IcyMoonError
from ..support.file_schemas import TEXT, Each
from ..support.steps import Steps, finish
from .built_scene import (
    CONTENT,
    EXCAVATION,
    FINGERPRINT,
    GROUND,
    SITE,
    STATISTICS,
    Built,
)
from .datablocks.fingerprint import TAG
from .datablocks.stored_json import read_stored
from .ground.mesh_edges import give_edges, read_edges, take_edges, write_edges
from .keep_references import find_owned_blocks
from .scene_objects import MadeObjects
from .surface.images import reuse_images

#: Property of the stored collection: the warnings of the build.
_WARNINGS = "icymoon_warnings"
#: Facts that a build finds out about its ground and records.
_RECORDED = (GROUND, SITE, CONTENT, EXCAVATION, STATISTICS, FINGERPRINT)


def write_build(built: Built, path: Path) -> None:
    """Write a scene that was just built, including its world, to a .blend file and a file beside it. The scene cannot
    be used afterwards, since its ground loses its edges."""
    built.collection[_WARNINGS] = json.dumps(built.warnings)
    write_edges(take_edges(built.terrain), _find_edges_file(path))
    bpy.data.libraries.write(str(path), {built.collection, built.scene.world})


def _find_edges_file(path: Path) -> Path:
    """Find the file of the ground's edges beside a .blend file."""
    return path.with_suffix(".edges.npz")


def read_build(path: Path) -> MadeObjects:
    """Read a stored build at once, see ``read_build_in_steps``."""
    return finish(read_build_in_steps(path))


def read_build_in_steps(path: Path) -> Steps[MadeObjects]:
    """Read in steps the objects of a stored build, in no collection yet, and the facts that the build has recorded.
    Nothing that was read remains if the steps end early. Raises IcyMoonError if a file is gone or damaged, or if a part
    is removed meanwhile.
    """
    edges_file = _find_edges_file(path)
    with _name_unreadable(edges_file):
        edges = yield partial(read_edges, edges_file)
    with _name_unreadable(path):
        made = _read_objects(path)
    made.keep_unused_sky(True)  # the live preview removes worlds without users
    try:
        yield None
        yield from give_edges(made.objects[0].data, edges)
    except ReferenceError:
        made.remove()
        raise IcyMoonError("Parts of the new scene were removed while it was read; press Build Scene again.") from None
    except BaseException:
        made.remove()
        raise
    made.keep_unused_sky(False)
    return made


@contextmanager
def _name_unreadable(path: Path) -> Iterator[None]:
    """Raise IcyMoonError for a file that cannot be read."""
    try:
        yield
    except (OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
        raise IcyMoonError(
            f"{path}: the scene that another Blender has built cannot be read ({' '.join(str(error).split())}); build "
            "it again, and if that fails too, free space in this folder."
        ) from None


def _read_objects(path: Path) -> MadeObjects:
    """Read the objects of a stored build, the ground first and without its edges."""
    before = set(bpy.data.libraries)
    with bpy.data.libraries.load(str(path), link=False) as (stored, wanted):
        wanted.collections, wanted.worlds = list(stored.collections), list(stored.worlds)
    for library in [library for library in bpy.data.libraries if library not in before]:
        bpy.data.libraries.remove(library)  # everything in it was copied, and the file will be deleted
    reuse_images()
    collections: list[bpy.types.Collection] = wanted.collections
    collection = next(each for each in collections if each.get(TAG) == "scene")
    objects = [item for item in find_owned_blocks(collection).values() if isinstance(item, bpy.types.Object)]
    warnings: list[str] = read_stored(collection, _WARNINGS, Each(TEXT), "[]")
    record: dict[str, Any] = {key: collection[key] for key in _RECORDED}
    made = MadeObjects(objects, wanted.worlds[0], None, float(collection[SITE]), warnings, record=record)
    for each in (collection, *(child for child in collection.children_recursive if TAG in child)):
        bpy.data.collections.remove(each)
    return made
