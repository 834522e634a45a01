"""Commands as a page shows them: cut into words as a shell would, and checked against the programs themselves."""

from __future__ import annotations

import argparse
import ast
import io
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from typing import Any

from icymoon.benchmarks import FOLDER
from icymoon.benchmarks.common import studies
from icymoon.commands import cli
from icymoon.settings import description, preset_files
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.trust_boundary import split_lidar
from icymoon.stereo import cli as stereo_cli
from icymoon.stereo.matchers import complete_options
from icymoon.stereo.matchers.lidar_options import LIDAR, complete_lidar_options
from icymoon.stereo.matchers.methods import parse_key_value, parse_named_methods, parse_own_matchers
from icymoon.support.version import ROOT
from manual import reference
from plugin_packages import examples

PYTHONS = ("python", "python3", ".venv/bin/python", "evaluator/bin/python", "networks/bin/python")
#: Programs of the shell that a page may show; what they do is not ours to check.
SHELL = ("sbatch", ".", "cd", "git")
OPERATORS = {operator.name.removeprefix("icymoon."): operator for operator in reference.operators()}
#: Tables of settings that are there once the example packages are installed; ``test_landform_releases`` tries them.
LANDFORMS_OF_EXAMPLES = {
    f"landform_{name}"
    for project in examples()
    for name in tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"].get(
        "icymoon.landforms", ()
    )
}
#: Program that needs no parser, and the parser of each that does.
PARSERS: dict[str, Callable[[], argparse.ArgumentParser]] = {
    "icymoon": cli.make_parser,
    "icymoon.stereo": stereo_cli.make_parser,
}


def words_of(code: str) -> Iterator[list[str]]:
    """The words of each command of a block: lines joined, comments and loops taken off, variables put in."""
    variables: dict[str, str] = {}
    line = ""
    for piece in code.splitlines():
        line += piece + "\n"
        if piece.endswith("\\"):
            line = line[:-2] + " "
            continue
        try:
            words = shlex.split(line, comments=True)
        except ValueError:
            continue  # a quotation goes on in the next line
        line = ""
        if words[:1] == ["for"]:
            variables[words[1]] = words[3].rstrip(";")
        elif words and words[0] not in ("do", "done"):
            words = [re.sub(r"\$(\w+)", lambda found: variables[found[1]], word) for word in words]
            yield words[: words.index(">")] if ">" in words else words
    assert not line.strip(), f"an open quotation: {line}"


def as_sh(code: str) -> str:
    """A block for PowerShell as sh writes it."""
    code = re.sub(r'foreach \(\$(\w+) in "?([\d.]+?)"?(?:\.\.|,).*\) \{', r"for \1 in \2 …; do", code)
    code = re.sub(r"(?m)^py(?: -[\d.]+)? ", "python3 ", code).replace("\n}", "\ndone").replace("`\n", "\\\n")
    code = re.sub(r"(\.venv|evaluator|networks)\\Scripts\\(python)\.exe", r"\1/bin/\2", code)
    return code.replace("; python", "\npython").replace(".venv\\Scripts\\Activate.ps1", ". .venv/bin/activate")


def fault(words: list[str]) -> str:
    """What is wrong with a command; empty if nothing is."""
    try:
        return _fault(words)
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def _fault(words: list[str]) -> str:
    program, rest = words[0], words[1:]
    if program in PYTHONS:
        if rest[0] == "__main__.py":
            rest = ["-m", "icymoon", *rest[1:]]
        if rest[0] == FOLDER.name:
            return study_fault(rest[1:])
        if rest[0] != "-m":
            return "" if (ROOT / rest[0]).is_file() else f"there is no {rest[0]}"
        program, rest = rest[1], rest[2:]
    if program == "icymoon" and rest[:1] == ["stereo"]:
        program, rest = "icymoon.stereo", rest[1:]
    if program in PARSERS:
        return _parsed(program, rest)
    if program == "make":
        targets = re.findall(r"(?m)^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"))
        return "".join(f"there is no target {word}" for word in rest if "=" not in word and word not in targets)
    if program == "blender":
        return python_fault(rest[rest.index("--python-expr") + 1]) if "--python-expr" in rest else ""
    if program == "pip":
        return _extras(rest)
    return "" if program in (*SHELL, "venv", "mkdocs") else f"{program} is no command that the manual may show"


