"""What is wrong with foreign data and predictions is one sentence that names the file and the fix."""

import json
import os
import re
import shutil
import struct
import zlib

import foreign
import numpy as np
import OpenEXR
import pairs
import pytest
from icymoon.physics.camera.stereo_camera import StereoCamera
from icymoon.stereo.datasets.calibrations import read_exported_camera
from icymoon.stereo.datasets.data_files import MapFile, read_image, read_map
from icymoon.stereo.datasets.input_faults import check_prediction
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.evaluated_pairs import find_sources
from icymoon.stereo.images.image_headers import MAX_PIXELS
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.filterwarnings("error")

#: The truth of a slanted surface: a plane that faces the camera would have the same ratio in every pixel.
TRUTH = np.linspace(20, 60, foreign.WIDTH)[None, :].repeat(foreign.HEIGHT, axis=0)
DEPTH = 70 / TRUTH
CAMERA_70 = StereoCamera(foreign.WIDTH, foreign.HEIGHT, 140.0, foreign.WIDTH / 2, foreign.HEIGHT / 2, 0.5)


def refused(root, *words):
    """The sentence by which a folder is refused; it has all ``words``."""
    with pytest.raises(IcyMoonError) as caught:
        [source.prepare({}) for source in find_sources([root])]
    text = str(caught.value)
    assert all(word in text for word in words), text
    assert text.endswith((".", "?"))
    assert "\n" not in text
    return text


def plain(tmp_path, file, truth='disparity = "truth/{pair}.npy"', toml=""):
    return foreign.plain(tmp_path, truth, toml, file)


def test_a_missing_calibration(tmp_path):
    root = foreign.middlebury(tmp_path / "m")
    (root / "Adirondack" / "calib.txt").unlink()
    refused(root, "calib.txt is missing; add it")
    root = foreign.kitti_2015(tmp_path / "k")
    (root / "training" / "calib_cam_to_cam" / "000000.txt").unlink()
    refused(root, "000000.txt is missing; add it")


def two_scenes(root):
    for name in ("a", "b"):
        foreign.middlebury(root / name)
        (root / name / "Adirondack").rename(root / f"scene_{name}")
        (root / name).rmdir()
    return root


def two_pairs(root):
    plain(root, foreign.constant(), 'disparity = "truth/{pair}.npy"\nvisible = "m/{pair}.png"')
    foreign.write_image(root / "m" / "a.png", np.full((foreign.HEIGHT, foreign.WIDTH), 255, np.uint8))
    for path in [*root.glob("*/a.*")]:
        shutil.copy(path, path.with_stem("b"))
    return root


TWO = {"plain": two_pairs, "kitti": lambda root: foreign.kitti_2015(root, frames=2), "middlebury": two_scenes}


@pytest.mark.parametrize(
    ("layout", "name"),
    [
        ("plain", "right/b.png"),
        ("plain", "truth/b.npy"),
        ("plain", "m/b.png"),
        ("kitti", "training/image_3/000001_10.png"),
        ("kitti", "training/disp_occ_0/000001_10.png"),
        ("kitti", "training/calib_cam_to_cam/000001.txt"),
        ("middlebury", "scene_b/calib.txt"),
        ("middlebury", "scene_b/im1.png"),
        ("middlebury", "scene_b/disp0.pfm"),
    ],
)
def test_a_missing_or_damaged_file_costs_its_own_pair(tmp_path, layout, name):
    root = TWO[layout](tmp_path)
    (root / name).unlink()
    for words in ("is missing; add it, or leave out this pair.", str(root / name)):
        sound, broken = find_sources([root])
        assert np.isfinite(sound.prepare({}).truth).any()
        with pytest.raises(IcyMoonError, match=re.escape(words)):
            broken.prepare({})
        (root / name).write_bytes(b"\xff\xfe\x00")


