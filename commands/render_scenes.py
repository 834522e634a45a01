"""The verbs that render scenes: ``demo``, ``render`` and ``gallery``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..render.cost.blender_abilities import check_abilities
from ..render.workers.assign_cards import choose_cards
from ..render.workers.job_commands import Job, render_job, resolve_dataset_folder
from ..settings import description, preset_files
from ..settings.topics.declaration import Parts
from ..settings.topics.scene import Settings
from ..support import printer
from ..support.errors import IcyMoonError
from ..support.terminal import add_repeatable_option, as_path, parse_list_option, show_progress
from .renderer_options import add_blender_option, add_cards_option
from .scene_options import add_scene_options, read_settings

#: Largest difference of the gallery's exposure from the camera's, in stops.
_MAX_STOPS = 20.0
#: The scenes of the demo. Their settings leave so little noise that it decides nothing, for little processor time: few
#: pixels, no light under the surface, and no shadows, which take more samples than all else. Snow has little texture;
#: its indirect light is baked.
DEMO_ALIKE: Parts = {"rig": {"width_px": 320, "height_px": 240}, "surface": {"model": "LAMBERT"}}
DEMO: dict[str, Parts] = {
    "enceladus_fresh_snow": {
        "quality": {
            "indirect": "BAKED",
            "bake_area": "VIEW",
            "bake_samples": 64,
            "bake_noise": 0.004,
            "direct_samples": 128,
        }
    },
    "europa_rough_ice": {"light": {"sun_elevation_deg": 55.0}, "quality": {"samples": 40, "diffuse_bounces": 2}},
}


def add_demo_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``demo``."""
    parser.add_argument(
        "--out", type=as_path, default=Path("out/demo"), help="folder for pairs and report (%(default)s)"
    )
    parser.set_defaults(run=_run_demo)


def add_render_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``render``."""
    add_scene_options(parser)
    add_blender_option(parser)
    parser.add_argument("--out", type=as_path, help="data set folder, instead of dataset.folder")
    add_cards_option(parser)
    parser.add_argument("--again", action="store_true", help="render pairs that are already complete once more")
    parser.set_defaults(run=_run_render)


def add_gallery_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``gallery``."""
    add_repeatable_option(parser, "--only", "NAME", "one scene; may repeat (all)")
    parser.add_argument("--scale", type=float, default=1.0, help="share of the images' width and height (%(default)s)")
    parser.add_argument(
        "--stops",
        type=float,
        default=0.0,
        help="expose pictures and sheet longer by this many stops; file names then end in the number (%(default)s)",
    )
    parser.add_argument(
        "--out",
        type=as_path,
        default=Path("out/gallery"),
        help="folder for the pairs, a picture of each and the sheet gallery.jpg (%(default)s)",
    )
    add_blender_option(parser)
    parser.set_defaults(run=_run_gallery)


def render_settings(settings: Settings, dataset: Path, blender: str, *, again: bool = False) -> list[Path]:
    """Render the pairs of a complete description in a worker, show its progress and return their folders.

    Raises IcyMoonError with the worker's own message if it fails.
    """
    with show_progress("Starting Blender") as show:
        return render_job(Job(dataset, settings, again=again), blender, show)


def _run_render(options: argparse.Namespace) -> int:
    choose_cards(options.cards)
    settings = read_settings(options)
    if settings.source.file and settings.source.kind == "PROCEDURAL":
        printer.warn("source.file is not used: source.kind is PROCEDURAL; set it to MESH or HEIGHT_MAP.")
    dataset = options.out.absolute() if options.out else resolve_dataset_folder(str(settings.dataset.folder))
    render_settings(settings, dataset, options.blender, again=options.again)
    printer.say(str(dataset))
    return 0


def _run_demo(options: argparse.Namespace) -> int:
    dataset = options.out.absolute()
    for name, changes in DEMO.items():
        path = preset_files.find_preset(name)
        printer.say(preset_files.read_preset_header(name)[0])
        settings = description.merged(description.defaults(), preset_files.load(path), DEMO_ALIKE, changes)
        render_settings(settings, dataset, sys.executable)
    from ..stereo.cli import main as stereo

    return stereo(["evaluate", str(dataset), "--methods", "bm,sgbm", "--out", str(dataset / "evaluation")])


def _run_gallery(options: argparse.Namespace) -> int:
    from ..stereo.environment import packages

    packages.require_modules(*packages.PACKAGES)
    from ..stereo.images.gallery import write_picture, write_sheet
    from ..stereo.trade.measure_variants import scale_view

    known = [name.removeprefix("gallery/") for name in preset_files.preset_names("gallery")]
    out = options.out.absolute()
    only = parse_list_option(options.only)
    if unknown := sorted(set(only) - set(known)):
        raise IcyMoonError(f"--only: no scene of the gallery is called {unknown[0]!r}; there are {', '.join(known)}.")
    if not abs(options.stops) <= _MAX_STOPS:
        raise IcyMoonError(f"--stops is {options.stops:g}, not a number from -{_MAX_STOPS:g} to {_MAX_STOPS:g}.")
    ending = f"_{options.stops:+g}" if options.stops else ""
    shown, shown_on_sheet = only or known, []
    described = {
        name: description.merged(description.defaults(), preset_files.load_preset(f"gallery/{name}")) for name in shown
    }
    check_abilities(described.values(), options.blender)
    for name in known:
        preset, picture = f"gallery/{name}", out / f"{name}{ending}.jpg"
        title, text = preset_files.read_preset_header(preset)
        command = f"icymoon render --preset {preset}"
        if name in shown:
            printer.say(f"{title}. {text}: python -m {command} --out DATASET", at_once=True)
            (pair,) = render_settings(scale_view(described[name], options.scale), out, options.blender)
            write_picture(pair, picture, options.stops)
        if picture.is_file():
            shown_on_sheet.append((picture, title, command))
    sheet = out / f"gallery{ending}.jpg"
    write_sheet(shown_on_sheet, sheet)
    printer.say(str(sheet))
    return 0
