"""Icy Moon's matchers and exports are found as those of packages are, and nothing else lists them."""

from __future__ import annotations

import ast
import json
import subprocess
import sys

import numpy as np
import pairs
import pytest
from icymoon.commands.cli import main as icymoon
from icymoon.plugins.installed import find_installed, read_fact
from icymoon.stereo.cli import main
from icymoon.stereo.export import exports_with_blender
from icymoon.stereo.export.plug_in import PluginExport
from icymoon.stereo.matchers import list_matcher_titles, load_matcher, match
from icymoon.stereo.matchers.methods import describe_method
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from plugin_packages import MATCHER, add_package, install_project, write_from_page

EXPORT = 'ICYMOON_API = 1\ndef write_pair(pair, folder):\n    (folder / "name.txt").write_text(pair.name)\n'


@pytest.fixture
def page_installed(tmp_path, monkeypatch):
    """The package of the manual's page, installed."""
    (project,) = write_from_page((ROOT / "docs" / "extend.md").read_text(encoding="utf-8"), tmp_path / "page")
    install_project(project, tmp_path / "site")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    return project.name


def data_set(folder):
    for name in ("one", "two"):
        pairs.write_pair(folder / "pairs" / name, pairs.Scene(), pairs.camera(96, 64))
    return str(folder)


def test_the_package_of_the_page_passes_its_check(page_installed, capsys):
    assert icymoon(["check-plugin", page_installed]) == 0, capsys.readouterr().out


def test_a_users_own_stand_beside_ours_in_every_list(page_installed, capsys):
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    listed = capsys.readouterr().out
    assert "png8" in listed
    assert "ros2" in listed
    assert "depth_table" in listed
    assert main(["methods"]) == 0
    listed = capsys.readouterr().out
    assert "\nsgbm: " in listed
    assert "\nrow_means: One disparity for each row" in listed
    assert "preset=fine rows=3" in listed
    main(["check"])  # what the window asks the evaluator for its list
    assert json.loads(capsys.readouterr().out)["matchers"] == {"row_means": "icymoon-row-means 1.0.0"}
    assert describe_method("row_means:rows=3") == "Row Means rows=3"