def test_a_pattern_that_no_file_has_is_told_once(tmp_path):
    root = two_pairs(tmp_path)
    shutil.rmtree(root / "right")
    refused(root, "there is no file right/{pair}.png of any pair, such as right/a.png; correct images.right.")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("baseline=200\n", "has no baseline, which is needed to convert disparities to depths; add it"),
        ("cam0=[100 0 47.5; 0 100 31.5; 0 0 1]\n", "has no cam0"),
    ],
)
def test_a_calibration_that_lacks_a_line(tmp_path, line, words):
    root = foreign.middlebury(tmp_path)
    path = root / "Adirondack" / "calib.txt"
    path.write_text(path.read_text().replace(line, ""))
    refused(root, "calib.txt", words)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("baseline=0", "gives a baseline of 0"),
        ("baseline=none", "'none', not a number"),
        ("cam0=[100 0 47.5; 0 100 31.5]", "not 9 numbers"),
        ("width=48", "is for 48 x 64 px"),
        ("dymax=nan", "not a number"),
        ("doffs=0", "doffs 0 px, and the principal points of cam0 and cam1 are 20 px apart"),
        ("cam1=[100 0 47.5; 0 100 31.5; 0 0 1]", "are 0 px apart; correct the one that is wrong"),
        ("cam1=[100 0 47.5]", "not 9 numbers"),
    ],
)
def test_a_calibration_with_a_wrong_number(tmp_path, line, words):
    root = foreign.middlebury(tmp_path)
    path = root / "Adirondack" / "calib.txt"
    key = line.split("=")[0]
    path.write_text(
        "".join(f"{line}\n" if old.startswith(f"{key}=") else f"{old}\n" for old in path.read_text().splitlines())
    )
    refused(root, "calib.txt", words)


def test_sizes_that_differ(tmp_path):
    root = plain(tmp_path, foreign.constant())
    image = foreign.eyes()[1]
    foreign.write_image(root / "right" / "a.png", image[:, :90])
    refused(root, "a.png is 96 x 64 px", "a.png is 90 x 64 px", "two rectified images of one size")
    foreign.write_image(root / "right" / "a.png", image)
    np.save(root / "truth" / "a.npy", foreign.constant()[:60])
    refused(root, "a.npy is 96 x 60 px, and the images are 96 x 64 px")


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        (
            "disparity",
            lambda a: a.repeat(2, 0).repeat(2, 1),
            "192 x 128 px, and the images are 96 x 64 px; reduce the map to that size and divide its disparities by 2.",
        ),
        ("disparity", lambda a: a[::4, ::4], "enlarge the map to that size and multiply its disparities by 4."),
        (
            "depth",
            lambda a: a.repeat(2, 0).repeat(2, 1),
            "reduce the map to that size and keep its depths as they are.",
        ),
        ("depth", lambda a: a.T, "is 64 x 96 px, and the images are 96 x 64 px; exchange its rows and columns."),
        ("depth", lambda a: a[:60], "give a depth for each pixel of the image."),
    ],
)
def test_a_truth_of_another_size_is_told_how_to_become_right(tmp_path, kind, change, words):
    refused(plain(tmp_path, change(foreign.constant()), f'{kind} = "truth/{{pair}}.npy"'), words)


@pytest.mark.parametrize(("kind", "unit"), [("depth", "metre"), ("disparity", "px")])
def test_the_fix_of_a_picture_has_the_unit_of_the_map(tmp_path, kind, unit):
    path = foreign.write_image(tmp_path / "a.png", foreign.eyes()[0])
    with pytest.raises(IcyMoonError, match=f"state its steps per {unit} as truth.steps"):
        read_map(MapFile(path, kind))
    for content in (foreign.eyes(colour=True)[0], None):
        if content is None:
            path.write_bytes(b"GIF89a")
        else:
            foreign.write_image(path, content)
        with pytest.raises(IcyMoonError, match=rf"16-bit PNG .*steps per {unit}\b"):
            read_map(MapFile(path, kind))


def test_a_truth_without_a_number(tmp_path):
    refused(plain(tmp_path, foreign.constant(np.nan)), "a.npy has no known value")


def test_a_truth_of_the_wrong_sign(tmp_path):
    refused(plain(tmp_path, foreign.constant(-7)), "a.npy has negative disparities", "negate them")

    depth = foreign.constant(-2.0)
    refused(plain(tmp_path / "depth", depth, 'depth = "truth/{pair}.npy"'), "a.npy has negative depths", "negate them")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (256, "256 times too large; divide them by 256"),
        (16, "16 times too large"),
        (1000, "1000 times too large"),
        (1 / 256, "256 times too small; multiply them by 256"),
    ],
)
def test_a_truth_of_another_unit(tmp_path, factor, words):
    refused(plain(tmp_path, foreign.constant(7 * factor)), f"a.npy has disparities that are {words}")


