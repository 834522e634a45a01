"""What a user reads keeps to the words of the glossary in CONTRIBUTING, and introduces the paper that it is about."""

from __future__ import annotations

import ast
import re
import tokenize
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import manual
import pytest
from icymoon.settings.table import TOPICS
from icymoon.settings.toml_text import read_toml
from icymoon.support.version import ROOT
from sources import SOURCES, tree_of

#: A row of the glossary: its word, its meaning, the words that are not used for it.
_ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \|([^|]*)\|$", re.MULTILINE)
_PAPER = (
    "Ramchander Bhaskara et al.",
    "Icy Moon Surface Simulation and Stereo Depth Estimation for Sampling Autonomy",
    "IEEE Aerospace Conference 2024",
)


def glossary(text: str) -> dict[str, str]:
    """The word to use for each word that is not used."""
    _, _, table = text.partition("\n## Words\n")
    return {
        phrase.strip(): word.strip()
        for word, _, phrases in _ROW.findall(table)
        if word not in ("word", "---")
        for phrase in phrases.split(",")
        if phrase.strip()
    }


GLOSSARY = glossary((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
#: Not in a name: of a file, a setting, an option, a Python module.
_FOUND = re.compile(
    r"(?<![\w./:<{-])(" + "|".join(sorted(map(re.escape, GLOSSARY), key=len, reverse=True)) + r")(?!\w|[./:=_-]\w)",
    re.IGNORECASE,
)


def faults(text: str) -> list[str]:
    """Each use of a word that the glossary rules out, with the words around it and the word to use."""
    text = " ".join(text.split())
    return [
        f"'{text[max(found.start() - 30, 0) : found.end() + 30]}': use '{GLOSSARY[found[1].lower()]}'"
        for found in _FOUND.finditer(text)
        if not found[1].isupper()
    ]  # DATASET stands for a folder


def spoken(page: str) -> str:
    """The sentences of a page: no code, no targets of links, not the glossary's own list."""
    text = re.sub(r"`[^`\n]*`", "`", manual.prose(page))
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return _ROW.sub(r"\1. \2", text)


def _strings(tree: ast.AST) -> Iterator[tuple[str, str]]:
    """(kind, text) of each text of a source: 'docstring', or 'message' for any other and for Blender's tooltips."""
    docstrings: dict[int, str] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                tooltip = isinstance(node, ast.ClassDef) and re.match(r"[A-Z]+_(OT|PT|MT)_", node.name)
                docstrings[id(first.value)] = "message" if tooltip else "docstring"
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield (
                "message",
                "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values),
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield docstrings.get(id(node), "message"), node.value


def _sources() -> Iterator[Path]:
    folders = [path.parent for path in ROOT.glob("*/__init__.py") if path.parent.name != "tests"]
    yield from ROOT.glob("*.py")
    for folder in [*folders, ROOT / "benchmarks", ROOT / "docs" / "make"]:
        yield from folder.rglob("*.py")


def _texts() -> Iterator[tuple[str, str, str]]:
    for name, text in manual.written().items():
        yield "page", name, spoken(text)
    for name in ("CITATION.cff", "mkdocs.yml", "blender_manifest.toml"):
        yield "page", name, (ROOT / name).read_text(encoding="utf-8")
    for path in sorted((ROOT / "presets").rglob("*.toml")):
        raw, name = read_toml(path), path.relative_to(ROOT).as_posix()
        header = raw.get("preset", raw.get("plan", {}))
        comments = " ".join(re.findall(r"(?m)#(?= )(.*)$", path.read_text(encoding="utf-8")))
        yield "preset", name, "\n".join([header.get("description", ""), *raw.get("sources", {}).values(), comments])
    for topic in TOPICS.values():
        for setting in topic.settings:
            shown = [setting.label, setting.description, *(text for choice in setting.choices for text in choice[1:])]
            yield "message", f"settings/table.py {topic.key}.{setting.key}", "\n".join(shown)
    for path in _sources():
        name = path.relative_to(ROOT).as_posix()
        for kind, text in _strings(ast.parse(path.read_text(encoding="utf-8"))):
            if kind == "docstring":
                text = re.sub(r"``[^`]*``", "``", text)  # code is no sentence
            if " " in text.strip():  # a single word may be a key, a name, an option
                yield "benchmark" if name.startswith("benchmarks/") else kind, name, text


@cache
def found() -> list[tuple[str, str, str]]:
    """(kind, path, fault) of everything that a user reads."""
    return [(kind, name, fault) for kind, name, text in _texts() for fault in faults(text)]


@pytest.mark.parametrize("kind", ["page", "preset", "benchmark", "message", "docstring"])
def test_words_are_those_of_the_glossary(kind):
    bad = [f"{name}: {fault}" for each, name, fault in found() if each == kind]
    assert not bad, "\n".join(bad)


#: Turns that a reader reads twice: the thing is not named.
_ROUNDABOUT = re.compile(
    r"\b[Ww]hat (is|are|was|has|have|can|they|it|the)\b|\b(that|those) of\b|\b(is|are) none\b"
    r"|\bof its own\b|\bof (which|whom)\b|\bso (many|much|often)\b"
)
#: Some of them are the plainest English there is.
_MAX_ROUNDABOUT = 0.015


def _docstrings_and_comments() -> Iterator[tuple[str, str]]:
    """(place, text) of each docstring and comment of the package."""
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node)):
                yield f"{name}:{node.body[0].lineno}", text
        with path.open("rb") as file:
            yield from (
                (f"{name}:{token.start[0]}", token.string)
                for token in tokenize.tokenize(file.readline)
                if token.type == tokenize.COMMENT
            )


def test_docstrings_and_comments_name_the_thing():
    texts = list(_docstrings_and_comments())
    found = [
        f"{place}: …{text[max(turn.start() - 40, 0) : turn.end() + 40]}…"
        for place, text in texts
        if (turn := _ROUNDABOUT.search(text))
    ]
    assert len(texts) > 1000
    assert len(found) <= _MAX_ROUNDABOUT * len(texts), "\n".join(found)


@pytest.mark.parametrize("page", sorted(manual.written()))
def test_a_page_that_names_the_paper_gives_its_reference(page):
    text = " ".join(manual.written()[page].split())
    if "GUISS" in spoken(manual.written()[page]):
        assert all(part in text for part in _PAPER), f"{page} speaks of GUISS and does not give its full reference"


def test_the_glossary_has_the_words_of_the_field():
    words = {word.strip() for word, _, _ in _ROW.findall((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))}
    assert words >= {
        "user",
        "fix",
        "rock",
        "pair",
        "plan",
        "data set",
        "scene",
        "setting",
        "preset",
        "quality",
        "radiance",
        "response",
        "develop",
        "matcher",
        "method",
        "truth",
        "coverage",
        "ground",
        "terrain",
        "surface",
        "worker",
        "runner",
        "claim",
        "id",
    }
    assert not set(GLOSSARY) & words, "a word cannot be ruled out and explained"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("How to mend it.", 1),
        ("The person\nmends it", 2),
        ("an ice  block lies there", 1),
        ("A Dataset", 1),
        ("Fix the data set", 0),
        ("dataset.headings and datasets/guiss_all", 0),
        ("block matching", 0),
        ("recommended", 0),
        ("DATASET", 0),
    ],
)
def test_words_that_are_ruled_out_are_found(text, count):
    assert len(faults(text)) == count


def test_code_links_and_the_glossary_itself_are_no_sentences():
    assert not faults(spoken("`dataset` and [plans](datasets.md)\n\n```sh\nmend dataset\n```\n\n| fix | x | mend |\n"))
    assert faults(spoken("| mend | this | |"))


def test_messages_are_told_from_docstrings():
    tree = ast.parse('"""A."""\nclass ICYMOON_OT_x:\n    """B."""\ndef f(a):\n    """C."""\n    raise E(f"D {a} e")\n')
    assert sorted(_strings(tree)) == [
        ("docstring", "A."),
        ("docstring", "C."),
        ("message", "B."),
        ("message", "D {} e"),
    ]


def test_presets_have_sentences():
    raw = tomllib.loads((ROOT / "presets" / "bodies" / "europa.toml").read_text(encoding="utf-8"))
    texts = {name: text for kind, name, text in _texts() if kind == "preset"}
    assert all(source in texts["presets/bodies/europa.toml"] for source in raw["sources"].values())
