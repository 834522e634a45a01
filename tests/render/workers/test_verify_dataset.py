"""``verify``: the plan decides what a pair is to be, and pairs decide which light is theirs."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.physics.light.baked_rocks import TERM_COUNT
from icymoon.render.baked_light import IndirectLight
from icymoon.render.pairs import baked_file, pair_folder
from icymoon.render.pairs.baked_file import BakedLight
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers import verify_dataset as verify_module
from icymoon.render.workers.pair_claims import Claims
from icymoon.render.workers.shared_light import StoredLight
from icymoon.render.workers.verify_dataset import Findings, Problem, verify_data_set
from icymoon.settings import description, pair_ids
from icymoon.support.errors import IcyMoonError
from pairs import Scene, camera, write_pair
from plans import grid

PAIRS = grid(seeds=1, more={"quality": {"indirect": "BAKED"}})
KEYS = ("000000000000", "111111111111")


def light(level: float = 1.0) -> BakedLight:
    return BakedLight(
        np.full((9, 3), level, np.float32),
        np.zeros(9, np.float32),
        np.zeros((0, TERM_COUNT, 3), np.float32),
        0.02,
        0.2,
        64,
        2.0,
    )


def rewrite(folder: Path, **changes: Any) -> None:
    path = folder / "pair.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def bake(dataset: Path, key: str, level: float = 1.0) -> StoredLight:
    path, checksum = baked_file.write_baked_light(dataset, key, light(level))
    return StoredLight(light(level), f"light/{path.name}", checksum)


def state(folder: Path, kept: StoredLight) -> None:
    rewrite(folder, indirect=IndirectLight({"Sun": kept}).to_json({"left": {"Sun": 0.2}, "right": {"Sun": 0.2}}, 0.01))


@pytest.fixture
def dataset(tmp_path) -> Path:
    """A whole data set of four pairs; each two share a light."""
    folder = tmp_path / "set"
    datasets.freeze_plan(folder, PAIRS, "")
    kept = [bake(folder, key) for key in KEYS]
    for number, pair in enumerate(PAIRS):
        made = write_pair(pair.folder(folder), Scene(), camera(32, 24), settings=pair.settings)
        rewrite(made, seeds={"dataset": 0, "render": pair.render_seed}, edited_by_hand=False)
        state(made, kept[number // 2])
    assert verify_data_set(folder) == Findings(4, 4, ())
    return folder


def everything(folder: Path) -> dict[str, bytes]:
    """All files below a folder, links not followed."""
    return {
        str(Path(place, name)): Path(place, name).read_bytes()
        for place, _, names in os.walk(folder)
        for name in names
        if not Path(place, name).is_symlink()
    }


def the_problem(dataset: Path, remove: bool = False) -> Problem:
    (problem,) = verify_data_set(dataset, remove).problems
    assert problem.text.endswith(".")
    assert "\n" not in problem.text
    return problem


def change_setting(folder: Path, topic: str, key: str, value: Any) -> None:
    settings = json.loads((folder / "pair.json").read_text())["settings"]
    settings[topic][key] = value
    rewrite(folder, settings=settings)


# The plan decides


@pytest.mark.parametrize("edited", [False, True])
@pytest.mark.parametrize(
    ("topic", "key", "value"),
    [
        ("light", "sun_elevation_deg", 77.0),
        ("surface", "albedo", 0.123),
        ("terrain", "hurst", 0.7),
        ("rig", "heading_deg", 45.0),
        ("dataset", "seed", 99),
        ("quality", "samples", 4000),
    ],
)
def test_settings_that_are_not_the_plans_are_reported_whatever_the_pair_states(dataset, topic, key, value, edited):
    folder = PAIRS[1].folder(dataset)
    change_setting(folder, topic, key, value)
    rewrite(folder, edited_by_hand=edited)
    found = verify_data_set(dataset, remove_broken=True)
    assert found.complete == 3
    texts = [problem.text for problem in found.problems]
    assert any(f"{topic}.{key} is {value}" in text and "was planned as" in text for text in texts)
    assert {(problem.kind, problem.what) for problem in found.problems} == {("foreign", PAIRS[1].id)}
    assert (folder / "pair.json").exists()
    assert len(texts) == 1 + edited


def test_a_pair_of_the_plan_that_claims_to_be_edited_is_not_as_planned(dataset):
    rewrite(PAIRS[1].folder(dataset), edited_by_hand=True)
    problem = the_problem(dataset)
    assert (problem.kind, problem.what) == ("foreign", PAIRS[1].id)
    assert "plan.jsonl plans no such pair" in problem.text


def test_the_settings_of_another_pair_of_the_plan_are_reported(dataset):
    """Consistent in itself, with the id, settings and seed of another planned pair."""
    other = json.loads((PAIRS[2].folder(dataset) / "pair.json").read_text())
    (PAIRS[1].folder(dataset) / "pair.json").write_text(json.dumps(other))
    texts = " ".join(problem.text for problem in verify_data_set(dataset).problems)
    for word in (f"is of pair {PAIRS[2].id}", "light.sun_elevation_deg is 40.0 and was planned as 20.0", "seed"):
        assert word in texts


@pytest.mark.parametrize("own", ["Hapke of nodes and more", "0" * 64])
def test_files_of_ones_own_that_do_not_give_the_id_are_reported(dataset, own):
    rewrite(PAIRS[1].folder(dataset), own_files_sha256=own)
    assert "own files do not give the id" in the_problem(dataset).text


def test_what_does_not_change_a_pixel_may_differ(dataset):
    for topic, key, value in (("sensor", "gain", 2.0), ("quality", "threads", 3)):
        change_setting(PAIRS[1].folder(dataset), topic, key, value)
    assert verify_data_set(dataset).problems == ()


def test_an_edited_pair_that_no_plan_has_is_a_state(dataset):
    """As the window renders a scene that was edited by hand into the folder of a data set."""
    folder = write_pair(dataset / "pairs" / ("e" * 12), Scene(), camera(32, 24), settings=grid()[0].settings)
    rewrite(folder, edited_by_hand=True)
    before = everything(dataset)
    problem = the_problem(dataset, remove=True)
    assert (problem.kind, problem.what) == ("edited", "e" * 12)
    assert "settings do not determine its images" in problem.text
    assert everything(dataset) == before
    rewrite(folder, edited_by_hand=False)
    assert the_problem(dataset).kind == "foreign"


def test_what_lies_in_a_pairs_folder_and_is_not_ours_is_reported_and_stays(dataset):
    inner = PAIRS[1].folder(dataset) / "inner"
    inner.mkdir()
    (problem,) = verify_data_set(dataset, remove_broken=True).problems
    assert (problem.kind, problem.what) == ("foreign", PAIRS[1].id)
    assert str(inner) in problem.text
    assert inner.is_dir()


@pytest.mark.parametrize("remove", [False, True])
def test_a_pair_with_links_and_files_that_are_not_ours_is_named_once(dataset, tmp_path, remove):
    folder = PAIRS[1].folder(dataset)
    (folder / "left.exr").rename(tmp_path / "left.exr")
    (folder / "left.exr").symlink_to(tmp_path / "left.exr")
    (folder / "notes.txt").write_text("x")
    (folder / "more.txt").write_text("x")
    problem = the_problem(dataset, remove)
    assert (problem.kind, problem.what) == ("foreign", PAIRS[1].id)
    assert f"{folder / 'left.exr'} is a link" in problem.text
    assert f"{folder / 'more.txt'} and 1 more are not Icy Moon's" in problem.text
    assert len(everything(folder)) == 4  # the truth, the other eye, and two that stay


@pytest.mark.parametrize("remove", [False, True])
def test_a_broken_pair_with_a_file_that_is_not_ours_states_once_why_it_stays(dataset, remove):
    folder = PAIRS[1].folder(dataset)
    (folder / "left.exr").unlink()
    (folder / "notes.txt").write_text("x")
    texts = [problem.text for problem in verify_data_set(dataset, remove).problems]
    assert sum("notes.txt" in text for text in texts) == 1
    assert (folder / "notes.txt").exists()


def test_a_name_forges_no_line(dataset, capsys):
    (dataset / "pairs" / "x\n4 pairs, all whole and as planned.").mkdir()
    assert main(["verify", str(dataset)]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert "x\\n4 pairs" in line


def test_an_image_that_is_replaced_with_its_checksum_is_not_found(dataset):
    """As docs/security.md states: the checksum is the pair's own. Without the checksum it is found."""
    folder = PAIRS[1].folder(dataset)
    (folder / "left.exr").write_bytes((folder / "right.exr").read_bytes())
    assert the_problem(dataset).kind == "broken"
    files = json.loads((folder / "pair.json").read_text())["files"]
    rewrite(folder, files=files | {"left.exr": files["right.exr"]})
    assert verify_data_set(dataset) == Findings(4, 4, ())


