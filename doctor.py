"""What is here, what is missing, and what to do about what is missing."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from typing import Any

from .errors import IcyMoonError
from .render.launch import blender_command, python_command
from .render.queue import Process, clean_environment


@dataclass(frozen=True)
class Finding:
    """One line of the examination: ``state`` is 'ok', 'missing' or 'limited'."""

    subject: str
    state: str
    fact: str
    mend: str = ""


def ask(command: list[str], kind: str, clean: bool = False) -> dict[str, Any]:
    """The first message of a kind that a command says. Raises IcyMoonError if it says none."""
    process = Process(command, clean_environment() if clean else None)
    for message in process.messages():
        if message["type"] == kind:
            return message
    raise IcyMoonError(f"{command[0]}: {process.last_words}")


def blender_findings(executable: str) -> list[Finding]:
    """What a Blender, or a Python with ``bpy``, can do."""
    found = shutil.which(executable)
    if not found:
        return [Finding("Blender", "missing", f"{executable} is not there", "Give its path with --blender.")]
    try:
        facts = ask(blender_command(executable, "probe"), "probe")
    except IcyMoonError as error:
        return [Finding("Blender", "missing", str(error), "Install the bpy package or give a Blender with --blender.")]
    version = tuple(int(part) for part in facts["blender"].split()[0].split(".")[:2])
    supported = version >= (4, 2)
    devices = ", ".join(facts["devices"])
    return [
        Finding("Blender", "ok" if supported else "missing", f"{facts['blender']}, Python {facts['python']}",
                "" if supported else "Use Blender 4.2 LTS or later."),
        Finding("Open Shading Language", "ok" if facts["osl"] else "limited", "built in" if facts["osl"] else "absent",
                "" if facts["osl"] else "Not needed by the Principled surface; official builds have it."),
        Finding("OpenImageDenoise", "ok" if facts["denoiser"] else "limited",
                "built in" if facts["denoiser"] else "absent",
                "" if facts["denoiser"] else "Leave quality.denoiser at NONE, or use an official build."),
        Finding("Graphics card", "ok" if devices else "limited", devices or "none that Cycles can use",
                "" if devices else "Leave quality.device at CPU."),
    ]


def evaluator_findings(python: str) -> list[Finding]:
    """What the Python of the evaluator can do."""
    try:
        facts = ask(python_command(python, "stereo", "check"), "check", clean=True)
    except IcyMoonError as error:
        return [Finding("Evaluator", "missing", str(error), "Install Python 3.11 or later and give its path.")]
    found = [f"{name} {version}" for name, version in facts["versions"].items() if version]
    missing = facts["missing"]
    return [Finding("Evaluator", "ok" if facts["ok"] else "missing", ", ".join(found),
                    f"Install {', '.join(missing)} into {python}." if missing else "")]


def examine(blender: str, evaluator: str) -> int:
    """Print all findings as a table; 1 if something that is needed is missing."""
    from rich.console import Console
    from rich.table import Table

    findings = blender_findings(blender) + evaluator_findings(evaluator)
    table = Table("", "found", "what to do")
    colours = {"ok": "green", "limited": "yellow", "missing": "red"}
    for finding in findings:
        table.add_row(f"[{colours[finding.state]}]{finding.subject}[/]", finding.fact, finding.mend)
    Console().print(table)
    return int(any(finding.state == "missing" for finding in findings))
