"""The manual as the tests read it: its pages, those that are made included, their headings, links and code."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from icymoon.version import ROOT

sys.path.insert(0, str(ROOT / "docs" / "make"))
import reference

#: Pages beside those in ``docs/``.
TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
_INDENTED = re.compile(r"(?:\A|\n\n)((?: {4}.*\n)(?:(?: {4}.*)?\n)*)")


@dataclass(frozen=True)
class Block:
    """A piece of code in a page; its language is empty where the page is indented instead of fenced."""

    page: str
    line: int
    language: str
    code: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@cache
def written() -> dict[str, str]:
    """Text of the pages in the repository, by their path in it."""
    paths = [*(ROOT / name for name in TOP), *sorted((ROOT / "docs").rglob("*.md"))]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


@cache
def pages() -> dict[str, str]:
    """The same and the pages that are made."""
    return written() | {f"docs/{path}": text for path, text in reference.pages().items()}


def blocks() -> Iterator[Block]:
    """Every piece of code of the written pages."""
    for page, text in written().items():
        for found in _FENCE.finditer(text):
            code = "\n".join(line.removeprefix(found[1]) for line in found[3].splitlines())
            yield Block(page, text.count("\n", 0, found.start()) + 1, found[2], code)
        rest = _FENCE.sub("", text)
        for found in _INDENTED.finditer(rest):
            yield Block(page, rest.count("\n", 0, found.start()) + 1, "", re.sub(r"(?m)^ {4}", "", found[1]))


def prose(text: str) -> str:
    """A page without its code blocks."""
    return _FENCE.sub("", text)


def anchors(text: str) -> set[str]:
    """What a link to this page may name after #: its headings, as MkDocs and GitHub both name them, and its ids."""
    found = set(re.findall(r'<span id="([^"]+)"', text))
    for heading in re.findall(r"(?m)^#+ (.+)$", prose(text)):
        plain = re.sub(r"[`*]|\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        found.add(re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain)).strip("-"))
    return found


def links(text: str) -> list[str]:
    """Targets of the links and images of a page."""
    return re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", prose(text)))


def resolved(page: str, target: str) -> str:
    """Path in the repository of what a link on a page leads to."""
    return Path(*_parts(Path(page).parent / target)).as_posix() if target else page


def _parts(path: Path) -> list[str]:
    parts: list[str] = []
    for part in path.parts:
        if part == "..":
            parts.pop()
        else:
            parts.append(part)
    return parts