def test_a_users_own_work_as_ours_do(page_installed, tmp_path, capsys):
    dataset, out = data_set(tmp_path / "data"), tmp_path / "out"
    assert main(["export", dataset, "--format", "depth_table", "--out", str(out)]) == 0, capsys.readouterr().err
    rig = pairs.camera(96, 64)
    lines = (out / "depths.csv").read_text().splitlines()
    assert [line.partition(",")[0] for line in lines] == ["pair", "one", "two"]
    depth = pairs.view(pairs.Scene(), rig, "left")[0]
    assert float(lines[1].partition(",")[2]) == pytest.approx(float(sorted(depth[depth < 1e9].ravel())[0]), rel=2.0)
    assert not list(tmp_path.rglob("*.part"))
    assert main(["evaluate", dataset, "--methods", "bm,row_means:preset=fine", "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    facts = report["provenance"]["methods"][1]["facts"][0]
    assert facts["plug_in"] == "icymoon-row-means 1.0.0"
    assert facts["shifts"] > 1


def test_every_declared_module_loads_and_every_networks_title_is_its_own():
    for kind, load in (("matcher", lambda plugin: load_matcher(plugin.name)), ("export", PluginExport)):
        for plugin in find_installed(kind).usable.values():
            load(plugin)
    assert list_matcher_titles()["igev"] == "IGEV-Stereo"
    assert exports_with_blender() == ["mitsuba", "dem", "ply", "obj", "usd", "gltf"]


#: Modules that only their declaration names.
PLUGGED = ("bop", "ros_bag", "parquet_index", "radiance_factor", "raw", "igev", "dsmnet", "jplv", "sgbm_wls")


def test_no_module_imports_or_lists_a_plug_in_by_name():
    """But for the documentation of a setting, and defaults, which are texts of several names."""
    names = {*find_installed("matcher").usable, *find_installed("export").usable} - {
        "dem",
        "ply",
        "obj",
        "usd",
        "gltf",
    }  # kinds of files
    own = {
        entry.entry.module.rpartition(".")[2]
        for kind in ("matcher", "export")
        for entry in find_installed(kind).usable.values()
    }
    lists = []
    rooms = ("commands", "library", "operators", "panels", "plugins", "render", "stereo", "support")
    for path in (path for room in rooms for path in (ROOT / room).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.ImportFrom) and path.stem not in own:
                module = (node.module or "").rpartition(".")[2]
                imported = {module, *(alias.name for alias in node.names)} & set(PLUGGED)
                lists += [f"{path.relative_to(ROOT)} imports {name}" for name in imported]
            if isinstance(node, ast.Tuple | ast.List | ast.Set | ast.Dict) and path.stem not in own:
                each = node.keys if isinstance(node, ast.Dict) else node.elts
                texts = {str(item.value) for item in each if isinstance(item, ast.Constant)}
                if len(texts & names) > 1:
                    lists.append(f"{path.relative_to(ROOT)} line {node.lineno} lists {sorted(texts & names)}")
    assert lists == []


def test_lists_import_no_package_that_only_a_plug_in_needs():
    program = (
        "import sys\nfrom icymoon.stereo.export import exports_with_blender, find_plugins\n"
        "from icymoon.stereo.matchers import list_matcher_names, list_matcher_titles, list_set_ups\n"
        "exports_with_blender(), find_plugins(), list_matcher_names(), list_set_ups(), list_matcher_titles()\n"
        "print({'torch', 'cv2', 'pyarrow', 'rosbags', 'mitsuba', 'onnxruntime'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=100)
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    "source",
    ["raise SystemExit(3)", "def (", "import os; os._exit", "\0", "TITLE = [" * 5000, "TITLE = 1/0\nNEEDS = 5\n"],
)
def test_a_hostile_package_takes_none_of_ours_down(source, tmp_path, monkeypatch, capsys):
    for kind in ("matcher", "export"):
        add_package(tmp_path / kind, monkeypatch, kind, "hostile", source, package=f"evil-{kind}")
    with pytest.raises(SystemExit) as ended:
        main(["export", "--help"])
    assert ended.value.code == 0
    assert describe_method("hostile") == "hostile"
    assert main(["methods"]) == 1
    said = capsys.readouterr()
    assert "\nsgbm: " in said.out
    assert "The matcher hostile of the package evil-matcher 1.0" in " ".join(said.err.split())
    assert main(["export", data_set(tmp_path / "data"), "--format", "png8", "--out", str(tmp_path / "out")]) == 0
    assert main(["export", str(tmp_path / "data"), "--format", "hostile", "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert "The export hostile of the package evil-export 1.0" in " ".join(said.err.split())
    assert "Traceback" not in said.err


@pytest.mark.parametrize("content", ["[icymoon.matchers]\nq\n", "[icymoon.matchers]\n= x\nq = a b c : d\n"])
def test_a_package_that_cannot_be_read_is_named_where_its_kind_is_listed(content, tmp_path, monkeypatch, capsys):
    add_package(tmp_path, monkeypatch, "matcher", "whole", MATCHER)
    info = tmp_path / "torn-1.0.dist-info"
    info.mkdir()
    (info / "entry_points.txt").write_text(content, encoding="utf-8")
    assert main(["methods"]) == 1
    said = capsys.readouterr()
    assert "\nsgbm: " in said.out
    assert "\nwhole: " in said.out
    assert "The package torn-1.0.dist-info cannot be read" in " ".join(said.err.split())
    assert find_installed("export").refused == {}


def test_facts_are_read_without_an_import(tmp_path, monkeypatch):
    package = tmp_path / "of_a_user" / "deep"
    package.mkdir(parents=True)
    for path in (package.parent, package):
        (path / "__init__.py").write_text("raise SystemExit('imported')")
    (package / "last.py").write_text("raise SystemExit('imported')\nTITLE = 'Deep'\nNEEDS = TITLE\nTITLE.x = 'no'\n")
    add_package(tmp_path, monkeypatch, "matcher", "deep", "TITLE = 'Flat'\nraise SystemExit('imported')\n")
    (info,) = tmp_path.glob("*.dist-info")
    flat = find_installed("matcher").usable["deep"]
    assert read_fact(flat, "TITLE") is None or read_fact(flat, "TITLE") == "Flat"
    (info / "entry_points.txt").write_text("[icymoon.matchers]\ndeep = of_a_user.deep.last\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "nowhere")])
    deep = find_installed("matcher").usable["deep"]
    assert read_fact(deep, "TITLE") == "Deep"
    assert read_fact(deep, "NEEDS") is None


BLACK = np.zeros((20, 30), "uint8")
CHECKED = 'ICYMOON_API = 1\ndef check(*_):\n    return "Install the moon."\n'


def test_why_it_cannot_run_is_one_sentence(tmp_path, monkeypatch, capsys):
    add_package(tmp_path / "a", monkeypatch, "matcher", "absent", CHECKED + "def match(*_):\n    raise SystemExit\n")
    with pytest.raises(IcyMoonError, match=r"The matcher absent of .* cannot run here: Install the moon\."):
        match("absent", BLACK, BLACK)
    add_package(tmp_path / "b", monkeypatch, "export", "absent", CHECKED + "def write_all(*_):\n    raise SystemExit\n")
    status = main(["export", data_set(tmp_path / "data"), "--format", "absent", "--out", str(tmp_path / "out")])
    assert status == 1
    assert "The export absent of the package icymoon-test-absent 1.0 cannot write here: Install the moon." in " ".join(
        capsys.readouterr().err.split()
    )
    assert icymoon(["check-plugin", "absent"]) == 1


def test_a_pair_that_write_all_cannot_write_is_left_out_and_named(tmp_path, monkeypatch, capsys):
    source = """
        ICYMOON_API = 1
        def write_all(each, folder):
            def write(pair):
                if pair.name == "one":
                    raise ValueError("no moon")
                (folder / pair.name).write_text("x")
            each(write)
    """
    add_package(tmp_path / "site", monkeypatch, "export", "picky", source)
    assert main(["export", data_set(tmp_path / "data"), "--format", "picky", "--out", str(tmp_path / "out")]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "The export picky of the package icymoon-test-picky 1.0 failed (ValueError: no moon" in said
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["two"]


def test_write_folders_is_given_the_folders_and_leaves_nothing_half_written(tmp_path, monkeypatch, capsys):
    source = """
        ICYMOON_API = 1
        def write_folders(folders, folder, context):
            with context.progress("Listing") as show:
                show({"type": "progress", "fraction": 1.0, "message": "all"})
            (folder / "names.txt").write_text(" ".join(path.name for path in folders))
            context.warn("The Moon is left out.")
            if context.changes:
                raise ValueError("late")
    """
    add_package(tmp_path / "site", monkeypatch, "export", "names", source)
    run = ["export", data_set(tmp_path / "data"), "--format", "names", "--out", str(tmp_path / "out")]
    assert main([*run, "--set", "sensor.bits=8"]) == 1
    assert "failed (ValueError: late" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out" / "names.txt").exists()
    assert main(run) == 0
    assert (tmp_path / "out" / "names.txt").read_text() == "one two"
    assert "The Moon is left out." in " ".join(capsys.readouterr().err.split())
    assert main([*run, "--cell-m", "1"]) == 1
    assert "give it with --format dem" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("PRESETS = 3", "PRESETS that are not dictionaries"),
        ("PRESETS = {'fine': {'w': 99}}", "outside 1 to 9"),
        ("PRESETS = {'fine': {'x': 1}}", "Unknown option"),
        ("def load(options): raise KeyError('no')", "failed (KeyError"),
    ],
)
def test_what_it_states_wrong_is_named(stated, said, tmp_path, monkeypatch):
    option = "OPTIONS = {'w': {'default': 3, 'minimum': 1, 'maximum': 9, 'doc': 'px'}}\n"
    add_package(tmp_path, monkeypatch, "matcher", "odd", f"{MATCHER}{option}{stated}\n")
    with pytest.raises(IcyMoonError) as raised:
        match("odd", BLACK, BLACK)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("nan", "{'a': np.nan}", "The matcher nan of the package .* failed"),
        ("set", "{'a': {1}}", "The matcher set of the package .* failed"),
        ("three", "{}, 3", "a confidence of the shape"),
        ("four", "{}, None, 3", "returned 4 values"),
    ],
)
def test_what_no_report_can_hold_is_a_sentence(name, more, words, tmp_path, monkeypatch):
    source = MATCHER.replace("np.float32)", f"np.float32), {more}")
    add_package(tmp_path, monkeypatch, "matcher", name, source)
    with pytest.raises(IcyMoonError, match=words):
        match(name, BLACK, BLACK)
