"""Any command line ends with a status and at most a sentence, whatever its words and files hold."""

from __future__ import annotations

import contextlib
import io
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from icymoon.commands import cli, sources
from icymoon.physics.terrain.standing_places import make_rocky_ground
from icymoon.render.plans import combine, plan_file
from icymoon.render.workers.out_of_memory import describe_shortage
from icymoon.settings.description import defaults, merged
from icymoon.stereo import cli as stereo
from pairs import write_pair

#: Words that have been misread somewhere, by this program or another.
WORDS = (
    "",
    " ",
    "~nouser/x",
    "~nouser/x.toml",
    "n" * 3000,
    "n" * 3000 + ".toml",
    "d/" * 3000,
    "..",
    "/",
    "/dev/null",
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1",
    "1e999",
    "9" * 5000,
    "1" * 19,
    "²",
    "²/3",
    "٣/٣",
    "1/0",
    "1/2",
    "\udcff",
    "\udcff.toml",
    "a\nb",
    "=",
    "a=b",
    "a.b=c",
    "terrain.size_m=nan",
    "terrain.size_m=1e999",
    "terrain.size_m=",
    "terrain.size_m=[[[",
    "terrain.size_m=" + "[" * 3000,
    "sensor.bits=²",
    "sensor.exposure_us=-1",
    "rig.x_m=1e39",
    "dataset.headings=1000000",
    "dataset.headings=360",
    "light.date_utc=99999999999-01-01T00:00:00",
    "light.directions_from=DATE",
    "source.kind=MESH",
    "source.file=~nouser/a.ply",
    "source.file=" + "n" * 3000,
    "dataset.folder=",
    "quality.samples=0",
    "bm",
    "bm:window=²",
    "sgbm,,bm",
    "external:command=",
    "own:x",
    "x:bm",
    "x:bm:window=9" + "9" * 4400,
    "datasets/guiss_terrains",
    "guiss_rocks",
    "bodies/europa",
    "../bodies/europa",
    "1:2:3",
    "local:²",
    "local:0",
    "tcp://",
    "🧊",
    "%s",
    "{}",
    "--",
    "-h",
    "samples",
    "shortcuts,",
)
#: Texts of files that are taken for settings, plans, pairs and data sets.
TEXTS = (
    "",
    "\0",
    "[plan]",
    "[plan]\nseeds = 100001",
    "[plan]\nextends = '~nouser/x.toml'",
    "[plan]\nextends = 'self.toml'",
    '[plan]\nextends = "a\\u0000b.toml"',
    "[plan]\nfiles = '~nouser/x'",
    "[plan]\nfiles = ''",
    "[plan]\ninclude = ['']",
    f"[plan]\ninclude = '{'n' * 3000}.toml'",
    "[plan]\nat_most = 0",
    "[plan]\nat_most = nan",
    "[plan]\nseeds = 9999\n[dataset]\nheadings = 360",
    "[plan]\n[[sweep]]\nkind = 'grid'\npreset = ['~nouser/a.toml']",
    "[plan]\n[[sweep]]\nkind = 'sobol'\ncount = 1000000000\nrig.x_m = {uniform = [0, 1]}",
    "[plan]\n[[sweep]]\nkind = 'random'\ncount = 3\nrig.x_m = {uniform = [nan, inf]}",
    "[plan]\n[[sweep]]\nkind = 'random'\ncount = 3\nrig.x_m = {normal = [0, 1e-320]}",
    "[plan]\n[[sweep]]\nkind = 'cases'\ncase = [{}]",
    "[plan]\n[light]\ndirections_from = 'DATE'\ndate_utc = '0000-00-00'",
    "[plan]\n[light]\ndirections_from = 'DATE'\ndate_utc = '99999999999999-01-01'",
    '[plan]\n[source]\nkind = "MESH"\nfile = "a\\u0000b.ply"',
    "[plan]\n[source]\nkind = 'MESH'\nfile = 'deep.gltf'",
    f"[plan]\n[source]\nkind = 'MESH'\nfile = '{'n' * 3000}.ply'",
    "[preset]\ninclude = ['self']",
    "a" * 9999,
    "x = " + "[" * 9999,
    "x = " + "9" * 9999,
    "[terrain]\nsize_m = 1979-05-27",
    "[terrain]\nlayers = [1]",
    "[light]\ndate_utc = '\ud7ff'",
    "{}",
    "[]",
    "null",
    '{"files": {}}',
    '{"files": 3, "settings": []}',
    "[" * 9999,
)
NAMES = ("self.toml", "pair.json", "plan.jsonl", "manifest.json", "deep.gltf", "a.npy", "a.png", "left.exr", "a.dat")
OUT, NO_BLENDER = ("--out", "out"), ("--blender", "no/blender")
#: Verbs with what keeps Blender out of them, and their options, '' for a word without one.
VERBS = {
    "render": (NO_BLENDER, ("--preset", "--settings", "--set", "--out", "--again")),
    "evaluate": (
        ("--jobs", "1"),
        (
            "",
            "",
            "--methods",
            "--method",
            "--out",
            "--guiss",
            "--points",
            "--set",
            "--option",
            "--seed",
            "--predictions",
        ),
    ),
    "settings": ((), ("--preset", "--settings", "--set", "--set", "--settings")),
    "presets": ((), ("", "--x")),
    "sources": ((), ("", "", "", "--x")),
    "quality": (NO_BLENDER, ("--preset", "--settings", "--set", "--json")),
    "trade": (
        (*NO_BLENDER, *OUT),
        (
            "--preset",
            "--set",
            "--methods",
            "--groups",
            "--repeats",
            "--scale",
            "--own",
            "--reference-samples",
            "--json-lines",
        ),
    ),
    "auto": ((*NO_BLENDER, *OUT), ("--set", "--methods", "--own", "--tolerance-px", "--tolerance-bad-1", "--scale")),
    "gallery": ((*NO_BLENDER, *OUT), ("--only", "--scale", "--x")),
    "plan": ((), ("", "--dry-run", "--out", "--json")),
    "batch": (
        NO_BLENDER,
        (
            "",
            "--out",
            "--workers",
            "--threads-per-worker",
            "--scenes-per-worker",
            "--evaluate",
            "--own",
            "--set",
            "--dask",
            "--json",
        ),
    ),
    "work": (NO_BLENDER, ("", "--shard", "--workers", "--json")),
    "slurm": (NO_BLENDER, ("", "--out", "--shards", "--at-once", "--cpus", "--memory", "--time", "--sbatch")),
    "verify": ((), ("", "--remove", "--json")),
    "doctor": ((*NO_BLENDER, "--evaluator", "no/python"), ("--x", "")),
    "stereo methods": ((), ("", "")),
    "stereo check": ((), ("",)),
    "stereo match": (OUT, ("--method", "--left", "--right", "--option", "--camera")),
    "stereo metrics": ((), ("--prediction", "--disparity", "--truth", "--focal-baseline", "--guiss")),
    "stereo evaluate": (
        (*OUT, "--jobs", "1"),
        ("", "--methods", "--method", "--option", "--own", "--set", "--seed", "--points", "--predictions", "--jobs"),
    ),
    "stereo truth": (OUT, ("",)),
    "stereo export": (OUT, ("", "--format", "--for-prediction", "--set")),
    "stereo develop": (OUT, ("", "--preset", "--set")),
    "nothing": ((), ("",)),
    "": ((), ("",)),
}
FLAGS = {"--again", "--for-prediction", "--guiss", "--points", "--json", "--json-lines", "--dry-run", "--remove", "--x"}
LIMIT_S = 60