# Pairs decide


def test_an_image_of_another_size_is_found_whatever_its_checksum(dataset, tmp_path):
    folder = PAIRS[1].folder(dataset)
    other = write_pair(tmp_path / "other" / PAIRS[1].id, Scene(), camera(24, 16))
    (folder / "left.exr").write_bytes((other / "left.exr").read_bytes())
    files = json.loads((folder / "pair.json").read_text())["files"]
    files["left.exr"] = json.loads((other / "pair.json").read_text())["files"]["left.exr"]
    rewrite(folder, files=files)
    assert "left.exr has 24 x 16 pixels, and its settings give 32 x 24" in the_problem(dataset).text


def first_light(dataset: Path) -> Path:
    return sorted((dataset / "light").iterdir())[0]


def replace_by_brighter(dataset: Path) -> None:
    other = dataset.with_name("other")
    first_light(dataset).write_bytes((other / bake(other, KEYS[0], 8.0).file).read_bytes())


LIGHT_FAULTS: dict[str, tuple[Callable[[Path], object], set[tuple[str, str]], bool]] = {
    "brighter": (
        replace_by_brighter,
        {("broken", "states another content"), ("light", "has another content now")},
        True,
    ),
    "empty": (
        lambda d: first_light(d).write_bytes(b""),
        {("broken", "another content"), ("light", "another content")},
        True,
    ),
    "not used": (lambda d: bake(d, "2" * 12), {("light", "No pair states the light")}, False),
    "not used, of a key": (lambda d: bake(d, KEYS[0], 8.0), {("light", "No pair states the light")}, False),
    "not ours": (lambda d: (d / "light" / "thesis.txt").write_text("x"), {("foreign", "is not baked light")}, False),
    "old name": (lambda d: first_light(d).rename(d / "light" / f"{KEYS[0]}.npz"), {("light", "No pair states")}, False),
    "unfinished": (
        lambda d: (d / "light" / f"{KEYS[0]}.npz.host-1-1.part").write_text(""),
        {("leftover", "left unfinished")},
        True,
    ),
    "a folder": (lambda d: (d / "light" / f"{KEYS[0]}.npz").mkdir(), {("foreign", "not a regular file")}, False),
    "a pipe": (lambda d: os.mkfifo(d / "light" / f"{KEYS[0]}.npz"), {("foreign", "not a regular file")}, False),
}


