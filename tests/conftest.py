"""For all tests: Blender leaves the person's settings alone, and the process ends cleanly."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile

import hypothesis
import pytest

_resources = tempfile.mkdtemp(prefix="icymoon-blender-")
os.environ["BLENDER_USER_RESOURCES"] = _resources  # before the first import of bpy
os.environ["ICYMOON_CACHE"] = os.path.join(_resources, "cache")  # nor is what was measured of the machine used
_status = pytest.StashKey[int]()
# A slow machine is no failure.
hypothesis.settings.register_profile("icymoon", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("icymoon")
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # A shell starts what runs in its background so, and the programs that tests interrupt would not listen either.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[_status] = int(exitstatus)


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