def command(chance: random.Random, folder: Path) -> list[str]:
    """A command line at random, in a folder of files that are not what they should be."""
    verb = chance.choice(list(VERBS))
    fixed, options = VERBS[verb]
    words = verb.split()
    for option in options:
        if chance.random() < 0.5 and option:
            continue
        # A place of its own folder as often as any word.
        value = chance.choice(NAMES) if chance.random() < 0.5 else chance.choice((*WORDS, ".", "pairs"))
        words += [option] if option in FLAGS else [value] if not option else [option, value]
    for name in NAMES:
        (folder / name).write_bytes(chance.choice(TEXTS).encode("utf-8", "surrogatepass"))
    return [*words, *fixed]


@contextlib.contextmanager
def limited(seconds: int):
    """Raise TimeoutError inside the block when it takes longer."""

    def late(number, frame):
        raise TimeoutError(f"more than {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def ended(words: list[str]) -> tuple[int, str]:
    """Status and standard error of a command that is run in this process."""
    said = io.StringIO()
    main, words = (stereo.main, words[1:]) if words[:1] == ["stereo"] else (cli.main, words)
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()), limited(LIMIT_S):
        try:
            status = main(words)
        except SystemExit as error:  # argparse
            status = int(error.code or 0)
    return status, said.getvalue()


