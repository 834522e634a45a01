"""Which engine traces rays in this process."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from .embree import EmbreeTracer, Library, load_library
from .shapes import World
from .surface import Tracer


@lru_cache
def _library(folders: tuple[Path, ...]) -> Library | None:
    return load_library(folders)


def can_trace(folders: Sequence[Path] = ()) -> bool:
    """Whether rays can be traced here: there is Embree in one of ``folders``, in embreex or in the system."""
    return _library(tuple(folders)) is not None


def open_tracer(world: World, folders: Sequence[Path] = ()) -> Tracer:
    """A tracer of a world. Raises RuntimeError without an engine, MemoryError if trees need more memory than there is.
    """
    library = _library(tuple(folders))
    if library is None:
        raise RuntimeError("there is no Embree")
    return EmbreeTracer(library, world)
