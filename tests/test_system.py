"""What differs between Windows, macOS and Linux."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from icymoon.support import files, system


@pytest.fixture
def strict(monkeypatch):
    """Windows' rule: what is flushed is open for writing, and is not a folder."""

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


@pytest.mark.parametrize("errno_", [errno.EINVAL, errno.ENOTSUP])
def test_a_network_drive_that_flushes_no_folder_is_no_failure(monkeypatch, tmp_path, errno_):
    def fsync(handle: int) -> None:
        raise OSError(errno_, "")

    monkeypatch.setattr(os, "fsync", fsync)
    system.flush(tmp_path)
    (tmp_path / "a").touch()
    with pytest.raises(OSError, match=rf"Errno {errno_}"):
        system.flush(tmp_path / "a")


@pytest.mark.parametrize("fails", [False, True])
def test_macos_flushes_through_the_disks_own_cache_where_it_can(monkeypatch, tmp_path, fails):
    asked, done = [], []

    def call(handle: int, command: int) -> None:
        asked.append(command)
        if fails:
            raise OSError(errno.ENOTSUP, "")

    monkeypatch.setattr(system, "PLATFORM", "darwin")
    monkeypatch.setattr(fcntl, "F_FULLFSYNC", 51, raising=False)
    monkeypatch.setattr(fcntl, "fcntl", call)
    monkeypatch.setattr(os, "fsync", done.append)
    files.write_text(tmp_path / "a", "x")
    assert set(asked) == {51}
    assert bool(done) == fails


@pytest.mark.parametrize(
    ("platform", "variables", "folder"),
    [
        ("linux", {}, ".cache"),
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x"),
        ("darwin", {}, "Library/Caches"),
        ("win32", {}, "AppData/Local"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local"),
    ],
)
def test_each_system_has_its_cache_folder(monkeypatch, platform, variables, folder):
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(system, "PLATFORM", platform)
    assert system.find_cache_folder() == Path.home() / folder


def test_an_environment_has_its_python_where_the_system_puts_it(monkeypatch):
    assert system.find_venv_python(Path("e")) == Path("e/bin/python")
    monkeypatch.setattr(system, "PLATFORM", "win32")
    assert system.find_venv_python(Path("e")) == Path("e/Scripts/python.exe")


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("python", True),
        ("/usr/bin/python3.11", True),
        ("Python.exe", True),
        ("py.exe", True),
        ("py", True),
        ("pythonw.exe", True),
        ("blender", False),
        ("blender.exe", False),
        ("pypy-blender", False),
        ("", False),
    ],
)
def test_a_python_is_known_by_its_name(name, is_one):
    assert system.is_python(name) == is_one


@pytest.mark.parametrize(
    ("platform", "text", "words"),
    [
        ("linux", r"run.py '{left} a' b\ c", ["run.py", "{left} a", "b c"]),
        (
            "win32",
            r'"C:\Program Files\m\run.exe" --l={left} "a b"',
            [r"C:\Program Files\m\run.exe", "--l={left}", "a b"],
        ),
        ("win32", r'C:\m\run.exe --name="a b" # x', [r"C:\m\run.exe", "--name=a b", "#", "x"]),
        ("win32", r"\\server\share\run.exe {out}", [r"\\server\share\run.exe", "{out}"]),
    ],
)
def test_a_command_is_split_as_one_would_type_it(monkeypatch, platform, text, words):
    monkeypatch.setattr(system, "PLATFORM", platform)
    assert system.split_command(text) == words
    with pytest.raises(ValueError, match="quotation"):
        system.split_command("'open")


def test_a_program_that_takes_too_long_is_an_error_of_the_system():
    with pytest.raises(OSError, match=r"took more than 0\.1 s"):
        system.run([sys.executable, "-c", "import time; time.sleep(60)"], timeout_s=0.1)


def test_what_it_says_is_read_as_utf8():
    done = system.run([sys.executable, "-c", "import sys; sys.stdout.buffer.write('Ω'.encode() + b'\\xff')"])
    assert done.stdout == "Ω\ufffd"


def test_an_error_that_passes_by_itself_is_waited_for_and_others_are_not(monkeypatch):
    waits: list[float] = []
    monkeypatch.setattr(system.time, "sleep", waits.append)

    def failing(times: int, number: int):
        def act() -> str:
            if len(waits) < times:
                raise OSError(number, "x")
            return "done"

        return act

    assert system.retry(failing(5, errno.EIO)) == "done"
    assert 4.0 < sum(waits) < 20.0
    waits.clear()
    with pytest.raises(OSError, match="Errno 13"):
        system.retry(failing(1, errno.EACCES))
    assert not waits
    monkeypatch.setattr(system, "PLATFORM", "win32")
    assert system.retry(failing(3, errno.EACCES)) == "done"
    waits.clear()
    with pytest.raises(OSError, match="Errno 13"):
        system.retry(failing(9, errno.EACCES))
    assert 1.0 < sum(waits) < 2.0  # what may not be written to at all is said soon


