"""What is not ours stays, whatever a plan, a name or a link says."""

from __future__ import annotations

import json
import os
import re
import socket
from pathlib import Path

import icymoon
import pytest
from icymoon.render.pairs.dataset_file_names import check_id, find_reason_to_keep, remove_own_file
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.pairs.publish_pair import publish_pair
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.workers import verify_dataset as verification
from icymoon.render.workers.pair_claims import Claims
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.stereo.report.row_log import RowLog
from icymoon.support.errors import IcyMoonError
from icymoon.support.files import make_part_path
from pairs import Scene, camera, write_pair
from plans import grid

PAIRS = grid(1)
ID = PAIRS[0].id
BAD_IDS = (
    "../../victim",
    "..",
    ".",
    "",
    "*",
    "/etc",
    "ABCDEF012345",
    "0123456789ab\n",
    "0123456789abc",
    "0123456789a",
    "٠" * 12,
    "0123456789ab/..",
    None,
    5,
    ["0"] * 12,
)


def everything(folder: Path) -> set[str]:
    """All there is below a folder, links not followed."""
    return {str(Path(place, name)) for place, folders, names in os.walk(folder) for name in (*folders, *names)}


@pytest.fixture
def victim(tmp_path):
    """A folder beside the data set with a user's work in it, some with names like ours."""
    folder = tmp_path / "victim"
    folder.mkdir()
    for name in ("thesis.txt", "left.exr", "pair.json", f"{ID}.1"):
        (folder / name).write_text("work")
    make_part_path(folder / ID).mkdir()
    yield folder
    assert {p.name.split(".")[0] for p in folder.iterdir()} == {"thesis", "left", "pair", ID}
    assert len(list(folder.iterdir())) == 5


@pytest.fixture
def dataset(tmp_path):
    folder = tmp_path / "sub" / "dataset"
    datasets.freeze_plan(folder, PAIRS, "")
    return folder


def link(path: Path, target: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        path.symlink_to(target, target_is_directory=True)
    except OSError:
        pytest.skip("links may not be made here")


def sweep(dataset: Path) -> None:
    """Everything that removes something in a data set, of pairs that nobody has claimed."""
    verify_data_set(dataset, remove_broken=True)
    claims = Claims(dataset)
    claims.remove_leftovers_of(os.getpid())
    claims.take(ID)
    claims.close()
    claims.remove_leftovers()


@pytest.mark.parametrize("name", BAD_IDS)
def test_what_is_no_id_is_refused_wherever_it_is_read(tmp_path, dataset, victim, name):
    with pytest.raises(IcyMoonError, match="id is 12"):
        check_id(name, "here")
    path = dataset / datasets.PLAN
    header, first, *rest = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join((header, json.dumps(json.loads(first) | {"id": name}), *rest)), encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"plan\.jsonl"):
        verify_data_set(dataset, remove_broken=True)
    pair = write_pair(tmp_path / "copy", Scene(), camera(32, 24))
    stated = json.loads((pair / "pair.json").read_text())
    (pair / "pair.json").write_text(json.dumps(stated | {"id": name}))
    with pytest.raises(IcyMoonError, match=r"pair\.json"):
        read_pair(pair)


@pytest.mark.parametrize(
    "place", ["pairs", "claims", f"pairs/{ID}", f"pairs/{ID}.host-1-1.part", "plan.jsonl.host-1-1.part"]
)
def test_links_to_elsewhere_stay_and_so_does_what_they_lead_to(dataset, victim, place):
    link(dataset / place, victim)
    sweep(dataset)
    assert (dataset / place).is_symlink()
    assert not remove_own_file(dataset / place, dataset)


def test_a_link_in_a_pair_of_ours_keeps_it(dataset, victim):
    folder = write_pair(dataset / "pairs" / ID, Scene(), camera(32, 24))
    (folder / "right.exr").unlink()
    link(folder / "right.exr", victim / "left.exr")
    (folder / "pair.json").write_text("{")
    found = verify_data_set(dataset, remove_broken=True)
    assert [p.kind for p in found.problems if p.what == ID] == ["foreign"]
    assert (folder / "right.exr").is_symlink()