@pytest.mark.parametrize("fault", LIGHT_FAULTS)
def test_every_fault_of_light_is_reported_and_only_what_is_broken_goes(dataset, fault):
    damage, wanted, goes = LIGHT_FAULTS[fault]
    damage(dataset)
    before = set(dataset.rglob("*"))
    found = verify_data_set(dataset, remove_broken=True)
    assert found.complete == 4  # the images of pairs are what they were
    assert len(found.problems) == len(wanted)
    for kind, words in wanted:
        assert any(problem.kind == kind and words in problem.text for problem in found.problems), words
    assert (before == set(dataset.rglob("*"))) != goes


@pytest.mark.parametrize("fault", ["brighter", "empty", "two of one key"])
def test_light_of_a_set_without_a_plan_has_a_fix_that_needs_none(dataset, fault):
    (dataset / "plan.jsonl").unlink()
    if fault == "two of one key":
        state(PAIRS[1].folder(dataset), bake(dataset, KEYS[0], 8.0))
    else:
        LIGHT_FAULTS[fault][0](dataset)
    (problem,) = [each for each in verify_data_set(dataset).problems if each.kind == "light"]
    assert problem.text.endswith("away and render the pair again.")
    assert "batch" not in problem.text


def test_two_pairs_of_one_key_with_different_light_are_reported(dataset):
    state(PAIRS[1].folder(dataset), bake(dataset, KEYS[0], 8.0))
    problem = the_problem(dataset)
    assert problem.kind == "light"
    assert sorted(PAIRS[k].id in problem.text for k in (0, 1)) == [True, True]
    assert "other light than pair" in problem.text


