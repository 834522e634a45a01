"""Writes ``manifest.json``: the pairs of a data set, the versions of the programs that made them, and their render
times. Imports no Blender.

It is written at the end of each run from the pairs' own files, so it lists all pairs of all processes.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...settings.description import Restorer
from ...support.errors import IcyMoonError
from ...support.files import write_json
from ...support.version import version
from ..pairs.pair_folder import check_pair, read_complete
from ..plans.frozen_plan import FORMAT, PLAN, VERSION, FrozenPlan, read_frozen_plan

MANIFEST = "manifest.json"


def _count_values(values: list[str]) -> dict[str, int]:
    return dict(sorted(Counter(values).items()))


def _read_pairs(frozen: FrozenPlan, dataset: Path) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Read the ``pair.json`` of each complete pair. Return them by id, and by id the reasons why others cannot be
    read."""
    there, unreadable, restore = {}, {}, Restorer()
    for pair in frozen.pairs:
        folder = pair.folder(dataset)
        if data := read_complete(folder):
            try:
                there[pair.id] = check_pair(folder, data, restore).data
            except IcyMoonError as error:
                unreadable[pair.id] = str(error)
    return there, unreadable


def write_manifest(dataset: Path, failed: Mapping[str, str]) -> dict[str, Any]:
    """Write the manifest of a data set and return it; ``failed`` are the reasons why pairs were set aside in this
    run."""
    frozen = read_frozen_plan(dataset)
    there, unreadable = _read_pairs(frozen, dataset)
    taken = [facts.get("seconds", {}) for facts in there.values()]
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "icymoon": version(),
        "planned_by": frozen.version,
        "plan": frozen.text,
        "plan_file": PLAN,
        "pairs": len(frozen.pairs),
        "complete": len(there),
        "missing": [pair.id for pair in frozen.pairs if pair.id not in there],
        "set_aside": unreadable | {name: why for name, why in failed.items() if name not in there},
        "seeds": sorted({int(pair.settings.dataset.seed) for pair in frozen.pairs}),
        "versions": _count_values([json.dumps(facts.get("versions")) for facts in there.values()]),
        "devices": _count_values([facts.get("device", "") for facts in there.values()]),
        "platforms": _count_values([facts.get("platform", "") for facts in there.values()]),
        "seconds": {
            step: round(sum(each.get(step, 0.0) for each in taken), 3)
            for step in sorted({step for each in taken for step in each})
        },
        "bytes": sum(file["bytes"] for facts in there.values() for file in facts["files"].values()),
        "peak_memory_mib": max((facts.get("peak_memory_mib") or 0.0 for facts in there.values()), default=None),
        "checksums_sha256": {
            f"pairs/{name}/{file}": fact["sha256"]
            for name, facts in there.items()
            for file, fact in facts["files"].items()
        },
    }
    write_json(dataset / MANIFEST, manifest)
    return manifest
