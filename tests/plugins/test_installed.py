"""Finding plug-ins among installed packages, and what is refused."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from icymoon.plugins.installed import find_function, find_installed, load_plugin, read_summary
from icymoon.support.bundled_wheels import WHEELS_VARIABLE
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT
from plugin_packages import MATCHER, add_package


def test_a_plug_in_is_found_by_its_name_with_its_package(tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", "twelve", MATCHER, package="Some_Matchers", version="2.3")
    plugin = find_installed("matcher").usable["twelve"]
    assert plugin.release == "Some_Matchers 2.3"
    assert plugin.licence == "MIT"
    assert "twelve" not in find_installed("metric").usable
    assert read_summary(load_plugin(plugin)) == "Twelve everywhere."


def test_nothing_of_a_plug_in_is_imported_before_it_is_used(tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", "bomb", "raise RuntimeError('imported')")
    plugin = find_installed("matcher").usable["bomb"]
    with pytest.raises(
        IcyMoonError,
        match=r"The matcher bomb of the package icymoon-test-bomb 1\.0 cannot be loaded "
        r"\(RuntimeError: imported, plugin_of_a_test_\d+\.py line 1\)",
    ):
        load_plugin(plugin)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("sgbm", "Icy Moon has a matcher of this name"),
        ("own", "Icy Moon has a matcher of this name"),
        ("Twelve", "small letters"),
        ("a" * 31, "30 characters"),
        ("a,b", "small letters"),
        ("a:b", "small letters"),
        ("../a", "small letters"),
    ],
)
def test_a_bad_name_is_refused(tmp_path, monkeypatch, name, said):
    add_package(tmp_path, monkeypatch, "matcher", name, MATCHER, package="some-package")
    found = find_installed("matcher", ["own"])
    assert name not in found.added
    assert said in found.refused[name]
    assert "some-package 1.0" in found.refused[name]


def test_two_of_one_name_are_both_refused(tmp_path, monkeypatch):
    add_package(tmp_path / "a", monkeypatch, "matcher", "twelve", MATCHER, package="first")
    add_package(tmp_path / "b", monkeypatch, "matcher", "twelve", MATCHER, package="second")
    found = find_installed("matcher")
    assert "twelve" not in found.usable
    assert "first 1.0 and second 1.0 both add it" in found.refused["twelve"]


def test_a_package_that_is_found_twice_counts_once(tmp_path, monkeypatch):
    """As where it is installed for editing, and its own folder has an egg-info too."""
    for folder in ("a", "b"):
        add_package(tmp_path / folder, monkeypatch, "matcher", "twelve", MATCHER, package="same")
    assert "twelve" in find_installed("matcher").usable


@pytest.mark.parametrize("stated", ["", "ICYMOON_API = 2", "ICYMOON_API = '1'"])
def test_another_interface_is_refused(tmp_path, monkeypatch, stated):
    add_package(tmp_path, monkeypatch, "matcher", "later", stated)
    with pytest.raises(IcyMoonError, match=r"The matcher later .* states ICYMOON_API = .*has 1"):
        load_plugin(find_installed("matcher").usable["later"])


@pytest.mark.parametrize("source", ["import sys; sys.exit(0)", "def x(:", "import no_such_module_anywhere"])
def test_whatever_goes_wrong_at_import_is_one_sentence(tmp_path, monkeypatch, source):
    add_package(tmp_path, monkeypatch, "matcher", "broken", source)
    with pytest.raises(IcyMoonError, match=r"The matcher broken .* cannot be loaded") as raised:
        load_plugin(find_installed("matcher").usable["broken"])
    assert "\n" not in str(raised.value)


def test_a_missing_function_is_named(tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", "empty", "ICYMOON_API = 1")
    plugin = find_installed("matcher").usable["empty"]
    with pytest.raises(IcyMoonError, match=r"has no function match; write match\(left, right\)"):
        find_function(plugin, load_plugin(plugin), "match", "left, right")


def test_a_package_in_the_current_folder_is_none(tmp_path, monkeypatch):
    """``python -m`` looks for modules there, and a data set may be there."""
    add_package(tmp_path, monkeypatch, "matcher", "twelve", "raise SystemExit('it was run')")
    program = (
        "from icymoon.plugins.installed import find_installed\nimport sys\n"
        "print(sorted(find_installed('matcher').added), sys.path[0] in ('', sys.argv[1]))"
    )
    for where, expected in ((tmp_path, "[] True"), (Path(__file__).parent, "[] True")):
        done = subprocess.run(
            [sys.executable, "-c", program, str(where)],
            cwd=where,
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
        assert done.stdout.strip() == expected


def test_a_module_in_the_current_folder_does_not_stand_for_an_installed_one(tmp_path, monkeypatch):
    installed, dataset = tmp_path / "installed", tmp_path / "dataset"
    add_package(installed, monkeypatch, "matcher", "twelve", MATCHER)
    (module,) = installed.glob("*.py")
    dataset.mkdir()
    (dataset / module.name).write_text("raise SystemExit('it was run')", encoding="utf-8")
    program = (
        "import sys; sys.path.append(sys.argv[1])\nfrom icymoon.plugins.installed import find_installed, load_plugin\n"
        "print(load_plugin(find_installed('matcher').usable['twelve']).__doc__, sys.path[0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(installed)],
        cwd=dataset,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout.strip() == "Twelve everywhere."  # and the search path is as it was, with '' first


def test_the_evaluator_of_a_store_build_finds_those_in_other_extensions(tmp_path, monkeypatch):
    """Blender unpacks the wheels of all extensions into one folder."""
    add_package(tmp_path, monkeypatch, "matcher", "twelve", MATCHER)
    monkeypatch.setenv(WHEELS_VARIABLE, f"{sys.prefix}{os.pathsep}{tmp_path}")
    done = subprocess.run(
        [sys.executable, str(ROOT / "__main__.py"), "check-plugin"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert "matcher twelve, icymoon-test-twelve 1.0" in done.stdout


def test_a_damaged_package_hides_no_other(tmp_path, monkeypatch):
    add_package(tmp_path, monkeypatch, "matcher", "twelve", MATCHER)
    (tmp_path / "damaged-1.0.dist-info").mkdir()
    (tmp_path / "damaged-1.0.dist-info" / "METADATA").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "damaged-1.0.dist-info" / "entry_points.txt").write_bytes(b"[icymoon.matchers\n\xff = ?")
    assert "twelve" in find_installed("matcher").usable
