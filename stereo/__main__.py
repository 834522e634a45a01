"""Run the evaluator: ``python -m icymoon.stereo …``, or ``python …/__main__.py stereo …`` without an installed
package.
"""

from __future__ import annotations

import sys

from ..support.printer import open_streams
from .cli import main

if __name__ == "__main__":
    open_streams()
    sys.exit(main())
