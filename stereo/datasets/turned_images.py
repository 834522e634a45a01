"""Images that viewers show turned, by the orientation in their EXIF data.

Icy Moon uses the pixels as stored. But a truth and a calibration may be for the turned image, because many programs
turn images when they read them. So the truth must confirm the images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ...support.errors import IcyMoonError
from ..images.exif import UPRIGHT
from .data_files import read_orientation


def find_turned(images: Sequence[Path]) -> dict[Path, int]:
    """The images that viewers turn, with their EXIF orientations, 2 to 8."""
    stated = {path: read_orientation(path) for path in images if path.suffix != ".pfm"}
    return {path: orientation for path, orientation in stated.items() if orientation != UPRIGHT}


def refuse_turned(turned: Mapping[Path, int]) -> None:
    """Raise IcyMoonError with the fix if some images are ``turned``, see ``find_turned``."""
    for path, orientation in turned.items():
        raise IcyMoonError(
            f"{path} states the EXIF orientation {orientation}, by which viewers turn it, and the truth "
            "does not confirm its pixels as they are stored; save it turned, as mogrify -auto-orient "
            "does, or without the tag, whichever the truth is for."
        )
