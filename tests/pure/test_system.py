"""What differs between Windows, macOS and Linux."""

from __future__ import annotations

import errno
import fcntl
import os

import pytest
from icymoon import files, system


@pytest.fixture
def strict(monkeypatch):
    """Windows' rule: what is flushed is open for writing, and is no folder."""
    def fsync(handle: int) -> None:
        if fcntl.fcntl(handle, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, "Bad file descriptor")
    monkeypatch.setattr(system, "PLATFORM", "win32")
    monkeypatch.setattr(os, "fsync", fsync)


def test_what_is_written_is_flushed_by_a_handle_that_may_write(strict, tmp_path):
    files.write_text(tmp_path / "new" / "settings.toml", "x = 1\n")
    assert (tmp_path / "new" / "settings.toml").read_bytes() == b"x = 1\n"
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fsync(os.open(tmp_path / "new" / "settings.toml", os.O_RDONLY))


def test_a_folder_is_flushed_where_it_can_be(monkeypatch, tmp_path):
    done = []
    monkeypatch.setattr(os, "fsync", done.append)
    system.flush(tmp_path)
    assert len(done) == 1
    monkeypatch.setattr(system, "PLATFORM", "win32")
    system.flush(tmp_path)
    assert len(done) == 1