def test_light_that_is_missing_is_a_note_and_no_problem(dataset, capsys):
    """Whoever needs the space may delete it: the images are what they were."""
    lost = first_light(dataset)
    lost.unlink()
    assert verify_data_set(dataset) == Findings(
        4,
        4,
        (),
        (
            f"{lost} is missing, the baked light of 2 pairs; their images do not need it any more, and later "
            "pairs of the "
            "same ground bake it again.",
        ),
    )
    shutil.rmtree(dataset / "light")
    (note,) = verify_data_set(dataset, remove_broken=True).notes
    assert f"{lost} and 1 more are missing, the baked light of 4 pairs" in note
    assert main(["verify", str(dataset)]) == 0
    assert capsys.readouterr().out.splitlines() == [note, "4 pairs, all whole and as planned."]
    assert main(["verify", str(dataset), "--json"]) == 0
    assert [json.loads(line)["type"] for line in capsys.readouterr().out.splitlines()] == ["note", "result"]


def test_light_that_is_missing_may_come_back(dataset):
    """The same light has the same file, whose content is compared again."""
    lost = first_light(dataset)
    lost.unlink()
    bake(dataset, KEYS[0])
    assert verify_data_set(dataset) == Findings(4, 4, ())
    lost.write_bytes(b"")
    assert {problem.kind for problem in verify_data_set(dataset).problems} == {"broken", "light"}


def test_light_of_an_older_version_is_whole_while_it_is_as_its_pairs_state(dataset):
    old = first_light(dataset).rename(dataset / "light" / f"{KEYS[0]}.npz")
    for pair in PAIRS[:2]:
        stated = json.loads((pair.folder(dataset) / "pair.json").read_text())["indirect"]
        stated["lights"]["Sun"]["file"] = f"light/{old.name}"
        rewrite(pair.folder(dataset), indirect=stated)
    assert verify_data_set(dataset).problems == ()
    old.write_bytes(old.read_bytes() + b"\0")
    assert "has another content now" in the_problem(dataset, remove=True).text
    assert old.exists()  # its name does not state its content


def test_light_that_is_being_baked_is_no_fault(dataset):
    other = Claims(dataset)
    assert other.take("2" * 12)
    bake(dataset, "2" * 12)
    (dataset / "light" / f"{'2' * 12}-{'3' * 12}.npz.host-1-1.part").write_text("")
    assert verify_data_set(dataset).problems == ()
    other.close()
    assert {problem.kind for problem in verify_data_set(dataset).problems} == {"light", "leftover"}


def test_a_claim_that_was_to_state_light_is_a_leftover(dataset):
    (dataset / "claims").mkdir()
    path = dataset / "claims" / f"{KEYS[0]}.1.host-1-1.part"
    path.write_text("")
    assert the_problem(dataset, remove=True).kind == "leftover"
    assert not path.exists()


# Links lead to what is anyone's

PLACES = [
    "pairs",
    "light",
    f"pairs/{PAIRS[0].id}",
    f"pairs/{PAIRS[0].id}/pair.json",
    f"pairs/{PAIRS[0].id}/left.exr",
    "a light",
]


