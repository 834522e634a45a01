"""Small defects made on purpose, one at a time, in modules that matter: those that no test notices are listed.

    python tests/mutants.py [MODULE ...]

cosmic-ray makes the mutants. Each is tried in a process of its own, which loads the mutated source in place of the
file, so the files stay as they are and several mutants are tried side by side. (cosmic-ray's own runner writes into
the files that are being worked on; mutmut leaves constants at the top of a module alone.)

``mutants.toml`` says which modules, which tests judge each, and which mutants change nothing that anyone can see.
Results are kept in out/mutants: a mutant that was killed is not tried again until its module changes. Ends with 1
where less than the wanted share is killed.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import hashlib
import importlib.util
import json
import os
import shutil
import signal
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "tests" / "mutants.toml"
OUT = ROOT / "out" / "mutants"
#: One or two defects for each place: a neighbour at the boundary, and the opposite.
OPERATORS = (
    "NumberReplacer",
    "AddNot",
    "ReplaceTrueWithFalse",
    "ReplaceFalseWithTrue",
    "ReplaceAndWithOr",
    "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue",
    "ReplaceContinueWithBreak",
    "ExceptionReplacer",
    "RemoveDecorator",
    "ZeroIterationForLoop",
    "ReplaceUnaryOperator_Delete_USub",
    "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_Invert",
    *(
        f"ReplaceBinaryOperator_{pair}"
        for pair in (
            "Add_Sub",
            "Sub_Add",
            "Mul_Div",
            "Div_Mul",
            "FloorDiv_Div",
            "Mod_Mul",
            "Pow_Mul",
            "BitOr_BitAnd",
            "BitAnd_BitOr",
            "RShift_LShift",
            "LShift_RShift",
        )
    ),
    *(
        f"ReplaceComparisonOperator_{pair}"
        for pair in (
            "Lt_LtE",
            "Lt_GtE",
            "LtE_Lt",
            "LtE_Gt",
            "Gt_GtE",
            "Gt_LtE",
            "GtE_Gt",
            "GtE_Lt",
            "Eq_NotEq",
            "NotEq_Eq",
            "Is_IsNot",
            "IsNot_Is",
        )
    ),
)
WANTED = 0.9
#: How much longer than unmutated code a mutant may take: it may loop for ever, and the machine may be busy.
PATIENCE, MIN_S = 8.0, 60.0
KILLED, SURVIVED, TIMEOUT = "killed", "survived", "timeout"


@dataclass(frozen=True)
class Mutant:
    """A changed source; told from others by the lines that differ and the function or class that they are in."""

    where: str
    was: str
    now: str
    source: str

    @property
    def name(self) -> str:
        return json.dumps([self.where, self.was, self.now], ensure_ascii=False)

    @property
    def rank(self) -> str:
        """What samples are drawn by: the same mutants each time."""
        return hashlib.sha256(self.name.encode()).hexdigest()


def bare(source: str) -> str:
    """What acts of a source: without annotations, which nothing evaluates, and zip's ``strict``, an assertion."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            node.returns = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
        elif isinstance(node, ast.Call):
            node.keywords = [each for each in node.keywords if each.arg != "strict"]
    return ast.dump(tree)


def place_of(source: str, line: int) -> str:
    """The innermost function or class of a line."""
    found = [
        node
        for node in ast.walk(ast.parse(source))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
        and min([node.lineno, *(d.lineno for d in node.decorator_list)]) <= line <= (node.end_lineno or 0)
    ]
    return ".".join(node.name for node in sorted(found, key=lambda node: node.lineno))


def mutants_of(source: str) -> list[Mutant]:
    """Every mutant of a source that differs from it, each once."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.operators.provider import OperatorProvider

    known, found, names = {bare(source)}, [], set()
    nodes = list(ast_nodes(get_ast(source)))
    for name in OPERATORS:
        operator = OperatorProvider()[name]()
        places = sum(len(list(operator.mutation_positions(node))) for node in nodes)
        for mutated in (mutate_code(source, operator, number) for number in range(places)):
            with suppress(SyntaxError):  # which is no mutant
                content = bare(mutated)
                if content in known:
                    continue
                known.add(content)
                mutant = _described(source, mutated)
                while mutant.name in names:  # the same change twice in a function
                    mutant = Mutant(mutant.where, mutant.was, mutant.now + " #", mutated)
                names.add(mutant.name)
                found.append(mutant)
    return found


def _described(source: str, mutated: str) -> Mutant:
    old, new = source.splitlines(), mutated.splitlines()
    first, last, start, end = next(
        (a, b, c, d)
        for kind, a, b, c, d in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
        if kind != "equal"
    )
    return Mutant(
        place_of(source, first + 1),
        " ".join(" ".join(old[first:last]).split()),
        " ".join(" ".join(new[start:end]).split()),
        mutated,
    )


class Instead(SourceFileLoader):
    """Loads a module from another source than its file's."""

    def __init__(self, module: str, path: Path, source: str) -> None:
        super().__init__(module, str(path))
        self.source = source

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.source, self.path, "exec", dont_inherit=True)

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """As a finder, that of this module alone."""
        return (
            importlib.util.spec_from_file_location(fullname, self.path, loader=self)
            if (fullname == self.name)
            else None
        )


