"""Exports read back, by other readers where there are any, and compared with the analytic scene."""

import csv
import importlib
import json
import re
import subprocess
import sys

import cv2
import numpy as np
import pairs
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.stereo.export import exports_with_blender, find_plugins
from icymoon.stereo.export.encodings import encode_run_lengths, quantise_to_16_bits, write_pfm
from icymoon.stereo.export.layouts import export, make_coco_annotations, write_truth
from icymoon.stereo.images.exr import read_view
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

RIG = pairs.camera(192, 96)
#: Layouts that have tests of their own: ``test_field_formats`` and ``test_bop``, whose pairs have poses,
#: ``test_training``, ``test_parquet_index`` and ``test_sequences``.
TESTED_ELSEWHERE = {
    "head",
    *("bop", "cahvor", "colmap", "fits", "tiff", "ros2", "webdataset", "sceneflow", "parquet-index"),
    *("tum", "kitti-odometry", "flow"),
}
SCENES = {"one": pairs.Scene(), "two": pairs.Scene(sky_rows=30, distance_m=3.0)}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for name, scene in SCENES.items():
        pairs.write_pair(root / "pairs" / name, scene, RIG)
    return root


@pytest.fixture(scope="module")
def out(dataset, tmp_path_factory):
    root = tmp_path_factory.mktemp("out")
    for kind in set(find_plugins().usable) - {*exports_with_blender(), *TESTED_ELSEWHERE}:
        assert export([dataset], kind, root / kind) == []
    assert not list(root.rglob("*.part"))
    return root


def truth(name, eye="left"):
    return RIG.disparity(pairs.view(SCENES[name], RIG, eye)[0])


def read(path):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def unscaled(steps, scale):
    """The values of a 16-bit PNG in which 0 means unknown."""
    return np.where(steps > 0, steps / scale, np.nan)


def read_pfm(path):
    """OpenCV's reading of a PFM file, infinity as NaN and colours as R, G, B."""
    values = read(path)
    values = values[..., ::-1] if values.ndim == 3 else values
    return np.where(np.isinf(values), np.float32(np.nan), values)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("eye", ["left", "right"])
def test_16_bit_images_are_the_8_bit_ones_and_finer(out, name, eye):
    coarse, fine = read(out / "png8" / name / f"{eye}.png"), read(out / "png16" / name / f"{eye}.png")
    assert (coarse.dtype, fine.dtype) == (np.uint8, np.uint16)
    np.testing.assert_array_equal(np.rint(fine / 257), coarse)
    assert coarse.std() > 10


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("eye", ["left", "right"])
def test_disparity_and_depth_come_back_to_half_a_step(out, name, eye):
    disparity = truth(name, eye)
    folder = out / "png16" / name
    np.testing.assert_allclose(unscaled(read(folder / f"disparity_{eye}.png"), 256), disparity, atol=0.5 / 256 + 1e-4)
    np.testing.assert_allclose(
        unscaled(read(folder / f"depth_{eye}.png"), 1000), RIG.focal_baseline_px_m / disparity, atol=0.5e-3 + 1e-6
    )
    for file in (
        out / "pfm" / name / f"disparity_{eye}.pfm",
        out / "middlebury" / name / f"disp{['left', 'right'].index(eye)}.pfm",
    ):
        np.testing.assert_allclose(read_pfm(file), disparity, rtol=1e-6)
        other = read(file).astype(np.float64)  # OpenCV's own reader
        np.testing.assert_allclose(np.where(np.isinf(other), np.nan, other), disparity, rtol=1e-6)


def test_radiance_is_kept_to_the_bit(out, dataset):
    for eye in ("left", "right"):
        radiance = read_view(dataset / "pairs" / "one" / f"{eye}.exr").radiance
        np.testing.assert_array_equal(read_pfm(out / "pfm" / "one" / f"{eye}.pfm"), radiance)


def test_labels_are_exact(out, dataset):
    folder = out / "png16" / "one"
    names = json.loads((folder / "calibration.json").read_text())["instance_labels"]
    for eye in ("left", "right"):
        view = read_view(dataset / "pairs" / "one" / f"{eye}.exr")
        np.testing.assert_array_equal(read(out / "png8" / "one" / f"semantic_{eye}.png"), view.semantic)
        stored = read(folder / f"instance_{eye}.png")
        np.testing.assert_array_equal(np.vectorize(lambda k: names[str(k)])(stored), view.instance)


def test_calibration_contains_what_a_reader_needs(out):
    calibration = json.loads((out / "pfm" / "one" / "calibration.json").read_text())
    assert calibration["camera"]["focal_baseline_px_m"] == pytest.approx(RIG.focal_baseline_px_m)
    assert calibration["self_check"]["ok"] is True


