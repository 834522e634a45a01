"""The source files of the package, read and parsed once."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import icymoon

ROOT = Path(icymoon.__file__).parent
#: Folders of the checkout that are not part of the package.
APART = ("tests", "benchmarks", "docs", "build", "dist", "out")
SOURCES = sorted(path for path in ROOT.rglob("*.py") if not path.relative_to(ROOT).parts[0].startswith((".", *APART)))
IDS = [path.relative_to(ROOT).as_posix() for path in SOURCES]


@cache
def tree_of(path: Path) -> ast.Module:
    """The parsed source of a file, read once."""
    return ast.parse(path.read_text(encoding="utf-8"))


def check_each(paths: Iterable[Path]) -> Callable[[Callable[[Path], None]], Callable[[], None]]:
    """Make one test of a rule for files; its failure lists every file that breaks the rule.

    A test per file and rule would be thousands, and pytest takes longer for each than the rule does.
    """

    def decorate(rule: Callable[[Path], None]) -> Callable[[], None]:
        def test() -> None:
            broken = []
            for path in paths:
                try:
                    rule(path)
                except AssertionError as error:
                    broken.append(f"{path.relative_to(ROOT).as_posix()}: {error}")
            assert not broken, "\n".join(broken)

        test.__name__, test.__doc__, test.__module__ = rule.__name__, rule.__doc__, rule.__module__
        return test

    return decorate
