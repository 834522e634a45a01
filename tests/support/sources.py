"""The source files of the package, read and parsed once."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import icymoon

ROOT = Path(icymoon.__file__).parent
#: Folders of the checkout that are no part of the package.
APART = ("tests", "benchmarks", "docs", "build", "dist", "out")
SOURCES = sorted(path for path in ROOT.rglob("*.py") if not path.relative_to(ROOT).parts[0].startswith((".", *APART)))
IDS = [path.relative_to(ROOT).as_posix() for path in SOURCES]


@cache
def tree_of(path: Path) -> ast.Module:
    """The parsed source of a file, read once."""
    return ast.parse(path.read_text(encoding="utf-8"))