def test_a_true_depth_in_millimetres(tmp_path):
    root = plain(tmp_path, foreign.constant(), 'depth = "truth/{pair}.npy"')
    focal_px, baseline_m = (
        float(re.search(f"{key} = (.*)", (root / "pairs.toml").read_text())[1]) for key in ("focal_px", "baseline_m")
    )
    np.save(root / "truth" / "a.npy", 1000 * focal_px * baseline_m / foreign.constant())
    refused(root, "a.npy has depths that are 1000 times too large; divide them by 1000", "truth.steps")


@pytest.mark.parametrize(
    ("focal_px", "baseline_m", "words"),
    [
        (
            280,
            0.5,
            "2 times too small; multiply them by 2, or state truth.steps in pairs.toml, unless camera.focal_px or "
            "camera.baseline_m there is 2 times too large",
        ),
        (140, 500, "1000 times too small; multiply them by 1000"),
        (140, 0.05, "is 10 times too small, which looks the"),
    ],
)
def test_depths_that_a_wrong_camera_contradicts(tmp_path, focal_px, baseline_m, words):
    """A common factor does not tell whether the depths or the camera are wrong."""
    root = plain(tmp_path, 70 / foreign.constant(), 'depth = "truth/{pair}.npy"')
    text = (root / "pairs.toml").read_text()
    (root / "pairs.toml").write_text(
        text.replace("focal_px = 140", f"focal_px = {focal_px}").replace(
            "baseline_m = 0.5", f"baseline_m = {baseline_m}"
        )
    )
    refused(root, "a.npy has depths that are", words)


@pytest.mark.parametrize(
    ("focal_px", "baseline_m", "words"),
    [
        (140, 0.5, None),
        (140, 500, "The baseline is 500 m, outside of 0.001 to 3 m"),
        (140, 2e-4, "baseline is 0.0002"),
        (4, 0.5, "The focal length is 4 px, outside of 14.4 to 2880 px for images of 96 px"),
        (9000, 0.5, "9000 px"),
    ],
)
def test_a_camera_that_no_stereo_head_has_is_doubtful(tmp_path, focal_px, baseline_m, words):
    """Disparities do not tell its lengths."""
    root = plain(tmp_path, foreign.constant())
    text = (root / "pairs.toml").read_text()
    (root / "pairs.toml").write_text(
        text.replace("focal_px = 140", f"focal_px = {focal_px}").replace(
            "baseline_m = 0.5", f"baseline_m = {baseline_m}"
        )
    )
    (source,) = find_sources([root])
    warnings = source.prepare({}).facts["warnings"]
    assert len(warnings) == (words is not None)
    assert words is None or words in warnings[0]


def test_exchanged_eyes(tmp_path):
    root = plain(tmp_path, foreign.constant())
    for eye, image in zip(("right", "left"), foreign.eyes(), strict=True):
        foreign.write_image(root / eye / "a.png", image)
    refused(root, "left/a.png", "right/a.png", "exchange the images")


def test_images_that_do_not_fit_are_not_called_exchanged(tmp_path):
    root = plain(tmp_path, foreign.constant())
    foreign.write_image(root / "right" / "a.png", foreign.eyes(seed=5)[1])  # as different as a bad photograph
    (source,) = find_sources([root])
    assert np.isfinite(source.prepare({}).truth).all()


