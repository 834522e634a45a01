"""Camera models against mrcal, there and back, and by their laws.

The pixels in ``tests/data/mrcal.json`` are those of mrcal 2.2, for random points; ``tests/data/make_mrcal.py`` makes
them. Where it is installed, its own reading of our files is asked too.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from contextlib import suppress

import numpy as np
import pytest
from icymoon.formats.cahvor import (
    Cahvor,
    find_nearest_lens,
    make_cahvor_text,
    make_model_from_pinhole,
    make_pds_text,
    read_model,
)
from icymoon.physics.camera.lens_distortion import distort_points
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT

GOLDEN = json.loads((ROOT / "tests" / "data" / "mrcal.json").read_text(encoding="utf-8"))
TO_WORLD, CENTRE = np.array(GOLDEN["R"]), np.array(GOLDEN["t"])
POINTS = np.array(GOLDEN["points_camera"])
WORLD = POINTS @ TO_WORLD.T + CENTRE
SIZE = (640, 480)
VECTORS = [name for name in GOLDEN["cases"] if not name.startswith("BROWN")]
#: Of the files that mrcal writes: ten decimals of unit vectors, times a focal length of 820 px.
ROUNDED_PX = 2e-7


def model_of(name: str) -> Cahvor:
    """The model of a case, from mrcal's numbers."""
    fx, fy, cx, cy, *more = GOLDEN["cases"][name]["data"]
    a = TO_WORLD.T[2]
    plain = make_model_from_pinhole(np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), TO_WORLD.T, CENTRE, SIZE)
    if not more:
        return plain
    alpha, beta = more[:2]
    o = np.array([np.sin(alpha) * np.cos(beta), np.sin(beta), np.cos(alpha) * np.cos(beta)]) @ TO_WORLD.T
    e = np.array(more[5:8]) if len(more) == 8 else None
    linearity = float(name.partition("_")[2] or 1.0)
    return Cahvor(CENTRE, a, plain.h, plain.v, *SIZE, o, np.array(more[2:5]), e, linearity)


