"""Run ``python -m icymoon.stereo …``; where the package is not installed, ``python …/__main__.py stereo …``."""

from __future__ import annotations

import sys

from ..support.printer import open_streams
from .cli import main

if __name__ == "__main__":
    open_streams()
    sys.exit(main())