def _extras(words: list[str]) -> str:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {
        extra
        for word in words
        for found in re.findall(r"(?:icymoon|\.)\[([\w,]+)\]", word)
        for extra in found.split(",")
    }
    return "".join(f"there is no extra {extra}" for extra in extras - set(project["optional-dependencies"]))


def _parsed(program: str, words: list[str]) -> str:
    """What the program's own parser, and then the settings, say of its arguments."""
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            options = vars(PARSERS[program]().parse_args(words))
    except SystemExit:
        return said.getvalue().strip().splitlines()[-1]
    for name in options.get("preset") or ():
        preset_files.find_preset(name)
    changed = options.get("overrides", options.get("set")) or ()
    for text in changed:
        if text.partition(".")[0] not in LANDFORMS_OF_EXAMPLES:
            description.override(text)
    if program == "icymoon.stereo":
        stereo_cli._read_response([], changed)
    owned = parse_own_matchers(options.get("own") or ())
    named = options.get("method") or ""
    if isinstance(named, list):
        for method in parse_named_methods(named):
            complete_options(method.name, method.options)
        named = ""
    for label in str(options.get("methods") or named).split(","):
        matcher, points = split_lidar(label)
        if points is not None:
            given = dict(parse_key_value(text, "--methods") for text in points.split(":") if text)
            complete_lidar_options(matcher or LIDAR, given)
        name, *own = matcher.split(":")
        if name == "own":
            name = owned[own.pop(0)].name
        if matcher:
            complete_options(name, dict(parse_key_value(text, "--methods") for text in own))
    for given in options.get("option") or ():
        for text in [given] if isinstance(given, str) else given:
            key, value = parse_key_value(text, "--option")
            name, dot, key = key.rpartition(".")
            complete_options(name if dot else str(options["method"]), {key: value})
    return ""


def study_fault(words: list[str]) -> str:
    """What is wrong with the words after ``python benchmarks``; empty if nothing is."""
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            if words:
                studies.make_parser(words[0]).parse_args(words[1:])
    except SystemExit as reason:
        return (said.getvalue().strip() or str(reason)).splitlines()[-1]
    return ""


def python_fault(code: str) -> str:
    """What is wrong with the operators and settings that a piece of Python for Blender uses."""
    tree = ast.parse(code)
    names = {"bpy.ops.icymoon": "bpy.ops.icymoon", "bpy.context.scene.icymoon": "bpy.context.scene.icymoon"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            pairs = [(node.targets[0], node.value)]
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(node.targets[0].elts, node.value.elts, strict=True))
            names |= {ast.unparse(target): ast.unparse(value) for target, value in pairs if ast.unparse(value) in names}
    faults = [_call_fault(node, names) for node in ast.walk(tree) if isinstance(node, ast.Call)]
    faults += [_setting_fault(node, names) for node in ast.walk(tree) if isinstance(node, ast.Assign)]
    return "; ".join(filter(None, faults))


def _call_fault(call: ast.Call, names: dict[str, str]) -> str:
    if not isinstance(call.func, ast.Attribute) or names.get(ast.unparse(call.func.value)) != "bpy.ops.icymoon":
        return ""
    operator = OPERATORS.get(call.func.attr)
    if operator is None:
        return f"there is no operator icymoon.{call.func.attr}"
    for word in call.keywords:
        if word.arg not in operator.properties:
            return f"icymoon.{call.func.attr} has no {word.arg}"
        if word.arg == "preset" and ast.literal_eval(word.value) not in preset_files.preset_names():
            return f"there is no preset {ast.unparse(word.value)}"
    return ""


def _setting_fault(node: ast.Assign, names: dict[str, str]) -> str:
    parts = ast.unparse(node.targets[0]).rsplit(".", 2)
    if len(parts) != 3 or names.get(parts[0]) != "bpy.context.scene.icymoon":
        return ""
    values: dict[str, Any] = {parts[1]: {parts[2]: ast.literal_eval(node.value)}}
    description.check(values, "the page")
    return ""


def unknown_settings(text: str) -> set[str]:
    """Settings that a page names in backticks and that do not exist."""
    named = re.findall(rf"`(?:--set )?({'|'.join(TOPICS)})\.([a-z]\w*\*?)", text)
    known = {topic: {setting.key for setting in TOPICS[topic].settings} for topic in TOPICS}
    return {
        f"{topic}.{key}"
        for topic, key in named
        if not (key in known[topic] or (key.endswith("*") and any(k.startswith(key[:-1]) for k in known[topic])))
    }
