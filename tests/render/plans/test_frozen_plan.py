"""A frozen plan is read back as it was, in the same order; whole and broken data sets are told apart."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.workers.manifest import write_manifest
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.support.errors import IcyMoonError
from pairs import Scene, camera, write_pair
from plans import grid, planned

PAIRS = grid()


def complete(folder, frozen) -> None:
    """Pairs as they would be rendered, small and all alike."""
    for pair in frozen.pairs:
        made = write_pair(pair.folder(folder), Scene(), camera(32, 24), settings=pair.settings)
        path = made / "pair.json"
        data = json.loads(path.read_text())
        data |= {
            "seeds": {"dataset": pair.settings.dataset.seed, "render": pair.render_seed},
            "versions": {"blender": "5.0.1"},
            "device": "CPU",
            "platform": "here",
            "seconds": {"render": 1.5, "build": 0.5},
            "peak_memory_mib": 300.0,
        }
        path.write_text(json.dumps(data))


def test_a_frozen_plan_is_read_back(tmp_path):
    frozen = datasets.freeze_plan(tmp_path, PAIRS, "the plan\n")
    assert [p.id for p in frozen.pairs] == [p.id for p in PAIRS]
    assert [p.settings for p in frozen.pairs] == [p.settings for p in PAIRS]
    assert frozen.text == "the plan\n"
    assert datasets.read_frozen_plan(tmp_path) == frozen
    assert frozen.find_missing(tmp_path) == list(frozen.pairs)
    stamp = (tmp_path / datasets.PLAN).stat().st_mtime_ns
    datasets.freeze_plan(tmp_path, PAIRS, "the plan\n")
    assert (tmp_path / datasets.PLAN).stat().st_mtime_ns == stamp  # nothing to write


def test_lists_of_tables_survive(tmp_path):
    layered = planned({"terrain": {"layers": [{"amplitude_m": 0.5}, {"scale_m": 1.0}]}})
    frozen = datasets.freeze_plan(tmp_path, [planned(), layered, planned({"dataset": {"seed": 9}})], "")
    assert frozen.pairs[1].settings == layered.settings
    assert frozen.pairs[2].settings.terrain.layers == []


def test_a_data_set_may_grow_but_not_become_another(tmp_path):
    datasets.freeze_plan(tmp_path, PAIRS[:3], "")
    assert len(datasets.freeze_plan(tmp_path, PAIRS, "longer").pairs) == len(PAIRS)
    with pytest.raises(IcyMoonError, match="another data set"):
        datasets.freeze_plan(tmp_path, PAIRS[:3], "")
    assert len(datasets.read_frozen_plan(tmp_path).pairs) == len(PAIRS)
    with pytest.raises(IcyMoonError, match="no pair"):
        datasets.freeze_plan(tmp_path / "x", [], "")


def square(*suns: float, size_m: float = 20.0) -> list[PlannedPair]:
    """Pairs in two headings under each Sun."""
    return [
        planned({"rig": {"heading_deg": heading}, "light": {"sun_elevation_deg": sun}, "terrain": {"size_m": size_m}})
        for heading in (0.0, 90.0)
        for sun in suns
    ]


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (
            square(20.0, 40.0, size_m=6.0),
            "4 of its 4 pairs are not in this plan, since terrain.size_m was 20.0 and is 6.0",
        ),
        (square(20.0), "2 of its 4 pairs are not in this plan, since light.sun_elevation_deg no longer takes 40.0"),
        (square(20.0, 50.0), "light.sun_elevation_deg no longer takes 40.0, but 50.0"),
        (
            square(50.0, 60.0),
            "light.sun_elevation_deg no longer takes 20.0 and 1 more value, but 50.0 and 1 more value",
        ),
        (
            square(20.0, 40.0)[1:],
            "1 of its 4 pairs is not in this plan, since no pair has together "
            "light.sun_elevation_deg 20.0, rig.heading_deg 0.0",
        ),
        (
            [replace(pair, id=f"{k:012x}") for k, pair in enumerate(square(20.0, 40.0))],
            "since a file of yours has changed",
        ),
    ],
)
def test_the_settings_that_changed_are_named_and_no_others(tmp_path, now, words):
    """Also where other settings vary, whose values are as they were."""
    datasets.freeze_plan(tmp_path, square(20.0, 40.0), "")
    with pytest.raises(IcyMoonError) as caught:
        datasets.freeze_plan(tmp_path, now, "edited")
    assert f"{words}. To continue" in str(caught.value)


@pytest.mark.parametrize("damage", ["", "{", "[1]\n", '{"format": "icymoon-dataset", "version": 99}\n'])
def test_a_damaged_plan_is_a_sentence(tmp_path, damage):
    (tmp_path / datasets.PLAN).write_text(damage)
    with pytest.raises(IcyMoonError, match=r"plan\.jsonl"):
        datasets.read_frozen_plan(tmp_path)


def test_a_cut_plan_is_a_sentence(tmp_path):
    datasets.freeze_plan(tmp_path, PAIRS, "")
    path = tmp_path / datasets.PLAN
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-1]))
    with pytest.raises(IcyMoonError, match="contains 7 of 8"):
        datasets.read_frozen_plan(tmp_path)


def test_a_folder_without_a_plan_is_a_sentence(tmp_path):
    with pytest.raises(IcyMoonError, match="icymoon batch"):
        verify_data_set(tmp_path)


def test_a_whole_data_set_has_no_fault_and_a_manifest(tmp_path):
    frozen = datasets.freeze_plan(tmp_path, PAIRS, "the plan")
    complete(tmp_path, frozen)
    manifest = write_manifest(tmp_path, {})
    assert manifest == json.loads((tmp_path / "manifest.json").read_text())
    assert (manifest["complete"], manifest["missing"], manifest["plan"]) == (8, [], "the plan")
    assert manifest["seconds"] == {"build": 4.0, "render": 12.0}
    assert len(manifest["checksums_sha256"]) == 16
    found = verify_data_set(tmp_path)
    assert (found.pairs, found.complete, found.problems) == (8, 8, ())


def _flip(path) -> None:
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


def _rewrite(folder, **changes) -> None:
    path = folder / "pair.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


FAULTS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "one bit": (lambda f: _flip(f / "left.exr"), "broken", "checksum"),
    "cut": (lambda f: (f / "left.exr").write_bytes(b"x"), "broken", "bytes"),
    "no image": (lambda f: (f / "right.exr").unlink(), "broken", "missing"),
    "no pair.json": (lambda f: (f / "pair.json").unlink(), "broken", "no pair.json"),
    "half a pair.json": (lambda f: (f / "pair.json").write_text("{"), "broken", "cannot be read"),
    "gone": (shutil.rmtree, "missing", "missing"),
    "other settings": (lambda f: _rewrite(f, settings=planned({"surface": {"albedo": 0.1}}).settings), "foreign", "id"),
    "other id": (lambda f: _rewrite(f, id="ffffffffffff"), "foreign", "ffffffffffff"),
    "other seed": (lambda f: _rewrite(f, seeds={"dataset": 0, "render": 1}), "foreign", "seed"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_found_and_taken_away_unless_the_files_are_whole(tmp_path, fault):
    damage, kind, word = FAULTS[fault]
    frozen = datasets.freeze_plan(tmp_path, PAIRS, "")
    complete(tmp_path, frozen)
    damage(frozen.pairs[2].folder(tmp_path))
    found = verify_data_set(tmp_path, remove_broken=True)
    assert {(p.kind, p.what) for p in found.problems} == {(kind, frozen.pairs[2].id)}
    assert any(word in p.text for p in found.problems)
    assert found.complete == 7
    assert frozen.find_missing(tmp_path) == ([] if kind == "foreign" else [frozen.pairs[2]])
    assert frozen.pairs[2].folder(tmp_path).exists() == (kind == "foreign")


def test_leftovers_go_and_what_is_not_ours_is_named_and_stays(tmp_path):
    complete(tmp_path, datasets.freeze_plan(tmp_path, PAIRS, ""))
    (tmp_path / "pairs" / "0123456789ab.host-1-1.part").mkdir()
    (tmp_path / "pairs" / "notes").mkdir()
    (tmp_path / "plan.jsonl.host-1-1.part").write_text("")
    (tmp_path / "thesis.txt").write_text("")
    found = verify_data_set(tmp_path, remove_broken=True)
    assert sorted((p.kind, p.what) for p in found.problems) == [
        ("foreign", "notes"),
        ("foreign", "thesis.txt"),
        ("leftover", "0123456789ab.host-1-1.part"),
        ("leftover", "plan.jsonl.host-1-1.part"),
    ]
    assert [p.what for p in verify_data_set(tmp_path).problems] == ["notes", "thesis.txt"]
    assert (tmp_path / "thesis.txt").exists()
