"""For the tests that need Blender as a Python module; all are skipped where there is none."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest
from icymoon import scene_properties

BPY = importlib.util.find_spec("bpy") is not None


class _WithoutBlender(pytest.Module):
    def collect(self) -> list[pytest.Item]:
        pytest.skip("this Python has no bpy (Blender as a module); `make env` installs it", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Skip every module here, with a reason, instead of failing to import it."""
    return None if BPY else _WithoutBlender.from_parent(parent, path=module_path)


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    """Icy Moon registered, once for all tests here."""
    import icymoon

    icymoon.register()
    yield
    icymoon.unregister()


@pytest.fixture
def scene(registered: None) -> Iterator[object]:
    """The scene of a new, empty file, with Icy Moon registered."""
    import bpy
    from icymoon.operators import jobs

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    yield bpy.context.scene
    jobs.stop_current()


@pytest.fixture
def small(scene: object, tmp_path: Path) -> object:
    """That scene with settings that render in a moment, into a folder of the test's own."""
    from rendering import SMALL

    scene_properties.to_group(scene.icymoon, {**SMALL, "dataset": {"folder": str(tmp_path / "dataset")}})
    return scene
