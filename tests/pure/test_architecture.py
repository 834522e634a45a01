"""What may import what, and what nothing may use; read from the source."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import icymoon
import pytest

ROOT = Path(icymoon.__file__).parent
PACKAGES = ("nodes", "operators", "panels", "physics", "render", "stereo")
SOURCES = sorted([*ROOT.glob("*.py"), *(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))])
IDS = [path.relative_to(ROOT).as_posix() for path in SOURCES]

#: What works in any Python, without Blender.
PURE = ("settings", "properties", "changes", "labels", "files", "own_files", "version", "errors", "cli", "batch",
        "sources",
        "terminal", "trade", "doctor", "install", "render.pair", "render.plan", "render.queue", "render.launch",
        "render.exr_check", "render.exr_parts", "render.sweep", "render.combine", "render.blocks", "render.poses",
        "render.toml_lines", "render.order", "render.claims", "render.dataset", "render.manifest", "render.verify",
        "render.runner", "render.cluster", "render.slurm", "render.variants", "render.cost", "render.detached",
        "render.machine", "render.qualities", "render.tolerance", "auto",
        "planning",
        *(f"{package}.{path.stem}" for package in ("physics", "stereo") for path in (ROOT / package).glob("*.py")
          if path.stem not in ("__init__", "__main__")))
#: Layers from the top down; each may import what is below it.
LAYERS = {"panels": 4, "operators": 3, "render": 2, "nodes": 1, "physics": 0}
#: Parts of render that are data and processes, and know no Blender; anyone may use them.
SHARED = {"render.pair", "render.plan", "render.queue", "render.launch", "render.exr_check", "render.exr_parts",
          "render.tolerance", "render.variants"}


def imported(path: Path) -> set[str]:
    """Absolute names of the modules that a source file imports, ours as ``icymoon.…``, anywhere in it."""
    package = ["icymoon", *path.relative_to(ROOT).parts[:-1]]
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*package[:len(package) - node.level + 1]] if node.level else [])
            module = ".".join(part for part in (base, node.module or "") if part)
            found.add(module)
            found |= {f"{module}.{alias.name}" for alias in node.names}
    return found


def ours(path: Path) -> set[str]:
    """Our modules that a file imports, without the package's name."""
    known = {".".join(p.relative_to(ROOT).with_suffix("").parts) for p in SOURCES} | set(PACKAGES)
    return {name.removeprefix("icymoon.") for name in imported(path)} & known


def test_imports_without_blender():
    program = ("import importlib, sys\n"
               "sys.modules['bpy'] = sys.modules['mathutils'] = sys.modules['_cycles'] = None\n"
               "for name in sys.argv[1:]:\n    print(name)\n    importlib.import_module('icymoon.' + name)")
    ended = subprocess.run([sys.executable, "-c", program, *PURE], capture_output=True, text=True, timeout=240,
                           check=False)
    assert ended.returncode == 0, f"icymoon.{ended.stdout.split()[-1]}: {ended.stderr}"


@pytest.mark.parametrize("path", SOURCES, ids=IDS)
def test_only_the_evaluator_uses_its_packages(path):
    used = {name.split(".")[0] for name in imported(path)} & {"cv2", "torch", "OpenEXR", "Imath", "jinja2"}
    assert path.is_relative_to(ROOT / "stereo") or not used


@pytest.mark.parametrize("path", SOURCES, ids=IDS)
def test_imports_go_one_way(path):
    part, used = path.relative_to(ROOT).parts[0], ours(path)
    if part in LAYERS:
        for name in used - SHARED:
            other = name.split(".")[0]
            assert LAYERS.get(other, -1) <= LAYERS[part], f"{part} imports {name}"
            assert other != "stereo", f"{part} imports {name}, which is for the evaluator's Python"
    if part == "stereo":
        foreign = {name for name in used if name.split(".")[0] in LAYERS} - SHARED
        assert {name for name in foreign if not name.startswith("physics")} <= {"render"}
        assert not any(name.split(".")[0] == "bpy" for name in imported(path))


@pytest.mark.parametrize("path", SOURCES, ids=IDS)
def test_only_compat_asks_for_blenders_version(path):
    text = path.read_text(encoding="utf-8")
    assert path.name == "compat.py" or "app.version" not in text.replace("app.version_string", "")


DRAWN = [path for path in SOURCES if path.relative_to(ROOT).parts[0] in ("physics", "nodes")
         or path.relative_to(ROOT).as_posix() in ("render/plan.py", "render/shoot.py", "render/sweep.py",
                                                    "render/combine.py", "render/blocks.py", "render/poses.py")]


@pytest.mark.parametrize("path", DRAWN, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_nothing_random_but_from_the_seed(path):
    """No random, uuid, secrets, global numpy generator, wall clock or hash() decides what is made."""
    assert not {name.split(".")[0] for name in imported(path)} & {"random", "uuid", "secrets"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Attribute | ast.Call):
            continue
        text = ast.unparse(node)
        if isinstance(node, ast.Attribute) and text.startswith(("np.random.", "numpy.random.")):
            allowed = ("Generator", "SeedSequence", "PCG64", "Philox", "default_rng", "BitGenerator")
            assert text.split(".")[2] in allowed, f"{text} in line {node.lineno}"
        if isinstance(node, ast.Call):
            assert text not in ("np.random.default_rng()", "default_rng()", "SeedSequence()"), f"line {node.lineno}"
            assert not text.startswith(("time.time(", "time.time_ns(", "datetime.", "hash(")), f"line {node.lineno}"
