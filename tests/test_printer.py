"""The one printer: what it shows, what it survives, and that nothing is printed past it."""

from __future__ import annotations

import ast
import errno
import io
import json
import os
import shlex
import subprocess
import sys
from typing import Any

import pytest
from icymoon.support import printer
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import escape_cell
from icymoon.support.terminal import Parser, report_end, run_verb, show_count, show_counted_progress, show_progress
from sources import ROOT, SOURCES, check_each, tree_of

#: A name as a stranger may give it: clears the screen, sets the title, is markup, turns the direction, ends a line.
HOSTILE = "q\x1b[2J\x1b]0;x\x07[/b][red]\u202e\x9b\x7f\u2066\r\n\ud800é"
SHOWN = r"q\x1b[2J\x1b]0;x\x07[/b][red]\u202e\x9b\x7f\u2066\r\n\ud800é"


def test_what_steers_a_terminal_is_shown():
    assert printer.show_controls(HOSTILE) == SHOWN
    assert printer.show_controls("a b\u00a0ü 冰 👩\u200d🚀") == "a b\u00a0ü 冰 👩\u200d🚀"
    assert printer.show_lines(f"a\n{HOSTILE}\n") == f"a\n{SHOWN.replace(chr(92) + 'n', chr(10))}\n"
    assert escape_cell(f"={HOSTILE}") == f"'={SHOWN}"


@pytest.mark.parametrize(
    "number", [*range(0x100), 0x61C, 0x200E, 0x200F, *range(0x2028, 0x202F), *range(0x2066, 0x206A), 0xD800, 0xDFFF]
)
def test_each_control_character_becomes_visible(number):
    shown = printer.show_controls(chr(number))
    assert shown == chr(number) if 0x20 <= number < 0x7F or 0xA0 <= number < 0x100 else shown.startswith("\\")
    shown.encode()


class Stream(io.StringIO):
    """A standard stream that fails as real ones do."""

    def __init__(self, error: Exception | None = None, encoding: str = "utf-8", terminal: bool = False) -> None:
        super().__init__()
        self.error, self.coding, self.terminal = error, encoding, terminal

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self.coding

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str) -> int:
        if self.error:
            raise self.error
        text.encode(self.coding)
        return super().write(text)


def closed() -> io.StringIO:
    stream = io.StringIO()
    stream.close()
    return stream


def print_everything() -> None:
    printer.say(HOSTILE)
    printer.warn(HOSTILE)
    printer.emit("problem", kind="x", text=HOSTILE)
    printer.rewrite_line(HOSTILE)
    printer.print_table((HOSTILE, "b"), [(HOSTILE, ("1 é", "bold"))], HOSTILE, narrowest=200)
    with show_progress(HOSTILE) as show:
        show({"type": "progress", "fraction": 0.5, "message": HOSTILE})
        for message in (
            {"type": "warning", "message": HOSTILE},
            {"type": "pair", "folder": HOSTILE, "seconds": 1.0, "rendered": True},
            {"type": "error", "pair": HOSTILE, "message": HOSTILE},
            {"type": "done"},
        ):
            show(message)
    with show_counted_progress(HOSTILE) as count:
        count({"type": "progress", "done": 1, "total": 2, "message": HOSTILE})
        count({"type": "warning", "message": HOSTILE})
    with show_count(HOSTILE) as told:
        told(1, 2)
    printer.flush()


STREAMS = {
    "absent": lambda: None,
    "closed": closed,
    "ascii": lambda: Stream(encoding="ascii"),
    "number closed": lambda: Stream(OSError(errno.EBADF, "Bad file descriptor")),
    "ascii terminal": lambda: Stream(encoding="ascii", terminal=True),
    "terminal": lambda: Stream(terminal=True),
}


