"""Options that several studies share, and their output folder."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


def add_scale(parser: argparse.ArgumentParser, default: float) -> None:
    """Declare ``--scale``, the size of the images as a share of the scene's."""
    parser.add_argument(
        "--scale", type=float, default=default, help="factor for the width and height of the image (%(default)s)"
    )


def add_out(parser: argparse.ArgumentParser) -> None:
    """Declare ``--out``, which ``open_out_folder`` reads."""
    parser.add_argument("--out", type=Path, help="folder that keeps the renders (default: a temporary one)")


@contextmanager
def open_out_folder(given: Path | None) -> Iterator[Path]:
    """The absolute folder of ``--out``, made if missing; by default a temporary folder."""
    if given is not None:
        given.mkdir(parents=True, exist_ok=True)
        yield given.absolute()
        return
    with scratch() as folder:
        yield folder


@contextmanager
def scratch() -> Iterator[Path]:
    """A temporary folder."""
    with tempfile.TemporaryDirectory(prefix="icymoon-benchmark-") as folder:
        yield Path(folder)


def is_asked(name: str, words: Iterable[str]) -> bool:
    """Whether a row's name contains one of the words, in any case; without words every row is requested."""
    words = list(words)
    return not words or any(word.lower() in name.lower() for word in words)
