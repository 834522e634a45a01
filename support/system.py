"""All differences between Windows, macOS and Linux. Imports no Blender.

Files: flushing, replacing and removing files that other programs have open, locks, names and lengths of paths.
Processes: starting a process without a window, stopping it, ending with the process that started this one.
"""

from __future__ import annotations

import errno
import math
import os
import re
import shlex
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path, PureWindowsPath
from typing import IO, Any, TypeVar

from .errors import IcyMoonError

PLATFORM = sys.platform
#: Temporary errors: of a network share, or of a call that a signal has interrupted.
_TEMPORARY_ERRORS = {errno.EIO, errno.ESTALE, errno.EAGAIN, errno.ETIMEDOUT, errno.EINTR}
#: Waits in seconds before another attempt, 13 s in all; a share that is away for longer is a failure.
_RETRY_WAITS_S = (0.02, 0.08, 0.3, 1.0, 3.0, 8.6)
#: Number of these waits for a file that another program has open, 1.4 s in all. Windows reports the same error for a
#: write-protected file.
_BUSY_RETRIES = 4
#: Flag of Windows' CreateProcess, which Python names on Windows only: a new group of processes.
_WINDOWS_NEW_GROUP = 0x200
#: Flag: no console window.
_WINDOWS_NO_WINDOW = 0x08000000
#: Windows' error of OpenProcess for a number that no process has.
_NO_SUCH_PROCESS = 87
#: Longest path that Windows accepts from programs without support for long paths.
LONGEST_WINDOWS_PATH = 259
_DEVICE_NAMES = {
    "CON",
    "PRN",
    "AUX",
    "NUL",
    "CONIN$",
    "CONOUT$",
    *(f"{device}{n}" for device in ("COM", "LPT") for n in "123456789¹²³"),
}
#: Environment variable that states when a process of ours must stop: at the end of its standard input (-), or as soon
#: as a file of this name exists.
_STOP_VARIABLE = "ICYMOON_STOP"
#: Environment of a process that computes with images. By default glibc returns the memory of each array to Linux and
#: requests it again, which takes a tenth of the processor time. These values keep the memory of arrays below 32 MiB.
KEEPS_MEMORY = {"MALLOC_MMAP_THRESHOLD_": str(2**25), "MALLOC_TRIM_THRESHOLD_": str(2**29)}
#: Address space of a thread in bytes: its stack, and the part of the heap that glibc keeps for it.
_BYTES_PER_THREAD = 2**27 + 2**26
#: Increase of niceness of a program of low priority.
_NICENESS_STEP = 10
#: Class of Windows for the same priority.
_WINDOWS_BELOW_NORMAL = 0x4000
#: Seconds between looks at another process or file.
_POLL_S = 0.25
#: Seconds in which a process may end by itself.
_GRACE_S = 3.0
_Result = TypeVar("_Result")


def is_windows() -> bool:
    """Return whether this is Windows."""
    return PLATFORM == "win32"


# Files


def flush(path: Path) -> None:
    """Flush a file, or the entries of a folder, to the disk."""
    folder = path.is_dir()
    if folder and is_windows():
        return  # Windows has no handle on a folder to flush
    handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)  # Windows flushes only what may be written to
    try:
        flush_handle(handle)
    except OSError as error:
        if not folder or error.errno not in (errno.EINVAL, errno.ENOTSUP):  # some network drives flush no folder
            raise
    finally:
        os.close(handle)


def flush_handle(handle: int) -> None:
    """Flush an open file to the disk. On macOS also empties the cache of the disk, which fsync does not."""
    if PLATFORM == "darwin":
        import fcntl

        with suppress(OSError):  # not every network drive can do this
            fcntl.fcntl(handle, getattr(fcntl, "F_FULLFSYNC"))  # noqa: B009  mypy knows it on macOS only
            return
    os.fsync(handle)


