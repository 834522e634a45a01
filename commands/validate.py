"""The verb ``validate``: Icy Moon beside measurements and other programs that no one here made."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ..terminal import as_path
from ..validation.all_comparisons import MODULES


def add_verbs(verbs: Any) -> None:
    """Add the verb to the command line's parser."""
    names = ", ".join(MODULES)
    verb = verbs.add_parser("validate", help="compare the surfaces and the renders with measurements and with other "
                            "programs, and print how far off they are")
    verb.add_argument("--only", action="append", default=[], metavar="NAME",
                      help=f"one comparison; may repeat ({names}; all)")
    verb.add_argument("--quick", action="store_true", help="only what takes a minute, with fewer cases")
    verb.add_argument("--own", action="append", default=[], type=as_path, metavar="FILE.py", dest="own_files",
                      help="Python file with a comparison of your own, which is run; may repeat")
    verb.add_argument("--polar", type=as_path, metavar="FOLDER", help="labels and scanned rocks of POLAR-Sim, a real "
                      "scene that is rendered again; see Validation in the manual")
    verb.add_argument("--out", type=as_path, default=Path("out/validation"), help="folder for renders, the tables "
                      "validation.json and validation.md, and pictures (%(default)s)")
    verb.add_argument("--page", type=as_path, metavar="FILE.md",
                      help="page whose sections of these comparisons are written anew")
    verb.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")
    verb.add_argument("--json", action="store_true", help="print the results as JSON")
    verb.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from .run_validation import run_validate  # whose comparisons every other verb would import too

    return run_validate(options)
