"""``manifest.json``: what a data set holds, what made it and what that took. Imports no Blender.

Made from the pairs' own files at the end of every run, so that it says what is there, whoever rendered it.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..files import write_json
from ..version import version
from .dataset import FORMAT, PLAN, VERSION, read
from .pair import is_complete

MANIFEST = "manifest.json"


def _facts(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "pair.json").read_text(encoding="utf-8")))


def _counted(values: list[str]) -> dict[str, int]:
    return dict(sorted(Counter(values).items()))


def write_manifest(dataset: Path, failed: Mapping[str, str]) -> dict[str, Any]:
    """Write the manifest of a data set and return it; ``failed`` says why pairs were set aside in this run."""
    frozen = read(dataset)
    there = {pair.id: _facts(pair.folder(dataset)) for pair in frozen.pairs if is_complete(pair.folder(dataset))}
    steps = sorted({step for facts in there.values() for step in facts["seconds"]})
    manifest = {
        "format": FORMAT, "version": VERSION, "icymoon": version(), "planned_by": frozen.version, "plan": frozen.text,
        "plan_file": PLAN, "pairs": len(frozen.pairs), "complete": len(there),
        "missing": [pair.id for pair in frozen.pairs if pair.id not in there],
        "set_aside": {name: why for name, why in failed.items() if name not in there},
        "seeds": sorted({int(pair.settings["dataset"]["seed"]) for pair in frozen.pairs}),
        "versions": _counted([json.dumps(facts["versions"]) for facts in there.values()]),
        "devices": _counted([facts["device"] for facts in there.values()]),
        "platforms": _counted([facts["platform"] for facts in there.values()]),
        "seconds": {step: round(sum(facts["seconds"].get(step, 0.0) for facts in there.values()), 3)
                    for step in steps},
        "bytes": sum(file["bytes"] for facts in there.values() for file in facts["files"].values()),
        "peak_memory_mib": max((facts["peak_memory_mib"] or 0.0 for facts in there.values()), default=None),
        "checksums_sha256": {f"pairs/{name}/{file}": fact["sha256"] for name, facts in there.items()
                             for file, fact in facts["files"].items()},
    }
    write_json(dataset / MANIFEST, manifest)
    return manifest
