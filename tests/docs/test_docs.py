"""The manual says what is so: its links lead somewhere, its commands are understood, its settings exist."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import tomllib
from functools import cache

import manual
import pytest
from icymoon.formats.calibrations.head_file import read_head
from icymoon.plugins.installed import GROUPS
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import preset_files
from icymoon.stereo.datasets.plain_folder import parse_pairs_toml
from icymoon.stereo.design.read_design import find_design, read_design
from icymoon.support.version import ROOT, version
from sources import SOURCES

import commands

PAGES = sorted(manual.pages())
WRITTEN = sorted(manual.written())
BLOCKS = list(manual.blocks())
#: Languages of fences; text and json are shown, not run.
LANGUAGES = ("sh", "powershell", "toml", "python", "text", "json")
#: What a shell of Windows does not understand: its own words, a line that goes on, where an environment has its Python.
ONLY_SH = re.compile(r"(?m)\\$|^(for|make|export|\.) |(\.venv|evaluator|networks)/bin/|\$\(")
#: Files of the user's, or made by hand for an example, which no block of code and no source names.
OF_USERS = {
    "argparse.py",
    "icymoon.py",  # in a folder of somebody else, where Python would find them
    "icymoon_few_paths.py",
    "frost_waves/__init__.py",  # modules of a package that the page describes
    "camera_NAME.exr",  # of a camera that is named by the user
    "camera_NAME.truth.exr",
    "make_pair.py",
    "wide.toml",
    "make_photographs.py",
    "make_site.py",
    *(f"{name}.tif" for name in ("sgbm_class", "sgbm_height", "sgbm_height_error", "true_height")),  # by method
    "sgbm_height_0.1m.tif",  # with a stated cell
    "plane.exr",
    "plane.pfm",
    "view_0000_left.npy",
    "view_0000_left.png",
    "view_0000_right.png",
    "mine.toml",
    "seaice1.obj",
    ".aux.xml",
    *(f"firn{map_}.png" for map_ in ("", "_albedo", "_height", "_normal", "_roughness", "_transmission")),
    "evaluation/curves/surface.albedo.png",
    "right_deposits.png",  # made of a setting's name, of an eye's
    "dist/manual/index.html",  # by MkDocs
}


def shell() -> list:
    """(block, words) of every command; of an indented block only what is ours."""
    found = []
    for block in BLOCKS:
        ours = not block.language and block.code.startswith(("python -m icymoon", "make ", "blender "))
        if block.language == "sh" or ours:
            found += [(block, words) for words in commands.words_of(block.code)]
    return found


SHELL = shell()


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page):
    text = manual.pages()[page]
    for link in manual.links(text):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = manual.resolved(page, path)
        assert target in manual.files(), f"{page} links to {link}, which a clone does not have"
        if anchor:
            assert anchor in manual.anchors(manual.pages()[target]), f"{page} links to {link}: no such heading"


def test_every_page_is_in_the_navigation():
    listed = re.findall(r"(?m): (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = {page.removeprefix("docs/") for page in PAGES if page.startswith("docs/")}
    assert set(listed) == pages, "the navigation in mkdocs.yml lacks a page, or has one that is not there"
    assert len(listed) == len(pages)


def test_every_version_is_that_of_the_manifest():
    assert f"\nversion: {version()}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## {version()}\n" in manual.written()["CHANGELOG.md"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == version()


def test_every_figure_is_shown():
    shown = {manual.resolved(page, link) for page, text in manual.written().items() for link in manual.links(text)}
    assert shown >= {path for path in manual.files() if path.startswith(("docs/images/", "docs/figures/"))}


def words_of_python(code: str) -> list[list[str]]:
    return [words for words in commands.words_of(code) if words[0].endswith("python")]


@pytest.mark.parametrize(
    "block",
    [b for b in BLOCKS if b.language == "sh" and ONLY_SH.search(b.code) and b.page != "CONTRIBUTING.md"],
    ids=str,
)
def test_what_only_some_shells_understand_is_said_for_powershell_too(block):
    """Where the spelling differs, what is run does not; make is for those who have it, its steps for the others."""
    text = manual.written()[block.page]
    fences = [b for b in manual.blocks() if b.page == block.page and b.language]
    twin = fences[fences.index(block) + 1]
    assert twin.language == "powershell", f"{block}: {text.splitlines()[block.line]}"
    if not block.code.startswith("make"):
        assert words_of_python(commands.as_sh(twin.code)) == words_of_python(block.code)


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "powershell"], ids=str)
def test_commands_for_powershell_are_understood(block):
    for words in words_of_python(commands.as_sh(block.code)):
        assert not commands.fault(words), words


@pytest.mark.parametrize("code", [". .venv/bin/activate", "for a in 1 2; do", "make demo", "python a \\\n  b"])
def test_what_only_sh_understands_is_found(code):
    assert ONLY_SH.search(code)


def test_extras_of_a_package_are_in_quotes():
    """A shell takes brackets for a pattern of file names, and zsh then runs nothing."""
    texts = manual.pages() | {path.name: path.read_text(encoding="utf-8") for path in SOURCES}
    bare = re.compile(r"pip install\b[^\n`]*? [\w.-]+\[|\binstall it with: [\w.]+\[")
    assert {name: found[0] for name, text in texts.items() if (found := bare.search(text))} == {}
    assert bare.search("pip install icymoon[ros]")
    assert not bare.search('pip install -e ".[blender,evaluate]"')


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language], ids=str)
def test_every_fence_says_a_language_that_is_checked(block):
    assert block.language in LANGUAGES


def test_there_is_something_to_check():
    assert len(SHELL) > 40
    assert {block.language for block in BLOCKS} >= {"sh", "toml", "python"}


@pytest.mark.parametrize(("block", "words"), SHELL, ids=[f"{b}-{' '.join(w)[:60]}" for b, w in SHELL])
def test_every_command_is_understood(block, words):
    assert not commands.fault(words), f"{block}: {' '.join(words)}"


@pytest.mark.ci_takes(10)
@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "toml"], ids=str)
def test_every_settings_file_loads(block, tmp_path):
    raw = tomllib.loads(block.code)
    if "project" in raw:  # a package of the user's, which test_plug_ins installs
        assert set(raw["project"]["entry-points"]) <= set(GROUPS.values())
        return
    raw.pop("preset", None)
    file = tmp_path / "scene.toml"
    file.write_text(block.code, encoding="utf-8")
    if "camera" in raw and "images" not in raw:
        assert len(read_head(file).cameras) == len(raw["camera"])
        return
    if "images" in raw:
        assert parse_pairs_toml(file) == raw
        return
    if "plan" in raw:
        assert block.code.startswith("# not counted") or read_plan(file).pairs()
        return
    if "suite" in raw:  # with the head of the shipped design
        shipped = find_design("suites").read_text(encoding="utf-8")
        file.write_text(shipped[: shipped.index("[[suite]]")] + block.code, encoding="utf-8")
        assert len(read_design(file).suites) == len(raw["suite"])
        return
    assert preset_files.load(file) or not raw
    for name in set(raw.get("sources", {})):
        topic, _, key = name.partition(".")
        assert key in raw[topic], f"{block}: a source of {name}, which it does not set"


#: What a Python need not have in which the tests run: Blender's module, and that of the networks.
ELSEWHERE = ("bpy", "torch")


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "python"], ids=str)
def test_every_piece_of_python_compiles_and_finds_what_it_imports(block):
    tree = ast.parse(block.code)
    assert not commands.python_fault(block.code), str(block)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "icymoon":
            module = importlib.import_module(node.module)
            assert all(hasattr(module, alias.name) for alias in node.names), f"{block}: {ast.unparse(node)}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                there = alias.name in ELSEWHERE or importlib.util.find_spec(alias.name.split(".")[0])
                assert there, f"{block}: {alias.name}"


@pytest.mark.parametrize("page", WRITTEN)
def test_every_setting_that_is_named_exists(page):
    text = manual.written()[page]
    assert not commands.unknown_settings(text)


@cache
def texts_of_files() -> tuple[str, str]:
    """What the package contains, and what the blocks of code of all pages contain: names of files are in them."""
    return ("\n".join(path.read_text(encoding="utf-8") for path in SOURCES), "\n".join(block.code for block in BLOCKS))


def is_there(name: str) -> bool:
    """Whether a file or folder is in the repository or OF_USERS, is a preset, or is what a source or example names."""
    name = name.rstrip("/")
    if any(f"/{name}/" in f"/{path}/" for path in manual.files()):
        return True
    folder = name.split("/")[0]
    if folder in {path.split("/")[0] for path in manual.files() if "/" in path}:
        return False
    if folder in preset_files.PRESET_KINDS and "." not in name:
        return name in preset_files.preset_names()
    source, code = texts_of_files()
    file = re.escape(name.split("/")[-1])
    last = re.compile(rf"{file}(?<![\w.]{file})(?!\w)")  # the name first, which is found fast in all sources
    written = not name.endswith(".py") and last.search(source)
    return bool(name in OF_USERS or written or last.search(code))


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_is_named_is_there(page):
    gone = sorted(name for name in manual.named_files(manual.pages()[page]) if not is_there(name))
    assert not gone, f"{page} names what is neither in the repository nor written by Icy Moon nor in OF_USERS: {gone}"


def test_a_file_that_is_gone_is_found():
    names = manual.named_files(
        "`settings/table.py`, `properties.py`, `settings/tables.py`, `docs/old/`, `FILE.toml`, "
        "`scenes/nowhere`, `nowhere.json`, `a.b`, `scenes/hapke_…` and `hapke_*.py`\n"
    )
    assert {name for name in names if not is_there(name)} == {
        "properties.py",
        "settings/tables.py",
        "docs/old/",
        "scenes/nowhere",
        "nowhere.json",
    }
    named = {name for text in manual.written().values() for name in manual.named_files(text)}
    assert named >= OF_USERS, "a name in OF_USERS is on no page any more"
    assert not [name for name in OF_USERS if name in manual.files()]


@pytest.mark.parametrize(
    ("command", "word"),
    [
        ("python -m icymoon rendr", "invalid choice"),
        ("python -m icymoon render --preset nowhere", "nowhere"),
        ("python -m icymoon render --set rig.baseline=3", "baseline_m"),
        ("python -m icymoon.stereo develop D --out O --set rig.baseline_m=3", "new render"),
        ("python -m icymoon.stereo evaluate D --out O --methods bmm", "bmm"),
        ("python -m icymoon.stereo evaluate D --out O --methods bm:windows=7", "windows"),
        ("python -m icymoon.stereo match --method bm --left L --right R --out O --option windo=7", "windo"),
        ("python benchmarks nothing", "nothing"),
        ("python benchmarks rocks spheres", "spheres"),
        ("python benchmarks blur --width 320", "--width"),
        ("python tests/nothing.py", "nothing"),
        ("make tests", "tests"),
        ("pip install icymoon[everything]", "everything"),
        ("blender -b --python-expr 'import bpy; bpy.ops.icymoon.build()'", "build"),
        ("blender -b --python-expr 'import bpy; bpy.ops.icymoon.render_pair(agin=True)'", "agin"),
        ("blender -b --python-expr 'import bpy; s = bpy.context.scene.icymoon; s.rig.base_m = 1'", "base_m"),
        ("rm -r /", "rm"),
    ],
)
def test_a_wrong_command_is_found(command, word):
    ((words),) = commands.words_of(command)
    assert word in commands.fault(words)


def test_a_wrong_link_or_setting_is_found():
    assert manual.anchors("# One `two` three\n## x.y") == {"one-two-three", "xy"}
    assert manual.links("[a](b.md#c) `[no](x)` ![d](e.png)") == ["b.md#c", "e.png"]
    assert manual.resolved("docs/howto/a.md", "../theory/b.md") == "docs/theory/b.md"
    assert commands.unknown_settings("`rig.base_m` and `rig.baseline_m` and `rig.distortion_*`") == {"rig.base_m"}
