"""The verb ``doctor``: the installed and the missing programs, and how to fix them."""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..plugins.landforms import load_landform_plugins
from ..render.cost.blender_abilities import probe_blender
from ..render.workers.job_commands import python_command
from ..render.workers.process import clean_environment
from ..support.errors import IcyMoonError
from ..support.foreign_bytes import parse_json
from ..support.printer import print_table
from ..support.system import run
from .renderer_options import add_blender_option

#: The subject of the finding on matchers of plug-ins.
PLUGINS = "Matchers of plug-ins"


@dataclass(frozen=True)
class Finding:
    """One line of the examination: ``state`` is 'ok', 'missing' or 'limited'."""

    subject: str
    state: str
    fact: str
    fix: str = ""
    names: tuple[str, ...] = ()  # of the matchers of plug-ins


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``doctor``."""
    add_blender_option(parser)
    parser.add_argument("--evaluator", default=sys.executable, help="Python of the evaluator (this Python)")
    parser.set_defaults(run=lambda options: examine(options.blender, options.evaluator))


def _check_evaluator(python: str) -> dict[str, Any]:
    """Get the evaluator's report on a Python. Raises IcyMoonError if the Python cannot be run or gives no report."""
    try:
        done = run(python_command(python, "stereo", "check"), clean_environment(), timeout_s=120.0)
        found = parse_json(done.stdout)
        if not isinstance(found, dict):
            raise ValueError(found)
        return found
    except OSError as error:
        raise IcyMoonError(f"{python} cannot be run ({error})") from None
    except ValueError:
        words = (done.stderr.strip().splitlines() or ["it prints nothing"])[-1]
        raise IcyMoonError(f"{python}: {words}") from None


def examine_blender(executable: str) -> list[Finding]:
    """Examine a Blender, or a Python with ``bpy``. Returns the findings."""
    found = shutil.which(executable)
    if not found:
        return [Finding("Blender", "missing", f"{executable} is not there", "Give its path with --blender.")]
    try:
        facts = probe_blender(executable)
    except IcyMoonError as error:
        fact, _, fix = str(error).partition("; ")  # the message of a known fault names the fix
        return [
            Finding(
                "Blender",
                "missing",
                fact.removesuffix("."),
                f"{fix[0].upper()}{fix[1:]}" if fix else "Install the bpy package or give a Blender with --blender.",
            )
        ]
    version = tuple(int(part) for part in facts["blender"].split()[0].split(".")[:2])
    devices = ", ".join(facts["devices"])

    def has(ability: str, there: bool, fact: str, fix: str, lacking: str = "limited") -> Finding:
        return Finding(ability, "ok" if there else lacking, fact, "" if there else fix)

    def built_in(ability: str, there: bool, fix: str) -> Finding:
        return has(ability, there, "built in" if there else "absent", fix)

    own = f"{facts['blender']}, Python {facts['python']}"
    return [
        has("Blender", version >= (4, 2), own, "Use Blender 4.2 LTS or later.", "missing"),
        built_in(
            "Open Shading Language", facts["osl"], "Not needed by the Principled surface; official builds have it."
        ),
        built_in("OpenImageDenoise", facts["denoiser"], "Set quality.denoiser to NONE, or use an official build."),
        has("Graphics card", bool(devices), devices or "none that Cycles can use", "Set quality.device to CPU."),
    ]


def examine_evaluator(python: str) -> list[Finding]:
    """Examine the Python of the evaluator. Returns the findings."""
    try:
        facts = _check_evaluator(python)
    except IcyMoonError as error:
        return [Finding("Evaluator", "missing", str(error), "Install Python 3.11 or later and give its path.")]
    names = {
        "python": "Python",
        "cv2": "OpenCV",
        "numpy": "numpy",
        "OpenEXR": "OpenEXR",
        "jinja2": "jinja2",
        "torch": "torch",
    }
    found = [f"{text} {facts[name]}" for name, text in names.items() if facts.get(name)]
    matchers = facts.get("matchers", {})
    return [
        Finding("Evaluator", "ok" if facts["ok"] else "missing", ", ".join(found), facts["message"]),
        *(
            [
                Finding(
                    PLUGINS,
                    "ok",
                    ", ".join(f"{name} ({release})" for name, release in matchers.items()),
                    names=tuple(matchers),
                )
            ]
            if matchers
            else []
        ),
        *(Finding("Plug-in", "limited", sentence) for sentence in facts.get("refused", ())),
    ]


def examine_landforms() -> list[Finding]:
    """List the landforms of plug-ins in this Python, and the reason why any is unusable."""
    usable, faults = load_landform_plugins()
    found = [f"{landform.label} ({landform.plugin.release})" for landform in usable.values()]
    return [
        *([Finding("Landforms of plug-ins", "ok", ", ".join(found))] if found else []),
        *(Finding("Plug-in", "limited", fault) for fault in faults.values()),
    ]


def examine_kernels(kernels: str) -> list[Finding]:
    """Examine the named SPICE kernels. Returns the findings; empty without kernels, since few scenes need them."""
    if not kernels:
        return []
    folder = Path(kernels)
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return [
            Finding(
                "SPICE kernels",
                "missing",
                f"{kernels} is not there or empty",
                "Give a meta-kernel or a folder of kernels, or leave it empty.",
            )
        ]
    if importlib.util.find_spec("spiceypy") is None:
        return [
            Finding(
                "SPICE kernels",
                "limited",
                f"{kernels}, but this Python has no SpiceyPy",
                'In the Python that renders: pip install "icymoon[ephemeris]".',
            )
        ]
    return [Finding("SPICE kernels", "ok", kernels)]


def examine(blender: str, evaluator: str) -> int:
    """Print all findings as a table. Returns 1 if something is missing that is needed, else 0."""
    findings = examine_blender(blender) + examine_evaluator(evaluator) + examine_landforms()
    colours = {"ok": "green", "limited": "yellow", "missing": "red"}
    print_table(
        ("", "found", "what to do"),
        [((finding.subject, colours[finding.state]), finding.fact, finding.fix) for finding in findings],
        left=range(3),
    )
    return int(any(finding.state == "missing" for finding in findings))