def open_regular(path: Path) -> IO[bytes]:
    """Open a regular file for reading. Raises OSError for any other, such as a pipe or a device, which could block its
    reader."""
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
    irregular = OSError(errno.EINVAL, "it is not a regular file", str(path))
    try:
        handle = os.open(path, flags)
    except OSError as error:
        raise (irregular if error.errno == errno.ENXIO else error) from None  # a socket
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise irregular
    return os.fdopen(handle, "rb")


def retry(act: Callable[[], _Result]) -> _Result:
    """Return the result of ``act``. After a temporary error it is tried again, for some seconds."""
    for n, wait_s in enumerate(_RETRY_WAITS_S):
        try:
            return act()
        except OSError as error:
            if error.errno not in _TEMPORARY_ERRORS and not (may_be_open_elsewhere(error) and n < _BUSY_RETRIES):
                raise
        time.sleep(wait_s)
    return act()


def may_be_open_elsewhere(error: OSError) -> bool:
    """Return whether an error may be due to another program that has the file open, such as a virus scanner or a
    viewer. Windows reports the same error for write-protected files."""
    return is_windows() and isinstance(error, PermissionError)


def rename(source: Path, target: Path) -> None:
    """Rename a file or a folder."""
    retry(lambda: os.rename(source, target))


def replace(source: Path, target: Path) -> None:
    """Rename a file to ``target``, in place of an existing file."""
    retry(lambda: os.replace(source, target))


def remove(path: Path) -> None:
    """Remove a file, if it exists."""
    retry(lambda: path.unlink(missing_ok=True))


def remove_folder(path: Path) -> None:
    """Remove a folder with its content, if it exists; files that cannot be removed stay."""
    with suppress(OSError):
        retry(lambda: shutil.rmtree(path))
        return
    shutil.rmtree(path, ignore_errors=True)


def is_broken_pipe(error: OSError) -> bool:
    """Return whether an error means that the reader of the printed output has ended; Windows then reports an invalid
    argument."""
    return isinstance(error, BrokenPipeError) or (
        is_windows() and error.errno == errno.EINVAL and error.filename is None
    )


def lock(path: Path) -> IO[bytes] | None:
    """Open and lock a file for this process, and make it if it is missing; None if another process has locked it."""
    stream = path.open("a+b")
    try:
        if is_windows():
            import msvcrt

            stream.seek(0)
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        stream.close()
        return None
    return stream


def lock_for_child(path: Path) -> IO[bytes] | None:
    """Lock a file as ``lock`` does, for use as the standard input of another process, which then holds it until it
    ends."""
    if not is_windows():
        return lock(path)
    return None if is_lock_held(path) else path.open("a+b")


def is_lock_held(path: Path) -> bool:
    """Return whether a living process has the lock of ``lock_for_child``."""
    if is_windows():  # Windows' locks are not inherited, but an open file cannot be renamed there
        try:
            path.rename(path)
        except FileNotFoundError:
            return False
        except PermissionError:
            return True
        return False
    stream = lock(path)
    if stream is None:
        return True
    stream.close()
    return False


# Names and paths


def check_path(path: Path, deepest: Path | None = None) -> None:
    """On Windows, raise IcyMoonError for a path that it does not accept, or whose longest part ``deepest`` it does not
    accept."""
    if not is_windows():
        return
    whole = PureWindowsPath(os.path.abspath(path))
    for name in whole.parts[1:]:
        if fault := find_name_fault(name):
            raise IcyMoonError(f"{path}: Windows takes no name such as {name!r} ({fault}); choose another one.")
    length = len(os.path.abspath(deepest or path))
    if length > LONGEST_WINDOWS_PATH and not _allows_long_paths():
        raise IcyMoonError(
            f"{path}: the path to write has {length} characters, and Windows takes {LONGEST_WINDOWS_PATH}; "
            "choose a folder with a shorter path."
        )