def matrix_of(name: str) -> Array:
    fx, fy, cx, cy = GOLDEN["cases"][name]["data"][:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


@pytest.mark.parametrize("name", VECTORS)
def test_it_projects_as_mrcal_does(name):
    found = model_of(name).project(WORLD)
    assert np.abs(found - GOLDEN["cases"][name]["pixels"]).max() < 1e-9  # asked for are 1e-6 px


@pytest.mark.parametrize("name", [name for name, case in GOLDEN["cases"].items() if "file" in case])
def test_files_of_mrcal_are_read(tmp_path, name):
    path = tmp_path / "a.cahvor"
    path.write_text(GOLDEN["cases"][name]["file"], encoding="utf-8")
    model = read_model(path)
    assert (model.kind, model.width_px, model.height_px) == (name.partition("_")[0], *SIZE)
    assert np.abs(model.project(WORLD) - GOLDEN["cases"][name]["pixels"]).max() < ROUNDED_PX


@pytest.mark.parametrize("name", VECTORS)
@pytest.mark.parametrize("form", ["cahvor", "pds"])
def test_both_texts_give_the_same_model_again(tmp_path, name, form):
    model, path = model_of(name), tmp_path / f"a.{form}"
    path.write_text(
        make_cahvor_text(model) if form == "cahvor" else make_pds_text(model, "SITE_FRAME"), encoding="utf-8"
    )
    again = read_model(path)
    assert (again.kind, again.linearity) == (model.kind, model.linearity)
    assert np.array_equal(again.project(WORLD), model.project(WORLD))
    matrix, rotation = again.pinhole()
    assert np.abs(matrix - matrix_of(name)).max() < 1e-10
    assert np.abs(rotation - TO_WORLD.T).max() < 1e-14


def test_radial_distortion_is_exact_both_ways():
    k = tuple(GOLDEN["cases"]["BROWN"]["data"][4:])
    model = make_model_from_pinhole(matrix_of("BROWN"), TO_WORLD.T, CENTRE, SIZE, k)
    assert np.abs(model.project(WORLD) - GOLDEN["cases"]["BROWN"]["pixels"]).max() < 1e-9
    assert (model.kind, model.residual_px) == ("CAHVOR", 0.0)
    lens = find_nearest_lens(model)
    assert (lens.k, lens.residual_px) == (k, 0.0)
    assert (lens.focal_px, lens.cx_px, lens.cy_px) == pytest.approx((820, 317.5, 241.5), abs=1e-9)


def test_the_lens_of_opencv_is_that_of_mrcal():
    data = GOLDEN["cases"]["BROWN_ALL"]["data"]
    seen = distort_points(POINTS[:, :2] / POINTS[:, 2:], tuple(data[4:])) * data[0] + data[2:4]
    assert np.abs(seen - GOLDEN["cases"]["BROWN_ALL"]["pixels"]).max() < 1e-9


def test_what_has_no_equal_is_fitted_and_its_error_is_stated():
    k = tuple(GOLDEN["cases"]["BROWN_ALL"]["data"][4:])
    model = make_model_from_pinhole(matrix_of("BROWN_ALL"), TO_WORLD.T, CENTRE, SIZE, k)
    assert 0 < model.residual_px < 0.02  # the best that there is, by mrcal's own optimiser: 0.017 px
    inside = np.array(GOLDEN["cases"]["BROWN_ALL"]["pixels"])
    seen = (inside > 0).all(axis=1) & (inside < SIZE).all(axis=1)
    assert seen.sum() > 5
    assert np.abs(model.project(WORLD) - inside)[seen].max() < 0.02
    assert f"error up to {model.residual_px:.2g} px" in make_cahvor_text(model)
    with pytest.raises(IcyMoonError, match="cannot be represented in CAHVOR"):
        make_model_from_pinhole(matrix_of("BROWN_ALL"), TO_WORLD.T, CENTRE, SIZE, k, most_px=1e-3)


@pytest.mark.parametrize("name", ["CAHVOR", "CAHVORE_1"])
def test_a_model_is_read_as_the_nearest_lens_or_refused(name):
    """Its own pinhole and coefficients, used together, see what the model sees."""
    matrix, tilted = matrix_of("BROWN"), model_of(name)
    _, rotation = tilted.pinhole()
    square = make_model_from_pinhole(matrix, rotation, CENTRE, SIZE)
    model = Cahvor(CENTRE, tilted.a, square.h, square.v, *SIZE, tilted.o, tilted.r, tilted.e, tilted.linearity)
    lens = find_nearest_lens(model, most_px=1.0)
    assert 0 < lens.residual_px < 0.2  # of CAHVOR whose O is 1.3 degrees off A: 0.055 px by mrcal's optimiser
    seen = distort_points(POINTS[:, :2] / POINTS[:, 2:], lens.k) * lens.focal_px + [lens.cx_px, lens.cy_px]
    theirs = model.project(WORLD)
    inside = ((theirs > 0) & (theirs < SIZE)).all(axis=1)
    assert np.abs(seen - theirs)[inside].max() <= 1.1 * lens.residual_px
    with pytest.raises(IcyMoonError, match="nearest is off"):
        find_nearest_lens(model, most_px=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Dimensions = 4 3\nC = 0 0 0\nA = 0 0 1\nH = 1 0 0\n", "vector V"),
        ("", "vector C"),
        ("C = 0 0 0\nA = 0 0 1\nH = 1 0 0\nV = 0 1 0\n", "size of the image"),
        ("Dimensions = 4 3\nC = 0 0 0\nA = 0 0 1\nH = 1 0 0\nV = 0 1 0\nO = 0 0 1\n", "O or R"),
    ],
)
def test_what_is_no_model_is_a_sentence(tmp_path, text, words):
    path = tmp_path / "a.cahvor"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError, match=words):
        read_model(path)


def test_skewed_pixels_are_refused():
    with pytest.raises(IcyMoonError, match="skewed"):
        Cahvor(np.zeros(3), np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), np.array([0.1, 1.0, 0]), 4, 3).pinhole()


