"""Where what is measured of a machine is kept."""

import pytest
from icymoon.render import machine


@pytest.fixture
def own(monkeypatch, tmp_path):
    """The person's own cache folder, whatever the system."""
    monkeypatch.delenv(machine.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(machine.sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    yield tmp_path / "own" / "icymoon"
    machine.choose_folder("")


def test_the_environment_goes_before_the_preferences_and_these_before_the_persons_cache(own, tmp_path, monkeypatch):
    assert machine.folder() == own
    machine.choose_folder(str(tmp_path / "chosen"))
    assert machine.folder() == tmp_path / "chosen"
    monkeypatch.setenv(machine.FOLDER_VARIABLE, str(tmp_path / "named"))
    assert machine.folder() == tmp_path / "named"
    monkeypatch.delenv(machine.FOLDER_VARIABLE)
    machine.choose_folder("")
    assert machine.folder() == own


def test_what_is_kept_in_one_folder_is_not_known_in_another(own, tmp_path):
    speed = machine.Speed(1.5, "CPU", "5.2.0", machine.processors(), "2026-01-01T00:00+00:00")
    machine.choose_folder(str(tmp_path / "chosen"))
    machine.remember(speed)
    assert machine.remembered("CPU") == speed
    machine.choose_folder("")
    assert machine.remembered("CPU") is None