def find_name_fault(name: str) -> str:
    """Find why Windows accepts no file of this name; empty if it does."""
    if wrong := [c for c in name if c in '<>:"/\\|?*' or ord(c) < 32]:
        return f"with {wrong[0]!r}"
    if name.endswith((".", " ")) and name.strip("."):
        return "that ends in a full stop or a space"
    if name.split(".")[0].rstrip().upper() in _DEVICE_NAMES:
        return "of a device"
    return ""


def _allows_long_paths() -> bool:
    """Return whether Windows lets this program use long paths."""
    import ctypes

    try:
        return bool(ctypes.WinDLL("ntdll").RtlAreLongPathsEnabled())
    except (AttributeError, OSError):  # before Windows 10 of 2016
        return False


def find_computer_name() -> str:
    """Return the name of this computer."""
    return socket.gethostname()


def find_user_key() -> str:
    """Return a text that separates the users of this computer in a shared folder."""
    return str(os.getuid()) if hasattr(os, "getuid") else "user"


def belongs_to_user(path: Path) -> bool:
    """Return whether a file or folder belongs to this user. On Windows always true, because folders of other users are
    hidden there."""
    return not hasattr(os, "getuid") or path.stat().st_uid == os.getuid()


def find_cache_folder() -> Path:
    """Find the folder for data that the user's programs can recreate."""
    home = Path.home()
    usual = {"win32": ("LOCALAPPDATA", home / "AppData" / "Local"), "darwin": ("", home / "Library" / "Caches")}
    variable, otherwise = usual.get(PLATFORM, ("XDG_CACHE_HOME", home / ".cache"))
    return Path(os.environ.get(variable) or otherwise)


# Libraries

#: Desktop packages that Blender as a module needs and that a server or a container may lack, by system.
BLENDER_NEEDS = {
    "Debian and Ubuntu": "sudo apt install libegl1 libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 "
    "libxkbcommon0 libxrender1 libxt6 libxxf86vm1",
    "Fedora": "sudo dnf install libICE libSM libX11 libXext libXfixes libXi libXrender libXt libXxf86vm libglvnd-egl "
    "libglvnd-glx libxkbcommon",
}
_MISSING_LIBRARY = re.compile(r"(\S+?\.so[.\d]*): cannot open shared object file|Library not loaded: (\S+)")


def explain_missing_library(error: str) -> str:
    """Return a sentence on a missing system library that Blender as a module needs, and how to get it; empty for
    another error."""
    if "DLL load failed" in error:
        return (
            "Windows lacks a library that Blender needs; install Microsoft Visual C++ Redistributable 2015-2022 "
            "(x64), and on Windows Server its feature Media Foundation."
        )
    found = _MISSING_LIBRARY.search(error)
    if found is None:
        return ""
    name = found[1] or found[2]
    if PLATFORM == "darwin":
        return (
            f"Blender does not find its library {name}; macOS brings all that it needs, so update macOS and "
            f"install Blender again: {sys.executable} -m pip install --force-reinstall bpy."
        )
    ways = ", or ".join(f"{command} ({system})" for system, command in BLENDER_NEEDS.items())
    return f"This system lacks {name}, which Blender needs; install what it needs of a desktop: {ways}."


# Pythons and commands


def find_venv_python(folder: Path) -> Path:
    """Return the Python of a virtual environment."""
    return folder / ("Scripts/python.exe" if is_windows() else "bin/python")


