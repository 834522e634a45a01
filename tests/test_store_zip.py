"""The zip for extensions.blender.org keeps the platform's rules, and works without an installer."""

from __future__ import annotations

import ast
import os
import tomllib
import zipfile

import pytest
import store_zip
from blender_program import run_main
from extension_zip import ROOT, shipped
from sources import check_each, tree_of

SOURCES = sorted(ROOT / name for name in shipped() - set(store_zip.LEFT_OUT) if name.endswith(".py"))
#: Modules that get something from the network, or install something.
REFUSED = {
    "pip",
    "ensurepip",
    "venv",
    "setuptools",
    "uv",
    "urllib.request",
    "http",
    "requests",
    "httpx",
    "aiohttp",
    "ftplib",
    "smtplib",
    "xmlrpc",
    "websockets",
    "socketserver",
    "marshal",
}


def wheel(folder, name, licence="LICENSE"):
    """A wheel with nothing in it but the text of a licence."""
    path = folder / f"{name}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        info = f"{name}.dist-info"
        archive.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: a\nVersion: 1\n")
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr(f"{info}/RECORD", "")
        archive.writestr(f"{info}/{licence}", "Anybody may copy it.")
    return path


@pytest.fixture
def built(tmp_path, monkeypatch):
    """The zip for Blender 4.2 to 5.0 on Linux, with an empty wheel."""
    monkeypatch.setattr(store_zip, "download", lambda store: [wheel(tmp_path, "jinja2-3.1.6")])
    target = tmp_path / "store.zip"
    store_zip.build(store_zip.Store("3.11", "linux-x64", "https://example.org/icymoon"), target)
    return target


def manifest_of(archive):
    with zipfile.ZipFile(archive) as opened:
        return tomllib.loads(opened.read("blender_manifest.toml").decode())


def test_the_manifest_is_of_one_python_and_one_platform(built):
    facts, plain = manifest_of(built), store_zip.manifest_of(ROOT)
    assert (facts["blender_version_min"], facts["blender_version_max"]) == ("4.2.0", "5.1.0")
    assert facts["platforms"] == ["linux-x64"]
    assert facts["website"] == "https://example.org/icymoon"
    assert "2007 Pallets" in facts["copyright"]
    assert facts["permissions"] == {"files": plain["permissions"]["files"]}
    assert {key: facts[key] for key in plain if key not in ("blender_version_min", "permissions", "build")} == {
        key: plain[key] for key in plain if key not in ("blender_version_min", "permissions", "build")
    }


def test_what_is_shown_of_the_extension_keeps_the_limits(built):
    facts = manifest_of(built)
    for text in (facts["tagline"], *facts["permissions"].values()):
        assert len(text) <= 64
        assert text[-1].isalnum()
    assert "blender" not in facts["name"].lower()
    assert not facts["name"].endswith(("Add-on", "Extension"))


def test_the_blenders_of_the_two_pythons_meet_and_none_is_in_both():
    assert store_zip.BLENDERS["3.11"][1] == store_zip.BLENDERS["3.13"][0]
    assert {python for python, _ in store_zip.RELEASE} == {"3.11", "3.13"}
    assert len({store_zip.Store(*each).file_name for each in store_zip.RELEASE}) == len(store_zip.RELEASE)


def test_every_package_that_is_put_in_is_named_with_its_copyright():
    names = {line.split("==")[0] for line in store_zip.locked().splitlines() if "==" in line}
    assert names == set(store_zip.COPYRIGHT)
    assert "numpy" not in names


def test_a_wheel_without_the_text_of_its_licence_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(store_zip, "download", lambda store: [wheel(tmp_path, "jinja2-3.1.6", licence="NAMES")])
    with pytest.raises(SystemExit, match=r"jinja2-3\.1\.6-py3-none-any\.whl has no text of its licence"):
        store_zip.build(store_zip.Store("3.13", "linux-x64"), tmp_path / "store.zip")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("operators/install_evaluator.py", ""), "install_evaluator.py installs packages"),
        (("wheels/other-1-py3-none-any.whl", None), "lists other wheels than there are"),
    ],
)
def test_faults_are_found(built, tmp_path, change, said):
    name, text = change
    with zipfile.ZipFile(built, "a") as archive:
        archive.writestr(name, wheel(tmp_path, "other-1").read_bytes() if text is None else text)
    assert any(said in fault for fault in store_zip.faults(built))


def imports(tree):
    """Names of the modules that a source imports, anywhere in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module or ""


@check_each(SOURCES)
def test_nothing_is_fetched_or_installed_and_no_thread_knows_blender(path):
    tree = tree_of(path)
    names = set(imports(tree))
    assert not {name for name in names if name in REFUSED or name.split(".")[0] in REFUSED}
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    assert not words & {"pip", "ensurepip", "venv", "easy_install"}
    called = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    assert not called & {"eval", "exec", "compile", "__import__"}
    # A computer's own name is no use of the network.
    assert {name for name in called if name.startswith("socket.")} <= (
        {"socket.gethostname"} if "socket" in names else called
    )
    if called & {"threading.Thread", "Thread", "ThreadPoolExecutor"}:
        assert "bpy" not in names


def test_the_preferences_are_named_after_the_package():
    tree = ast.parse((ROOT / "operators" / "preferences.py").read_text(encoding="utf-8"))
    (preferences,) = [
        node
        for node in tree.body
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base).endswith("AddonPreferences") for base in node.bases)
    ]
    assert any(ast.unparse(node) == "bl_idname = ADD_ON" for node in preferences.body)
    (name,) = [node for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "ADD_ON"]
    assert ast.unparse(name.value) == "__package__.rpartition('.')[0]"  # without the room


PROGRAM = """
    import hashlib, os, sys, traceback
    from pathlib import Path
    import bpy
    import addon_utils

    archive, dataset = sys.argv[1:]

    def files(folder):
        return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.rglob("*")
                if path.is_file() and "__pycache__" not in path.parts}

    def main():
        bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
        resources = Path(os.environ["BLENDER_USER_RESOURCES"])
        (folder,) = resources.glob("**/user_default/icymoon")
        before = files(folder)
        named = os.environ["ICYMOON_WHEELS"].split(os.pathsep)[1]
        assert (Path(named) / "jinja2-3.1.6.dist-info" / "LICENSE").is_file(), named
        assert not {"install_evaluator", "remove_evaluator"} & set(dir(bpy.ops.icymoon))
        from bl_ext.user_default.icymoon.operators import preferences
        assert not preferences.is_evaluator_missing()
        operators, group = bpy.ops.icymoon, bpy.context.scene.icymoon
        assert operators.load_preset(preset="scenes/europa_rough_ice") == {"FINISHED"}
        group.terrain.resolution, group.quality.samples = 65, 1
        group.rig.width_px, group.rig.height_px = 64, 48
        group.dataset.folder = dataset
        for step in (operators.build_scene, operators.render_pair, operators.evaluate):
            assert step() == {"FINISHED"}, step
        assert files(folder) == before, "it writes into its own folder"
        assert not addon_utils._extensions_warnings_get()
        bpy.ops.preferences.addon_disable(module="bl_ext.user_default.icymoon")
        assert "ICYMOON_WHEELS" not in os.environ
    """


@pytest.mark.long
@pytest.mark.heavy
def test_it_works_without_an_installer_and_writes_nothing_into_its_folder(built, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key != "ICYMOON_EVALUATOR"}
    run_main(PROGRAM, built, tmp_path, environment)
