"""The command line: the same verbs as the operators, for headless use.

This process never loads Blender; the worker that it starts does. So a crash of Blender is an
error message here, and Ctrl-C stops at once and leaves nothing half-written.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from . import settings as description
from .errors import IcyMoonError
from .render.launch import Job, absolute_folder, blender_command
from .render.queue import Process
from .version import version

_DEMO_PRESETS = ("enceladus_fresh_snow", "europa_rough_ice")


def main(arguments: list[str]) -> int:
    """Run a verb and return the exit status: 0 done, 1 an error that stderr states, 130 stopped."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.run(options))
    except IcyMoonError as error:
        print(f"icymoon: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("icymoon: stopped; finished pairs are kept, run the same command to go on.", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="icymoon", description="Icy-moon landing sites seen by a stereo camera.")
    parser.add_argument("--version", action="version", version=version())
    verbs = parser.add_subparsers(required=True, metavar="VERB")

    demo = verbs.add_parser("demo", help="build two scenes, render a pair of each, evaluate them, show the report")
    demo.add_argument("--out", type=Path, default=Path("out/demo"), help="folder for pairs and report (%(default)s)")
    demo.set_defaults(run=_demo)

    render = verbs.add_parser("render", help="build the described scene and render its stereo pairs")
    _describe(render)
    render.add_argument("--out", type=Path, help="data set folder, instead of dataset.folder")
    render.add_argument("--again", action="store_true", help="render pairs that are already complete once more")
    render.set_defaults(run=_render)

    evaluate = verbs.add_parser("evaluate", help="match the pairs of a data set and write a report")
    evaluate.add_argument("path", type=Path, nargs="+", help="pair or data set folder")
    evaluate.add_argument("--methods", default="bm,sgbm", help="matchers, separated by commas (%(default)s)")
    evaluate.add_argument("--out", type=Path, help="report folder (evaluation in the data set)")
    evaluate.add_argument("--guiss", action="store_true", help="show what the GUISS reference code would report too")
    evaluate.add_argument("--points", action="store_true", help="write the measured surfaces too, as point clouds")
    evaluate.set_defaults(run=_evaluate)

    settings = verbs.add_parser("settings", help="print the described scene as TOML, every setting stated")
    _describe(settings)
    settings.set_defaults(run=lambda options: print(description.to_toml(_described(options)), end="") or 0)

    presets = verbs.add_parser("presets", help="list the shipped presets")
    presets.set_defaults(run=_presets)

    doctor = verbs.add_parser("doctor", help="say what is here, what is missing and what to do about it")
    doctor.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")
    doctor.add_argument("--evaluator", default=sys.executable, help="Python of the evaluator (this Python)")
    doctor.set_defaults(run=_doctor)
    return parser


def _describe(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--preset", action="append", default=[], help="shipped preset, see icymoon presets; may repeat")
    parser.add_argument("--settings", type=Path, action="append", default=[], help="TOML file; may repeat")
    parser.add_argument("--set", action="append", default=[], metavar="TOPIC.KEY=VALUE", dest="overrides",
                        help="one setting; may repeat")
    parser.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")


def _described(options: argparse.Namespace) -> description.Settings:
    return description.merged(
        description.defaults(),
        *(description.load(description.preset_path(name)) for name in options.preset),
        *(description.load(path) for path in options.settings),
        *(description.override(text) for text in options.overrides))


def render_described(settings: description.Settings, dataset: Path, blender: str, *, again: bool = False) -> list[str]:
    """Render the pairs of a complete description in a worker, showing its progress.

    Returns the pair folders. Raises IcyMoonError with the worker's own words if it fails.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    job = Job(settings, dataset, again=again)
    process = Process(blender_command(blender, "worker", str(job.file)))
    folders: list[str] = []
    failure = ""
    try:
        with Progress(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"),
                      TimeElapsedColumn(), TimeRemainingColumn(), transient=False) as bar:
            task = bar.add_task("Starting Blender", total=1.0)
            for message in process.messages():
                kind = message["type"]
                if kind == "progress":
                    bar.update(task, completed=message["fraction"], description=message["message"])
                elif kind == "warning":
                    bar.console.print(f"[yellow]Warning:[/] {message['message']}")
                elif kind == "pair":
                    done = f"rendered in {message['seconds']:.0f} s" if message["rendered"] else "was already there"
                    bar.console.print(f"  {message['folder']} {done}", highlight=False)
                elif kind == "error":
                    failure = message["message"]
                elif kind == "done":
                    folders = message["folders"]
                    bar.update(task, completed=1.0)
    finally:
        process.stop()
        job.remove()
    if failure or not folders:
        raise IcyMoonError(failure or f"Blender ended without a result (status {process.returncode}): "
                           f"{process.last_words}")
    return folders


def _render(options: argparse.Namespace) -> int:
    settings = _described(options)
    if settings["source"]["file"] and settings["source"]["kind"] == "PROCEDURAL":
        print("icymoon: source.file is not used: source.kind is PROCEDURAL; set it to MESH or HEIGHT_MAP.",
              file=sys.stderr)
    dataset = options.out.absolute() if options.out else absolute_folder(str(settings["dataset"]["folder"]))
    render_described(settings, dataset, options.blender, again=options.again)
    print(dataset)
    return 0


def _evaluate(options: argparse.Namespace) -> int:
    from .stereo.cli import main as stereo

    out = options.out or options.path[0] / "evaluation"
    flags = [f"--{name}" for name in ("guiss", "points") if getattr(options, name)]
    return stereo(["evaluate", *map(str, options.path), "--methods", options.methods, "--out", str(out), *flags])


def _demo(options: argparse.Namespace) -> int:
    dataset = options.out.absolute()
    for name in _DEMO_PRESETS:
        path = description.preset_path(name)
        print(f"{description.preset_header(name)[0]}")
        settings = description.merged(description.defaults(), description.load(path),
                                      description.load(description.preset_path("qualities/draft")))
        render_described(settings, dataset, sys.executable)
    from .stereo.cli import main as stereo

    return stereo(["evaluate", str(dataset), "--methods", "bm,sgbm", "--out", str(dataset / "evaluation")])


def _presets(options: argparse.Namespace) -> int:
    for name in description.preset_names():
        title, text = description.preset_header(name)
        print(f"{name:32} {title}. {text}")
    return 0


def _doctor(options: argparse.Namespace) -> int:
    from .doctor import examine

    return examine(options.blender, options.evaluator)