def test_kitti(out):
    root = out / "kitti" / "training"
    with (out / "kitti" / "pairs.csv").open(newline="") as stream:
        assert {row["number"]: row["pair"] for row in csv.DictReader(stream)} == {"000000": "one", "000001": "two"}
    for number, name in (("000000", "one"), ("000001", "two")):
        occluded, both = (
            unscaled(read(root / kind / f"{number}_10.png"), 256) for kind in ("disp_occ_0", "disp_noc_0")
        )
        np.testing.assert_allclose(occluded, truth(name), atol=0.5 / 256 + 1e-4)
        seen = np.isfinite(both)
        assert 0 < seen.sum() < np.isfinite(occluded).sum()
        np.testing.assert_array_equal(both[seen], occluded[seen])
        matrices = {
            line.split(":")[0]: np.array(line.split()[1:], float)
            for line in (root / "calib_cam_to_cam" / f"{number}.txt").read_text().splitlines()
        }
        left, right = (matrices[f"P_rect_{eye}"].reshape(3, 4) for eye in ("02", "03"))
        # Projecting a point with the two matrices gives its disparity.
        point = np.array([0.3, -0.2, 2.5, 1.0])
        pixels = [(matrix @ point)[:2] / (matrix @ point)[2] for matrix in (left, right)]
        np.testing.assert_allclose(pixels[0] - pixels[1], [RIG.focal_baseline_px_m / 2.5, 0], atol=1e-9)
        # And the middle of the image is half a pixel before the first pixel right of it.
        assert left[0, 2] == RIG.width_px / 2 - 0.5


def test_middlebury(out):
    for name in SCENES:
        folder = out / "middlebury" / name
        lines = dict(line.split("=") for line in (folder / "calib.txt").read_text().splitlines())
        focal = float(lines["cam0"].strip("[]").split()[0])
        disparity = read_pfm(folder / "disp0.pfm")
        # Z = baseline · f / (d + doffs), in mm, is the benchmark's own formula.
        depth = float(lines["baseline"]) * focal / (disparity + float(lines["doffs"])) / 1000
        np.testing.assert_allclose(depth, pairs.view(SCENES[name], RIG, "left")[0], rtol=1e-5)
        assert float(lines["vmin"]) <= np.nanmin(disparity) <= np.nanmax(disparity) < float(lines["ndisp"])
        mask = read(folder / "mask0nocc.png")
        assert set(np.unique(mask)) <= {0, 128, 255}
        np.testing.assert_array_equal(mask > 0, np.isfinite(disparity))


def decoded(segmentation):
    """A mask from COCO's run lengths, as pycocotools does it: zeros first, columns."""
    height, width = segmentation["size"]
    ends = np.cumsum(segmentation["counts"])
    assert ends[-1] == height * width
    flat = np.concatenate([np.full(count, k % 2) for k, count in enumerate(segmentation["counts"])])
    return flat.reshape(width, height).T.astype(bool)


def test_coco(out, dataset):
    data = json.loads((out / "coco" / "annotations.json").read_text())
    assert [category["name"] for category in data["categories"]] == ["rock", "lander"]
    assert len(data["images"]) == 4
    for image in data["images"]:
        assert read(out / "coco" / "images" / image["file_name"]).shape == (image["height"], image["width"])
        view = read_view(dataset / "pairs" / image["pair"] / f"{image['eye']}.exr")
        (found,) = [a for a in data["annotations"] if a["image_id"] == image["id"]]  # the rock, not the ground
        mask = decoded(found["segmentation"])
        np.testing.assert_array_equal(mask, view.instance == 1000)
        assert (found["category_id"], found["label"], found["area"]) == (2, 1000, mask.sum())
        x, y, width, height = found["bbox"]
        assert mask[y : y + height, x : x + width].sum() == mask.sum()
        assert mask[y].any()
        assert mask[:, x + width - 1].any()


@settings(deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9))).filter(np.any))
def test_run_lengths_of_any_mask(mask):
    pixels = np.flatnonzero(mask.ravel(order="F"))
    counts = encode_run_lengths(pixels, mask.size)
    np.testing.assert_array_equal(decoded({"size": mask.shape, "counts": counts}), mask)
    assert all(count > 0 for count in counts[1:])


def test_only_rocks_and_objects_are_annotated_and_nothing_without_labels():
    instance = np.array([[0, 1, 5], [7, 7, 5]])
    semantic = np.array([[0, 1, 3], [2, 2, 3]])
    assert [(a["label"], a["category_id"]) for a in make_coco_annotations(instance, semantic)] == [(5, 3), (7, 2)]
    assert list(make_coco_annotations(None, semantic)) == []


