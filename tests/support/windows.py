"""A layer under os, io, shutil, subprocess and signal that behaves as Windows does, for what tests do on Linux.

The rules hold for paths inside a drive (a folder), those of handles and processes everywhere. Who has a file open is
asked of the system, so that what libraries and other processes open counts too. Python processes that are started
under the layer live under it as well, see ``prelude``. What would end another process on Windows is a fault: it is
kept in ``Windows.faults``, whatever the code makes of it.

Sources, all of Microsoft's documentation: "Naming Files, Paths, and Namespaces", "Maximum Path Length Limitation",
MoveFileExW, DeleteFileW, CreateFileW (share modes), FlushFileBuffers, _commit, CreateProcessW and its flags,
GenerateConsoleCtrlEvent, TerminateProcess; and of Python's: os.kill, os.rename, os.replace, subprocess on Windows.
"""

from __future__ import annotations

import builtins
import contextlib
import errno
import importlib.abc
import importlib.machinery
import io
import os
import select
import shutil
import signal
import stat
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path, PureWindowsPath
from typing import Any

HERE = Path(__file__).resolve().parent
#: Tells the Python processes that are started under the layer where the drive and the list of processes are.
DRIVE, PROCESSES = "SIMULATED_WINDOWS_DRIVE", "SIMULATED_WINDOWS_PROCESSES"
MAX_PATH = 260  # with the NUL at its end
DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{name}{k}" for name in ("COM", "LPT") for k in "123456789¹²³")}
_FORBIDDEN = set('<>:"|?*') | {chr(k) for k in range(32)}
_CREATE_NEW_PROCESS_GROUP, _CREATE_NO_WINDOW = 0x200, 0x08000000
_ABSENT = {
    os: (
        "fork",
        "forkpty",
        "getuid",
        "geteuid",
        "getgid",
        "getegid",
        "setsid",
        "killpg",
        "getpgid",
        "setpgid",
        "sched_getaffinity",
        "getloadavg",
        "mkfifo",
        "chown",
        "nice",
        "sync",
        "wait",
    ),
    signal: ("SIGKILL", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGSTOP", "SIGCONT", "pthread_kill", "sigwait"),
}  # what times tests stays
_NAMES = {
    5: (errno.EACCES, "Access is denied"),
    32: (errno.EACCES, "The process cannot access the file because it is being used by another process"),
    3: (errno.ENOENT, "The system cannot find the path specified"),
    183: (errno.EEXIST, "Cannot create a file when that file already exists"),
    123: (errno.EINVAL, "The filename, directory name, or volume label syntax is incorrect"),
    206: (errno.ENOENT, "The filename or extension is too long"),
    193: (errno.ENOEXEC, "%1 is not a valid Win32 application"),
    109: (errno.EPIPE, "The pipe has been ended"),
    87: (errno.EINVAL, "The parameter is incorrect"),
}


def error(number: int, path: Any = None) -> OSError:
    """An OSError as Windows' number of it becomes."""
    code, text = _NAMES[number]
    found = OSError(code, text, path)
    found.winerror = number  # type: ignore[attr-defined]
    return found


class Windows:
    """The layer: ``install`` puts it on, ``remove`` takes it off."""

    def __init__(self, drive: Path, processes: Path) -> None:
        self.drive, self.processes = os.path.realpath(drive), str(processes)
        self.faults: list[str] = []
        #: Of the processes that were started: what they run, and whether a console window appears with them where
        #: there is none, and whether our Ctrl-C reaches them.
        self.started: list[tuple[list[str], bool, bool]] = []
        self._real: dict[tuple[Any, str], Any] = {}

    # Putting on and off

    def install(self) -> None:
        """Put it on; off again if that fails."""
        try:
            self._install()
        except BaseException:
            self.remove()
            raise

    def _install(self) -> None:
        os.makedirs(self.processes, exist_ok=True)
        self._register(os.getpid())
        for module, names in _ABSENT.items():
            for name in names:
                self._patch(module, name, None)
        for name in (
            "rename",
            "replace",
            "unlink",
            "remove",
            "mkdir",
            "rmdir",
            "open",
            "stat",
            "lstat",
            "listdir",
            "scandir",
            "utime",
            "fsync",
            "kill",
            "access",
            "chmod",
            "symlink",
        ):
            self._patch(os, name, getattr(self, f"_{name}"))
        for module in (io, builtins):
            self._patch(module, "open", self._text_open)
        self._patch(shutil, "_use_fd_functions", False)
        for name in ("__init__", "send_signal", "kill", "terminate"):
            self._patch(subprocess.Popen, name, self._of_popen(name))
        for name, number in (("CTRL_C_EVENT", 0), ("CTRL_BREAK_EVENT", 1), ("SIGBREAK", 21)):
            self._patch(signal, name, number)
        self._patch(signal, "signal", self._signal)
        self._patch(signal, "raise_signal", lambda number: self._do("kill", os.getpid(), number))
        modules: dict[str, Any] = {
            "msvcrt": types.SimpleNamespace(LK_NBLCK=2, locking=self._locking, get_osfhandle=lambda handle: handle),
            "_winapi": types.SimpleNamespace(
                PeekNamedPipe=self._peek,
                OpenProcess=self._open_process,
                SYNCHRONIZE=0x100000,
                WaitForSingleObject=self._wait,
                WAIT_OBJECT_0=0,
                CloseHandle=lambda handle: None,
            ),
            "fcntl": None,
            "resource": None,
            "pwd": None,
        }
        for name, module in modules.items():
            self._real["modules", name] = sys.modules.get(name)
            sys.modules[name] = module
        if "icymoon.support.system" in sys.modules:
            self._patch(sys.modules["icymoon.support.system"], "PLATFORM", "win32")

    def remove(self) -> None:
        for (owner, name), real in reversed(self._real.items()):
            if owner == "modules":
                if real is None:
                    del sys.modules[name]
                else:
                    sys.modules[name] = real
            elif real is _MISSING:
                delattr(owner, name)
            else:
                setattr(owner, name, real)
        self._real.clear()

    def _patch(self, owner: Any, name: str, value: Any) -> None:
        real = owner.__dict__.get(name, _MISSING)
        if value is None and real is _MISSING:
            return
        self._real[owner, name] = real
        if value is None:
            delattr(owner, name)
        else:
            setattr(owner, name, value)

    def _do(self, name: str, *arguments: Any, **options: Any) -> Any:
        return self._real[os, name](*arguments, **options)

    # Paths

    def _inside(self, path: Any) -> str | None:
        """The absolute path if it is on the drive; None of handles and of what is elsewhere."""
        if isinstance(path, int) or path is None:
            return None
        whole = os.path.abspath(os.fsdecode(path))
        if whole.startswith("/proc/"):
            raise error(3, path)
        return whole if whole == self.drive or whole.startswith(self.drive + "/") else None

    def _path(self, path: Any, folder: bool = False) -> Any:
        """The path that Windows takes for this one: names without case and without full stops at their end."""
        whole = self._inside(path)
        if whole is None or whole == self.drive:
            return path
        if len(whole) >= MAX_PATH - (12 if folder else 0):  # a folder leaves room for a file of 8.3
            raise error(206 if folder else 3, path)
        found = self.drive
        for name in whole[len(self.drive) + 1 :].split("/"):
            if set(name) & _FORBIDDEN or name.split(".")[0].rstrip().upper() in DEVICES:
                raise error(123, path)
            name = name.rstrip(". ")
            if not self._there(f"{found}/{name}"):
                name = next((other for other in self._names(found) if other.casefold() == name.casefold()), name)
            found = f"{found}/{name}"
        return found

    def _there(self, path: str) -> bool:
        try:
            self._do("lstat", path)
        except OSError:
            return False
        return True

    def _names(self, folder: str) -> list[str]:
        try:
            return list(self._do("listdir", folder))
        except OSError:
            return []

    def _is_folder(self, path: Any) -> bool:
        try:
            return stat.S_ISDIR(self._do("stat", path).st_mode)
        except OSError:
            return False

    # Who has what open

    def _register(self, pid: int) -> None:
        open_ = self._real.get((os, "open"), os.open)
        os.close(open_(f"{self.processes}/{pid}", os.O_CREAT | os.O_WRONLY))

    def _open_files(self, folders: bool = False) -> Iterator[str]:
        for pid in self._names(self.processes):
            links = [f"/proc/{pid}/fd/{handle}" for handle in self._names(f"/proc/{pid}/fd")]
            for link in [*links, *([f"/proc/{pid}/cwd"] if folders else [])]:
                try:
                    path = os.readlink(link)
                except OSError:
                    continue
                if path.startswith(self.drive) and (link.endswith("cwd") or not self._is_folder(path)):
                    yield path

    def _is_open(self, path: str) -> bool:
        real = os.path.join(os.path.realpath(os.path.dirname(path)), os.path.basename(path))
        return any(other == real for other in self._open_files())

    def _holds_open(self, folder: str) -> bool:
        return any(other == folder or other.startswith(folder + "/") for other in self._open_files(folders=True))

    # Calls to the system

    def _rename(self, source: Any, target: Any, **options: Any) -> None:
        self._move(source, target, replace=False)

    def _replace(self, source: Any, target: Any, **options: Any) -> None:
        self._move(source, target, replace=True)

    def _move(self, source: Any, target: Any, replace: bool) -> None:
        if self._inside(source) is None:
            self._do("replace" if replace else "rename", source, target)
            return
        old = self._path(source)
        folder = self._is_folder(old)
        new = self._path(target, folder)
        if not self._there(old):
            raise FileNotFoundError(errno.ENOENT, "The system cannot find the file specified", str(source))
        if folder and self._holds_open(old):
            raise error(5, source)
        if not folder and self._is_open(old):
            raise error(32, source)
        if self._there(new) and old != new:
            if not replace:
                raise error(183, source)
            if folder or self._is_folder(new) or self._is_open(new):
                raise error(5, source)
        # Another case of the same name is another name.
        wanted = os.path.join(os.path.dirname(new), os.path.basename(os.path.abspath(os.fsdecode(target))))
        self._do("rename", old, wanted if old == new else new)

    def _unlink(self, path: Any, **options: Any) -> None:
        if self._inside(path) is None:
            return self._do("unlink", path, **options)
        found = self._path(path)
        if self._is_folder(found):
            raise error(5, path)
        if self._is_open(found):
            raise error(32, path)
        return self._do("unlink", found)

    _remove = _unlink

    def _mkdir(self, path: Any, *rest: Any, **options: Any) -> None:
        self._do("mkdir", self._path(path, folder=True), *rest, **options)

    def _rmdir(self, path: Any, **options: Any) -> None:
        found = self._path(path)
        if self._inside(path) is not None and self._holds_open(found):
            raise error(32, path)
        self._do("rmdir", found, **options)

    def _open(self, path: Any, flags: int, mode: int = 0o777, **options: Any) -> int:
        found = self._path(path)
        if self._is_folder(found):
            raise error(5, path)
        return int(self._do("open", found, flags, mode, **options))

    def _stat(self, path: Any, **options: Any) -> Any:
        return self._do("stat", self._path(path), **options)

    def _lstat(self, path: Any, **options: Any) -> Any:
        return self._do("lstat", self._path(path), **options)

    def _access(self, path: Any, *rest: Any, **options: Any) -> Any:
        return self._do("access", self._path(path), *rest, **options)

    def _chmod(self, path: Any, *rest: Any, **options: Any) -> Any:
        return self._do("chmod", self._path(path), *rest, **options)

    def _listdir(self, path: Any = ".") -> Any:
        return self._do("listdir", self._path(path))

    def _scandir(self, path: Any = ".") -> Any:
        if isinstance(path, int):
            raise TypeError("scandir: path should be string, bytes, os.PathLike or None, not int")
        return self._do("scandir", self._path(path))

    def _utime(self, path: Any, *rest: Any, **options: Any) -> None:
        self._do("utime", self._path(path), *rest, **options)

    def _symlink(self, source: Any, target: Any, *rest: Any, **options: Any) -> None:
        failed = OSError(errno.EINVAL, "A required privilege is not held by the client", str(target))
        failed.winerror = 1314  # type: ignore[attr-defined]
        raise failed

    def _fsync(self, handle: int) -> None:
        number = handle if isinstance(handle, int) else handle.fileno()
        flags = int(
            io.FileIO(self._do("open", f"/proc/self/fdinfo/{number}", os.O_RDONLY))
            .read()
            .split(b"flags:")[1]
            .split()[0],
            8,
        )
        if flags & os.O_ACCMODE == os.O_RDONLY or stat.S_ISDIR(os.fstat(number).st_mode):
            raise OSError(errno.EBADF, "Bad file descriptor")
        self._do("fsync", number)

    def _text_open(
        self,
        file: Any,
        mode: str = "r",
        buffering: int = -1,
        encoding: str | None = None,
        errors: str | None = None,
        newline: str | None = None,
        *rest: Any,
        **options: Any,
    ) -> Any:
        real = self._real[io, "open"]
        if isinstance(file, int):
            return real(file, mode, buffering, encoding, errors, newline, *rest, **options)
        inside = self._inside(file) is not None
        found = self._path(file)
        if inside and self._is_folder(found):
            raise error(5, file)
        if "b" not in mode and inside:
            encoding = "cp1252" if encoding in (None, "locale") else encoding
            newline = "\r\n" if newline is None and set(mode) & set("wax") else newline
        return real(found, mode, buffering, encoding, errors, newline, *rest, **options)

    # Processes

    def _fault(self, text: str) -> None:
        self.faults.append(text)
        with self._real[io, "open"](f"{self.processes}.faults", "a", encoding="utf-8") as stream:
            stream.write(f"{text}\n")

    def _kill(self, pid: int, number: int) -> None:
        if number in (0, 1):  # CTRL_C_EVENT and CTRL_BREAK_EVENT
            what = "would end it if it had our console, and reaches nobody else"
            self._fault(f"os.kill({pid}, {number}) {what}")
            raise error(5)
        self._do("kill", pid, 9)  # TerminateProcess

    def _signal(self, number: int, handler: Any) -> Any:
        if number == 21:
            return None  # Ctrl-Break: nobody presses it here
        if number not in (
            signal.SIGINT,
            signal.SIGTERM,
            signal.SIGABRT,
            signal.SIGFPE,
            signal.SIGILL,
            signal.SIGSEGV,
            signal.SIGALRM,
        ):  # which ends a test that hangs
            raise ValueError("signal number out of range")
        return self._real[signal, "signal"](number, handler)

    def _locking(self, handle: int, mode: int, count: int) -> None:
        fcntl = self._real["modules", "fcntl"] or __import__("fcntl")
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OSError(errno.EACCES, "Permission denied") from None

    def _peek(self, handle: int, size: int = 0) -> tuple[int, int]:
        if not stat.S_ISFIFO(os.fstat(handle).st_mode):
            raise error(5)
        poll = select.poll()
        poll.register(handle, select.POLLIN)
        if any(event & select.POLLHUP for _, event in poll.poll(0)):
            raise error(109)
        return 0, 0

    def _open_process(self, access: int, inherit: bool, pid: int) -> int:
        if not self._there(f"/proc/{pid}"):
            raise error(87)
        return pid

    def _wait(self, handle: int, milliseconds: int) -> int:
        try:
            with self._real[io, "open"](f"/proc/{handle}/stat", encoding="utf-8") as stream:
                ended = stream.read().rsplit(")", 1)[1].split()[0] == "Z"
        except OSError:
            ended = True
        return 0 if ended else 0x102  # WAIT_TIMEOUT

    def _of_popen(self, name: str) -> Callable[..., Any]:
        real = subprocess.Popen.__dict__[name]
        layer = self

        def start(process: Any, args: Any, *rest: Any, **options: Any) -> None:
            assert not rest
            if options.pop("preexec_fn", None) is not None:
                raise ValueError("preexec_fn is not supported on Windows platforms")
            options.pop("start_new_session", None)  # which Windows ignores
            flags = options.pop("creationflags", 0)
            command = [os.fspath(arg) for arg in ([args] if isinstance(args, str) else args)]
            layer.started.append(
                (command, not flags & _CREATE_NO_WINDOW, not flags & (_CREATE_NEW_PROCESS_GROUP | _CREATE_NO_WINDOW))
            )
            if PureWindowsPath(command[0]).name in ("taskkill", "taskkill.exe"):
                layer._taskkill(int(command[command.index("/PID") + 1]))
                command = [sys.executable, "-I", "-S", "-c", ""]
            layer._check_program(command[0])
            if (options.get("text") or options.get("universal_newlines")) and not options.get("encoding"):
                options["encoding"] = "cp1252"
            options["env"] = layer.environment(options.get("env"))
            real(
                process,
                command,
                **options,
                start_new_session=bool(flags & (_CREATE_NEW_PROCESS_GROUP | _CREATE_NO_WINDOW)),
            )
            layer._register(process.pid)

        def end(process: Any) -> None:
            if process.poll() is None:
                layer._do("kill", process.pid, 9)

        def send(process: Any, number: int) -> None:
            if number == signal.SIGTERM:
                end(process)
            elif number in (0, 1):
                layer._fault(f"a console event {number} reaches no process without our console")
            else:
                raise ValueError(f"Unsupported signal: {number}")

        methods: dict[str, Callable[..., Any]] = {"__init__": start, "kill": end, "terminate": end, "send_signal": send}
        return methods[name]

    def environment(self, given: Any) -> dict[str, str]:
        """What a process inherits, so that a Python lives under the layer too."""
        found = {**(os.environ if given is None else given), DRIVE: self.drive, PROCESSES: self.processes}
        found["PYTHONPATH"] = os.pathsep.join(
            [str(HERE / "windows_prelude"), *found.get("PYTHONPATH", "").split(os.pathsep)]
        ).rstrip(os.pathsep)
        return found

    def _check_program(self, program: str) -> None:
        """A script is no program there, whatever its first line; what is called .exe stands for one."""
        found = shutil.which(program) or program
        if found.endswith(".exe") or not os.path.isfile(found):
            return
        with self._real[io, "open"](found, "rb") as stream:
            if stream.read(2) == b"#!":
                raise error(193, program)

    def _taskkill(self, pid: int) -> None:
        """End a process and all that it has started, as taskkill /T /F does."""
        for child in self._children(pid):
            self._taskkill(child)
        with contextlib.suppress(ProcessLookupError):
            self._do("kill", pid, 9)

    def _children(self, pid: int) -> list[int]:
        try:
            with self._real[io, "open"](f"/proc/{pid}/task/{pid}/children", encoding="ascii") as stream:
                return [int(word) for word in stream.read().split()]
        except OSError:
            return []

    def all_faults(self) -> list[str]:
        """Of this process and of those that it has started."""
        path = f"{self.processes}.faults"
        if not self._there(path) if self._real else not os.path.exists(path):
            return []
        with (self._real.get((io, "open")) or io.open)(path, encoding="utf-8") as stream:
            return stream.read().splitlines()


_MISSING = object()


class _Finder(importlib.abc.MetaPathFinder):
    """Has our module of systems believe that this is Windows, as soon as it is loaded."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> Any:
        if name != "icymoon.support.system":
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        assert spec is not None
        load = spec.loader.exec_module  # type: ignore[union-attr]

        def exec_module(module: types.ModuleType) -> None:
            load(module)
            module.PLATFORM = "win32"  # type: ignore[attr-defined]

        spec.loader.exec_module = exec_module  # type: ignore[union-attr,method-assign]
        return spec


def prelude() -> None:
    """Put the layer on in a process that was started under it."""
    if DRIVE in os.environ:
        import _posixsubprocess  # noqa: F401  before its absence could be noticed
        import asyncio  # noqa: F401
        import pathlib  # noqa: F401
        import tempfile  # noqa: F401

        for stream in (sys.stdout, sys.stderr):  # into a file or a pipe Python writes in the code page
            stream.reconfigure(encoding="cp1252", errors=stream.errors)  # type: ignore[union-attr]
        Windows(Path(os.environ[DRIVE]), Path(os.environ[PROCESSES])).install()
        sys.meta_path.insert(0, _Finder())


def wait_until(done: Callable[[], bool], seconds: float = 60.0) -> None:
    """Wait for something that is to happen."""
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)
