"""The command line: the same verbs as the operators, for headless use.

This process never loads Blender; the worker that it starts does. So a crash of Blender is an
error message here, and Ctrl-C stops at once and leaves nothing half-written.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import IcyMoonError
from ..render.cost.abilities import Abilities, ask_abilities, check_abilities
from ..render.cost.tolerance import PX, checked_tolerance, parse_fraction
from ..render.workers.cards import choose_cards
from ..render.workers.job import Job, absolute_folder, render_job
from ..render.workers.process import Message, report_errors
from ..scratch import scratch_folder
from ..settings import description, preset_files, toml_text
from ..stereo.cli import add_decide_options, add_evaluate_options, run_decide, run_evaluate, stereo_verbs
from ..support import printer
from ..terminal import Parser, as_path, run_verb, show_counted_progress, show_progress
from ..typed_settings import Parts, Settings
from ..version import version
from . import batch, camera, check, check_plugin, plan, sky, stand_ins, validate
from .scene_options import add_scene_options, read_settings

if TYPE_CHECKING:
    from ..stereo.trade.measure_variants import Bench

#: Most stops by which the gallery's exposure may differ from the camera's.
_MOST_STOPS = 20.0
#: The scenes of the demo. Their settings leave so little noise that it decides nothing, for little processor time: few
#: pixels, no light under the surface, and no shadows, which take more samples than all else. Snow has little texture;
#: its indirect light is baked.
_DEMO_ALIKE: Parts = {"rig": {"width_px": 320, "height_px": 240}, "surface": {"model": "LAMBERT"}}
_DEMO: dict[str, Parts] = {
    "enceladus_fresh_snow": {"quality": {"indirect": "BAKED", "bake_area": "VIEW", "bake_samples": 32,
                                         "direct_samples": 96}},
    "europa_rough_ice": {"light": {"sun_elevation_deg": 55.0}, "quality": {"samples": 40, "diffuse_bounces": 2}}}


def main(arguments: list[str]) -> int:
    """Run a verb and return the exit status: 0 done, 1 an error that stderr states, 130 stopped."""
    return run_verb(_make_parser(), arguments, "icymoon",
                    "stopped; finished pairs are kept, run the same command to go on.")


def _make_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="icymoon", description="Icy-moon landing sites seen by a stereo camera.")
    parser.add_argument("--version", action="version", version=version())
    verbs = parser.add_subparsers(required=True, metavar="VERB")

    demo = verbs.add_parser("demo", help="build two scenes, render a pair of each, evaluate them, show the report")
    demo.add_argument("--out", type=as_path, default=Path("out/demo"), help="folder for pairs and report (%(default)s)")
    demo.set_defaults(run=_run_demo)

    render = verbs.add_parser("render", help="build the described scene and render its stereo pairs")
    _add_scene_options(render)
    render.add_argument("--out", type=as_path, help="data set folder, instead of dataset.folder")
    batch.add_cards_option(render)
    render.add_argument("--again", action="store_true", help="render pairs that are already complete once more")
    render.set_defaults(run=_run_render)

    evaluate = verbs.add_parser("evaluate", help="match the pairs of a data set and write a report")
    add_evaluate_options(evaluate, out_needed=False)
    evaluate.set_defaults(run=_run_evaluate)

    decide = verbs.add_parser("decide", help="measure what a lander would decide by each matcher, and write a report")
    add_decide_options(decide, out_needed=False)
    decide.set_defaults(run=_run_decide)

    verbs.add_parser("stereo", help=f"the evaluator by itself: {', '.join(stereo_verbs())}", add_help=False)

    settings = verbs.add_parser("settings", help="print the described scene as TOML, every setting stated")
    _add_scene_options(settings)
    settings.set_defaults(run=_run_settings)

    presets = verbs.add_parser("presets", help="list the shipped presets")
    presets.set_defaults(run=_run_presets)

    sources = verbs.add_parser("sources", help="print which preset and source each number of a pair is from")
    sources.add_argument("path", type=as_path, help="pair folder, or a data set of one pair")
    sources.add_argument("names", nargs="*", metavar="NAME", help="topic such as light, or setting such as "
                         "light.planet_albedo (all that are not defaults)")
    sources.set_defaults(run=_run_sources)

    quality = verbs.add_parser("quality", help="print what each quality costs on this machine and what error it leaves")
    _add_scene_options(quality)
    quality.add_argument("--measure", action="store_true",
                         help="measure this machine again by a small render, not only the first time")
    quality.add_argument("--json", action="store_true", help="print JSON lines")
    quality.set_defaults(run=_run_quality)

    trade = verbs.add_parser("trade", help="measure how much accuracy each way to save time costs, on one scene")
    _add_scene_options(trade)
    _add_bench_options(trade)
    trade.add_argument("--groups", default="", help="what to vary, separated by commas: samples, bounces, threshold, "
                       "indirect, shortcuts, files, subsurface, glints, mesh, relief, hapke (all that the scene has)")
    trade.add_argument("--repeats", type=int, default=2, help="renders of each variant (%(default)s)")
    trade.add_argument("--json-lines", action="store_true", help="progress and result as JSON lines on stdout")
    trade.set_defaults(run=_run_trade)

    auto = verbs.add_parser("auto", help="find the cheapest quality whose stereo error is tolerable, on one scene")
    _add_scene_options(auto)
    _add_bench_options(auto)
    auto.add_argument("--tolerance-px", type=float, metavar="PX",
                      help=f"mean disparity error that may be added ({PX:g}, or any if --tolerance-bad-1 is given)")
    auto.add_argument("--tolerance-bad-1", type=parse_fraction, metavar="SHARE",
                      help="share of pixels that may be added to those missing or off by more than 1 px, as 0.5%% or "
                      "0.005 (any)")
    auto.add_argument("--json-lines", action="store_true", help="progress and result as JSON lines on stdout")
    auto.set_defaults(run=_run_auto)

    gallery = verbs.add_parser("gallery", help="render the scenes of the gallery, as pictures and all on one sheet")
    gallery.add_argument("--only", action="append", default=[], metavar="NAME", help="one scene; may repeat (all)")
    gallery.add_argument("--scale", type=float, default=1.0, help="share of the images' width and height (%(default)s)")
    gallery.add_argument("--stops", type=float, default=0.0, help="expose pictures and sheet so many stops longer than "
                         "the camera does; files then end in the number (%(default)s)")
    gallery.add_argument("--out", type=as_path, default=Path("out/gallery"), help="folder for the pairs, a picture of "
                         "each and the sheet gallery.jpg (%(default)s)")
    gallery.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")
    gallery.set_defaults(run=_run_gallery)

    camera.add_verb(verbs)
    sky.add_verb(verbs)
    check.add_verb(verbs)
    plan.add_verbs(verbs)
    batch.add_verbs(verbs)
    stand_ins.add_verbs(verbs)
    validate.add_verbs(verbs)
    check_plugin.add_verb(verbs)

    doctor = verbs.add_parser("doctor", help="print what is installed, what is missing and how to fix that")
    doctor.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")
    doctor.add_argument("--evaluator", default=sys.executable, help="Python of the evaluator (this Python)")
    doctor.set_defaults(run=_run_doctor)
    return parser


def _parse_count(text: str) -> int:
    """A number from 1 on. Raises ValueError for anything else."""
    if int(text) < 1:
        raise ValueError(text)
    return int(text)


def _add_bench_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--methods", default="sgbm,bm,jplv", help="matchers, separated by commas (%(default)s)")
    parser.add_argument("--own", action="append", default=[], metavar="NAME:METHOD:KEY=VALUE",
                        help="option of your own matcher, which --methods then names as own:NAME; may repeat")
    parser.add_argument("--reference-samples", type=int, default=1024,
                        help="light paths per pixel of the reference (%(default)s)")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the image's width and height (%(default)s)")
    parser.add_argument("--images", type=_parse_count, default=1, metavar="N",
                        help="images of the ground under this Sun, which share what it takes to bake its light "
                        "(%(default)s)")
    parser.add_argument("--out", type=as_path, required=True, help="folder for renders and report")


def _add_scene_options(parser: argparse.ArgumentParser) -> None:
    add_scene_options(parser)
    parser.add_argument("--blender", default=sys.executable, help="Blender, or a Python with bpy (this Python)")


def render_settings(settings: Settings, dataset: Path, blender: str, *, again: bool = False) -> list[Path]:
    """Render the pairs of a complete description in a worker, showing its progress; their folders.

    Raises IcyMoonError with the worker's own message if it fails.
    """
    with show_progress("Starting Blender") as show:
        return render_job(Job(dataset, settings, again=again), blender, show)


def _run_render(options: argparse.Namespace) -> int:
    choose_cards(options.cards)
    settings = read_settings(options)
    if settings.source.file and settings.source.kind == "PROCEDURAL":
        printer.warn("source.file is not used: source.kind is PROCEDURAL; set it to MESH or HEIGHT_MAP.")
    dataset = options.out.absolute() if options.out else absolute_folder(str(settings.dataset.folder))
    render_settings(settings, dataset, options.blender, again=options.again)
    printer.say(str(dataset))
    return 0


def _run_settings(options: argparse.Namespace) -> int:
    printer.say(toml_text.to_toml(read_settings(options)).removesuffix("\n"))
    return 0


def _run_evaluate(options: argparse.Namespace) -> int:
    options.out = options.out or options.path[0] / "evaluation"
    return run_evaluate(options)


def _run_decide(options: argparse.Namespace) -> int:
    options.out = options.out or options.path[0] / "decisions"
    return run_decide(options)


def _run_demo(options: argparse.Namespace) -> int:
    dataset = options.out.absolute()
    for name, changes in _DEMO.items():
        path = preset_files.preset_path(name)
        printer.say(preset_files.preset_header(name)[0])
        settings = description.merged(description.defaults(), preset_files.load(path), _DEMO_ALIKE, changes)
        render_settings(settings, dataset, sys.executable)
    from ..stereo.cli import main as stereo

    return stereo(["evaluate", str(dataset), "--methods", "bm,sgbm", "--out", str(dataset / "evaluation")])


def _emit_event(event: Message) -> None:
    printer.emit_json(event)


def _run_gallery(options: argparse.Namespace) -> int:
    from ..stereo.environment import packages

    packages.require(*packages.PACKAGES)
    from ..stereo.images.gallery import write_picture, write_sheet
    from ..stereo.trade.measure_variants import scaled_view

    known = [name.removeprefix("gallery/") for name in preset_files.preset_names("gallery")]
    out = options.out.absolute()
    if unknown := sorted(set(options.only) - set(known)):
        raise IcyMoonError(f"--only: no scene of the gallery is called {unknown[0]!r}; there are {', '.join(known)}.")
    if not abs(options.stops) <= _MOST_STOPS:
        raise IcyMoonError(f"--stops is {options.stops:g}, not a number from -{_MOST_STOPS:g} to {_MOST_STOPS:g}.")
    ending = f"_{options.stops:+g}" if options.stops else ""
    chosen, shown_on_sheet = options.only or known, []
    described = {name: description.merged(description.defaults(), preset_files.load_preset(f"gallery/{name}"))
                 for name in chosen}
    check_abilities(described.values(), options.blender)
    for name in known:
        preset, picture = f"gallery/{name}", out / f"{name}{ending}.jpg"
        title, text = preset_files.preset_header(preset)
        command = f"icymoon render --preset {preset}"
        if name in chosen:
            printer.say(f"{title}. {text}: python -m {command} --out DATASET", at_once=True)
            pair, = render_settings(scaled_view(described[name], options.scale), out, options.blender)
            write_picture(pair, picture, options.stops)
        if picture.is_file():
            shown_on_sheet.append((picture, title, command))
    sheet = out / f"gallery{ending}.jpg"
    write_sheet(shown_on_sheet, sheet)
    printer.say(str(sheet))
    return 0


def _run_bench(options: argparse.Namespace, title: str, work: Callable[[Bench], dict[str, Any]],
               show: Callable[[dict[str, Any]], None], repeats: int = 1) -> int:
    """Do ``work`` with a bench as the options describe it, showing progress, then ``show`` its result."""
    from ..stereo.trade.measure_variants import Bench, scaled_view

    told = nullcontext(_emit_event) if options.json_lines else show_counted_progress(title)
    with report_errors(options.json_lines), told as on_event:
        view = description.merged(read_settings(options), {"dataset": {"headings": 1}})
        found = work(Bench(scaled_view(view, options.scale), options.out.absolute(), options.blender, options.methods,
                           options.reference_samples, repeats, on_event, tuple(options.own), options.images))
    if options.json_lines:
        printer.emit("result", **found)
    else:
        show(found)
    return 0


def _run_trade(options: argparse.Namespace) -> int:
    from ..stereo.trade.measure_variants import run_trade

    if options.repeats < 1:
        raise IcyMoonError(f"--repeats is {options.repeats}; give 1, or 2 to tell noise from the rest.")
    page = options.out.absolute() / "trade.html"

    def show(report: dict[str, Any]) -> None:
        _say_all(report["advice"])
        _print_decided(report)
        _say_all(report["decision_advice"])
        printer.say(str(page))

    groups = [group for group in options.groups.split(",") if group]
    return _run_bench(options, "Measuring", lambda bench: {**run_trade(bench, groups), "report": str(page)}, show,
                      options.repeats)


def _print_decided(report: dict[str, Any]) -> None:
    """Print how the decisions of each variant differ from the reference's, as a table; nothing if there are none."""
    from ..stereo.matchers.methods import describe_method
    from ..stereo.report.table_columns import format_number
    from ..stereo.trade.report import DECISION_COLUMNS, SAME

    rows = [row for row in report["rows"] if row["decisions"]]
    if not rows:
        return
    printer.print_table(
        ("Variant", "CPU (s)", "Matcher", "Decisions", *(column.title for column in DECISION_COLUMNS)),
        [(row["name"], f"{row['cpu_s'] or 0.0:.1f}", describe_method(method), SAME[found["same"]],
          *(format_number(found, column) for column in DECISION_COLUMNS))
         for row in sorted(rows, key=lambda row: row["cpu_s"] or 0.0) for method, found in row["decisions"].items()],
        "Decisions against those on the reference", left=(0, 2), narrowest=160)
    printer.say(report["decision_rule"])