@pytest.mark.parametrize("name", ["truth/a.npy", "left/a.png"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_half_written_files(tmp_path, name, share):
    root = plain(tmp_path, foreign.constant())
    content = (root / name).read_bytes()
    (root / name).write_bytes(content[: int(share * len(content))])
    refused(root, name)


IMAGES = '[images]\nleft = "l/{pair}.png"\nright = "r/{pair}.png"\n[truth]\n'
DEPTH_FILE, CAMERA = 'depth = "d/{pair}.npy"\n', "[camera]\nfocal_px = 1\nbaseline_m = 1\n"


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("[images", "is not TOML"),
        ('[images]\nleft = "l/{pair}.png"\n', "truth is missing"),
        ('[images]\nleft = 3\nright = "r/{pair}.png"\n[truth]\n[camera]\n', "images.left is 3, not a text"),
        (IMAGES + CAMERA, "names no files; name either disparity or depth"),
        (
            IMAGES + DEPTH_FILE + DEPTH_FILE.replace("depth", "disparity") + CAMERA,
            "names disparity and depth; name either",
        ),
        (IMAGES + DEPTH_FILE.replace("depth", "depht") + CAMERA, "unknown key truth.depht"),
        (IMAGES + DEPTH_FILE + CAMERA + "[camra]\n", "unknown table camra"),
        (IMAGES.replace("l/{pair}", "l/a") + DEPTH_FILE + CAMERA, "the same file for all pairs"),
        (
            IMAGES + DEPTH_FILE + CAMERA.replace("px = 1", "px = -1"),
            "camera.focal_px is -1, not a number from 1e-9 to 1e9",
        ),
        (IMAGES + DEPTH_FILE + CAMERA.replace("px = 1", "px = 1e308"), "not a number from 1e-9 to 1e9"),
        (IMAGES.replace("l/{pair}", "l/{pair}{pair}") + DEPTH_FILE + CAMERA, "twice in a row"),
        (IMAGES + DEPTH_FILE + "steps = 0\n" + CAMERA, "truth.steps is 0, not a number other than 0"),
        (IMAGES + DEPTH_FILE + CAMERA, "there is no file l/{pair}.png"),
    ],
)
def test_a_wrong_toml(tmp_path, toml, words):
    (tmp_path / "pairs.toml").write_text(toml, encoding="utf-8")
    refused(tmp_path, "pairs.toml", words)


@pytest.mark.parametrize(
    "pattern",
    [
        "../secret/{pair}.npy",
        "/etc/{pair}.npy",
        "C:/{pair}.npy",
        "a\\\\{pair}.npy",
        "truth/../../{pair}.npy",
        "a\\u0000{pair}.npy",
    ],
)
def test_no_path_leaves_the_folder(tmp_path, pattern):
    root = plain(tmp_path / "set", foreign.constant(), f'depth = "{pattern}"')
    (tmp_path / "secret").mkdir()
    shutil.copy(root / "truth" / "a.npy", tmp_path / "secret" / "a.npy")
    refused(root, "only files in this folder are read")


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
@pytest.mark.parametrize("layout", ["plain", "kitti", "middlebury"])
def test_no_link_leaves_the_folder(tmp_path, layout):
    root, name = {
        "plain": lambda: (plain(tmp_path / "set", foreign.constant()), "truth/a.npy"),
        "kitti": lambda: (foreign.kitti_2015(tmp_path / "set"), "training/disp_occ_0/000000_10.png"),
        "middlebury": lambda: (foreign.middlebury(tmp_path / "set"), "Adirondack/disp0.pfm"),
    }[layout]()
    shutil.move(root / name, tmp_path / "outside")
    (root / name).symlink_to(tmp_path / "outside")
    refused(root, "is outside of", "only files in a data set are read")
    (tmp_path / "link").symlink_to(root, target_is_directory=True)  # a link to the data set itself is the user's
    (root / name).unlink()
    shutil.move(tmp_path / "outside", root / name)
    assert find_sources([tmp_path / "link"])


