"""What may import what, and what nothing may use; read from the source."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from sources import IDS, ROOT, SOURCES, check_each, tree_of

#: The rooms from the ground up. A module imports from its own room and from those below it, wherever in the file the
#: import stands. A room is a folder; a module at the root is a room by itself. All that is above has a place here.
PURE = (
    "support",
    "settings/topics",
    "plugins",
    "physics/rig",
    "physics/random_numbers",
    "physics/gravity",
    "physics/triangle_files",
    "physics/rocks",
    "physics/terrain/noise",
    "physics/terrain/roughness",
    "physics/terrain/landforms",
    "physics/terrain",
    "physics/mesh",
    "physics/arm",
    "physics/excavation",
    "physics/surfaces",
    "physics/light",
    "physics/camera",
    "physics/lidar",
    "physics/projector",
    "physics",
    "rays",
    "formats",
    "formats/calibrations",
    "paper_stand_ins",
    "settings",
    "render/pairs",
    "render/plans",
    "render/workers",
    "render/cost",
    "stereo/environment",
    "stereo/inference",
    "stereo/images",
    "stereo/measure",
    "stereo/networks",
    "stereo/adapters",
    "stereo/matchers",
    "stereo/export",
    "stereo/datasets",
    "stereo/report",
    "stereo/fusion",
    "stereo/decisions",
    "stereo/trade",
    "stereo/paper",
    "stereo/study",
    "stereo/twin",
    "stereo/learning",
    "stereo/design",
    "stereo/landed_day",
    "stereo",
    "validation/ground",
    "validation/polar",
    "validation",
    "commands",
    "library",
)
WITH_BLENDER = (
    "support/blender",
    "settings/blender",
    "nodes/tree",
    "nodes/datablocks",
    "nodes/light",
    "nodes/ground",
    "nodes/surface",
    "nodes/lander",
    "nodes",
    "render",
    "operators",
    "panels",
    "__init__",
    "__main__",
)
FLOORS = {room: floor for floor, room in enumerate((*PURE, *WITH_BLENDER))}
#: What only Blender has.
BLENDERS = {"bpy", "mathutils", "bmesh", "gpu", "bl_ui", "idprop", "_cycles", "_bpy"}


def room_of(module: str) -> str:
    """The room that a module such as ``physics.rocks.rock_shapes`` is in, as its folder's path."""
    path = ROOT.joinpath(*module.split(".")) if module else ROOT
    parts = module.split(".") if path.is_dir() else module.split(".")[:-1]
    return "/".join(parts) or module or "__init__"


@cache
def imported(path: Path) -> set[str]:
    """Absolute names of the modules that a source file imports, ours as ``icymoon.…``, anywhere in it."""
    package = ["icymoon", *path.relative_to(ROOT).parts[:-1]]
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join([*package[: len(package) - node.level + 1]] if node.level else [])
            module = ".".join(part for part in (base, node.module or "") if part)
            found.add(module)
            found |= {f"{module}.{alias.name}" for alias in node.names}
    return found


def name_of(path: Path) -> str:
    """The module of a source file, without the package's name; the package itself is ''."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


MODULES = {name_of(path) for path in SOURCES}


def ours(path: Path) -> set[str]:
    """Our modules that a file imports, without the package's name; of a package only what it defines itself."""
    return {name.removeprefix("icymoon.") for name in imported(path)} & MODULES


def upward(module: str, used: set[str]) -> list[str]:
    """Those of the modules used that are in a room above that of the module."""
    floor = FLOORS[room_of(module)]
    # A package that holds others is named by every import from a room inside it; what counts is the room.
    leaves = {name for name in used if not any(other.startswith(f"{name}.") for other in used)}
    return sorted(name for name in leaves if FLOORS[room_of(name)] > floor)


def test_every_module_has_a_floor():
    assert set(FLOORS) == {room_of(module) for module in MODULES}


