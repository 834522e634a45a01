"""A path with backslashes, which only Windows divides folders by, is told as one."""

from __future__ import annotations

import pytest
from icymoon.render.plans.plan_file import read_plan
from icymoon.settings import user_files
from icymoon.settings.description import check, defaults, merged
from icymoon.settings.preset_files import load
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.support import system
from icymoon.support.errors import IcyMoonError

NOTE = r"\(a \\ is a part of a name here; write / between folders\)"
HEAD = '[plan]\ntitle = "Test"\n'


@pytest.fixture(autouse=True)
def meshes(tmp_path, monkeypatch):
    monkeypatch.setattr(system, "PLATFORM", "linux")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "x.obj").write_text("v 0 0 0\n")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "[source]\nkind = 'MESH'\nfile = 'meshes\\x.obj'\n",
        "include = ['.\\mine.toml']\n",
        "extends = '.\\a.toml'\n",
        "[lander]\nkind = 'OWN'\nfile = '.\\a.urdf'\n",
        "[light]\ndirections_from = 'KERNELS'\nkernels = '.\\k'\n",
        "[textures]\nset = 'OWN'\nalbedo_file = '.\\a.png'\n",
    ],
)
def test_in_a_plan(tmp_path, text):
    (tmp_path / "plan.toml").write_text(HEAD + text)
    with pytest.raises(IcyMoonError, match=NOTE):
        read_plan(tmp_path / "plan.toml").pairs()


@pytest.mark.parametrize(
    "topic", [{"source": {"kind": "MESH", "file": "meshes\\x.obj"}}, {"lander": {"kind": "OWN", "file": "a\\b.urdf"}}]
)
def test_in_settings(topic):
    with pytest.raises(IcyMoonError, match=NOTE):
        user_files.hash_content(merged(defaults(), check(topic, "test")))


def test_in_the_name_of_a_settings_file(tmp_path):
    with pytest.raises(IcyMoonError, match=NOTE):
        load(tmp_path / "b\\c.toml")


@pytest.mark.parametrize(
    ("left", "right"), [("left\\{pair}.png", "right/{pair}.png"), ("left/{pair}.png", "right\\{pair}.png")]
)
def test_in_pairs_toml(tmp_path, left, right):
    for side in ("left", "right", "truth"):
        (tmp_path / side).mkdir()
        (tmp_path / side / "1.png").write_bytes(b"")
    (tmp_path / "pairs.toml").write_text(
        f"[images]\nleft = '{left}'\nright = '{right}'\n[truth]\ndisparity = 'truth/{{pair}}.png'\n"
        "[camera]\nfocal_px = 100\nbaseline_m = 0.1\n"
    )
    with pytest.raises(IcyMoonError, match="write a path in it, with / between folders"):
        find_sources([tmp_path])


def test_not_on_windows_nor_of_other_paths(monkeypatch):
    mesh = {"source": {"kind": "MESH", "file": "meshes/y.obj"}}
    with pytest.raises(IcyMoonError, match=r"\(No such file or directory\); check source\.file"):
        user_files.hash_content(merged(defaults(), check(mesh, "test")))
    monkeypatch.setattr(system, "PLATFORM", "win32")
    mesh["source"]["file"] = "meshes\\y.obj"
    with pytest.raises(IcyMoonError, match=r"\(No such file or directory\); check source\.file"):
        user_files.hash_content(merged(defaults(), check(mesh, "test")))