@pytest.mark.long
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("place", PLACES)
def test_a_link_is_reported_and_nothing_behind_it_changes(dataset, tmp_path, place, whole, monkeypatch):
    path = first_light(dataset) if place == "a light" else dataset / place
    elsewhere = tmp_path / "elsewhere"
    path.rename(elsewhere)
    path.symlink_to(elsewhere)
    if not whole:
        target = next(each for each in (elsewhere, *sorted(elsewhere.rglob("*"))) if each.is_file())
        target.write_bytes(b"mine")
    before = everything(tmp_path)
    found = verify_data_set(dataset, remove_broken=True)
    assert any("link" in problem.text or "not a regular file" in problem.text for problem in found.problems)
    assert everything(tmp_path) == before
    assert path.is_symlink()
    if place.startswith("pairs"):
        assert found.complete < 4
    monkeypatch.setenv("ICYMOON_CACHE", str(tmp_path / "cache"))
    assert main(["work", str(dataset), "--blender", "/nowhere/blender"]) == (
        0 if "light" in place and place != "light" else 1
    )
    after = everything(tmp_path)
    assert before.items() <= after.items()
    assert {name for name in after.keys() - before.keys() if "elsewhere" in name} == set()


def test_the_data_set_itself_may_be_reached_by_a_link(dataset, tmp_path):
    (tmp_path / "short").symlink_to(dataset)
    assert verify_data_set(tmp_path / "short") == Findings(4, 4, ())


# A data set without a plan


def without_plan(dataset: Path) -> Path:
    (dataset / datasets.PLAN).unlink()
    return dataset


def test_a_data_set_without_a_plan_is_checked_against_what_its_pairs_state(dataset, capsys):
    assert main(["verify", str(without_plan(dataset))]) == 0
    note, result = capsys.readouterr().out.splitlines()
    assert note.startswith(f"{dataset} has no plan.jsonl, so each pair is compared with its own statements")
    assert result == "4 pairs, all whole and as stated."


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda folder: (folder / "left.exr").write_bytes(b""), "left.exr has 0 bytes"),
        (lambda folder: change_setting(folder, "surface", "albedo", 0.123), "do not give the id"),
        (lambda folder: rewrite(folder, seeds={"dataset": 0, "render": 1}), "was rendered with the seed 1"),
        (lambda folder: folder.rename(folder.with_name("f" * 12)), f"is of pair {PAIRS[1].id}, not {'f' * 12}"),
    ],
)
def test_a_broken_pair_without_a_plan_is_named(dataset, capsys, damage, words):
    damage(PAIRS[1].folder(without_plan(dataset)))
    assert main(["verify", str(dataset)]) == 1
    said = capsys.readouterr()
    assert words in said.out
    assert "icymoon batch" not in said.out + said.err


def test_an_edited_pair_without_a_plan_is_whole(dataset):
    rewrite(PAIRS[1].folder(without_plan(dataset)), edited_by_hand=True, own_files_sha256="x")
    assert verify_data_set(dataset).problems == ()


def test_nothing_is_removed_without_a_plan(dataset):
    (PAIRS[1].folder(without_plan(dataset)) / "left.exr").write_bytes(b"")
    before = everything(dataset)
    with pytest.raises(IcyMoonError, match=r"has no plan\.jsonl, so icymoon batch could not render again"):
        verify_data_set(dataset, remove_broken=True)
    assert everything(dataset) == before


def test_a_folder_without_plan_and_pairs_is_no_data_set(tmp_path):
    with pytest.raises(IcyMoonError, match=r"has no plan\.jsonl and no pairs; give the folder of a data set"):
        verify_data_set(tmp_path)


# What a line asks for can be done


@pytest.mark.parametrize("remove", [False, True])
def test_a_folder_without_pair_json_and_with_foreign_files_is_one_line(dataset, remove):
    folder = PAIRS[1].folder(dataset)
    (folder / "pair.json").unlink()
    (folder / "notes.txt").write_text("x")
    problems = [problem for problem in verify_data_set(dataset, remove).problems if problem.what == PAIRS[1].id]
    assert len(problems) == 1
    assert "has no pair.json" in problems[0].text
    assert "notes.txt is not Icy Moon's; move it out" in problems[0].text