def find_pythons(prefix: Path) -> list[Path]:
    """Find possible Pythons outside Blender: in the installation at ``prefix``, and on the search path."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    names = ("python", "py") if is_windows() else ("python3",)
    found = [Path(path) for name in names if (path := shutil.which(name))]
    # Windows looks in the current folder first, which may be anyone's.
    found = [path for path in found if not is_windows() or path.resolve().parent != Path.cwd()]
    own = ("python.exe", "bin/python.exe") if is_windows() else (f"bin/python{version}",)
    return [*(prefix / path for path in own), *found]


def is_python(executable: str) -> bool:
    """Return whether a program has a name of Python, including the ``py`` of Windows."""
    stem = Path(executable).stem.lower()
    return stem == "py" or stem.startswith("python")


def split_command(text: str) -> list[str]:
    """Split a command as typed into its arguments. Raises ValueError for an unclosed quote."""
    words = shlex.shlex(text, posix=True)
    words.whitespace_split, words.commenters = True, ""
    if is_windows():
        words.escape = ""  # Windows' paths contain backslashes
    return list(words)


# Processes


def count_processors() -> int:
    """Count the processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def measure_peak_memory_mib() -> float | None:
    """Measure the peak memory of this process in MiB; None on Windows, where Python cannot measure it."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak / (2**20 if PLATFORM == "darwin" else 2**10), 1)


def measure_peak_memory_mib_of(pid: int) -> float | None:
    """Measure the peak memory in MiB of another process; None except on Linux."""
    try:
        with open(f"/proc/{pid}/status", encoding="ascii", errors="replace") as stream:
            return next((int(line.split()[1]) / 1024 for line in stream if line.startswith("VmHWM:")), None)
    except OSError:
        return None


@contextmanager
def bound_memory_and_time(memory: int, cpu_s: float | None = None) -> Iterator[None]:
    """Bound memory and processor time of this process inside the ``with`` statement, on Linux only.

    Allocating fails beyond ``memory`` more bytes than now and room for the threads of a library. With ``cpu_s``, the
    process ends after this many more processor seconds, see ``is_ended_by_time_limit``.
    """
    if PLATFORM != "linux":
        yield
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most_bytes = pages * resource.getpagesize() + memory + _BYTES_PER_THREAD * count_processors()
    limits = {resource.RLIMIT_AS: most_bytes, resource.RLIMIT_CORE: 0}
    if cpu_s is not None:
        used_s = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        limits[resource.RLIMIT_CPU] = math.ceil(used_s + cpu_s)  # whole seconds
    before = {which: resource.getrlimit(which) for which in limits}
    for which, most in limits.items():
        soft, hard = before[which]
        given = [each for each in (soft, hard, most) if each != resource.RLIM_INFINITY]
        resource.setrlimit(which, (min(given), hard))
    try:
        yield
    finally:
        for which, limit in before.items():
            resource.setrlimit(which, limit)


def is_ended_by_time_limit(status: int) -> bool:
    """Return whether a process with this exit status exceeded the time of ``bound_memory_and_time``."""
    return hasattr(signal, "SIGXCPU") and status == -signal.SIGXCPU


def run(
    command: Sequence[str], environment: Mapping[str, str] | None = None, timeout_s: float | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, without a window, and return its output.

    The program and all that it has started end when we are interrupted. Raises OSError if it cannot start, and
    TimeoutError if it takes longer than ``timeout_s``.
    """
    process = start(command, environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    begun = time.monotonic()
    try:
        while True:  # Windows does not interrupt a waiting thread
            with suppress(subprocess.TimeoutExpired):
                said = [text.decode("utf-8", "replace") for text in process.communicate(timeout=_POLL_S)]
                return subprocess.CompletedProcess(list(command), process.returncode, *said)
            if timeout_s is not None and time.monotonic() - begun > timeout_s:
                raise TimeoutError(f"{command[0]} took more than {timeout_s:g} s")
    finally:
        if process.poll() is None:
            kill_all(process)


#: Products of matrices in our programs are short. The other threads of numpy's OpenBLAS would only wait and use a
#: quarter of the processor time of a pair's truth. A user who states the variable overrides this value.
_ONE_BLAS_THREAD = {"OPENBLAS_NUM_THREADS": "1"}


def start(
    command: Sequence[str], environment: Mapping[str, str] | None = None, **streams: Any
) -> subprocess.Popen[bytes]:
    """Start a program without a window that our Ctrl-C does not reach; ``streams`` are as for subprocess.Popen. Raises
    OSError if it cannot start."""
    apart: dict[str, Any] = (
        {"creationflags": _WINDOWS_NEW_GROUP | _WINDOWS_NO_WINDOW} if is_windows() else {"start_new_session": True}
    )
    return subprocess.Popen(list(command), env=environment, **{"stdin": subprocess.DEVNULL, **streams, **apart})


def start_dependent(command: Sequence[str], environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Start a program as ``start`` does. The program calls ``stop_with_starter``, so it ends when this process ends.
    Its standard error goes to its standard output.
    """
    return start(
        command,
        _stop_environment(environment, "-"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )


def start_detached(
    command: Sequence[str], environment: Mapping[str, str] | None, held: IO[bytes], log: IO[bytes], stop: Path
) -> subprocess.Popen[bytes]:
    """Start a program as ``start`` does, which may outlive this process. It holds ``held``, a lock of
    ``lock_for_child``, and writes to ``log``. ``stop`` names the file by which ``interrupt_detached`` stops it."""
    remove(stop)
    told = _stop_environment(environment, str(stop)) if is_windows() else environment
    return start(command, told, stdin=held, stdout=log, stderr=subprocess.STDOUT)


def call_dependent(command: Sequence[str], environment: Mapping[str, str] | None = None) -> int:
    """Run a program that calls ``stop_with_starter`` to its end, with our own output. Returns its exit status."""
    with subprocess.Popen(list(command), stdin=subprocess.PIPE, env=_stop_environment(environment, "-")) as process:
        try:
            return process.wait()
        except BaseException:
            process.kill()
            raise


def _stop_environment(environment: Mapping[str, str] | None, how: str) -> dict[str, str]:
    return {**_ONE_BLAS_THREAD, **(os.environ if environment is None else environment), _STOP_VARIABLE: how}


def interrupt(process: subprocess.Popen[bytes]) -> None:
    """Ask a program of ``start_dependent`` to stop."""
    with suppress(OSError):  # the process has ended just now
        if not is_windows():
            process.send_signal(signal.SIGINT)
        elif process.stdin is not None:
            process.stdin.close()  # no signal reaches a process on another console


def interrupt_detached(pid: int, stop: Path) -> None:
    """Ask a program of ``start_detached``, and all that it has started, to stop. An earlier process may have started
    it."""
    with suppress(OSError):
        if is_windows():
            stop.touch()
        else:
            os.killpg(pid, signal.SIGINT)


def kill_detached(pid: int) -> None:
    """End a program of ``start_detached`` at once, with all that it has started."""
    with suppress(OSError):
        if is_windows():
            os.kill(pid, signal.SIGTERM)  # on Windows this is TerminateProcess
        else:
            os.killpg(pid, signal.SIGKILL)


def kill_all(process: subprocess.Popen[bytes]) -> None:
    """End a program of ``start`` at once, with all that it has started, and wait until it is gone."""
    with suppress(OSError):
        if is_windows():
            # taskkill is started by its full path, because Windows looks for a mere name in the current folder too,
            # which may be anyone's.
            taskkill = PureWindowsPath(os.environ.get("SYSTEMROOT", "C:/Windows"), "System32", "taskkill.exe")
            subprocess.run(
                [str(taskkill), "/T", "/F", "/PID", str(process.pid)],
                capture_output=True,
                check=False,
                creationflags=_WINDOWS_NO_WINDOW,
            )
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)  # the group has the number of the process, and may outlive it
    process.wait()


def lower_priority() -> None:
    """Give other programs priority on the processors."""
    if is_windows():
        import ctypes

        kernel = ctypes.WinDLL("kernel32")
        kernel.SetPriorityClass(kernel.GetCurrentProcess(), _WINDOWS_BELOW_NORMAL)
        return
    with suppress(OSError):  # a system that refuses this is only slower
        os.nice(_NICENESS_STEP)


def stop_with_starter(at_once: bool = False) -> None:
    """Stop when the process that started this one by ``start_dependent`` ends or requests it.

    The stop is as by Ctrl-C, and 3 s later this process ends in any case; with ``at_once`` it ends immediately.
    """
    how = os.environ.pop(_STOP_VARIABLE, "")
    if how:
        threading.Thread(target=_end_as_told, args=(how, at_once), daemon=True).start()


def _end_as_told(how: str, at_once: bool) -> None:
    try:
        if how == "-":
            _wait_for_input_end()
        else:
            while not os.path.exists(how):
                time.sleep(_POLL_S)
    except OSError:  # there is no standard input
        return
    if not at_once:
        if is_windows():
            signal.raise_signal(signal.SIGINT)
        else:
            os.kill(os.getpid(), signal.SIGINT)  # the main thread receives this also while it waits
        time.sleep(_GRACE_S)
    os._exit(1)


def _wait_for_input_end() -> None:
    """Wait for the end of the standard input, a pipe into which nothing is written."""
    if not is_windows():
        while os.read(0, 1):
            pass
        return
    import _winapi
    import msvcrt

    # On Windows, a waiting read would block everything that looks at the pipe, as many libraries do when they are
    # loaded.
    with suppress(BrokenPipeError):
        while True:
            _winapi.PeekNamedPipe(msvcrt.get_osfhandle(0), 0)
            time.sleep(_POLL_S)


def set_stop_handler(handler: Callable[[int, Any], None]) -> None:
    """Call ``handler`` at Ctrl-C, and when a scheduler or the system stops this process."""
    # A shell that starts a program in the background lets it ignore SIGINT; a scheduler sends SIGTERM.
    for name in ("SIGINT", "SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), handler)


def raise_at_interrupt() -> None:
    """Make Ctrl-C raise KeyboardInterrupt, also in Blender, which otherwise handles it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def end_at_interrupt() -> None:
    """Make Ctrl-C end this process immediately."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def silence_interrupts() -> Iterator[None]:
    """While modules load, let Ctrl-C end this process at once and without a message. No work has begun yet, and some
    modules turn a KeyboardInterrupt into another error."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler and threading.current_thread() is threading.main_thread():
        end_at_interrupt()
    yield
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, before)


def find_process_scope() -> str:
    """Find a name of the scope in which a process number is unique; empty if unknown."""
    if PLATFORM == "linux":
        try:
            boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
            return f"{boot} {os.readlink('/proc/self/ns/pid')}"
        except OSError:
            return ""
    return find_computer_name()


def has_ended(pid: int, where: str) -> bool:
    """Return whether a process of the scope ``where``, see ``find_process_scope``, has certainly ended."""
    if not where or where != find_process_scope() or not 0 < pid < 2**31:
        return False
    if is_windows():
        return _is_gone_on_windows(pid)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:
        return False
    try:  # the process has ended but was not waited for yet
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0] == "Z"
    except (OSError, IndexError):
        return False


def _is_gone_on_windows(pid: int) -> bool:
    import _winapi

    try:  # on Windows, os.kill with 0 would end the process; elsewhere it only looks
        handle = _winapi.OpenProcess(_winapi.SYNCHRONIZE, False, pid)
    except OSError as error:
        return getattr(error, "winerror", None) == _NO_SUCH_PROCESS
    try:  # an ended process still exists as long as anybody has a handle on it
        ended = _winapi.WaitForSingleObject(handle, 0)
        return bool(ended == _winapi.WAIT_OBJECT_0)
    finally:
        _winapi.CloseHandle(handle)


def set_utf8_output() -> None:
    """Print in UTF-8, also into a file or a pipe on Windows, so that every character can be printed."""
    for stream in (sys.stdout, sys.stderr):
        if is_windows() and stream is not None and not stream.isatty() and hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