def test_nobody_obeys_who_did_not_start_it(monkeypatch):
    """A pipe that ends is a wish only of who has said so."""
    monkeypatch.delenv("ICYMOON_STOP", raising=False)
    code = (
        "import sys; sys.path[:0] = " + repr(sys.path) + "\nfrom icymoon.support import system\nimport time\n"
        "system.stop_with_starter()\ntime.sleep(0.5)\nprint('there')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False, input="")
    assert done.stdout == "there\n"


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_wish_to_stop_is_heard_also_where_a_shell_has_it_ignored(name):
    code = (
        "import signal, sys; sys.path[:0] = " + repr(sys.path) + "\nfrom icymoon.support import system\n"
        "import os, time\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "system.set_stop_handler(lambda *_: (print('heard'), sys.exit(7)))\n"
        f"os.kill(os.getpid(), signal.{name})\ntime.sleep(9)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=False)
    assert (done.returncode, done.stdout) == (7, "heard\n")


def test_ctrl_c_ends_a_worker_at_once_and_is_an_exception_elsewhere():
    for name, status in (("end", -signal.SIGINT), ("raise", 3)):
        code = (
            "import os, signal, sys, time; sys.path[:0] = " + repr(sys.path) + "\n"
            "from icymoon.support import system\n"
            f"system.{name}_at_interrupt()\n"
            "try:\n    os.kill(os.getpid(), signal.SIGINT); time.sleep(9)\n"
            "except KeyboardInterrupt:\n    sys.exit(3)"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == status


@pytest.mark.parametrize(
    ("platform", "error", "said"),
    [
        (
            "linux",
            "libXi.so.6: cannot open shared object file: No such file or directory",
            r"This system lacks libXi\.so\.6, .* libxi6 .* \(Debian and Ubuntu\), or sudo dnf .* libXi .* \(Fedora\)\.",
        ),
        ("linux", "libGL.so.1: cannot open shared object file: No such file", r"lacks libGL\.so\.1, .* libgl1 "),
        (
            "darwin",
            "dlopen(/a/bpy/__init__.so, 2): Library not loaded: @loader_path/lib/libtbb.dylib",
            r"@loader_path/lib/libtbb\.dylib; macOS brings .* update macOS",
        ),
        (
            "win32",
            "DLL load failed while importing bpy: The specified module could not be found.",
            r"Visual C\+\+ Redist",
        ),
        ("linux", "cannot import name 'nothing' from 'bpy'", r"\A\Z"),
        ("linux", "/a/bpy/__init__.so: undefined symbol: xyz", r"\A\Z"),
    ],
)
def test_a_library_that_blender_lacks_is_named_with_its_package(monkeypatch, platform, error, said):
    monkeypatch.setattr(system, "PLATFORM", platform)
    assert re.search(said, system.explain_missing_library(error))


def test_every_library_that_blender_asks_of_the_desktop_is_in_the_packages():
    """As the linker sees it: what the module needs, less the C library and what the module brings."""
    module = Path(sysconfig.get_path("platlib"), "bpy", "__init__.so")
    if not module.is_file():
        pytest.skip("Blender is no module of an environment here")
    listed = subprocess.run(["ldd", str(module)], capture_output=True, text=True, check=True).stdout
    needed = {match[1] for match in re.finditer(r"^\s*lib(\w+?)\.so\S* => (?!.*bpy)", listed, re.MULTILINE)}
    # What each of those brings along, and what every Linux with a Python has.
    needed -= {
        "xcb",
        "Xau",
        "Xdmcp",
        "uuid",
        "bsd",
        "md",
        "GLdispatch",
        "GLX",
        "c",
        "m",
        "dl",
        "pthread",
        "util",
        "rt",
        "gcc_s",
        "crypt",
    }
    assert {"Xi", "SM", "GL"} <= needed
    words = {where: command.lower() for where, command in system.BLENDER_NEEDS.items()}
    for name in needed:
        for where, packages in words.items():
            known = {"gl": ("libgl1", "libglvnd-glx")}.get(name.lower(), (f"lib{name.lower()}",))
            assert any(f" {each}" in packages for each in known), f"{name} is not in what to install on {where}"


def test_a_worker_without_a_library_ends_with_one_sentence(tmp_path):
    """A module bpy that cannot be loaded stands in for Blender's on a bare machine."""
    (tmp_path / "bpy.py").write_text("raise ImportError('libSM.so.6: cannot open shared object file: No such file')\n")
    done = subprocess.run(
        [sys.executable, str(system.__file__.replace("support/system.py", "__main__.py")), "probe"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    message = json.loads(done.stdout.splitlines()[-1])
    assert done.returncode == 1
    assert message["type"] == "error"
    assert "lacks libSM.so.6, which Blender needs" in message["message"]
    assert done.stderr == ""


def test_the_readme_names_the_same_packages():
    page = (Path(system.__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    assert all(command in " ".join(page.split()) for command in system.BLENDER_NEEDS.values())


def test_programs_of_ours_have_one_thread_for_short_products_unless_another_number_is_stated(monkeypatch):
    ask = [sys.executable, "-c", "import os; print(os.environ['OPENBLAS_NUM_THREADS'])"]
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    for environment, threads in ((None, b"1"), ({**os.environ, "OPENBLAS_NUM_THREADS": "3"}, b"3")):
        with system.start_dependent(ask, environment) as process:
            assert process.stdout is not None
            assert process.stdout.read().strip() == threads