def test_what_is_of_no_plan_and_other_seeds_are_told_with_what_to_do(dataset):
    (dataset / "pairs" / "my pair").mkdir()
    assert "is not of this plan; move it out of the data set." in the_problem(dataset).text
    (dataset / "pairs" / "my pair").rmdir()
    rewrite(PAIRS[1].folder(dataset), seeds={"dataset": 7, "render": PAIRS[1].render_seed})
    text = the_problem(dataset).text
    assert "seeds.dataset is 7, and its settings give 0; move the folder away and run icymoon batch." in text


# What it costs


def test_each_pair_is_read_once_and_what_all_share_is_made_once(dataset, monkeypatch):
    read: list[str] = []
    counters: list[int] = []
    checked: list[str] = []
    read_text, make_counter, check_table = pair_folder.read_text, pair_ids.make_counter, description._check_table
    for module in (verify_module, pair_folder):
        monkeypatch.setattr(module, "read_text", lambda path: read.append(path.parent.name) or read_text(path))
    monkeypatch.setattr(verify_module, "make_counter", lambda: counters.append(1) or make_counter())
    monkeypatch.setattr(
        description,
        "_check_table",
        lambda topic, *rest, **named: checked.append(topic) or check_table(topic, *rest, **named),
    )
    assert verify_data_set(dataset).problems == ()
    assert sorted(read) == sorted(pair.id for pair in PAIRS)
    assert len(counters) == 1
    # The plan's first pair, and what differs from it, beside what is in the files.
    assert checked.count("surface") <= 2
    assert checked.count("terrain") <= 2


def test_what_file_managers_leave_is_no_problem(dataset):
    """In every folder of a data set, as on a disk that a Mac or Windows has shown."""
    for folder in [dataset, *(path for path in dataset.rglob("*") if path.is_dir())]:
        for name in (".DS_Store", "._pair.json", "._left.exr", "Thumbs.db", "desktop.ini"):
            (folder / name).write_bytes(bytes(100))
    assert verify_data_set(dataset) == Findings(4, 4, ())
    (dataset / "pairs" / ".DS_Store2").write_bytes(b"")
    assert the_problem(dataset).kind == "foreign"


@pytest.mark.parametrize("planned", [True, False])
def test_a_pair_under_another_name_is_told_its_own(dataset, planned, capsys):
    if not planned:
        without_plan(dataset)
    first, second = (pair.folder(dataset) for pair in PAIRS[:2])
    shutil.copytree(first, copy := first.with_name(f"{first.name} copy"))
    problem = the_problem(dataset)
    assert problem.text == f"{copy} is pair {first.name} again, under another name; move it out of the data set."
    assert main(["verify", str(dataset)]) == 1
    if not planned:
        assert "4 of 4 pairs whole and as stated; follow the fix in each line." in capsys.readouterr().err
    shutil.rmtree(copy)
    renamed = second.rename(second.with_name("best one"))
    texts = [problem.text for problem in verify_data_set(dataset).problems]
    assert (
        f"{renamed} is pair {second.name} under another name; call it {second.name}, or move it out of the data "
        "set." in texts
    )
    renamed.rename(second)  # the fix works
    assert verify_data_set(dataset).problems == ()


def test_a_data_set_whose_only_pair_was_renamed_is_told_so(dataset):
    without_plan(dataset)
    first, *others = (pair.folder(dataset) for pair in PAIRS)
    for folder in others:
        shutil.rmtree(folder)
    renamed = first.rename(first.with_name("best"))
    with pytest.raises(IcyMoonError, match=f"best is pair {first.name} under another name; call it {first.name}"):
        verify_data_set(dataset)
    (renamed / "pair.json").write_text("{")
    with pytest.raises(IcyMoonError, match=r"best has the name of no pair, and its pair.json cannot be read"):
        verify_data_set(dataset)
