"""The verb ``design``: compare sensor suites on the same grounds by decision risk, energy and processor time."""

from __future__ import annotations

import argparse
from typing import Any

from ..support import printer
from ..support.errors import IcyMoonError
from ..support.terminal import add_json_lines, as_path, check_least, tell_events
from ..support.version import version
from .environment import packages

#: Fewest grounds of a study, because intervals of energy and time need as many.
_FEWEST_GROUNDS = 20


def add_design_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the verb ``design``; ``run_design`` reads them."""
    command.add_argument(
        "design",
        nargs="?",
        default="suites",
        help="a shipped design by its name, or a TOML file of that form (%(default)s)",
    )
    command.add_argument(
        "--out",
        type=as_path,
        required=True,
        metavar="FOLDER",
        help="folder of the rows and the report; rows that are there are kept",
    )
    command.add_argument(
        "--grounds",
        type=int,
        default=60,
        metavar="N",
        help=f"grounds of the design's terrains, {_FEWEST_GROUNDS} or more (%(default)s)",
    )
    command.add_argument(
        "--landforms",
        type=int,
        default=30,
        metavar="N",
        help=f"grounds of held-out landforms, {_FEWEST_GROUNDS} or more (%(default)s)",
    )
    command.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all grounds (%(default)s)")
    command.add_argument(
        "--rules", type=as_path, metavar="FILE", help="TOML file with rules of your own for sites, as in decide"
    )
    add_json_lines(command)


def run_design(parsed: argparse.Namespace) -> int:
    """Run ``design`` with its parsed arguments; return the exit code."""
    packages.require_modules(*packages.PACKAGES)
    from .decide import DECISIONS_VERSION
    from .decisions.rules import read_rules
    from .design.measure_suites import ROW_SHAPE, Study, draw_grounds, measure_suites
    from .design.read_design import find_design, read_design
    from .design.report import FIRST_BYTES, LOG_FILE, write_design
    from .evaluation_files import check_output_folder, remove_leftovers
    from .report.row_log import RowLog

    check_least(parsed, 0, "seed")
    _check_grounds(parsed)
    study = Study(read_design(find_design(parsed.design)), read_rules(parsed.rules), [DECISIONS_VERSION, version()])
    check_output_folder(parsed.out, [], FIRST_BYTES)
    recipes = draw_grounds(study.design, parsed.seed, parsed.grounds, parsed.landforms)
    remove_leftovers(parsed.out)
    log = RowLog(parsed.out / LOG_FILE, ROW_SHAPE)
    with tell_events("Deciding", parsed.json_lines) as on_event:
        rows = measure_suites(study, recipes, log, on_event)
    _tell_result(parsed, write_design(parsed.out, study, rows, parsed.seed))
    return 0


def _check_grounds(parsed: argparse.Namespace) -> None:
    """Raise IcyMoonError for too few grounds to state a risk or a cost."""
    for option in ("grounds", "landforms"):
        asked = getattr(parsed, option)
        if asked < _FEWEST_GROUNDS:
            raise IcyMoonError(
                f"--{option} is {asked}, and intervals of risk, energy and time need {_FEWEST_GROUNDS} grounds; give "
                f"{_FEWEST_GROUNDS} or more."
            )


def _tell_result(parsed: argparse.Namespace, report: dict[str, Any]) -> None:
    """Print the result. Raises IcyMoonError if suites failed."""
    path = (parsed.out / "design.html").resolve()
    if parsed.json_lines:
        printer.emit_json({"type": "result", "report": str(path)} | {key: report[key] for key in ("head", "suites")})
    else:
        from .design.report import COLUMNS, list_cells

        rows = [list_cells(entry) for entry in report["suites"]]
        printer.print_table(COLUMNS, rows, f"Decisions on {report['grounds']} grounds", narrowest=140)
        for sentence in (*report["head"], *report["notes"]):
            printer.say(sentence)
        printer.say(str(path))
    if failed := report["failed"]:
        raise IcyMoonError(f"{len(failed)} of the decisions failed, the first one: {failed[0]['message']}")
