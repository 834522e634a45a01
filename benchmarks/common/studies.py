"""The studies by name, their lines of help and their options."""

from __future__ import annotations

import argparse
import ast
from importlib import import_module
from pathlib import Path
from types import ModuleType

from icymoon.benchmarks import FOLDER
from icymoon.support.errors import IcyMoonError

COMMON = Path(__file__).parent.name


def find_studies() -> dict[str, Path]:
    """The file of each study by its name, sorted by folder."""
    return {path.stem: path for path in sorted(FOLDER.glob("*/*.py")) if _is_study(path)}


def _is_study(path: Path) -> bool:
    return path.parent.name != COMMON and "\ndef main(" in path.read_text(encoding="utf-8")


def sentence(path: Path) -> str:
    """The first paragraph of a study's docstring, on one line; reads the file without importing it."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(docstring.split("\n\n")[0].split())


def list_studies() -> str:
    """The studies, folder by folder, with a sentence each."""
    lines = ["python benchmarks NAME --help tells more of a study, python benchmarks NAME runs it."]
    folder = ""
    for name, path in find_studies().items():
        if path.parent.name != folder:
            folder = path.parent.name
            lines += ["", folder]
        lines.append(f"  {name:20} {sentence(path)}")
    return "\n".join(lines)


def load(name: str) -> ModuleType:
    """The module of a study. SystemExit without a study of this name."""
    path = find_studies().get(name)
    if path is None:
        raise SystemExit(f"There is no study {name}; `python benchmarks` lists them.")
    return import_module(f"icymoon.{FOLDER.name}.{path.parent.name}.{name}")


def make_parser(name: str) -> argparse.ArgumentParser:
    """The parser of a study's options. SystemExit without a study of this name."""
    study = load(name)
    parser = argparse.ArgumentParser(
        prog=f"python benchmarks {name}",
        description=study.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    getattr(study, "add_arguments", lambda parser: None)(parser)
    return parser


def run(words: list[str]) -> int:
    """Run the study named by the first word, with the other words as its options; return the exit status. SystemExit
    with the sentence of an IcyMoonError."""
    if not words or words[0] in ("-h", "--help"):
        print(list_studies())
        return 0
    name, *options = words
    options_read = make_parser(name).parse_args(options)
    try:
        return int(load(name).main(options_read) or 0)
    except IcyMoonError as error:
        raise SystemExit(str(error)) from None
