"""For all tests: Blender leaves the user's settings alone, and the process ends cleanly.

The folders are those of the source; ``whole_program`` tests what no room does alone. Tests of the rooms that need
Blender as a Python module are skipped where there is none.
"""

from __future__ import annotations

import gc
import importlib.util
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest

if TYPE_CHECKING:
    import bpy

HAS_BLENDER = importlib.util.find_spec("bpy") is not None
#: Rooms of the source that need Blender, and all in them; of ``render`` only what stands at its top does.
WITH_BLENDER = ("nodes", "operators", "panels", "whole_program")

_resources = tempfile.mkdtemp(prefix="icymoon-blender-")
os.environ["BLENDER_USER_RESOURCES"] = _resources  # before the first import of bpy
os.environ["ICYMOON_CACHE"] = os.path.join(_resources, "cache")  # nor is what was measured of the machine used
_status = pytest.StashKey[int]()
# A slow machine is no failure, and all settings of a scene make a large example.
CHECK = hypothesis.HealthCheck
hypothesis.settings.register_profile(
    "icymoon", deadline=None, suppress_health_check=[CHECK.too_slow, CHECK.large_base_example]
)
hypothesis.settings.load_profile("icymoon")
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # A shell starts what runs in its background so, and the programs that tests interrupt would not listen either.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without charts, for tests of all else: drawing them takes four fifths of an evaluation of small pairs."""
    from icymoon.stereo.report.charts import CHARTS

    empty: dict[str, list[str]] = {name: [] for name in CHARTS}
    monkeypatch.setattr("icymoon.stereo.report.html.draw_charts", lambda *_: empty)
    monkeypatch.setattr("icymoon.stereo.report.html.draw_sweeps", lambda *_: [])
    monkeypatch.setattr("icymoon.stereo.report.write_results.write_curves", lambda *_: {})


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what was measured to take more than 0.3 s of a processor, by ``make measure-tests``, and the cases
    beyond those that CI takes."""
    cases: Counter[str] = Counter()
    for item in items:
        if limit := item.get_closest_marker("ci_takes"):
            function = item.nodeid.partition("[")[0]
            cases[function] += 1
            if cases[function] > limit.args[0]:
                item.add_marker("long")
    measured = set((config.rootpath / "tests" / "left_to_ci.txt").read_text(encoding="utf-8").splitlines())
    for item in items:
        if item.nodeid in measured:
            item.add_marker("left_to_ci")


def pytest_collection_finish() -> None:
    """Keep modules and tests out of garbage collection: they stay, and each pass over all took half a second."""
    gc.freeze()


@pytest.hookimpl(trylast=True)  # a plugin may have changed the status
def pytest_sessionfinish(session: pytest.Session) -> None:
    session.config.stash[_status] = int(session.exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """End the process at once where Blender is loaded: it may crash (4.2) or hang (4.5) when it is unloaded.

    By now pytest has printed its summary and written its reports.
    """
    shutil.rmtree(_resources, ignore_errors=True)
    if sys.modules.get("bpy") is not None and _status in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[_status])


def needs_blender(path: Path) -> bool:
    """Whether a test file is of a room that needs Blender."""
    folder = path.relative_to(Path(__file__).parent).parent
    return folder.parts[:1] in {(room,) for room in WITH_BLENDER} or folder == Path("render")


class _WithoutBlender(pytest.Module):
    def collect(self) -> list[pytest.Item]:
        pytest.skip("this Python has no bpy (Blender as a module); `make env` installs it", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Skip a module that needs Blender with a reason, instead of failing to import it."""
    return (
        None if HAS_BLENDER or not needs_blender(module_path) else _WithoutBlender.from_parent(parent, path=module_path)
    )


@pytest.fixture(scope="session")
def registered() -> Iterator[None]:
    """Icy Moon registered in Blender, once for all tests of a process."""
    import icymoon

    icymoon.register()
    yield
    icymoon.unregister()


@pytest.fixture(scope="module", autouse=True)
def _registered_where_needed(request: pytest.FixtureRequest) -> None:
    """Register Icy Moon before anything else of a room that needs Blender."""
    if needs_blender(request.path):
        request.getfixturevalue("registered")


@pytest.fixture
def scene(registered: None) -> Iterator[bpy.types.Scene]:
    """The scene of a new, empty file, with Icy Moon registered."""
    import bpy
    from icymoon.operators.session import session

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    yield bpy.context.scene
    session.reset()


@pytest.fixture
def small(scene: bpy.types.Scene, tmp_path: Path) -> bpy.types.Scene:
    """That scene with settings that render in a moment, into a folder of the test's own."""
    from icymoon.settings.blender import scene_properties
    from rendering import SMALL

    scene_properties.write_settings(scene.icymoon, {**SMALL, "dataset": {"folder": str(tmp_path / "dataset")}})
    return scene
