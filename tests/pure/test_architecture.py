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
PURE = ("settings", "schema", "properties", "changes", "labels", "system", "files", "own_files", "version", "errors",
        "cli", "batch", "sources", "terminal", "trade", "doctor", "install", "render.pair", "render.plan",
        "render.queue",
        "render.launch", "render.exr_check", "render.exr_parts", "render.exr_pixels", "render.sweep", "render.combine",
        "render.blocks",
        "render.poses", "render.ours", "render.publish", "records", "scratch",
        "render.toml_lines", "render.order", "render.claims", "render.dataset", "render.manifest", "render.verify",
        "render.runner", "render.cluster", "render.slurm", "render.variants", "render.cost", "render.detached",
        "render.machine", "render.room", "render.qualities", "render.tolerance", "render.abilities", "auto", "trust",
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


#: What differs between Windows, macOS and Linux, whether one sees it or not: a handle that is open for reading cannot
#: be flushed on Windows, what is open cannot be renamed or removed, os.kill ends what it is to look at.
OF_SYSTEMS = {"sys.platform", "os.name", "os.uname", "os.kill", "os.killpg", "os.getuid", "os.getppid", "os.fork",
              "os.fsync", "os.sync", "os.replace", "os.rename", "os.remove", "os.unlink", "os.symlink", "os.link",
              "os.sched_getaffinity", "os.cpu_count", "os.setsid", "os.startfile", "shutil.rmtree", "shutil.move",
              "socket.gethostname", "platform.system", "subprocess.run", "subprocess.call", "subprocess.check_call",
              "subprocess.check_output", "shlex.split"}
MODULES_OF_SYSTEMS = {"signal", "fcntl", "msvcrt", "resource", "ctypes", "winreg", "pwd", "_thread", "multiprocessing"}


def asks_the_system(tree: ast.AST) -> list[str]:
    """What a source uses that only ``system`` may, with its lines."""
    found = []
    for node in ast.walk(tree):
        text = ast.unparse(node) if isinstance(node, ast.Attribute) else ""
        if text in OF_SYSTEMS:
            found.append(f"{text} in line {node.lineno}")
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "subprocess.Popen":
            found.append(f"subprocess.Popen in line {node.lineno}")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and not ast.unparse(
                node.func.value).endswith(".objects") and (  # a collection of Blender's, which unlinks objects
                node.func.attr in ("rename", "unlink", "symlink_to", "hardlink_to")
                or (node.func.attr == "replace" and len(node.args) == 1)):  # of a path; a text's has two
            found.append(f"{node.func.attr} in line {node.lineno}")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=IDS)
def test_only_system_knows_what_differs_between_systems(path):
    if path == ROOT / "system.py":
        return
    assert not {name.split(".")[0] for name in imported(path)} & MODULES_OF_SYSTEMS
    assert not asks_the_system(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("code", ["os.fsync(f)", "x = sys.platform", "subprocess.Popen(['a'])", "path.unlink()",
                                  "Path('a').replace('b')", "os.kill(1, 0)", "shutil.rmtree(a, ignore_errors=True)"])
def test_what_asks_the_system_is_found(code):
    assert asks_the_system(ast.parse(code))


def test_what_does_not_is_not():
    assert not asks_the_system(ast.parse("'a'.replace('b', 'c'); p: subprocess.Popen[bytes]; os.path.join('a', 'b')"))


def texts_without_encoding(tree: ast.AST) -> list[str]:
    """Calls that read or write text and state no encoding, which is then the system's: on Windows seldom UTF-8."""
    found = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or any(word.arg == "encoding" for word in node.keywords):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else ast.unparse(node.func)
        modes = [a.value for a in [*node.args, *(w.value for w in node.keywords if w.arg == "mode")]
                 if isinstance(a, ast.Constant) and isinstance(a.value, str)]
        binary = any(set(mode) <= set("rwxab+t") and "b" in mode for mode in modes)
        text = any(word.arg in ("text", "universal_newlines") and ast.unparse(word.value) == "True"
                   for word in node.keywords)
        if name in ("read_text", "write_text") and len(node.args) < (1 if name == "read_text" else 2):
            found.append(f"{name} in line {node.lineno}")
        if (name in ("open", "fdopen", "NamedTemporaryFile") and not binary
                and ast.unparse(node.func) not in ("os.open", "webbrowser.open")) or text:
            found.append(f"{name} in line {node.lineno}")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=IDS)
def test_every_text_states_its_encoding(path):
    # Our own write_text of files writes UTF-8 and takes the text second.
    assert not texts_without_encoding(ast.parse(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(("code", "found"), [
    ("path.read_text()", True), ("path.read_text(encoding='utf-8')", False), ("path.write_text(text)", True),
    ("open('a')", True), ("path.open('rb')", False), ("os.fdopen(3, 'w')", True), ("path.open(mode='w')", True),
    ("write_text(path, text)", False), ("run(['a'], text=True)", True)])
def test_texts_without_encoding_are_found(code, found):
    assert bool(texts_without_encoding(ast.parse(code))) == found


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