def _say_all(sentences: Iterable[str]) -> None:
    for sentence in sentences:
        printer.say(sentence)


def _run_auto(options: argparse.Namespace) -> int:
    from ..stereo.trade.cheapest_quality import find_cheapest_quality

    allowed = checked_tolerance(options.tolerance_px, options.tolerance_bad_1)

    def show(found: dict[str, Any]) -> None:
        *tried, last = found["said"]
        _say_all(tried)
        if found["chosen"] is None:
            raise IcyMoonError(last)
        printer.say(f"{last} Add --settings {found['file']} to a command to use it:")
        printer.say(toml_text.to_toml(found["settings"]).removesuffix("\n"))

    return _run_bench(options, "Trying", lambda bench: find_cheapest_quality(bench, allowed), show)


def _run_presets(options: argparse.Namespace) -> int:
    for name in preset_files.preset_names():
        title, text = preset_files.preset_header(name)
        printer.say(f"{name:32} {title}. {text}")
    return 0


def _run_sources(options: argparse.Namespace) -> int:
    from .sources import find_origins, read_pair_settings

    for origin in find_origins(read_pair_settings(options.path), options.names):
        printer.say(origin.lines)
    return 0


def _run_quality(options: argparse.Namespace) -> int:
    from ..render.cost.estimate import count_triangles
    from ..render.cost.measure_speed import measure_speed
    from ..render.cost.quality_presets import list_qualities
    from ..render.cost.speed import recall_speed

    with report_errors(options.json):
        settings = read_settings(options)
        device = str(settings.quality.device)
        speed = None if options.measure else recall_speed(device)
        if speed is None:
            with scratch_folder() as folder, show_progress("Measuring this machine") as show:
                speed = measure_speed(options.blender, device, folder,
                                      lambda message: show(message) if message["type"] == "progress" else None)
        found = list_qualities(settings, count_triangles(settings), speed, _ask_abilities(options.blender))
    if options.json:
        printer.emit("result", speed=asdict(speed), qualities=[asdict(each) for each in found])
        return 0
    printer.say(f"A pair of this scene takes ({speed.basis}, {speed.processors} processors):")
    for each in found:
        printer.say(f"  {each.name or each.title.lower():22} {each.cost:28} "
                    f"{'' if each.lacks else each.error}".rstrip())
    measured = next((each.errors for each in found if each.errors), None)
    if measured:
        printer.say(f"Errors are those of {measured['scene']}; of this scene: icymoon auto, icymoon trade.")
    return 0


def _ask_abilities(blender: str) -> Abilities:
    """What a Blender can do; all, where it cannot be asked: a render will report that."""
    try:
        return ask_abilities(blender)
    except IcyMoonError:
        return Abilities()


def _run_doctor(options: argparse.Namespace) -> int:
    from .doctor import examine

    return examine(options.blender, options.evaluator)
