"""The manual as the tests read it: its pages, those that are generated included, their headings, links and code."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from icymoon.support.version import ROOT

sys.path.insert(0, str(ROOT / "docs" / "make"))
import reference as reference

#: Pages beside those in ``docs/``.
TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")
_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
#: A word that is not part of an address, an option or a pattern.
_NAME = re.compile(r"(?<![\w./<>*{}~:$%\\-])\.?\w[\w.-]*(?:/[\w.-]+)*/?(?![\w*<>{}/%…-])")
_ENDS = (
    ".bin",
    ".blend",
    ".cff",
    ".cfg",
    ".css",
    ".csv",
    ".exr",
    ".glb",
    ".html",
    ".jpg",
    ".js",
    ".json",
    ".jsonl",
    ".lock",
    ".md",
    ".npy",
    ".npz",
    ".obj",
    ".parquet",
    ".pfm",
    ".ply",
    ".png",
    ".ps1",
    ".py",
    ".sh",
    ".svg",
    ".tar",
    ".tif",
    ".toml",
    ".tsv",
    ".txt",
    ".usd",
    ".whl",
    ".xml",
    ".yaml",
    ".yml",
    ".zip",
)
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
    """Text of the pages that are written by hand, by their path in the repository."""
    paths = [*(ROOT / name for name in TOP), *sorted((ROOT / "docs").rglob("*.md"))]
    names = [name for path in paths if (name := path.relative_to(ROOT).as_posix()) not in generated()]
    return {name: (ROOT / name).read_text(encoding="utf-8") for name in names}


@cache
def generated() -> dict[str, str]:
    """Text of the pages as the code gives them now, by the path at which the repository keeps them."""
    return {f"docs/{path}": text for path, text in reference.pages().items()}


@cache
def pages() -> dict[str, str]:
    """All of them."""
    return written() | generated()


@cache
def files() -> frozenset[str]:
    """The files of a clone: those that git has or would take, or all that are there if this is no clone."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    names = (
        listed.stdout.decode().split("\0")
        if not listed.returncode
        else [path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*")]
    )
    return frozenset(name for name in names if (ROOT / name).is_file())


def named_files(text: str) -> set[str]:
    """Names of files and folders between backticks: with an ending that files have, or a slash. No placeholders."""
    spans = re.findall(r"`([^`\n]+)`", prose(text))
    return {
        name
        for span in spans
        for name in _NAME.findall(span)
        if (name.endswith(_ENDS) or "/" in name) and not re.search(r"(^|/)[A-Z]+(/|\.|$)", name)
    }


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
