"""``python -m icymoon.stereo …``; where the package has no name, ``python …/__main__.py stereo …`` at its root."""

from __future__ import annotations

import sys

from ..system import write_utf8
from .cli import main

if __name__ == "__main__":
    write_utf8()
    sys.exit(main())
