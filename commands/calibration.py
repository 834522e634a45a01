"""The verb ``calibration``: the tolerance of a rig and a matcher to errors of the calibration."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from ..support import printer
from ..support.terminal import add_repeatable_option, as_path, show_count


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``calibration``."""
    parser.add_argument("path", nargs="+", type=as_path, help="pair folder or data set of pairs; may be several")
    parser.add_argument("--methods", default="sgbm,jplv", help="matchers, separated by commas (%(default)s)")
    add_repeatable_option(
        parser,
        "--errors",
        "KEY=NUMBER,NUMBER",
        "errors of a setting of [calibration_error], as in right_yaw_deg=-0.1,0.1; may repeat (six or ten of each "
        "setting)",
    )
    parser.add_argument("--out", required=True, type=as_path, metavar="FOLDER", help="folder of the table and curves")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ..stereo.environment import packages

    packages.require_modules(*packages.PACKAGES)
    from ..stereo.calibration_curves import measure_calibration, parse_errors, tabulate, write_curves, write_rows
    from ..stereo.matchers.methods import parse_methods

    methods, errors = parse_methods(options.methods), parse_errors(options.errors)
    with show_count("Pairs") as tell:
        rows = measure_calibration(options.path, methods, errors, tell)
    write_rows(rows, options.out / "calibration.csv")
    _print_table(tabulate(rows))
    for path in write_curves(rows, options.out):
        printer.say(str(path.absolute()))
    return 0


def _print_table(table: Sequence[dict[str, Any]]) -> None:
    for rig in dict.fromkeys(entry["rig"] for entry in table):
        printer.print_table(
            ("Error of", "Method", "Median depth error", "doubles at", "Coverage", "a tenth less at"),
            [
                (
                    entry["setting"],
                    entry["method"],
                    f"{100 * entry['exact']:.2f} %",
                    _format_limit(entry, "tolerance"),
                    f"{100 * entry['exact_coverage']:.1f} %",
                    _format_limit(entry, "coverage_tolerance"),
                )
                for entry in table
                if entry["rig"] == rig
            ],
            rig,
            left=(0, 1),
            narrowest=120,
        )


def _format_limit(entry: dict[str, Any], key: str) -> str:
    return f"> {entry['largest']:g}" if entry[key] is None else f"{entry[key]:.2g}"