@pytest.mark.parametrize("name", [name for name in VECTORS if "-" not in name])  # it reads no negative linearity
def test_mrcal_reads_our_files_to_the_same_pixels(tmp_path, name):
    python = shutil.which("python3", path="/usr/bin")
    if python is None or subprocess.run([python, "-c", "import mrcal"], capture_output=True, check=False).returncode:
        pytest.skip("there is no mrcal; apt-get install python3-mrcal")
    path = tmp_path / "a.cahvor"
    path.write_text(make_cahvor_text(model_of(name)), encoding="utf-8")
    program = (
        "import json, sys, mrcal, numpy as np; m = mrcal.cameramodel(sys.argv[1])\n"
        "v = mrcal.transform_point_Rt(m.extrinsics_Rt_fromref(), np.array(json.loads(sys.argv[2])))\n"
        "print(json.dumps(mrcal.project(np.ascontiguousarray(v), *m.intrinsics()).tolist()))"
    )
    ended = subprocess.run(
        [python, "-c", program, str(path), json.dumps(WORLD.tolist())], capture_output=True, text=True, check=True
    )
    assert np.abs(np.array(json.loads(ended.stdout)) - model_of(name).project(WORLD)).max() < 1e-9


LABEL = """PDS_VERSION_ID = PDS3
GROUP = GEOMETRIC_CAMERA_MODEL
 MODEL_COMPONENT_ID = ("C", "A", "H", "V", "O", "R")
 MODEL_COMPONENT_1 = (0.8, -0.1,
                          -1.9)
 MODEL_COMPONENT_2 = (1 <m>, 0, 0) /* along x */
 MODEL_COMPONENT_3 = (511.5, 1200, 0)
 MODEL_COMPONENT_4 = (511.5, 0,
    1200)
 MODEL_COMPONENT_5 = (1, 0, 0)
 MODEL_COMPONENT_6 = (0, -0.05, 0.01)
END_GROUP = GEOMETRIC_CAMERA_MODEL
"""
SIZED = "OBJECT = {0}\n LINES = {1}\n LINE_SAMPLES = {1}\nEND_OBJECT = {0}\n"
#: Other images of a product, as labels of rovers have them.
SMALL = SIZED.format("THUMBNAIL_IMAGE", 64) + SIZED.format("SUBFRAME_REQUEST_PARMS", 32)


def read_text_as(tmp_path, text: str | bytes, name: str = "a.lbl") -> Cahvor:
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_model(path)


@pytest.mark.parametrize(
    "text",
    [
        SMALL + LABEL + SIZED.format("IMAGE", 1024) + "END",
        SMALL + SIZED.format("IMAGE_DATA", 1024) + LABEL,
        SIZED.format("IMAGE", 1024) + LABEL + SIZED.format("LEFT_IMAGE", 9),
        LABEL + " LINES = 1024 <pixel>\n LINE_SAMPLES = 1024\nEND\n",
    ],
)
def test_a_label_is_read_as_the_language_has_it(tmp_path, text):
    """The size is the image's and not a thumbnail's, and a vector may go on in the next line."""
    for whole in (text, text.replace("\n", "\r\n"), text.encode() + b"\nEND\r\n" + bytes(range(256)) * 8192):
        model = read_text_as(tmp_path, whole)
        assert (model.kind, model.width_px, model.height_px) == ("CAHVOR", 1024, 1024)
        assert (model.c.tolist(), model.h.tolist(), model.v.tolist()) == (
            [0.8, -0.1, -1.9],
            [511.5, 1200, 0],
            [511.5, 0, 1200],
        )


MODEL = "Dimensions = 4 3\nC = 0 0 0\nA = 0 0 1\nH = 1 0 0\nV = 0 1 0\n"
PDS = LABEL + SIZED.format("IMAGE", 9)