def test_every_package_is_shipped():
    """Wheel and extension contain the packages that pyproject.toml lists, and would start without the others."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    there = {
        ".".join(["icymoon", *path.parent.relative_to(ROOT).parts]) for path in SOURCES if path.name == "__init__.py"
    }
    assert there == set(listed)


def test_the_manual_lists_the_rooms_in_this_order():
    page = (ROOT / "docs" / "extend.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?) \|", page[page.index("## The rooms") :], re.MULTILINE)
    listed = [re.sub(r"/$|\.py$", "", name) for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert listed == [*reversed(FLOORS)]


#: Folders of tests that are no rooms: the manual, the program as a whole, a real window, and what tests use.
NO_ROOMS = ("docs", "whole_program", "gui", "support", "data")


def test_tests_are_in_the_rooms_of_what_they_test():
    tests = ROOT / "tests"
    folders = {path.parent.relative_to(tests).as_posix() for path in tests.rglob("test_*.py")}
    assert {folder for folder in folders if folder.split("/")[0] not in NO_ROOMS} <= {".", *FLOORS}


def test_every_file_that_breaks_a_rule_is_named():
    @check_each(SOURCES)
    def rule(path):
        assert path.name != "__main__.py", "a rule"

    with pytest.raises(AssertionError, match=r"^__main__\.py: a rule[^:]*\nstereo/__main__\.py: a rule"):
        rule()


@check_each(SOURCES)
def test_imports_go_down(path):
    assert not upward(name_of(path), ours(path))


@pytest.mark.parametrize(
    ("module", "used"),
    [
        ("physics.camera.point_spread", {"stereo.trade.measure_variants", "commands.cli"}),
        ("physics.camera.point_spread", {"settings", "settings.table"}),
        ("support.errors", {"settings.table"}),
        ("render.plans.render_order", {"render.workers.pair_claims"}),
        ("nodes.build_scene", {"render.worker"}),
        ("stereo.measure.metrics", {"stereo.report.html"}),
        ("physics.light.sky", {"physics.scene_requirements"}),
    ],
)
def test_an_import_upwards_is_found(module, used):
    assert upward(module, used) == sorted(used - {"settings"})


@pytest.mark.parametrize(
    ("module", "used"),
    [
        ("operators.trade", {"render.cost.machine_speed", "commands.doctor"}),
        ("physics.light.sky", {"physics.light.bodies"}),
        ("support.files", {"support.errors"}),
        ("__main__", {"commands.cli"}),
        ("stereo.cli", {"stereo.trade.advice", "stereo"}),
    ],
)
def test_an_import_downwards_is_none(module, used):
    assert not upward(module, used)


def uses_of(path: Path) -> set[str]:
    """Our modules that a file imports: of ``from package import module`` the module, not the package around it."""
    found = ours(path)
    return {name for name in found if not any(other.startswith(f"{name}.") for other in found)} - {name_of(path)}


def circle(uses: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a circle, of any length; empty if there are none."""
    left = {module: set(used) for module, used in uses.items()}
    while done := [module for module, used in left.items() if not used & left.keys()]:
        for module in done:
            del left[module]
    if not left:
        return []
    path = [next(iter(left))]
    while path.count(path[-1]) == 1:  # what is left imports something that is left
        path.append(min(left[path[-1]] & left.keys()))
    return path[path.index(path[-1]) :]


def test_no_modules_import_each_other_in_a_circle():
    assert not circle({name_of(path): uses_of(path) for path in SOURCES})


@pytest.mark.parametrize(
    ("uses", "found"),
    [
        ({"a": {"b"}, "b": {"a"}}, ["a", "b", "a"]),
        ({"a": {"b"}, "b": {"c"}, "c": {"b"}}, ["b", "c", "b"]),
        ({"a": {"b", "d"}, "b": {"c"}, "c": {"d"}, "d": {"b"}}, ["b", "c", "d", "b"]),
        ({"a": {"b", "c"}, "b": {"c"}, "c": set()}, []),
    ],
)
def test_a_circle_is_found(uses, found):
    assert circle(uses) == found


def in_a_pure_room(path: Path) -> bool:
    return room_of(name_of(path)) in PURE


@check_each([path for path in SOURCES if in_a_pure_room(path)])
def test_pure_rooms_know_no_blender(path):
    assert not {name.split(".")[0] for name in imported(path)} & BLENDERS