@pytest.mark.parametrize("kind", STREAMS)
def test_a_stream_that_is_absent_closed_or_ascii_stops_nothing(monkeypatch, kind):
    out, err = STREAMS[kind](), STREAMS[kind]()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    print_everything()
    if "closed" not in kind and out is not None:
        said = out.getvalue() + err.getvalue()
        assert SHOWN.replace("é", r"\xe9" if "ascii" in kind else "é") in "".join(said.split("\n"))
        for control in ("\x1b[2J", "\x1b]0", "\x07", "\u202e", "\x9b", "\x7f", "\u2066", "\ud800"):
            assert control not in said


def test_who_reads_no_more_ends_the_program_quietly(monkeypatch):
    for broken, still in (("stdout", "stderr"), ("stderr", "stdout")):
        monkeypatch.setattr(sys, broken, Stream(BrokenPipeError(errno.EPIPE, "Broken pipe")))
        monkeypatch.setattr(sys, still, Stream())
        if broken == "stderr":
            printer.warn("nobody hears it")
            with show_counted_progress("a") as show:
                show({"type": "warning", "message": "nobody hears it"})
            continue
        for act in (lambda: printer.say("a", at_once=True), lambda: printer.emit("a")):
            with pytest.raises(BrokenPipeError) as raised:
                act()
            assert report_end(raised.value, "icymoon", "stopped") == 1
        assert sys.stderr.getvalue() == ""  # type: ignore[union-attr]


def test_a_full_disk_is_told(monkeypatch, capsys):
    monkeypatch.setattr(sys, "stdout", Stream(OSError(errno.ENOSPC, "No space left on device")))
    parser = Parser()
    parser.set_defaults(run=lambda options: printer.say("a"))
    assert run_verb(parser, [], "icymoon", "stopped") == 1
    assert "No space left" in capsys.readouterr().err


def test_numbers_that_json_lacks_are_null(capsys):
    printer.emit_json({"a": [float("nan"), (1.5, float("inf"))], "b": {"c": -float("inf")}, "d": "\x7f\u202e"})
    said = capsys.readouterr().out
    assert json.loads(said) == {"a": [None, [1.5, None]], "b": {"c": None}, "d": "\x7f\u202e"}
    assert said.isascii()
    assert said.strip().isprintable()


def test_a_wrong_word_of_the_command_line_is_shown(capsys):
    with pytest.raises(SystemExit):
        Parser(prog="icymoon").parse_args([HOSTILE])
    said = capsys.readouterr().err
    assert said.splitlines()[-1] == f"icymoon: error: unrecognized arguments: {SHOWN}"


def test_an_error_is_told_once_before_it_is_printed(capsys):
    def fail(options: Any) -> int:
        raise IcyMoonError(f"a\n{HOSTILE} b")

    parser, told = Parser(), []
    parser.set_defaults(run=fail)
    assert run_verb(parser, [], "icymoon", "stopped", lambda options, error: told.append(str(error))) == 1
    assert told == [f"a\n{HOSTILE} b"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].isprintable()


# Streams of real processes