def faults(seed: int, folder: Path) -> list[str]:
    """What is wrong with the end of a command line at random."""
    words = command(random.Random(seed), folder)
    shown = f"{seed}: {' '.join(word[:40] for word in words)}"
    try:
        status, said = ended(words)
    except BaseException as error:
        return [f"{shown} raised {type(error).__name__}: {str(error)[:200]}"]
    if status not in (0, 1, 2, 130):
        return [f"{shown} ended with {status}"]
    last = said.strip().splitlines()[-1:] or [""]
    if status == 1 and not (last[0].startswith("icymoon") and len(last[0]) > 30):
        return [f"{shown} said {last[0][:200]!r}"]
    return []


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder to run in, with a data set of one pair and a broken one."""
    monkeypatch.chdir(tmp_path)
    write_pair(tmp_path / "pairs" / "0123456789ab")
    (tmp_path / "pairs" / "ba9876543210").mkdir()
    (tmp_path / "pairs" / "ba9876543210" / "pair.json").write_text('{"files": {}}')
    return tmp_path


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no alarm")
def test_every_command_line_ends_with_a_status_and_a_sentence(place):
    found = [fault for seed in range(200) for fault in faults(seed, place)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    "words",
    [
        ["work", "x", "--shard", "²/3"],
        ["work", "x", "--shard", "9" * 5000 + "/1"],
        ["verify", "n" * 3000],
        ["batch", "guiss_rocks", "--out", ""],
        ["plan", "~nouser/x"],
        ["sources", "\ud7ff\n" + "x" * 300],
    ],
    ids=lambda words: words[0],
)
def test_these_were_tracebacks(words, place):
    status, said = ended(words)
    assert status in (1, 2)
    assert len(said.strip().splitlines()[-1]) > 30


@pytest.mark.parametrize(
    "error", [PermissionError(13, "Permission denied", "pairs/x"), OSError("pairs/x is odd")], ids=str
)
def test_what_the_system_refuses_is_a_sentence(place, monkeypatch, error):
    """Whichever call it is that nobody thought of."""

    def refused(path):
        raise error

    monkeypatch.setattr(sources, "read_pair_settings", refused)
    status, said = ended(["sources", "pairs/x"])
    assert status == 1
    assert said.startswith("icymoon: ")
    assert "pairs/x" in said


PLAN = """[plan]
title = "Many"
seeds = 1000
"""


def test_a_plan_of_many_grounds_is_looked_at_on_some_and_says_so(place, monkeypatch):
    """Each ground takes some hundredths of a second; a hundred thousand took most of an hour, in silence."""
    looked, level = [], make_rocky_ground(merged(defaults(), {"terrain": {"rms_slope_deg": 0.0}}))
    monkeypatch.setattr(
        combine, "make_rocky_ground", lambda settings: looked.append(settings["dataset"]["seed"]) or level
    )
    (place / "many.toml").write_text(PLAN)
    many = plan_file.read_plan(place / "many.toml")
    assert len(many.pairs()) == 1000
    assert len(set(looked)) == combine.MAX_CHECKED_GROUNDS
    seeds = [pair.settings.dataset.seed for pair in many.pairs()]
    assert np.ptp([seeds.index(seed) for seed in looked]) > 900  # from the first to the last
    found = many.describe_unchecked()
    assert f"{combine.MAX_CHECKED_GROUNDS} grounds were checked, {1000 - combine.MAX_CHECKED_GROUNDS} were not" in found
    (place / "few.toml").write_text(PLAN.replace("1000", "3"))
    assert plan_file.read_plan(place / "few.toml").describe_unchecked() == ""


@pytest.mark.parametrize(
    ("part", "word"),
    [
        ({"rig": {"width_px": 16384, "height_px": 16384}}, "rig.width_px"),
        ({"mesh": {"most": 10**8}}, "mesh.most"),
        ({"mesh": {"kind": "GRID"}, "terrain": {"resolution": 4097}}, "terrain.resolution"),
        ({"source": {"kind": "HEIGHT_MAP", "file": "large.tif"}}, "large.tif"),
    ],
    ids=str,
)
def test_a_shortage_of_memory_names_what_is_large(place, part, word):
    with (place / "large.tif").open("wb") as file:
        file.truncate(10**9)  # takes no room on the disk
    assert word in describe_shortage(merged(defaults(), part))


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another thing there")
@pytest.mark.parametrize("words", [["presets"], ["stereo", "check"], ["plan", "guiss_terrains", "--dry-run"]], ids=str)
def test_ctrl_c_while_modules_load_is_quiet(words):
    """At moments of the start, once Python has begun with our code: a sentence at most, and a status that says it."""
    for module in ("icymoon.support.system", "numpy", "numpy.linalg", "icymoon.support.errors", "argparse"):
        done = subprocess.run(
            [sys.executable, "-c", INTERRUPTED, module, *words],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode in (130, -signal.SIGINT), (module, done.stderr[-300:])
        assert "Traceback" not in done.stderr
        assert "Error" not in done.stderr


#: Runs the command line as ``python -m`` does, and sends itself a Ctrl-C when a module begins to load.
INTERRUPTED = """
import importlib.abc, os, runpy, signal, sys
module = sys.argv.pop(1)
class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == module:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.modules.pop(module, None)
runpy.run_module("icymoon", run_name="__main__", alter_sys=True)
"""