@pytest.mark.parametrize(
    "text",
    [
        "Model = CAHVOR\n" + "\n" * 100_000 + "C = (0,0,0)\n",
        f"Dimensions = {'9' * 5000} 480\n" + MODEL,
        f"C = {'1' * 20_000} 0 0\n",
        MODEL.replace("4 3", f"4 {'9' * 5000}"),
        MODEL.replace("4 3", "-4 3"),
        MODEL.replace("4 3", "0 3"),
        MODEL.replace("4 3", "100001 3"),
        MODEL.replace("4 3", "4.5 3"),
        MODEL.replace("4 3", "4"),
        MODEL.replace("4 3", "４ ３"),
        MODEL.replace("H = 1", "H = nan"),
        MODEL.replace("H = 1", "H = 1e999"),
        MODEL.replace("H = 1", "H = 1_0"),
        MODEL.replace("H = 1", "H = 1,5"),
        MODEL.replace("H = 1 0 0", "H = 1 0"),
        MODEL + "C = 1 1 1\n",
        MODEL + "Dimensions = 9 9\n",
        MODEL + "E = 0 0 0\n",
        MODEL.replace("H = 1 0 0", "H = " + "1\n" * 10**5),
        "=" * 10**5,
        "C =" * 10**5,
        MODEL.encode("utf-16"),
        b"\0" * 10**5,
        LABEL,
        LABEL + SMALL,
        PDS + PDS.replace("-0.1", "0.1") + SIZED.format("IMAGE", 8),
        PDS.replace("9", "9" * 5000),
        PDS.replace("1200", "1" * 5000),
        PDS.replace("1200", "inf"),
        PDS.replace("511.5, 1200, 0", "511.5, 1200"),
        PDS.replace("511.5, 1200, 0", "511.5, (1200), 0"),
        PDS.replace("(511.5, 1200, 0)", "511.5"),
        PDS.replace("(1 <m>", "(" * 10**5),
        PDS.replace("= PDS3", '= "'),
        LABEL + SIZED.format("ONE", 5) + SIZED.format("B", 6),
        PDS.replace('"C", "A"', '"C", "X"'),
        PDS.replace('("C"', '("CA"'),
        LABEL.replace(")", ""),
        "GEOMETRIC_CAMERA_MODEL" * 40_000,
        "GEOMETRIC_CAMERA_MODEL = (" * 30_000,
        PDS.replace(" = IMAGE\n", " = {IMAGE}\n"),
        PDS.replace(" MODEL_COMPONENT_2", " MODEL_COMPONENT_2 = (2, 0, 0)\n MODEL_COMPONENT_2"),
    ],
    ids=range(42),
)
@pytest.mark.timeout(20)
def test_a_hostile_model_is_a_sentence(tmp_path, text):
    with pytest.raises(IcyMoonError) as caught:
        read_text_as(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "a.lbl"))
    assert str(caught.value).endswith(".")
    assert len(str(caught.value)) < 600
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        MODEL.replace("A = 0 0 1", "A = 0 0 0"),
        MODEL.replace("H = 1 0 0", "H = 0 0 0"),
        MODEL + "O = 0 0 0\nR = 0 1 1\n",
        MODEL + "O = 1 0 0\nR = 0 1 1\n",
        MODEL.replace("= 1 0 0", "= 1e9 1e-9 1e9"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_model_that_sees_nothing_is_a_sentence(tmp_path, text):
    with pytest.raises(IcyMoonError, match=r"axis A|skewed|represented|outside the field"):
        find_nearest_lens(read_text_as(tmp_path, text))


def test_files_that_are_none_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", tmp_path / "absent"):
        with pytest.raises(IcyMoonError, match="cannot be read"):
            read_model(path)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("text", [MODEL + "O = 0 0 1\nR = 0 0.1 0\n", PDS])
def test_a_damaged_model_is_a_model_or_a_sentence(tmp_path, text, seed):
    random = np.random.default_rng(seed)
    for _ in range(100):
        data = bytearray(text.encode())
        for at in random.integers(0, len(data), 2):
            data[at] = random.integers(0, 256)
        with suppress(IcyMoonError):
            read_text_as(tmp_path, bytes(data))
