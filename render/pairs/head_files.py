"""The files of the cameras beside a pair, in the pair's folder. Imports no Blender."""

from __future__ import annotations

#: Pattern of the files' names. Names of cameras have no full stop.
PATTERN = r"camera_[A-Za-z0-9_-]{1,40}(\.truth)?\.exr"


def image_file(name: str) -> str:
    """Return the name of the file with the image of a camera. It also has the truth, unless the truth has a separate
    file."""
    return f"camera_{name}.exr"


def truth_file(name: str) -> str:
    """Return the name of the file with the truth of a camera whose image was rendered with another projection, on other
    pixels."""
    return f"camera_{name}.truth.exr"
