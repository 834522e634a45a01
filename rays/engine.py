"""Chooses the engine that traces rays in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

from ..support.errors import IcyMoonError
from .embree import EmbreeTracer, Library, load_library
from .shapes import World
from .surface import Tracer


@lru_cache
def _load_library(folders: tuple[Path, ...]) -> Library | None:
    return load_library(folders)


def open_tracer(
    world: World, folders: Sequence[Path] = (), without_embree: Callable[[World], Tracer] | None = None
) -> Tracer:
    """Open a tracer of a world: Embree from one of ``folders``, from embreex or from the system; else the tracer that
    ``without_embree`` makes. Raises IcyMoonError if both are missing, MemoryError if trees need more memory than there
    is."""
    library = _load_library(tuple(folders))
    if library is not None:
        return EmbreeTracer(library, world)
    if without_embree is None:
        raise _lack_embree()
    return without_embree(world)


def require_embree(folders: Sequence[Path] = ()) -> None:
    """Raise IcyMoonError unless ``open_tracer`` finds Embree."""
    if _load_library(tuple(folders)) is None:
        raise _lack_embree()


def _lack_embree() -> IcyMoonError:
    return IcyMoonError(
        f"{sys.executable} cannot trace rays, because it lacks Embree; run {sys.executable} -m pip install embreex."
    )
