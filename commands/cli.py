"""The command line: the same verbs as the operators, for headless use.

This process never loads Blender; the worker that it starts does. So a crash of Blender is an
error message here, and Ctrl-C stops at once and leaves nothing half-written.

Only the module of the verb that runs is imported: help comes without NumPy.
"""

from __future__ import annotations

import argparse
from importlib import import_module

from ..support.system import silence_interrupts
from ..support.terminal import Parser, run_verb
from ..support.version import version

#: The verbs of ``python -m icymoon.stereo``, for the help of ``stereo``.
STEREO_VERBS = (
    "check",
    "methods",
    "match",
    "metrics",
    "evaluate",
    "decide",
    "design",
    "fuse",
    "truth",
    "export",
    "develop",
    "train",
    "days",
    "poses",
)
#: Each verb: its meaning, the module here that runs it, and the function there that adds its arguments.
_MODULE_BY_VERB = {
    "demo": (
        "build two scenes, render a pair of each, evaluate them, show the report",
        "render_scenes",
        "add_demo_options",
    ),
    "render": ("build the described scene and render its stereo pairs", "render_scenes", "add_render_options"),
    "evaluate": ("match the pairs of a data set and write a report", "evaluate", "add_evaluate_options"),
    "decide": (
        "measure the decisions of a lander by each matcher, and write a report",
        "evaluate",
        "add_decide_options",
    ),
    "design": (
        "compare suites of sensors by decision risk, energy and processor time, on grounds by rays",
        "evaluate",
        "add_design_options",
    ),
    "fuse": (
        "join matchers with sparse range points, and compare both, by the number of points",
        "evaluate",
        "add_fuse_options",
    ),
    "stereo": (f"the evaluator by itself: {', '.join(STEREO_VERBS)}", "", ""),
    "settings": ("print the described scene as TOML, every setting stated", "print_settings", "add_settings_options"),
    "presets": ("list the shipped presets", "print_settings", "add_presets_options"),
    "sources": ("print the preset and the source of each number of a pair", "print_settings", "add_sources_options"),
    "quality": (
        "print what each quality costs on this machine and what error it leaves",
        "quality",
        "add_quality_options",
    ),
    "trade": ("measure how much accuracy each way to save time costs, on one scene", "quality", "add_trade_options"),
    "auto": ("find the cheapest quality whose stereo error is tolerable, on one scene", "quality", "add_auto_options"),
    "study": (
        "render and measure a preregistered study of recipes, and continue where it stopped",
        "study",
        "add_options",
    ),
    "gallery": (
        "render the scenes of the gallery, as pictures and all on one sheet",
        "render_scenes",
        "add_gallery_options",
    ),
    "camera": (
        "read calibrated cameras (OpenCV, ROS, Kalibr, mrcal, CAHVORE, COLMAP): print settings, show, convert",
        "camera",
        "add_options",
    ),
    "calibration": (
        "measure how depth errors grow with errors of the calibration, on rendered pairs",
        "calibration",
        "add_options",
    ),
    "lidar": (
        "scan the described scene by a laser scanner, and write its returns with their truth",
        "lidar",
        "add_options",
    ),
    "projector": (
        "project dots, stripes or coded light on the described scene, and save a pair or decode its columns",
        "projector",
        "add_options",
    ),
    "sky": ("print Sun, planet and eclipse over a site at a date, without a render", "sky", "add_options"),
    "check": ("render and measure a small pair whose truth is known, to test the installation", "check", "add_options"),
    "plan": ("list the pairs in the plan of a data set, or their cost", "plan", "add_options"),
    "batch": ("render the data set that a plan describes, and continue where it stopped", "batch", "add_batch_options"),
    "work": ("render a shard of a data set that icymoon batch or slurm has planned", "batch", "add_work_options"),
    "slurm": ("write the job script that renders a data set on a cluster with SLURM", "batch", "add_slurm_options"),
    "verify": (
        "check every file of a data set against its plan, if it has one, and what its pairs state, and print "
        "what is missing or wrong",
        "batch",
        "add_verify_options",
    ),
    "reproduce": (
        "make the tables and figures of the GUISS paper beside the printed ones",
        "reproduce",
        "add_options",
    ),
    "twin": (
        "render the twin of photographed pairs with their calibration, and compare images and matchers",
        "twin",
        "add_options",
    ),
    "stand-ins": (
        "list the textures and meshes made by code in place of the GUISS paper's, or write them to a folder",
        "stand_ins",
        "add_options",
    ),
    "validate": (
        "compare surfaces and renders with measurements and other programs, and print the differences",
        "validate",
        "add_options",
    ),
    "check-plugin": (
        "try a plug-in that is installed in this Python, and print its faults",
        "check_plugin",
        "add_options",
    ),
    "doctor": ("print the installed and the missing programs, with fixes", "doctor", "add_options"),
}


def main(arguments: list[str]) -> int:
    """Run a verb and return the exit status: 0 done, 1 an error that stderr states, 130 stopped."""
    # Options that stand before the verb take no value, so the first other word is the verb.
    verb = next((word for word in arguments if not word.startswith("-")), "")
    with silence_interrupts():
        parser = make_parser(verb)
    return run_verb(parser, arguments, "icymoon", "stopped; finished pairs are kept, run the same command to continue.")


def make_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Make the parser of the command line, with the arguments of one verb ``only``, or of all verbs."""
    parser = Parser(prog="icymoon", description="Icy-moon landing sites seen by a stereo camera.")
    parser.add_argument("--version", action="version", version=version())
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    for name, (meaning, module, add_options) in _MODULE_BY_VERB.items():
        verb = verbs.add_parser(name, help=meaning, add_help=bool(module))
        if module and only in (None, name):
            getattr(import_module(f"{__package__}.{module}"), add_options)(verb)
    return parser
