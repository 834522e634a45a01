"""``python -m icymoon.stereo …``; where the package is not installed, ``python …/__main__.py stereo …``."""

from __future__ import annotations

import sys

from ..system import set_utf8_output
from .cli import main

if __name__ == "__main__":
    set_utf8_output()
    sys.exit(main())