class Watching:
    """Runs quick tests first, so that most mutants are killed in a moment, and notes what a test took or failed."""

    def __init__(self, note: int, seconds: Mapping[str, float]) -> None:
        self.note, self.seconds = note, seconds

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items.sort(key=lambda item: self.seconds.get(item.nodeid, 0.0))

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed or not self.seconds:
            os.write(self.note, f"{report.nodeid}\t{report.duration}\n".encode())


def judge(module: str, path: Path, source: str, tests: Sequence[str], seconds: Mapping[str, float], note: int) -> None:
    """Run the tests on a mutant, in a forked process, and end it with pytest's status."""
    os.setpgid(0, 0)
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(silent, stream)
    import pytest

    sys.meta_path.insert(0, Instead(module, path, source))
    folder = OUT / f"tmp-{os.getpid()}"
    status = 3
    try:
        status = int(
            pytest.main(
                [
                    "-x",
                    "-q",
                    "-p",
                    "no:cacheprovider",
                    "--hypothesis-seed=0",
                    "--basetemp",
                    str(folder),
                    "-m",
                    "not slow",
                    *tests,
                ],
                plugins=[Watching(note, seconds)],
            )
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(status)


class Trial:
    """One mutant, or none, before its tests."""

    def __init__(
        self, module: str, path: Path, source: str, tests: Sequence[str], limit_s: float, seconds: Mapping[str, float]
    ) -> None:
        self.started, self.limit_s = time.monotonic(), limit_s
        self.notes = OUT / f"notes-{os.getpid()}-{time.monotonic_ns()}"
        note = os.open(self.notes, os.O_WRONLY | os.O_CREAT)
        self.pid = os.fork()
        if not self.pid:
            judge(module, path, source, tests, seconds, note)
        os.close(note)

    def verdict(self) -> tuple[str, list[str]] | None:
        """KILLED, SURVIVED or TIMEOUT, and the notes of ``Watching``; None while it runs."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if not pid and self.seconds < self.limit_s:
            return None
        if not pid:
            with suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        notes = self.notes.read_text(encoding="utf-8").splitlines()
        self.notes.unlink()
        return (TIMEOUT if not pid else SURVIVED if status == 0 else KILLED), notes

    @property
    def seconds(self) -> float:
        return time.monotonic() - self.started


def judged(
    module: str, path: Path, mutants: Sequence[Mutant], tests: Sequence[str], seconds: Mapping[str, float], jobs: int
) -> Iterator[tuple[Mutant, str, str]]:
    """Every mutant with its verdict and the test that killed it; ``seconds`` is what each test takes without one."""
    limit_s = max(MIN_S, PATIENCE * sum(seconds.values()))
    waiting, running = list(mutants), dict[Mutant, Trial]()
    while waiting or running:
        while waiting and len(running) < jobs:
            mutant = waiting.pop(0)
            running[mutant] = Trial(module, path, mutant.source, tests, limit_s, seconds)
        for mutant, trial in list(running.items()):
            if (verdict := trial.verdict()) is not None:
                del running[mutant]
                yield mutant, verdict[0], "".join(verdict[1][:1]).partition("\t")[0]
        time.sleep(0.02)


def durations(module: str, path: Path, source: str, tests: Sequence[str]) -> dict[str, float]:
    """What each test takes, in seconds, on the source as it is."""
    before = Trial(module, path, source, tests, 600.0, {})
    while (verdict := before.verdict()) is None:
        time.sleep(0.02)
    if verdict[0] != SURVIVED:
        sys.exit(f"{module}: its tests fail without any mutant; run them.")
    seconds = dict.fromkeys((line.partition("\t")[0] for line in verdict[1]), 0.0)
    for line in verdict[1]:
        name, _, taken = line.partition("\t")
        seconds[name] += float(taken)
    return seconds


def run(entry: dict[str, Any], jobs: int) -> tuple[int, int, int, list[Mutant]]:
    """Judge the mutants of one module: how many there are and were tried, are equivalent, were killed; survivors."""
    module, tests = entry["module"], [str(ROOT / "tests" / name) for name in entry["tests"]]
    path = ROOT / Path(*module.split(".")).with_suffix(".py")
    source = path.read_text(encoding="utf-8")
    every = mutants_of(source)
    alike = {
        json.dumps([same["where"], same["was"], now], ensure_ascii=False)
        for same in entry.get("equivalent", [])
        for now in same["now"]
    }
    if unknown := alike - {mutant.name for mutant in every}:
        sys.exit(f"{TABLE.name}: {module} has no mutant {min(unknown)}; take it out of the list.")
    real = sorted((mutant for mutant in every if mutant.name not in alike), key=lambda mutant: mutant.rank)
    real = real[: entry.get("most", len(real))]

    kept = OUT / f"{module}.jsonl"
    mark = hashlib.sha256(source.encode()).hexdigest()
    lines = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()] if kept.exists() else []
    killed = (
        {line["name"] for line in lines[1:] if line["verdict"] != SURVIVED}
        if (lines and lines[0]["source"] == mark)
        else set()
    )
    seconds = durations(f"icymoon.{module}", path, source, tests)
    survivors = []
    with kept.open("w", encoding="utf-8") as stream:

        def note(line: dict[str, str]) -> None:
            stream.write(json.dumps(line, ensure_ascii=False) + "\n")
            stream.flush()

        note({"source": mark})
        for name in killed:
            note({"name": name, "verdict": KILLED})
        ahead = [mutant for mutant in real if mutant.name not in killed]
        for number, (mutant, verdict_, by) in enumerate(
            judged(f"icymoon.{module}", path, ahead, tests, seconds, jobs), 1
        ):
            note({"name": mutant.name, "verdict": verdict_, "by": by})
            print(f"\r{module}: {number} of {len(ahead)}", end="", file=sys.stderr, flush=True)
            if verdict_ == SURVIVED:
                survivors.append(mutant)
    print("\r\033[K", end="", file=sys.stderr)
    diffs = (
        "".join(
            difflib.unified_diff(
                source.splitlines(True),
                mutant.source.splitlines(True),
                f"{module} in {mutant.where or 'the module'}",
                "mutant",
                n=1,
            )
        )
        for mutant in survivors
    )
    (OUT / f"{module}.diff").write_text("\n".join(diffs), encoding="utf-8")
    return len(every), len(alike), len(real) - len(survivors), survivors


def main() -> int:
    """Judge the modules, print a table and where the survivors are listed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="*", help="as in mutants.toml; all of them if none is named")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="mutants that are tried side by side")
    arguments = parser.parse_args()
    entries = tomllib.loads(TABLE.read_text(encoding="utf-8"))["of"]
    if unknown := set(arguments.modules) - {entry["module"] for entry in entries}:
        parser.error(f"{TABLE.name} has no module {min(unknown)}")
    OUT.mkdir(parents=True, exist_ok=True)
    os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(OUT / "hypothesis")
    os.chdir(ROOT)
    preload()
    low = []
    print(f"{'module':<36}{'mutants':>8}{'alike':>7}{'tried':>7}{'killed':>8}{'rate':>8}")
    for entry in entries:
        if not arguments.modules or entry["module"] in arguments.modules:
            every, alike, killed, survivors = run(entry, arguments.jobs)
            tried = killed + len(survivors)
            rate = killed / tried if tried else 1.0
            print(f"{entry['module']:<36}{every:>8}{alike:>7}{tried:>7}{killed:>8}{rate:>8.1%}", flush=True)
            low += [entry["module"]] if rate < WANTED else []
    print(f"Survivors are listed in {OUT.relative_to(ROOT)}/*.diff.")
    if low:
        print(f"Less than {WANTED:.0%} killed: {', '.join(low)}.")
    return int(bool(low))


def preload() -> None:
    """Import what the tests need beside Icy Moon, once for all the processes that are forked off this one."""
    import hypothesis.extra.numpy
    import numpy
    import pytest
    import rich.console

    with suppress(ImportError):
        import cv2

        cv2.setNumThreads(1)
    assert not any(name.startswith("icymoon.") for name in sys.modules), "a mutant would not be loaded"
    del numpy, pytest, rich, hypothesis


if __name__ == "__main__":
    sys.exit(main())