def with_two_pairs(layout, root):
    """A data set, the name of a file of its pair b, and the names of both pairs as sources."""
    if layout == "plain":
        foreign.plain(root, 'disparity = "truth/{pair}.npy"', "", foreign.constant())
        for folder, ending in (("left", "png"), ("right", "png"), ("truth", "npy")):
            shutil.copy(root / folder / f"a.{ending}", root / folder / f"b.{ending}")
        return root, "truth/b.npy", {"a", "b"}
    if layout == "kitti":
        return (foreign.kitti_2015(root, frames=2), "training/calib_cam_to_cam/000001.txt", {"000000_10", "000001_10"})
    if layout == "sceneflow":
        return (
            foreign.sceneflow(root),
            "disparity/eating_camera2_x2/right/0001.pfm",
            {"15mm_focallength-scene_forwards-fast-0001", "eating_camera2_x2-0001"},
        )
    if layout == "sintel":
        foreign.sintel(root)
        for folder in [path for path in root.glob("**/alley_1") if path.is_dir()]:
            shutil.copytree(folder, folder.with_name("b"))
        return root, "training/camdata_left/b/frame_0001.cam", {"alley_1-frame_0001", "b-frame_0001"}
    foreign.middlebury(root)
    shutil.copytree(root / "Adirondack", root / "b")
    return root, layout, {"Adirondack", "b"}


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
@pytest.mark.parametrize("layout", ["plain", "kitti", "sceneflow", "sintel", "b/calib.txt", "b/disp0.pfm", "b"])
@pytest.mark.parametrize("fault", ["outside", "missing"])
def test_a_file_outside_costs_one_pair(tmp_path, layout, fault):
    root, name, names = with_two_pairs(layout, tmp_path / "set")
    shutil.move(root / name, tmp_path / "secret")
    if fault == "outside":
        (root / name).symlink_to(tmp_path / "secret")
    elif layout in ("sceneflow", "b"):  # whose file is not needed
        return
    sources = find_sources([root])
    assert {source.name for source in sources} == names
    faults = []
    for source in sources:
        try:
            source.prepare({})
        except IcyMoonError as error:
            faults.append(str(error))
    assert len(faults) == 1
    assert str(root / name) in faults[0]
    assert ("is outside of" if fault == "outside" else "is missing") in faults[0]


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
@pytest.mark.usefixtures("undrawn")
def test_an_evaluation_goes_on_beside_a_link_that_leads_outside(tmp_path):
    root, name, _ = with_two_pairs("plain", tmp_path / "set")
    shutil.move(root / name, tmp_path / "secret")
    (root / name).symlink_to(tmp_path / "secret")
    result = evaluate([root], parse_methods("bm"), tmp_path / "out")
    assert {row["pair"]: row["status"] for row in result["rows"]} == {"a": "ok", "b": "failed"}
    (failed,) = result["failed"]
    assert "b.npy is outside of" in failed["message"]


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege on Windows")
def test_a_data_set_without_a_usable_pair_is_refused_at_once(tmp_path):
    root, name, _ = with_two_pairs("kitti", tmp_path / "set")
    shutil.move((root / name).parent, tmp_path / "secret")
    (root / name).parent.symlink_to(tmp_path / "secret")
    with pytest.raises(IcyMoonError, match=r"000000\.txt is outside of"):
        find_sources([root])


class Evil:
    """What a pickle would run."""

    def __reduce__(self):
        return os.mkdir, ("ran",)


def test_no_pickle_is_loaded(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.npy"
    np.save(path, np.array([[Evil()]], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "a.npz", disparity=np.array([[Evil()]], dtype=object))
    for file in (path, tmp_path / "a.npz"):
        with pytest.raises(IcyMoonError, match=r"is not a whole map that can be read .values of type"):
            read_map(MapFile(file))
    assert not (tmp_path / "ran").exists()


def png_of(width, height):
    """A PNG of a few bytes that states this size."""

    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(b"\0"))
        + chunk(b"IEND", b"")
    )


def npy_of(*shape):
    """The beginning of an npy file that states this shape."""
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()


SIDE = int(MAX_PIXELS**0.5) + 1


def write_large_npz(path):
    import zipfile

    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("disparity.npy", npy_of(10 * SIDE, SIDE))


LARGE = {
    "a.png": lambda path: path.write_bytes(png_of(SIDE, SIDE)),
    "a.npy": lambda path: path.write_bytes(npy_of(10**6, 10**6)),
    "a.npz": write_large_npz,
    "a.pfm": lambda path: path.write_bytes(b"Pf\n999999 999999\n-1.0\n"),
    "a.tif": lambda path: path.write_bytes(
        b"II*\0\x08\0\0\0"
        + struct.pack("<H", 2)
        + struct.pack("<HHII", 256, 4, 1, SIDE)
        + struct.pack("<HHII", 257, 4, 1, SIDE)
        + b"\0\0\0\0"
    ),
}


@pytest.mark.parametrize("name", LARGE)
def test_a_small_file_takes_no_large_memory(tmp_path, name):
    path = tmp_path / name
    LARGE[name](path)
    assert path.stat().st_size < 2000
    with pytest.raises(IcyMoonError, match=r"a\.\w+: (states|is not a whole)"):
        read_map(MapFile(path))
    if name in ("a.png", "a.tif"):
        with pytest.raises(IcyMoonError, match="pixels are the most that can be read"):
            read_image(path)