@settings(deadline=None)
@given(
    values=arrays(
        np.float32,
        st.tuples(st.integers(1, 6), st.integers(1, 6)),
        elements=st.floats(width=32, allow_nan=True, allow_infinity=True),
    )
)
def test_pfm_keeps_every_finite_number(tmp_path_factory, values):
    path = tmp_path_factory.getbasetemp() / "values.pfm"
    write_pfm(path, values)
    np.testing.assert_array_equal(read_pfm(path), np.where(np.isfinite(values), values, np.nan))


def test_what_does_not_fit_16_bits_is_unknown_and_counted_never_wrapped():
    values = np.array([[np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-3, 1 / 256, 255.99, 256.0, 1e10, 1e308]])
    steps, (loss,) = quantise_to_16_bits(values, 256, "disparity", "px")
    np.testing.assert_allclose(unscaled(steps, 256)[0], [np.nan] * 6 + [1 / 256, 255.99] + [np.nan] * 3, atol=0.5 / 256)
    assert loss.share == pytest.approx(6 / 8)  # of the finite ones
    assert "outside of 0.00391 to 255.996 px" in loss.why
    assert quantise_to_16_bits(values[:, :1], 256, "disparity", "px")[1] == []
    assert quantise_to_16_bits(np.array([[255.9, np.nan]]), 256, "disparity", "px")[1] == []


#: Ground half a metre before the eyes.
NEAR = pairs.Scene(distance_m=0.5, slope_y=1.2, rock=False)


def near_rig(baseline_m: float) -> StereoCamera:
    return StereoCamera(96, 64, 120.0, 48.0, 32.0, baseline_m)


@pytest.mark.parametrize("kind", ["kitti", "png16", "webdataset"])
def test_a_pair_whose_truth_16_bits_cannot_hold_is_refused_with_a_format_that_does(tmp_path, kind):
    pairs.write_pair(tmp_path / "set" / "pairs" / "wide", NEAR, near_rig(1.5))
    pairs.write_pair(tmp_path / "set" / "pairs" / "fits", NEAR, near_rig(0.5))
    heard: list[dict] = []
    (sentence,) = export([tmp_path / "set"], kind, tmp_path / "out", on_event=heard.append)
    assert "wide: " in sentence
    assert re.search(r"\d+ % of its true disparities are outside of 0.00391 to 255.996 px", sentence)
    assert "export it as pfm or middlebury" in sentence
    assert [each["type"] for each in heard] == ["progress", "error"]
    assert not list((tmp_path / "out").rglob("*wide*"))
    for whole in ("pfm", "middlebury"):
        assert not export([tmp_path / "set"], whole, tmp_path / whole)
        stored = read_pfm(
            next((tmp_path / whole / "wide").glob("disp*0.pfm" if whole == "middlebury" else "disparity_left.pfm"))
        )
        assert np.nanmax(stored) > 256


def test_truth_that_is_lost_in_part_is_reported_once_for_all_pairs(tmp_path):
    for name, baseline in (("one", 0.9), ("two", 1.0), ("whole", 0.5)):
        pairs.write_pair(tmp_path / "set" / "pairs" / name, NEAR, near_rig(baseline))
    heard: list[dict] = []
    assert not export([tmp_path / "set"], "kitti", tmp_path / "out", on_event=heard.append)
    (warning,) = [each["message"] for each in heard if each["type"] == "warning"]
    assert re.match(
        r"In 2 of 3 pairs up to \d+ % of the true disparity is lost \(pair two\): it is outside of", warning
    )
    assert warning.endswith("pfm and middlebury hold all of it.")


def test_another_camera_response(dataset, tmp_path):
    export([dataset / "pairs" / "one"], "png8", tmp_path, {"sensor": {"auto_exposure": False, "exposure_s": 10.0}})
    assert read(tmp_path / "one" / "left.png").min() > 240


def test_a_broken_pair_is_reported_and_the_others_are_written(tmp_path):
    for name in ("bad", "good"):
        pairs.write_pair(tmp_path / "set" / "pairs" / name, rig=RIG)
    (tmp_path / "set" / "pairs" / "bad" / "left.exr").write_bytes(b"no")
    events = []
    failed = export([tmp_path / "set"], "coco", tmp_path / "out", on_event=events.append)
    assert len(failed) == 1
    assert "left.exr" in failed[0]
    assert [event["type"] for event in events] == ["error", "progress"]
    assert len(json.loads((tmp_path / "out" / "annotations.json").read_text())["images"]) == 2
    checks = list(write_truth([tmp_path / "set"], tmp_path / "truth"))
    assert [found["ok"] for found in checks] == [False, True]


