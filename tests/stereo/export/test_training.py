"""Training copies: read back by their loaders' rules, the same bytes twice, no scene in two splits."""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pairs
import pytest
from icymoon.physics.light.directions import direction_toward
from icymoon.physics.light.scene_sun import SceneSun
from icymoon.render.pairs.pair_folder import Pair, find_pair_folders, read_pair
from icymoon.render.pairs.scene_splits import DEFAULT_SPLITS, choose_split, name_scene
from icymoon.settings.description import defaults, merged
from icymoon.stereo.export import training
from icymoon.stereo.export.layouts import export
from icymoon.support.arrays import Array
from icymoon.support.errors import DiskError, IcyMoonError

RIG = pairs.camera(96, 64)
SCENE = pairs.Scene(sky_rows=8)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Eight pairs of eight scenes, two of them not for training."""
    root = tmp_path_factory.mktemp("set")
    wanted = {True: 6, False: 2}
    for k in range(200):
        settings = merged(defaults(), {"dataset": {"seed": k}})
        trained = choose_split(name_scene(Pair(root, "0" * 12, settings, RIG, {})), DEFAULT_SPLITS) == "train"
        if wanted[trained]:
            wanted[trained] -= 1
            pairs.write_pair(root / "pairs" / f"{k:012x}", SCENE, RIG, settings=settings)
    return root


def with_sun(folder: Path, elevation_deg: float | None) -> None:
    """A pair whose settings ask for a date and whose record states a Sun that was turned by hand, or none."""
    settings = merged(defaults(), {"light": {"directions_from": "DATE", "sun_elevation_deg": 28.0}})
    pairs.write_pair(folder, SCENE, RIG, settings=settings)
    record = json.loads((folder / "pair.json").read_text())
    if elevation_deg is not None:
        record["light"] = {"sun": SceneSun(direction_toward(30.0, elevation_deg), 50.0, 0.1, "HAND").to_json()}
        record["edited_by_hand"] = True
    (folder / "pair.json").write_text(json.dumps(record))


@pytest.mark.parametrize(
    ("layout", "index"), [("webdataset", "index.csv"), ("sceneflow", "index.csv"), ("parquet-index", "index.parquet")]
)
def test_tables_state_the_sun_of_the_images_not_that_of_the_settings(tmp_path, layout, index):
    if layout == "parquet-index":
        parquet = pytest.importorskip("pyarrow.parquet", reason="pip install icymoon[parquet]")
    wanted = {"0" * 12: 82.25, "1" * 12: -3.5, "2" * 12: None}
    for name, elevation in wanted.items():
        with_sun(tmp_path / "set" / "pairs" / name, elevation)
    out = tmp_path / "x"
    export([tmp_path / "set"], layout, out)
    rows = (
        list(csv.DictReader((out / index).open()))
        if index.endswith("csv")
        else parquet.read_table(out / index).to_pylist()
    )
    found = {row["key"]: row["sun_elevation_deg"] for row in rows}
    assert {key: None if value in ("", None) else float(value) for key, value in found.items()} == wanted
    if index.endswith("csv"):
        assert "The Sun stands -3.5 to 82.25 degrees above the horizon." in (out / "README.md").read_text()


def test_an_export_that_is_stopped_leaves_no_shard(dataset, tmp_path, monkeypatch):
    made = []

    def fail(image, end):
        if len(made) == 6:  # four images of the first pair and two of the second
            raise KeyboardInterrupt
        made.append(end)
        return b"0"

    monkeypatch.setattr(training, "encode_image", fail)
    with pytest.raises(KeyboardInterrupt):
        export([dataset], "webdataset", tmp_path / "stopped")
    assert made
    assert not [path for path in (tmp_path / "stopped").iterdir() if path.is_file()]


def test_a_full_disk_ends_the_export_instead_of_tearing_a_shard(dataset, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tarfile.TarFile, "addfile", refuse)
    with pytest.raises(DiskError):
        export([dataset], "webdataset", tmp_path / "full")
    assert not [path for path in (tmp_path / "full").iterdir() if path.is_file()]


def split_by_key(dataset) -> dict[str, str]:
    found = [read_pair(folder) for folder in find_pair_folders(dataset)]
    return {pair.id: choose_split(name_scene(pair), DEFAULT_SPLITS) for pair in found}


def test_shards_have_the_pairs_of_their_split_and_give_the_truth_back(dataset, tmp_path):
    assert export([dataset], "webdataset", tmp_path / "a") == []
    wanted = split_by_key(dataset)
    assert len(set(wanted.values())) > 1
    members = {}
    for path in (tmp_path / "a").glob("*.tar"):
        with tarfile.open(path) as archive:
            for member in archive:
                key, _, suffix = member.name.partition(".")
                assert path.name.startswith(wanted[key])
                members[key, suffix] = archive.extractfile(member).read()
    assert len(members) == 8 * 5

    def image(key: str, suffix: str) -> Array:
        return cv2.imdecode(np.frombuffer(members[key, suffix], np.uint8), cv2.IMREAD_UNCHANGED)

    key = next(iter(wanted))
    depth = pairs.view(SCENE, RIG, "left")[0]
    known = np.isfinite(depth)
    steps = image(key, "disparity.png")
    assert ((steps > 0) == known).all()
    assert np.abs(steps / 256 - RIG.disparity(depth))[known].max() <= 0.5 / 256 + 1e-9
    assert image(key, "left.png").dtype == np.uint16
    assert json.loads(members[key, "camera.json"])["focal_px"] == RIG.focal_px


def test_the_same_pairs_give_the_same_bytes_and_no_mixture(dataset, tmp_path):
    for name in ("a", "b"):
        export([dataset], "webdataset", tmp_path / name)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
    with pytest.raises(IcyMoonError, match="already contains shards"):
        export([dataset], "webdataset", tmp_path / "a")


def test_croissant_and_the_card_state_what_is_there(dataset, tmp_path):
    export([dataset], "webdataset", tmp_path)
    found = json.loads((tmp_path / "croissant.json").read_text(encoding="utf-8"))
    files = {each["contentUrl"]: each["sha256"] for each in found["distribution"]}
    assert set(files) == {"index.csv", *(path.name for path in tmp_path.glob("*.tar"))}
    for name, digest in files.items():
        assert hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    with (tmp_path / "index.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    columns = [each["source"]["extract"]["column"] for each in found["recordSet"][0]["field"]]
    assert list(rows[0]) == columns
    assert {row["key"]: row["split"] for row in rows} == split_by_key(dataset)
    assert "8 pairs" in (tmp_path / "README.md").read_text(encoding="utf-8")


def read_pfm(path: Path) -> Array:
    """As the loaders do: header lines, then floats, bottom row first."""
    with path.open("rb") as stream:
        assert stream.readline().rstrip() == b"Pf"
        width, height = map(int, stream.readline().split())
        order = "<" if float(stream.readline()) < 0 else ">"
        return np.flipud(np.frombuffer(stream.read(), f"{order}f4").reshape(height, width))


def test_sceneflows_loaders_find_and_read_everything(dataset, tmp_path):
    """The rules of RAFT-Stereo's and IGEV-Stereo's loaders, restated: globs, and words replaced in whole paths."""
    root = tmp_path / "copy"
    assert export([dataset], "sceneflow", root) == []
    count = {"TRAIN": 0, "TEST": 0}
    for split in count:
        for passed in ("frames_cleanpass", "frames_finalpass"):
            lefts = sorted((root / "FlyingThings3D" / passed / split).glob("*/*/left/*.png"))
            count[split] = len(lefts)
            for left in map(str, lefts):
                right = left.replace("left", "right")
                disparity = read_pfm(Path(left.replace(passed, "disparity").replace(".png", ".pfm")))
                assert cv2.imread(left, cv2.IMREAD_UNCHANGED).shape == cv2.imread(right).shape == (64, 96, 3)
                assert np.isfinite(disparity).all()
                valid = np.abs(disparity) < 512
                depth = pairs.view(SCENE, RIG, "left")[0]
                assert (valid == np.isfinite(depth)).all()
                assert disparity[valid] == pytest.approx(RIG.disparity(depth)[valid], rel=1e-6)
    wanted = list(split_by_key(dataset).values())
    assert count == {"TRAIN": wanted.count("train"), "TEST": 8 - wanted.count("train")}
    listed = (root / "flyingthings_validation.txt").read_text(encoding="utf-8").split()
    assert len(listed) == count["TEST"]
    assert all((root / "FlyingThings3D" / "disparity" / line).is_file() for line in listed)


def test_a_folder_that_loaders_would_rename_is_refused(dataset, tmp_path):
    with pytest.raises(IcyMoonError, match="the word left"):
        export([dataset], "sceneflow", tmp_path / "left_over")