def test_pure_rooms_import_without_blender():
    there = importlib.util.find_spec("torch") is not None  # not in the Python 3.13 that has Blender 5.2
    modules = [
        name_of(path)
        for path in SOURCES
        if in_a_pure_room(path) and path.stem != "__main__" and (there or not {"networks", "learning"} & {*path.parts})
    ]
    program = (
        "import importlib, sys\n"
        "sys.modules['bpy'] = sys.modules['mathutils'] = sys.modules['_cycles'] = None\n"
        "for name in sys.argv[1:]:\n    print(name)\n    importlib.import_module('icymoon.' + name)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, *modules], capture_output=True, text=True, timeout=240, check=False
    )
    assert ended.returncode == 0, f"icymoon.{ended.stdout.split()[-1]}: {ended.stderr}"


WITHOUT_THE_EVALUATOR = (
    "import sys\nsys.modules |= dict.fromkeys(('cv2', 'torch', 'OpenEXR', 'Imath', 'jinja2', 'matplotlib', 'rich'))\n"
)


def test_imports_go_without_the_evaluators_packages():
    """Blender has none of them, and the extension would not start."""
    program = WITHOUT_THE_EVALUATOR + "import icymoon\nicymoon.register()\nicymoon.unregister()"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=240, check=False)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.parametrize(
    ("arguments", "status", "printed"),
    [
        (["plan", "datasets/guiss_smoke", "--dry-run"], 0, "pair"),
        (["batch", "--help"], 0, "usage"),
        (["trade", "--help"], 0, "usage"),
        (["validate", "--only", "other_codes"], 1, "lacks"),
    ],
)
def test_the_command_line_starts_without_the_evaluators_packages(arguments, status, printed):
    """The window renders data sets by it, in Blender's own Python."""
    program = WITHOUT_THE_EVALUATOR + ("from icymoon.commands.cli import main\nsys.exit(main(sys.argv[1:]))")
    ended = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=240, check=False
    )
    assert ended.returncode == status, ended.stderr
    assert printed in ended.stdout + ended.stderr
    assert "Traceback" not in ended.stderr


@check_each(SOURCES)
def test_only_the_evaluator_uses_its_packages(path):
    used = {name.split(".")[0] for name in imported(path)} & {"cv2", "torch", "OpenEXR", "Imath", "jinja2"}
    assert path.is_relative_to(ROOT / "stereo") or not used


@check_each(SOURCES)
def test_only_compat_asks_for_blenders_version(path):
    text = path.read_text(encoding="utf-8")
    assert path.name == "compat.py" or "app.version" not in text.replace("app.version_string", "")


#: What differs between Windows, macOS and Linux, whether one sees it or not: a handle that is open for reading cannot
#: be flushed on Windows, what is open cannot be renamed or removed, os.kill ends what it is to look at.
OF_SYSTEMS = {
    "sys.platform",
    "os.name",
    "os.uname",
    "os.kill",
    "os.killpg",
    "os.getuid",
    "os.getppid",
    "os.fork",
    "os.fsync",
    "os.sync",
    "os.replace",
    "os.rename",
    "os.remove",
    "os.unlink",
    "os.symlink",
    "os.link",
    "os.sched_getaffinity",
    "os.cpu_count",
    "os.setsid",
    "os.startfile",
    "shutil.rmtree",
    "shutil.move",
    "socket.gethostname",
    "platform.system",
    "subprocess.run",
    "subprocess.call",
    "subprocess.check_call",
    "subprocess.check_output",
    "shlex.split",
}
#: Embree is called by ctypes, in the same way on all systems.
CALLS_A_LIBRARY = ROOT / "rays" / "embree.py"
MODULES_OF_SYSTEMS = {"signal", "fcntl", "msvcrt", "resource", "ctypes", "winreg", "pwd", "_thread", "multiprocessing"}


