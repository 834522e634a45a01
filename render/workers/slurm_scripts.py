"""Writes job scripts for a cluster with SLURM, whose machines need only this folder and Blender. Imports no Blender."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...support.errors import IcyMoonError
from ...support.files import write_text
from ..plans.frozen_plan import FrozenPlan
from ..plans.render_order import choose_shard
from .job_commands import python_command

SLURM_FOLDER = "slurm"
_CONTROL_CHARACTER = re.compile(r"[\x00-\x1f\x7f]")


@dataclass(frozen=True)
class SlurmRequest:
    """The requests of the script to SLURM: shards of the data set, the number of shards that run at once (0: all),
    processors and memory for each shard, wall time, and further options in sbatch's form."""

    shards: int
    at_once: int
    cpus: int
    memory: str
    time: str
    options: tuple[str, ...]


_SCRIPT_TEMPLATE = """#!/bin/bash
# {pairs} pairs of {dataset} in {shards} shards.
# Submit it with: sbatch {file}
# A shard may be killed, requeued or run twice at any moment: finished pairs are kept and none is rendered twice.
#SBATCH --job-name=icymoon
#SBATCH --array={array}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task={cpus}
#SBATCH --mem={memory}
#SBATCH --time={time}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:USR1@60
#SBATCH --output={log}
{options}
most_restarts={restarts}

requeue() {{
    echo "icymoon: $1; the shard is requeued"
    exec scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}"
}}

stop() {{
    kill -TERM "$child" 2>/dev/null
    wait "$child"
    requeue "the time is nearly up"
}}
trap stop USR1

{command} &
child=$!
wait "$child"
status=$?
[ "$status" -eq 0 ] && exit 0
[ "${{SLURM_RESTART_COUNT:-0}}" -lt "$most_restarts" ] && requeue "the shard ended with status $status"
exit "$status"
"""

#: Number of restarts of a shard after failures. A shard whose time is up always restarts.
MAX_RESTARTS = 3


def format_array_ranges(numbers: Sequence[int]) -> str:
    """Format rising numbers as SLURM does: ``1-3,7``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in runs)


def _refuse_lines(text: str) -> None:
    """Raise IcyMoonError for a text with a line break, since the rest would run as a command."""
    if _CONTROL_CHARACTER.search(text):
        raise IcyMoonError(
            f"{text!r} contains a line break or another control character, which a job script cannot "
            "contain; choose another path or option."
        )


def _quote_folder(folder: Path) -> str:
    """Quote a folder for an option of sbatch: one word, without escapes and % patterns."""
    if "\\" in str(folder):
        raise IcyMoonError(
            f"{folder} contains a backslash, after which SLURM does not replace %A and %a; choose another folder."
        )
    return '"' + str(folder).replace('"', '\\"').replace("%", "%%") + '"'


def write_script(dataset: Path, frozen: FrozenPlan, request: SlurmRequest, python: str, blender: str) -> Path | None:
    """Write the script of a job array for the shards that lack pairs, and return its file; None if all pairs are
    complete.

    ``python`` runs this package on the cluster's machines, ``blender`` is their Blender. Raises IcyMoonError for a path
    or an option that a line of the script cannot contain.
    """
    for text in (str(dataset), python, blender, request.memory, request.time, *request.options):
        _refuse_lines(text)
    missing = {pair.id for pair in frozen.find_missing(dataset)}
    open_shards = [
        number
        for number in range(1, request.shards + 1)
        if any(pair.id in missing for pair in choose_shard(frozen.pairs, number, request.shards))
    ]
    if not open_shards:
        return None
    folder = dataset / SLURM_FOLDER
    file = folder / "job.sh"
    words = python_command(python, "work", str(dataset), "--blender", blender, "--json", "--workers", "1")
    given = f'--threads-per-worker "${{SLURM_CPUS_PER_TASK:-1}}" --shard "${{SLURM_ARRAY_TASK_ID}}/{request.shards}"'
    limit = f"%{request.at_once}" if request.at_once else ""
    write_text(
        file,
        _SCRIPT_TEMPLATE.format(
            pairs=len(missing),
            dataset=dataset,
            shards=request.shards,
            file=shlex.quote(str(file)),
            array=format_array_ranges(open_shards) + limit,
            cpus=request.cpus,
            memory=request.memory,
            time=request.time,
            log=f"{_quote_folder(folder)}/%A_%a.log",
            options="".join(f"#SBATCH {option}\n" for option in request.options),
            restarts=MAX_RESTARTS,
            command=f"{shlex.join(words)} {given}",
        ),
    )
    return file