@pytest.mark.parametrize(
    "others",
    [
        ("notes.txt",),
        ("left.exr", "right.exr", "pair.json", "notes.txt"),
        ("deep/left.exr",),
        ("pair.json/x",),
        ("left_copy.exr",),
        ("pair.json.bak",),
    ],
)
def test_a_folder_called_as_a_pair_with_other_files_stays_and_is_named(dataset, others):
    folder = dataset / "pairs" / ID
    for name in others:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("mine")
    before = everything(folder)
    found = verify_data_set(dataset, remove_broken=True)
    (kept,) = (p for p in found.problems if p.kind in ("kept", "foreign"))
    assert str(folder) in kept.text
    assert any(Path(name).parts[0] in kept.text for name in others)
    sweep(dataset)
    assert everything(folder) == before


@pytest.mark.parametrize("again", [False, True])
def test_a_finished_render_does_not_push_a_persons_folder_aside(dataset, again):
    folder = dataset / "pairs" / ID
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("mine")
    part = write_pair(make_part_path(folder), Scene(), camera(32, 24))
    with pytest.raises(IcyMoonError, match=r"is in the place of the pair and is not replaced: notes\.txt"):
        publish_pair(part, folder, lambda: False, again)
    assert everything(dataset / "pairs") == {
        str(folder),
        str(folder / "notes.txt"),
        str(part),
        *(str(part / name) for name in ("left.exr", "right.exr", "pair.json")),
    }
    (folder / "notes.txt").unlink()
    publish_pair(part, folder, lambda: False, again)
    assert sorted(path.name for path in folder.iterdir()) == ["left.exr", "pair.json", "right.exr"]


def test_a_file_in_the_place_of_a_pair_stays(dataset):
    (dataset / "pairs").mkdir()
    (dataset / "pairs" / ID).write_text("mine")
    (problem,) = (p for p in verify_data_set(dataset, remove_broken=True).problems if p.what == ID)
    assert problem.kind == "foreign"
    assert (dataset / "pairs" / ID).read_text() == "mine"


def test_names_that_only_look_like_ours_stay(dataset):
    host = socket.gethostname()
    names = (
        "pairs/mine.part",
        f"pairs/mine.{host}-{os.getpid()}-1.part",
        "claims/notes.1",
        f"claims/{ID}.txt",
        f"claims/{ID}.1.bak",
        f"thesis.{host}-1-1.part",
        "pairs/.part",
        "my.part",
    )
    for name in names:
        (dataset / name).parent.mkdir(exist_ok=True)
        (dataset / name).write_text("mine")
    sweep(dataset)
    assert [name for name in names if not (dataset / name).exists()] == []


def test_what_is_ours_goes(dataset):
    (dataset / "pairs" / ID).mkdir(parents=True)
    ours = [
        write_pair(make_part_path(dataset / "pairs" / ID), Scene(), camera(32, 24)),
        dataset / "pairs" / ID,
        dataset / "claims" / f"{ID}.3",
        make_part_path(dataset / "plan.jsonl"),
        make_part_path(dataset / "pairs" / ".clock"),
    ]
    for name in (
        "left.exr",
        "right_toed_truth.exr",
        "pair.json",
        ".DS_Store",
        "._left.exr",
        "lidar.npz",
        "lidar.json",
        "lidar.wdp",
        make_part_path(Path("lidar.las")).name,
        "Thumbs.db",
        make_part_path(Path("pair.json")).name,
    ):
        (dataset / "pairs" / ID / name).write_text("")
    for path in ours[2:]:
        path.parent.mkdir(exist_ok=True)
        path.write_text("{}")
    for path in ours:
        assert find_reason_to_keep(path, dataset) == ""
        assert remove_own_file(path, dataset)
        assert not path.exists()
    assert remove_own_file(dataset / "pairs" / ID, dataset)  # nothing is there: that is what was wanted
    assert (dataset / "plan.jsonl").is_file()
    assert not remove_own_file(dataset / "plan.jsonl", dataset)
    assert not remove_own_file(dataset / "pairs", dataset)


def test_a_data_set_that_is_reached_by_a_link_is_ours(dataset, tmp_path):
    link(tmp_path / "short", dataset)
    (dataset / "pairs" / ID).mkdir(parents=True)
    assert remove_own_file(tmp_path / "short" / "pairs" / ID, tmp_path / "short")
    assert not (dataset / "pairs" / ID).exists()


def test_a_folder_with_the_name_of_a_file_of_ours_stays(dataset):
    places = [
        make_part_path(dataset / "plan.jsonl"),
        dataset / "claims" / f"{ID}.1",
        make_part_path(dataset / "pairs" / ".clock"),
    ]
    for place in places[:2]:
        place.mkdir(parents=True)
        (place / "thesis.txt").write_text("work")
        os.utime(place, (0, 0))
    sweep(dataset)
    assert all((place / "thesis.txt").read_text() == "work" for place in places[:2])
    assert find_reason_to_keep(places[0], dataset) == "it is a folder"


