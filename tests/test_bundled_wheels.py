"""The wheels of a store build: found by Blender's own Python as a program, and by no other process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import bpy
import pytest
from icymoon.operators import preferences
from icymoon.stereo.environment import packages
from icymoon.support import bundled_wheels
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT

HERE = f"python{sys.version_info[0]}.{sys.version_info[1]}"


@pytest.fixture
def store(monkeypatch, tmp_path):
    """A store build, in a Blender whose Python is this one; the folder of its wheels."""
    folder = tmp_path / "extensions" / ".local" / "lib" / HERE / "site-packages"
    folder.mkdir(parents=True)
    monkeypatch.setenv(bundled_wheels.WHEELS_VARIABLE, "")
    monkeypatch.setattr(bundled_wheels, "has_bundled_wheels", lambda: True)
    monkeypatch.setattr(bpy, "app", SimpleNamespace(binary_path="/blender", background=True))
    monkeypatch.delenv("ICYMOON_EVALUATOR", raising=False)
    found = bundled_wheels.find_python
    found.cache_clear()
    yield folder
    found.cache_clear()


def test_a_plain_extension_has_none_and_announces_none(monkeypatch, tmp_path):
    monkeypatch.delenv(bundled_wheels.WHEELS_VARIABLE, raising=False)
    assert not bundled_wheels.has_bundled_wheels()
    bundled_wheels.share_wheels(tmp_path)
    assert bundled_wheels.WHEELS_VARIABLE not in os.environ
    (tmp_path / "wheels").mkdir()
    assert not bundled_wheels.has_bundled_wheels(tmp_path)
    (tmp_path / "wheels" / "a.whl").touch()
    assert bundled_wheels.has_bundled_wheels(tmp_path)


def test_blenders_python_loads_the_wheels_before_what_is_installed(store):
    """As a program it takes the numpy of the wheels, which stands in here for a package of another version."""
    (store / "numpy.py").write_text("__version__ = '1.26.99'\n")
    (store / "cv2.py").write_text("__version__ = '4.11.0'\n")
    bundled_wheels.share_wheels(store.parents[3])
    facts = check({**os.environ})
    assert (facts["numpy"], facts["cv2"]) == ("1.26.99", "4.11.0")
    bundled_wheels.unshare_wheels()
    assert check({**os.environ})["numpy"] != "1.26.99"


def check(environment):
    done = subprocess.run(
        [sys.executable, "-I", str(ROOT / "__main__.py"), "stereo", "check"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return json.loads(done.stdout)


def test_another_python_and_blender_itself_leave_them_alone(store, monkeypatch):
    monkeypatch.setenv(bundled_wheels.WHEELS_VARIABLE, f"{sys.prefix}{os.pathsep}{store}")
    assert bundled_wheels.find_folder() == ""  # this process has bpy
    monkeypatch.delitem(sys.modules, "bpy")
    assert bundled_wheels.find_folder() == str(store)
    monkeypatch.setattr(sys, "prefix", "/a/python/for/networks")
    assert bundled_wheels.find_folder() == ""


def program(path, says):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\necho {says}\n")
    path.chmod(0o755)
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins are shell scripts")
def test_blenders_python_is_found_by_trial(store, monkeypatch, tmp_path):
    """Blender may name another Python of the same version, or none."""
    here = f"{sys.version_info[0]} {sys.version_info[1]}"
    shim = program(tmp_path / "shims" / "python3", f"{here} /another/prefix")
    true = program(tmp_path / "usr" / "bin" / HERE, f"{here} {sys.prefix}")
    monkeypatch.setattr(sys, "executable", str(shim))
    monkeypatch.setattr(sys, "base_prefix", str(tmp_path / "usr"))
    monkeypatch.setenv("PATH", "")
    assert bundled_wheels.find_python() == str(true)
    bundled_wheels.find_python.cache_clear()
    program(true, f"3 10 {sys.prefix}")
    assert bundled_wheels.find_python() is None


def test_a_store_build_evaluates_with_blenders_python(store, monkeypatch):
    monkeypatch.setattr(preferences, "can_install_evaluator", lambda: False)
    monkeypatch.setattr(bundled_wheels, "find_python", lambda: "/blender/python")
    assert preferences.find_evaluator_python() == "/blender/python"
    assert not preferences.is_evaluator_missing()
    monkeypatch.setattr(bundled_wheels, "find_python", lambda: None)
    assert not preferences.is_evaluator_missing()
    with pytest.raises(IcyMoonError, match=r"was not found as a program, .* or name it by ICYMOON_EVALUATOR"):
        preferences.find_evaluator_python()


def test_the_users_choice_comes_first(store, monkeypatch):
    monkeypatch.setenv("ICYMOON_EVALUATOR", sys.executable)
    monkeypatch.setattr(bundled_wheels, "find_python", lambda: "/blender/python")
    assert preferences.find_evaluator_python() == sys.executable


def test_where_a_wheel_is_missing_no_pip_is_advised(store, monkeypatch):
    monkeypatch.setattr(bundled_wheels, "find_folder", lambda: str(store))
    monkeypatch.setitem(packages.PACKAGES, "nothing_like_it", ("nothing", (1, 0), 2))
    with pytest.raises(IcyMoonError, match="another extension may have replaced them: install Icy Moon again"):
        packages.require_modules("nothing_like_it")
