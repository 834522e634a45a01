"""Studies: measurements behind the numbers of the manual. ``python benchmarks`` lists them, each in one sentence.

A study is a module in one of the folders. Its docstring tells what it measures and how it is called, ``add_arguments``
declares its options, if it has any, and ``main`` takes them and prints. Code that several studies share is in
``common``.
"""

import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
#: Synthetic pairs, independent rays and the way to drive a window come from the tests.
for _name in ("support", "gui"):
    sys.path.append(str(FOLDER.parent / "tests" / _name))