def test_a_large_exr_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    path = tmp_path / "a.exr"
    OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, {"Z": np.zeros((20, 20), np.float32)}
    ).write(str(path))
    assert read_map(MapFile(path)).shape == (20, 20)
    monkeypatch.setattr("icymoon.stereo.images.image_headers.MAX_PIXELS", 399)
    with pytest.raises(IcyMoonError, match="states 20 x 20 px"):
        read_map(MapFile(path))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"GIF89a",
        b"\x89PNG",
        b"Pf\n",
        b"\x76\x2f\x31\x01",
        b"II*\0",
        b"PK\x03\x04",
        b"\xff\xd8\xff\xe0\x00\x02\xff\xd9",
        b"\x93NUMPY",
    ],
)
def test_what_is_no_map_and_no_image(tmp_path, content):
    path = tmp_path / "a"
    path.write_bytes(content)
    for read in (lambda: read_map(MapFile(path)), lambda: read_image(path)):
        with pytest.raises(IcyMoonError, match=rf"{path}.*; \w.*\w\.$"):
            read()


def test_a_picture_of_a_map_is_none(tmp_path):
    path = foreign.write_image(tmp_path / "a.png", foreign.eyes()[0])
    with pytest.raises(IcyMoonError, match="is a picture, not a map"):
        read_map(MapFile(path))


@pytest.mark.parametrize(
    ("disparity", "words"),
    [
        (-TRUTH, "negative disparities, as of optical flow; negate them"),
        (np.full_like(TRUTH, np.nan), "has no number in any pixel"),
        (TRUTH * 256, "256 times too large; divide them by 256"),
        (TRUTH / 16, "16 times too small; multiply them by 16"),
        (TRUTH * 16 * 1.02, "16 times too large"),
        (TRUTH / 2, "images of half the width; multiply them by 2"),
        (TRUTH / 4, "a quarter of the width; multiply them by 4"),
        (TRUTH / foreign.WIDTH, f"shares of the width; multiply them by {foreign.WIDTH}"),
        (DEPTH, "has depths in metres"),
        (
            TRUTH[::2, ::2] / 2,
            "is 48 x 32 px, and the pair is 96 x 64 px; enlarge the map to that size and multiply its disparities by 2",
        ),
        (TRUTH.repeat(2, 0).repeat(2, 1), "reduce the map to that size and divide its disparities by 2"),
        (TRUTH[:, :90], "give a disparity for each pixel"),
    ],
)
def test_predictions_that_mean_something_else(tmp_path, disparity, words):
    with pytest.raises(IcyMoonError) as caught:
        check_prediction(tmp_path / "a.npy", disparity, DEPTH, CAMERA_70)
    assert words in str(caught.value)
    assert str(tmp_path / "a.npy") in str(caught.value)


@pytest.mark.parametrize(
    "disparity",
    [
        TRUTH,
        TRUTH * 1.1,
        TRUTH + 5,
        TRUTH * 16 * 1.05,
        np.where(TRUTH > 40, TRUTH, np.nan),
        np.random.default_rng(1).uniform(0, 60, TRUTH.shape),  # a matcher that fails: its ratios are scattered
        np.full_like(TRUTH, 20.0),
        np.where(TRUTH > 21, -1.0, TRUTH) + np.linspace(0, 9, foreign.HEIGHT)[:, None],
    ],
    ids=["right", "10 % off", "5 px off", "17 times", "half", "random", "constant", "mixed signs"],
)
def test_bad_matchers_are_measured_not_refused(tmp_path, disparity):
    check_prediction(tmp_path / "a.npy", disparity, DEPTH, CAMERA_70)


def test_exports_that_hold_no_truth_say_what_to_export(tmp_path):
    from icymoon.stereo.export.layouts import export

    pair = pairs.write_pair(tmp_path / "pairs" / "one", rig=pairs.camera(96, 48))
    for kind, words in (("png8", "png8 cannot hold it; export it as png16"), ("raw", "not rectified; export it as")):
        assert not export([pair], kind, tmp_path / kind)
        refused(tmp_path / kind, words)


@pytest.mark.parametrize("key", ["focal_px", "margin_x_px", "toe_in_deg", "doffs_px"])
def test_every_number_of_a_camera_of_ours_is_checked(tmp_path, key):
    camera = StereoCamera(64, 48, 50.0, 32.0, 24.0, 0.1).to_json() | {key: "wide"}
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({"camera": camera}))
    with pytest.raises(IcyMoonError, match=rf"{key}.*export the pair again"):
        read_exported_camera(path, 64, 48)