def asks_the_system(tree: ast.AST) -> list[str]:
    """What a source uses that only ``system`` may, with its lines."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and (text := ast.unparse(node)) in OF_SYSTEMS:
            found.append(f"{text} in line {node.lineno}")
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "subprocess.Popen":
            found.append(f"subprocess.Popen in line {node.lineno}")
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and not ast.unparse(node.func.value).endswith((".objects", ".children"))
            and (  # a collection of Blender's, which unlinks objects
                node.func.attr in ("rename", "unlink", "symlink_to", "hardlink_to")
                or (node.func.attr == "replace" and len(node.args) == 1)
            )
        ):  # of a path; a text's has two
            found.append(f"{node.func.attr} in line {node.lineno}")
    return found


@check_each(SOURCES)
def test_only_system_knows_what_differs_between_systems(path):
    if path == ROOT / "support" / "system.py":
        return
    allowed = {"ctypes"} if path == CALLS_A_LIBRARY else set()
    assert not {name.split(".")[0] for name in imported(path)} & (MODULES_OF_SYSTEMS - allowed)
    assert not asks_the_system(tree_of(path))


@pytest.mark.parametrize(
    "code",
    [
        "os.fsync(f)",
        "x = sys.platform",
        "subprocess.Popen(['a'])",
        "path.unlink()",
        "Path('a').replace('b')",
        "os.kill(1, 0)",
        "shutil.rmtree(a, ignore_errors=True)",
    ],
)
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
        modes = [
            a.value
            for a in [*node.args, *(w.value for w in node.keywords if w.arg == "mode")]
            if isinstance(a, ast.Constant) and isinstance(a.value, str)
        ]
        binary = any(set(mode) <= set("rwxab+t") and "b" in mode for mode in modes)
        text = any(
            word.arg in ("text", "universal_newlines") and ast.unparse(word.value) == "True" for word in node.keywords
        )
        if name in ("read_text", "write_text") and len(node.args) < (1 if name == "read_text" else 2):
            found.append(f"{name} in line {node.lineno}")
        # A member of an archive is always bytes.
        in_zip = any(word.arg == "force_zip64" for word in node.keywords) or ast.unparse(node.func) == "archive.open"
        if (
            name in ("open", "fdopen", "NamedTemporaryFile")
            and not binary
            and not in_zip
            and ast.unparse(node.func) not in ("os.open", "webbrowser.open")
        ) or text:
            found.append(f"{name} in line {node.lineno}")
    return found


@check_each(SOURCES)
def test_every_text_states_its_encoding(path):
    # Our own write_text of files writes UTF-8 and takes the text second.
    assert not texts_without_encoding(tree_of(path))


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("path.read_text()", True),
        ("path.read_text(encoding='utf-8')", False),
        ("path.write_text(text)", True),
        ("open('a')", True),
        ("path.open('rb')", False),
        ("os.fdopen(3, 'w')", True),
        ("path.open(mode='w')", True),
        ("archive.open('a', 'w', force_zip64=True)", False),
        ("write_text(path, text)", False),
        ("run(['a'], text=True)", True),
    ],
)
def test_texts_without_encoding_are_found(code, found):
    assert bool(texts_without_encoding(ast.parse(code))) == found


def test_drivers_of_the_window_name_modules_that_exist():
    """They find modules of the installed extension by their names, which no import and no type checker follows."""
    texts = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "gui").glob("*.py"))
    names = {*re.findall(r'\bmodule\("([a-z_.]+)"\)', texts), *re.findall(r'ADD_ON}\.([a-z_.]+)"', texts)}
    names.discard("bl_ext.user_default.icymoon")
    assert len(names) > 20
    paths = {name: ROOT / name.replace(".", "/") for name in names}
    missing = [name for name, path in paths.items() if not (path.is_dir() or path.with_suffix(".py").is_file())]
    assert missing == []


def list_stored(tree: ast.Module) -> set[str]:
    """The private attributes with names of several words that a file stores values under."""
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and node.attr.startswith("_")
        and "_" in node.attr[1:]
    }


def list_functions(tree: ast.Module) -> set[str]:
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_no_value_has_the_name_of_a_function_elsewhere():
    """A script that renames a private function by its name alone renames values of other files too."""
    files = {path: (list_stored(tree_of(path)), list_functions(tree_of(path))) for path in SOURCES}
    functions = set().union(*(own for _, own in files.values()))
    misnamed = {
        f"{name_of(path)}.{name}" for path, (stored, own) in files.items() for name in stored & (functions - own)
    }
    assert misnamed == {"stereo.export.plug_in._write_pair"}  # the function of a plug-in


def test_a_value_with_the_name_of_a_function_is_found():
    assert list_stored(ast.parse("self._find_scene, x._of = 1, 2; self._go(y)")) == {"_find_scene"}
    assert list_functions(ast.parse("class A:\n    def _find_scene(self): pass")) == {"_find_scene"}


DRAWN = [
    path
    for path in SOURCES
    if path.relative_to(ROOT).parts[0] in ("physics", "nodes")
    or path.is_relative_to(ROOT / "render" / "plans")
    or path == ROOT / "render" / "render_pair.py"
]


@check_each(DRAWN)
def test_nothing_random_but_from_the_seed(path):
    """No random, uuid, secrets, global numpy generator, wall clock or hash() decides what is made."""
    assert not {name.split(".")[0] for name in imported(path)} & {"random", "uuid", "secrets"}
    for node in ast.walk(tree_of(path)):
        if not isinstance(node, ast.Attribute | ast.Call):
            continue
        text = ast.unparse(node)
        if isinstance(node, ast.Attribute) and text.startswith(("np.random.", "numpy.random.")):
            allowed = ("Generator", "SeedSequence", "PCG64", "Philox", "default_rng", "BitGenerator")
            assert text.split(".")[2] in allowed, f"{text} in line {node.lineno}"
        if isinstance(node, ast.Call):
            assert text not in ("np.random.default_rng()", "default_rng()", "SeedSequence()"), f"line {node.lineno}"
            assert not text.startswith(("time.time(", "time.time_ns(", "datetime.", "hash(")), f"line {node.lineno}"


#: Lines of code of a function, without its docstring. Complexity is ruff's to keep, see ``C901`` in pyproject.toml.
MAX_LINES = 40
#: The functions that may be longer, with the reason. A function that follows a formula or tells a story has parts with
#: names; these are tables, which would read worse in parts.
LONGER = {
    "render/pair_record.py:make_pair_json": "the content of a file, key by key",
    "settings/blender/scene_properties.py:_make_variations": "a table of declared properties",
    "stereo/adapters/mitsuba_hapke.py:register_bsdf": "a class of Mitsuba, which is imported only where it is used",
    "stereo/cli.py:add_evaluate_options": "a table of declared options",
    "stereo/report/html.py:write_report": "the names that a template gets",
}


DEFINITIONS = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def lengths_of(tree, within=""):
    """Lines of code of each function by its name in its file; the functions in a function count for both."""
    found = {}
    for node in ast.iter_child_nodes(tree):
        name = f"{within}{node.name}" if isinstance(node, DEFINITIONS) else ""
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            code = node.body[ast.get_docstring(node) is not None :]
            found[name] = code[-1].end_lineno - code[0].lineno + 1 if code else 0
        found |= lengths_of(node, f"{name}." if name else within)
    return found


def test_no_function_is_longer_than_it_has_a_reason_for():
    long = {
        f"{source}:{name}"
        for source, path in zip(IDS, SOURCES, strict=True)
        for name, lines in lengths_of(tree_of(path)).items()
        if lines > MAX_LINES
    }
    assert long - LONGER.keys() == set(), "give its steps names, or state in LONGER why it reads better in one piece"
    assert LONGER.keys() - long == set(), "these are short by now: take them out of LONGER"


@pytest.mark.parametrize(("lines", "is_long"), [(MAX_LINES, False), (MAX_LINES + 1, True)])
@pytest.mark.parametrize(
    "head",
    [
        "def f():\n",
        "async def f():\n",
        'def f():\n    """A docstring.\n\n    Of lines that do not count.\n    """\n',
        "class A:\n  def f():\n",
        "if True:\n  def f():\n",
        "def of():\n  def f():\n",
    ],
)
def test_long_functions_are_found(head, lines, is_long):
    found = lengths_of(ast.parse(head + "    x = 1\n\n" + "    # a comment\n" * (lines - 3) + "    x = 2\n"))
    (length,) = (count for name, count in found.items() if name.split(".")[-1] == "f")
    assert length == lines
    assert (length > MAX_LINES) == is_long


def test_complexity_is_kept_without_exceptions_in_the_code():
    lint = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["lint"]
    assert "C901" in lint["select"]
    assert lint["mccabe"]["max-complexity"] == 15
    assert not [path for path in SOURCES if re.search(r"noqa:.*C901", path.read_text(encoding="utf-8"))]