def test_a_persons_folder_whose_name_ends_as_ours_stops_no_batch(dataset):
    for name in (".x.part", "mine.part"):
        (dataset / "pairs" / name).mkdir(parents=True)
        (dataset / "pairs" / name / "thesis.txt").write_text("work")
    sweep(dataset)
    assert {path.name for path in (dataset / "pairs").iterdir()} == {".x.part", "mine.part"}


@pytest.mark.parametrize("name", ["../../../victim/thesis.txt", "/dev/zero", "."])
def test_no_checksum_is_made_of_what_lies_elsewhere(dataset, victim, name, monkeypatch):
    """Whoever asks learns a file's content by guesses, and one of a device never ends."""
    folder = dataset / "pairs" / ID
    folder.mkdir(parents=True)
    (folder / "pair.json").write_text(json.dumps({"files": {name: {"bytes": 4, "sha256": "0" * 64}}}))
    read = []
    monkeypatch.setattr(verification, "hash_file", lambda path: read.append(path) or "0" * 64)
    assert "broken" in {problem.kind for problem in verify_data_set(dataset).problems if problem.what == ID}
    assert not read


def test_rows_of_an_evaluation_name_no_folder(tmp_path):
    path = tmp_path / "results.jsonl"
    path.write_text(
        "".join(
            json.dumps({"pair": pair, "method": "bm", "key": "k"}) + "\n"
            for pair in ("../../victim", "..", "a/b", "good")
        )
    )
    log = RowLog(path)
    assert log.find("good", "bm", "k")
    assert log.find("../../victim", "bm", "k") is None
    assert log.find("a/b", "bm", "k") is None


#: Who else removes something, and why it may: what the same process has made a moment before under a name of its own,
#: and files that a user asks to replace or delete by name.
REMOVES = {
    "render/pairs/dataset_file_names.py": "the one way",
    "support/system.py": "how it is done",
    "support/files.py": "its own part",
    "render/workers/job_commands.py": "its own temporary folder",
    "library/renderers.py": "its own temporary folder",
    "render/ground_maps.py": "the image that it has read, in its own temporary folder",
    "paper_stand_ins/cached_files.py": "its own parts and record, in a folder of the cache",
    "render/render_pair.py": "what it wrote into its own part",
    "render/workers/pair_claims.py": "its own claim and probe",
    "stereo/environment/install.py": "the folder that it has made",
    "stereo/reexpose.py": "what it writes again",
    "formats/asset_library.py": "the files that its record lists, when a user asks for it",
    "operators/trade.py": "its own temporary folder",
    "support/temporary_folders.py": "its own temporary folder, and those marked by ended processes of this user",
    "operators/presets.py": "the preset that a user removes, with its picture",
    "operators/install_evaluator.py": "the environment that it has made, when a user asks for it",
    "operators/show_pair.py": "its own temporary folder",
    "operators/variation_pictures.py": "its own temporary folder",
    "stereo/learning/train.py": "samples of grounds that the same run has used up",
    "stereo/matchers/resident_process.py": "its own temporary folder",
    "stereo/export/lidar.py": "points of an earlier scan, by the names that the next one gives them",
    "stereo/export/bag_file.py": "its own part of a bag that was not finished",
    "stereo/export/training.py": "its own part of a shard that was not finished",
    "stereo/export/whole_folders.py": "its own part of a pair that was not finished",
    "stereo/trade/cheapest_quality.py": "what it writes again",
    "formats/wave_packets.py": "its own part",
    "render/lidar_worker.py": "the waveforms of an earlier scan, whose returns it has just replaced",
}


def test_nothing_else_in_the_project_removes_anything():
    root = Path(icymoon.__file__).parent
    apart = ("tests", "benchmarks", "docs", "build", "dist", "out", ".")
    sources = [path for path in root.rglob("*.py") if not path.relative_to(root).parts[0].startswith(apart)]
    # Blender's collections unlink objects and collections, which are no files.
    signs = re.compile(
        r"rmtree|(?<!objects)(?<!children)\.unlink\(|\bos\.(remove|unlink|rmdir)|system\.remove|"
        r"system import .*remove"
    )
    removing = {path.relative_to(root).as_posix() for path in sources if signs.search(path.read_text("utf-8"))}
    assert removing == set(REMOVES)