def test_truth_of_both_eyes(dataset, tmp_path):
    checks = list(write_truth([dataset], tmp_path))
    assert [(found["pair"], found["ok"]) for found in checks] == [("one", True), ("two", True)]
    with np.load(tmp_path / "two" / "truth.npz") as stored:
        for eye in ("left", "right"):
            np.testing.assert_allclose(stored[f"disparity_{eye}"], truth("two", eye), rtol=1e-6)
            assert not stored[f"visible_{eye}"][:30].any()
            assert stored[f"visible_{eye}"][30:].mean() > 0.5


def run(*words):
    return subprocess.run(
        [sys.executable, "-m", "icymoon.stereo", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def test_the_command_exports(dataset, tmp_path):
    result = run("export", dataset, "--format", "kitti", "--out", tmp_path / "k")
    assert (result.returncode, result.stderr, result.stdout.strip()) == (0, "", str(tmp_path / "k"))
    result = run("truth", dataset, "--out", tmp_path / "t")
    assert result.returncode == 0
    assert [json.loads(line)["ok"] for line in result.stdout.splitlines()] == [True, True]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--format", "pfm", "--set", "rig.baseline_m=1"), "needs a new render"),
        (("--format", "pfm"), "no complete stereo pair"),
    ],
)
def test_errors_are_one_sentence(tmp_path, words, reason):
    (tmp_path / "empty").mkdir()
    result = run("export", tmp_path / "empty", *words, "--out", tmp_path / "out")
    assert result.returncode == 1
    assert reason in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_the_place_on_a_map_is_in_every_export(tmp_path):
    for name in ("mapped", "plain"):
        pairs.write_pair(tmp_path / "set" / "pairs" / name)
    file = tmp_path / "set" / "pairs" / "mapped" / "pair.json"
    place = {
        "crs": "EPSG:32633",
        "unit_m": 1.0,
        "origin": [500000.0625, 4649990.123456789],
        "scale": [1.0, 1.0],
        "height_zero_m": 1234.5,
    }
    file.write_text(json.dumps(json.loads(file.read_text()) | {"ground": {"map": place}}), encoding="utf-8")
    export([tmp_path / "set"], "pfm", tmp_path / "out")
    found = json.loads((tmp_path / "out" / "map_coordinates.json").read_text(encoding="utf-8"))
    assert found["pairs"] == {"mapped": place}
    export([tmp_path / "set" / "pairs" / "plain"], "pfm", tmp_path / "plain")
    assert not (tmp_path / "plain" / "map_coordinates.json").exists()


@pytest.mark.parametrize(
    ("kind", "last"),
    [
        ("png8", "layouts.write_json"),
        ("png16", "layouts.write_json"),
        ("pfm", "layouts.write_json"),
        ("middlebury", "layouts.write_text"),
        ("raw", "raw.write_json"),
    ],
)
def test_a_pair_that_fails_leaves_nothing_half_written(dataset, tmp_path, monkeypatch, kind, last):
    def fail(*_, **__):
        raise IcyMoonError("cannot be")

    monkeypatch.setattr(f"icymoon.stereo.export.{last}", fail)
    out = tmp_path / "new" / "out"
    assert len(export([dataset], kind, out)) == len(list((dataset / "pairs").iterdir()))
    assert [path for path in out.rglob("*") if path.is_file()] == []
    assert [path.name for path in out.parent.rglob("*.part")] == []


@pytest.mark.parametrize(
    ("kind", "last"),
    [
        ("kitti", "layouts.write_text"),
        ("coco", "layouts.make_coco_annotations"),
        ("sceneflow", "training.write_pfm"),
        ("webdataset", "training._encode_pair_files"),
    ],
)
def test_a_pair_that_fails_is_nowhere_in_a_folder_of_all_pairs(dataset, tmp_path, monkeypatch, kind, last):
    """The first pair fails at its last file, or at that of its right eye; the rest is as if it had not been there."""
    first, *others = sorted((dataset / "pairs").iterdir())
    assert export(others, kind, tmp_path / "alone") == []
    room, name = last.split(".")
    module = importlib.import_module(f"icymoon.stereo.export.{room}")
    whole, calls = getattr(module, name), []
    fails_at = 2 if kind in ("coco", "sceneflow") else 1

    def fail(*given):
        calls.append(given)
        if len(calls) == fails_at:
            raise IcyMoonError("cannot be")
        return whole(*given)

    monkeypatch.setattr(module, name, fail)
    assert len(export([first, *others], kind, tmp_path / "both")) == 1
    files = [
        {
            path.relative_to(root): path.read_bytes()
            for path in root.rglob("*")
            if path.is_file() and path.suffix != ".tar"
        }
        for root in (tmp_path / "alone", tmp_path / "both")
    ]
    assert files[0] == files[1]
    assert not list(tmp_path.rglob("*.part"))
