"""The layer that stands for Windows in tests does what Microsoft and Python document of it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from icymoon.support import system
from windows import Windows, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the layer asks Linux who has a file open")


@pytest.fixture
def layer(tmp_path, monkeypatch):
    (tmp_path / "C").mkdir()
    (tmp_path / "C" / "temp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "C" / "temp"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "C" / "temp"))
    found = Windows(tmp_path / "C", tmp_path / "processes")
    found.install()
    yield found
    found.remove()


@pytest.fixture
def drive(layer):
    return Path(layer.drive)


def refused(winerror: int, act) -> None:
    with pytest.raises(OSError) as raised:  # noqa: PT011  its number says which
        act()
    assert getattr(raised.value, "winerror", None) == winerror, raised.value


def test_a_handle_for_reading_is_not_flushed_nor_is_a_folder_opened(drive):
    """_commit: EBADF without write access. CreateFile: a folder only with FILE_FLAG_BACKUP_SEMANTICS."""
    (drive / "a").write_bytes(b"a")
    handle = os.open(drive / "a", os.O_RDONLY)
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fsync(handle)
    os.close(handle)
    with (drive / "a").open("r+b") as stream:
        os.fsync(stream.fileno())
    with pytest.raises(PermissionError):
        os.open(drive, os.O_RDONLY)
    with pytest.raises(PermissionError):
        drive.open("rb")


@pytest.mark.parametrize("who", ["this process", "another"])
def test_what_is_open_is_not_renamed_replaced_or_removed(drive, who):
    """MoveFileEx opens the file with DELETE access, which who opened it without FILE_SHARE_DELETE does not share."""
    old, new = drive / "old", drive / "new"
    old.write_bytes(b"old")
    if who == "another":
        process = subprocess.Popen(
            [sys.executable, "-c", f"f = open({str(old)!r}); print(flush=True); input()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        process.stdout.readline()
    else:
        stream = old.open("rb")
    refused(32, lambda: old.rename(new))
    refused(32, lambda: os.replace(old, new))
    refused(32, old.unlink)
    refused(32, lambda: old.rename(old))  # by which one can tell that it is open
    new.write_bytes(b"new")
    refused(5, lambda: os.replace(new, old))
    if who == "another":
        process.communicate(b"\n")
    else:
        stream.close()
    os.replace(old, new)
    assert new.read_bytes() == b"old"


def test_a_folder_in_which_a_file_is_open_is_not_renamed(drive):
    (drive / "a" / "b").mkdir(parents=True)
    with (drive / "a" / "b" / "file").open("wb"):
        refused(5, lambda: (drive / "a").rename(drive / "c"))
    (drive / "a").rename(drive / "c")
    assert (drive / "c" / "b" / "file").exists()


def test_rename_replaces_nothing_and_no_call_replaces_a_folder(drive):
    """MoveFile fails where something is; MOVEFILE_REPLACE_EXISTING is for files."""
    for name in ("one", "two"):
        (drive / name).mkdir()
        (drive / f"{name}.txt").write_bytes(b"")
    refused(183, lambda: os.rename(drive / "one", drive / "two"))
    refused(183, lambda: os.rename(drive / "one.txt", drive / "two.txt"))
    refused(5, lambda: os.replace(drive / "one", drive / "two"))
    os.replace(drive / "one.txt", drive / "two.txt")
    refused(5, lambda: os.unlink(drive / "one"))


@pytest.mark.parametrize("name", ["CON", "nul.txt", "com1", "LPT9.a.b", "a:b", "what?", "a*", "<", "a|b", 'a"b'])
def test_names_that_are_refused(drive, name):
    for act in (lambda: (drive / name).write_bytes(b""), lambda: (drive / name).mkdir()):
        refused(123, act)
    assert system.find_name_fault(name)


@pytest.mark.parametrize("name", ["console", "a.con", "nul_", "com10", "com", ".hidden", "a b", "a.b.c", "ü", "Ω"])
def test_names_that_are_taken(drive, name):
    (drive / name).write_bytes(b"")
    assert [path.name for path in drive.iterdir() if path.name != "temp"] == [name]
    assert not system.find_name_fault(name)


def test_full_stops_and_spaces_at_the_end_are_lost(drive):
    for name in ("a.", "a ", "a. ."):
        (drive / name).write_bytes(name.encode())
        assert system.find_name_fault(name)
    assert [path.name for path in drive.iterdir() if path.name != "temp"] == ["a"]


def test_names_have_no_case(drive):
    (drive / "Folder").mkdir()
    (drive / "folder" / "File.TXT").write_bytes(b"1")
    assert (drive / "FOLDER" / "file.txt").read_bytes() == b"1"
    (drive / "Folder" / "FILE.txt").write_bytes(b"2")
    assert [path.name for path in (drive / "Folder").iterdir()] == ["File.TXT"]
    refused(183, lambda: os.rename(drive / "temp", drive / "FOLDER"))
    (drive / "Folder").rename(drive / "FOLDER")
    assert "FOLDER" in os.listdir(drive)


def test_paths_have_at_most_259_characters(drive):
    room = 259 - len(str(drive)) - 1
    (drive / ("a" * room)).write_bytes(b"")
    refused(3, lambda: (drive / ("a" * (room + 1))).write_bytes(b""))
    refused(206, lambda: (drive / ("b" * (room - 11))).mkdir())  # 12 less: a folder has room for a file's name of 8.3
    (drive / ("b" * (room - 12))).mkdir()


def test_text_is_of_the_code_page_unless_said_and_lines_end_in_two_bytes(drive):
    (drive / "a").write_text("µ\n")
    assert (drive / "a").read_bytes() == b"\xb5\r\n"
    with pytest.raises(UnicodeEncodeError):
        (drive / "a").write_text("Ω")
    (drive / "a").write_text("Ω\n", encoding="utf-8", newline="\n")
    assert (drive / "a").read_bytes() == "Ω\n".encode()


def test_looking_at_a_process_by_a_signal_is_a_fault(layer):
    """os.kill of Windows: CTRL_C_EVENT is 0; every other number is TerminateProcess."""
    with pytest.raises(OSError, match="denied"):
        os.kill(os.getpid(), 0)
    assert layer.all_faults()
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    os.kill(process.pid, signal.SIGTERM)
    assert process.wait(60) == -9
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    process.terminate()
    assert process.wait(60) == -9


def test_what_windows_lacks_is_absent(layer):
    assert not any(hasattr(os, name) for name in ("fork", "getuid", "killpg", "setsid", "sched_getaffinity"))
    assert not hasattr(signal, "SIGKILL")
    with pytest.raises(ImportError):
        import fcntl  # noqa: F401
    with pytest.raises(ImportError):
        import resource  # noqa: F401
    with pytest.raises(ValueError, match="out of range"):
        signal.signal(10, signal.SIG_DFL)
    with pytest.raises(ValueError, match="preexec_fn"):
        subprocess.Popen(["x"], preexec_fn=print)
    with pytest.raises(OSError, match="privilege"):
        os.symlink("a", Path(layer.drive) / "b")


def test_a_script_is_no_program(drive):
    (drive / "run").write_bytes(b"#!/bin/sh\nexit 0\n")
    (drive / "run").chmod(0o755)
    refused(193, lambda: subprocess.call([str(drive / "run")]))


def test_a_process_lives_under_the_layer_too(drive):
    said = subprocess.run(
        [sys.executable, "-c", f"import os; os.open({str(drive)!r}, os.O_RDONLY)"],
        text=True,
        capture_output=True,
        check=False,
    ).stderr
    assert "PermissionError" in said


def test_folders_are_removed_without_handles_on_them(drive):
    (drive / "a" / "b").mkdir(parents=True)
    (drive / "a" / "b" / "c").write_bytes(b"")
    with (drive / "a" / "b" / "c").open("rb"):
        refused(32, lambda: shutil.rmtree(drive / "a"))
    shutil.rmtree(drive / "a")
    with tempfile.TemporaryDirectory() as folder:
        assert folder.startswith(str(drive))


def test_taskkill_ends_what_a_process_has_started(layer, drive):
    program = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        "print(child.pid, flush=True); time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    child = int(process.stdout.readline())
    subprocess.run(["taskkill", "/T", "/F", "/PID", str(process.pid)], check=True)
    process.wait(60)
    layer.remove()
    wait_until(
        lambda: not Path(f"/proc/{child}").exists()
        or Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    )


def test_it_comes_off_again(layer):
    before = layer._real[os, "open"]
    layer.remove()
    assert os.open is before
    assert hasattr(os, "fork")
    assert threading.active_count() >= 1
    assert sys.platform == system.PLATFORM
