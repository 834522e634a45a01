"""A data set whose workers are played by a program of the tests."""

from __future__ import annotations

import json
import stat
import sys
from pathlib import Path
from typing import Any

from icymoon.render.workers.pair_claims import CLAIMS_FOLDER
from icymoon.render.workers.runner import Runner, WorkerOptions
from plans import grid

PAIRS = grid(seeds=3)  # of two lights and two headings each


class Stand:
    """A folder with the false Blender, and a data set."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.dataset = folder, folder / "set"
        self.blender = folder / "blender"
        text = Path(__file__).with_name("fake_blender.py").read_text()
        self.blender.write_text(text.replace("#!/usr/bin/env python3", f"#!{sys.executable}"))
        self.blender.chmod(self.blender.stat().st_mode | stat.S_IXUSR)
        self.behave()
        self.said: list[dict[str, Any]] = []

    def behave(self, **how: str) -> None:
        """What goes wrong, by pair."""
        (self.folder / "behave.json").write_text(json.dumps(how))

    def runner(self, workers: int = 2, **options: Any) -> Runner:
        return Runner(
            self.dataset,
            PAIRS,
            WorkerOptions(workers, 1, str(self.blender), **options),
            lambda kind, **facts: self.said.append({"type": kind, **facts}),
        )

    def run(self, **options: Any) -> dict[str, str]:
        return self.runner(**options).run()

    @property
    def rendered(self) -> list[str]:
        """The pairs that were begun, each as often as it was."""
        return (self.folder / "log").read_text().split()

    def assert_done(self, *but: str) -> None:
        """Every pair but these is there, once, and nothing else."""
        there = {p.name for p in (self.dataset / "pairs").iterdir()}
        assert there == {p.id for p in PAIRS} - set(but)
        assert not (self.dataset / CLAIMS_FOLDER).exists()
