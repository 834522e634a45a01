"""The verb ``days``: a lander looks, chooses, digs and verifies on ray-traced grounds, one day after another."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from ..support import printer
from ..support.errors import IcyMoonError
from ..support.number_text import format_count
from ..support.terminal import add_json_lines, as_path, check_least, tell_events
from .environment import packages


def add_days_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb ``days``; ``run_days_command`` reads them."""
    command.add_argument(
        "--out",
        type=as_path,
        required=True,
        metavar="FOLDER",
        help="folder of the rows and the summary; a run that is there goes on",
    )
    command.add_argument(
        "--days", type=int, default=100, metavar="N", help="days, each on a ground of its own (%(default)s)"
    )
    command.add_argument("--method", default="sgbm", help="the lander's matcher, as in evaluate (%(default)s)")
    command.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the grounds (%(default)s)")
    command.add_argument(
        "--ground",
        metavar="PRESET",
        help="preset or file of settings whose terrain and rocks all grounds have, each with its own seed (several "
        "gentle terrains)",
    )
    command.add_argument(
        "--lander",
        metavar="PRESET",
        help="preset or file of settings with another camera, sensor, workspace, scoop or place of the Sun",
    )
    command.add_argument("--rules", type=as_path, metavar="FILE", help="TOML file with rules of your own for sites")
    command.add_argument(
        "--energy-wh", type=float, default=1000.0, metavar="WH", help="what a day may spend (%(default)s)"
    )
    command.add_argument(
        "--looks", type=int, default=2, metavar="N", help="looks before a site is chosen (%(default)s)"
    )
    command.add_argument(
        "--least-margin",
        type=float,
        default=0.0,
        metavar="MARGIN",
        help="least margin of a site that is dug, such as a calibrated one (%(default)s)",
    )
    add_json_lines(command)


def run_days_command(parsed: argparse.Namespace) -> int:
    """Run ``days`` with its parsed arguments; return the exit code."""
    check_least(parsed, 1, "days", "looks")
    check_least(parsed, 0, "seed")
    _check_numbers(parsed)
    packages.require_modules(*packages.PACKAGES)
    from ..settings.preset_files import load_named
    from .decisions.rules import read_rules
    from .design.default_lander import GENTLE_TERRAINS
    from .design.made_workspaces import draw_recipes
    from .evaluation_files import check_output_folder, remove_leftovers
    from .landed_day.episodes import DAY_LANDER, FIRST_BYTES, change_lander, make_policy, read_method, run_days
    from .learning.grounds import Variety
    from .training_data import read_ground

    own = None if parsed.ground is None else read_ground(parsed.ground, "--ground ")
    recipes = draw_recipes(parsed.seed, "ground", parsed.days, Variety(GENTLE_TERRAINS, own=own))
    lander = DAY_LANDER if parsed.lander is None else change_lander(load_named(parsed.lander))
    method = read_method(parsed.method)
    rules = read_rules(parsed.rules)
    check_output_folder(parsed.out, [], FIRST_BYTES)
    remove_leftovers(parsed.out)
    policy = make_policy(lander, looks=parsed.looks, least_margin=parsed.least_margin)
    lived = 0
    with tell_events("Days", parsed.json_lines) as tell:

        def on_day(row: Mapping[str, Any]) -> None:
            nonlocal lived
            lived += 1
            if row["error"]:
                tell({"type": "error", "message": f"{row['pair']}: {row['error']}"})
            message = f"{row['pair']}: {row['day']['end'] if row['day'] else row['status']}"
            tell({"type": "progress", "done": lived, "total": parsed.days, "message": message})

        found = run_days(recipes, lander, method, rules, policy, parsed.out, parsed.energy_wh, on_day)
    _tell_summary(parsed, found)
    return 0


def _check_numbers(parsed: argparse.Namespace) -> None:
    if not 0 < parsed.energy_wh < float("inf"):
        raise IcyMoonError(f"--energy-wh is {parsed.energy_wh:g}; give watt-hours above 0.")
    if not 0 <= parsed.least_margin <= 1:
        raise IcyMoonError(f"--least-margin is {parsed.least_margin:g}; give a margin from 0 to 1.")


def _tell_summary(parsed: argparse.Namespace, found: Mapping[str, Any]) -> None:
    """Print the summary. Raises IcyMoonError if days failed."""
    path = str((parsed.out / "days.json").resolve())
    if parsed.json_lines:
        printer.emit_json({"type": "result", "days": path, "summary": found})
    elif found["days"]:
        rows = [
            (end, str(each["days"]), f"{each['share'][0]:.2f} to {each['share'][1]:.2f}")
            for end, each in found["ends"].items()
        ]
        printer.print_table(("End", "Days", "Share, 95 %"), rows, f"{found['days']} days")
        printer.say(
            f"At most {100 * found['unsafe_bound']:.1f} % of such grounds get an unsafe trench, with 95 % confidence; "
            f"{found['dangerous']} of the unsafe ones miss a limit by more than its tolerance. A day lasts "
            f"{found['hours']:.1f} h and takes {found['energy_wh']:.0f} Wh and {found['looks']:.1f} looks on average."
        )
        if found["verified"]:
            printer.say(
                f"The verified volumes err by {1e6 * found['volume_bias_m3']:+.0f} cm³ on average and "
                f"{1e6 * found['volume_rms_m3']:.0f} cm³ root mean square, over "
                f"{format_count(found['verified'], 'day')}."
            )
        printer.say(path)
    if found["failed"]:
        raise IcyMoonError(
            f"{format_count(found['failed'], 'day')} failed, and {path} leaves them out; correct what the messages "
            "above state, and run the command again."
        )