#: Shell words that leave a process without a stream, or with one of few characters.
LACKS = {"stdout": ">&-", "stderr": "2>&-", "stdin": "<&-", "all": "<&- >&- 2>&-", "ascii": ""}
_ASCII = {"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}


def run_in_shell(words: list[str], lacks: str, folder: Any) -> subprocess.CompletedProcess[bytes]:
    """Run icymoon by a shell, without a stream."""
    command = f"{shlex.join([sys.executable, '-m', *words])} {LACKS[lacks]}"
    return subprocess.run(
        ["/bin/sh", "-c", command],
        capture_output=True,
        cwd=folder,
        timeout=120,
        check=False,
        env=os.environ | (_ASCII if lacks == "ascii" else {}),
    )


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize("lacks", LACKS)
@pytest.mark.parametrize("module", ["icymoon", "icymoon.stereo"])
def test_a_process_without_a_stream_ends_as_it_should(module, lacks, tmp_path):
    folder = tmp_path / "q\x1b[2J[b]é"
    folder.mkdir()
    verb = ["verify", str(folder)] if module == "icymoon" else ["truth", str(folder), "--out", str(folder / "out")]
    done = run_in_shell([module, *verb], lacks, tmp_path)
    assert done.returncode == 1
    said = done.stdout + done.stderr
    assert b"Traceback" not in said
    assert b"\x1b" not in said
    if lacks not in ("stderr", "all"):
        assert rb"q\x1b[2J[b]" in said


def test_what_is_opened_next_does_not_become_the_output(tmp_path):
    program = (
        "import os, sys\nfrom icymoon.support.printer import open_streams\nopen_streams()\n"
        f"stream = open({str(tmp_path / 'file')!r}, 'w')\nassert stream.fileno() > 2\n"
        "print('a'); print('b', file=sys.stderr); os.write(1, b'c'); os.write(2, b'd')\n"
        "assert os.read(0, 1) == b'' and sys.stdin.read() == ''\nstream.write('mine')\n"
    )
    done = subprocess.run(
        ["/bin/sh", "-c", f"{shlex.join([sys.executable, '-c', program])} <&- >&- 2>&-"],
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0
    assert (tmp_path / "file").read_text() == "mine"


# Nothing is printed past it

#: What still prints by itself, and why that is right.
ALLOWED = {
    "support/printer.py": "the printer",
    "__main__.py": "sys.exit: nothing can be imported yet",
    "library/renderers.py": "warnings.warn: Python prints it where its user wants it",
    "stereo/adapters/icymoon_serve.py": "sys.exit, sys.stdout.flush, traceback.print_exc: runs in a Python without us",
    "stereo/adapters/mitsuba_render.py": "sys.exit: runs in a Python without us",
    "stereo/adapters/run_stereo_matching.py": "argparse.ArgumentParser, sys.exit: runs in a Python without us",
    "render/worker.py": "sys.stderr.flush, sys.stdout.flush, traceback.print_exc: a defect of ours, for its log",
    "render/probe_blender.py": "sys.stdout.flush: the process ends without Python's own flush",
    "operators/job_operators.py": "traceback.print_exc: a defect of ours, beside the sentence in the window",
    "stereo/images/exr.py": "sys.stderr.flush: before its stream is exchanged",
}
_PRINTERS = {"print", "pprint", "print_exc", "print_exception", "Console", "ArgumentParser"}
_QUALIFIED = (
    "sys.stdout.write",
    "sys.stdout.flush",
    "sys.stderr.write",
    "sys.stderr.flush",
    "warnings.warn",
    *(f"logging.{level}" for level in ("debug", "info", "warning", "error", "critical", "exception")),
)


def prints(tree: ast.AST) -> set[str]:
    """What a source uses to print by itself."""
    found = set()
    for node in (each for each in ast.walk(tree) if isinstance(each, ast.Call)):
        text = ast.unparse(node.func)
        words = node.args and not isinstance(node.args[0], ast.Call)
        if text.split(".")[-1] in _PRINTERS or text in _QUALIFIED or (text == "sys.exit" and words):
            found.add(text)
    return found


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("print(a)", {"print"}),
        ("console.print(a)", {"console.print"}),
        ("sys.stdout.write(a)", {"sys.stdout.write"}),
        ("rich.console.Console()", {"rich.console.Console"}),
        ("argparse.ArgumentParser()", {"argparse.ArgumentParser"}),
        ("traceback.print_exc()", {"traceback.print_exc"}),
        ("sys.exit('a')", {"sys.exit"}),
        ("sys.exit(main())", set()),
        ("fingerprint(a)", set()),
        ("say(a)", set()),
        ("logging.warning(a)", {"logging.warning"}),
    ],
)
def test_a_print_is_found(code, found):
    assert prints(ast.parse(code)) == found


@check_each(SOURCES)
def test_everything_is_printed_by_the_printer(path):
    name = path.relative_to(ROOT).as_posix()
    allowed = ALLOWED.get(name, ":").partition(":")[0]
    assert allowed == "the printer" or prints(tree_of(path)) == set(filter(None, allowed.split(", ")))
