"""The verb twin from files to the page, without Blender: pairs of planes stand for the renders."""

from __future__ import annotations

import json

import numpy as np
import pairs
import pytest
from icymoon.commands import twin
from icymoon.commands.cli import main
from icymoon.formats.calibrations.registry import write_calibration
from icymoon.physics.camera.calibrated_camera import CalibratedCamera, CalibratedRig
from icymoon.physics.camera.lens_models import Brown
from icymoon.physics.light.directions import camera_axes
from icymoon.render.pairs.pair_folder import is_complete, read_pair
from icymoon.stereo.images.image_files import write_png

WIDTH, HEIGHT, FOCAL_PX, BASELINE_M = 160, 112, 90.0, 0.2


@pytest.fixture
def rendered(monkeypatch):
    """The pairs that are rendered, each a folder with a plane as seen by the rig of its settings."""
    made = []

    def render(dataset, planned, how, say):
        for pair in planned:
            if not is_complete(pair.folder(dataset)):
                made.append(pair)
                camera = pairs.StereoCamera.from_settings(pair.settings.rig)
                plain = {**pair.settings, "rig": pair.settings.rig | {"overscan": 0.0}}
                pairs.write_pair(
                    pair.folder(dataset), pairs.Scene(contrast=0.4), camera.rectified, noise=0.01, settings=plain
                )
        return 0

    monkeypatch.setattr(twin, "render_missing", render)
    monkeypatch.setattr(twin, "check_abilities", lambda *_: None)
    return made


def photographs(folder, count=1, bent=0.0, shift=0.0):
    """Images of noise, and the OpenCV YAML of the rig that took them."""
    folder.mkdir()
    random = np.random.default_rng(4)
    files = []
    for number in range(1, count + 1):
        ground = random.integers(0, 256, (HEIGHT, WIDTH + 20)).astype(np.uint8)
        for eye, at in (("left", 0), ("right", 12)):
            files.append(folder / f"{eye}{number}.png")
            write_png(files[-1], ground[:, at : at + WIDTH].copy())
    lens = Brown((bent, 0.0, 0.0, 0.0, 0.0))
    left = CalibratedCamera(WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, 79.5, 55.5, lens)
    right = CalibratedCamera(
        WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, 79.5 + shift, 55.5, lens, translation_m=np.array([-BASELINE_M, 0, 0])
    )
    write_calibration(CalibratedRig((left, right)), [folder / "stereo.yml"], "opencv")
    return [str(path) for path in files], str(folder / "stereo.yml")


def run(files, calibration, out, *more):
    return main(["twin", *files, "--calibration", calibration, "--methods", "sgbm", "--out", str(out), *map(str, more)])


def test_from_two_photographs_to_the_page_and_again_without_a_render(tmp_path, rendered, capsys):
    files, calibration = photographs(tmp_path / "in", count=1)
    assert run(files, calibration, tmp_path / "out", "--set", "rig.height_m=1.2") == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(tmp_path / "out" / "twin.html")
    (pair,) = rendered
    assert pair.settings.rig.height_m == pytest.approx(1.2)
    assert pair.settings.rig.baseline_m == pytest.approx(BASELINE_M)
    assert (pair.settings.rig.width_px, pair.settings.dataset.headings) == (WIDTH, 1)
    html = (tmp_path / "out" / "twin.html").read_text(encoding="utf-8")
    assert "1.2 m above the ground and looks 45.84 degrees down, as stated." in html
    stamp = (tmp_path / "out" / "measured" / "left1.json").stat().st_mtime_ns
    assert run(files, calibration, tmp_path / "out", "--set", "rig.height_m=1.2", "--json") == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["page"].endswith("twin.html")
    assert len(rendered) == 1
    assert (tmp_path / "out" / "measured" / "left1.json").stat().st_mtime_ns == stamp


def test_each_pair_has_a_ground_of_its_own(tmp_path, rendered):
    _, calibration = photographs(tmp_path / "in", count=3)
    assert run([str(tmp_path / "in")], calibration, tmp_path / "out", "--set", "dataset.seed=40") == 0
    assert [pair.settings.dataset.seed for pair in rendered] == [40, 41, 42]
    assert len((tmp_path / "out" / "twin.csv").read_text(encoding="utf-8").splitlines()) == 7


@pytest.mark.long
def test_more_pairs_keep_what_is_there(tmp_path, rendered):
    files, calibration = photographs(tmp_path / "in", count=2)
    assert run(files[:2], calibration, tmp_path / "out") == 0
    assert run(files, calibration, tmp_path / "out") == 0
    assert len(rendered) == 2
    assert len({pair.id for pair in rendered}) == 2


def test_other_settings_in_the_same_folder_are_a_sentence(tmp_path, rendered, capsys):
    files, calibration = photographs(tmp_path / "in")
    assert run(files, calibration, tmp_path / "out") == 0
    assert run(files, calibration, tmp_path / "out", "--set", "rig.height_m=3") == 1
    assert "choose another folder" in capsys.readouterr().err


@pytest.mark.long
def test_height_pitch_and_roll_follow_from_the_true_depth_unless_stated(tmp_path, rendered):
    files, calibration = photographs(tmp_path / "in")
    row, column = np.meshgrid(
        (np.arange(HEIGHT) + 0.5 - 56) / FOCAL_PX, (np.arange(WIDTH) + 0.5 - 80) / FOCAL_PX, indexing="ij"
    )
    # Downward in the axes of a camera that is pitched by 35 and rolled by 8 degrees.
    down = -camera_axes(0.0, 35.0, 8.0)[2]
    np.save(tmp_path / "depth.npy", 1.5 / np.maximum(column * down[0] + row * down[1] + down[2], 0.02))
    depth = ("--depth", tmp_path / "depth.npy")
    assert run(files, calibration, tmp_path / "out", *depth) == 0
    assert rendered[0].settings.rig.height_m == pytest.approx(1.5, rel=1e-3)
    assert rendered[0].settings.rig.pitch_deg == pytest.approx(35, abs=0.05)
    assert rendered[0].settings.rig.roll_deg == pytest.approx(8, abs=0.05)
    assert "1.5 m high, 35 degrees down, 8 degrees clockwise" in (tmp_path / "out" / "twin.html").read_text(
        encoding="utf-8"
    )
    assert run(files, calibration, tmp_path / "stated", *depth, "--set", "rig.pitch_deg=50") == 0
    assert (rendered[1].settings.rig.pitch_deg, rendered[1].settings.rig.roll_deg) == (50, 0)
    assert rendered[1].settings.rig.height_m != pytest.approx(1.5, rel=1e-3)


def test_a_bent_lens_is_bent_in_the_twin_too_with_the_margin_it_needs(tmp_path, rendered):
    files, calibration = photographs(tmp_path / "in", bent=-0.1)
    assert run(files, calibration, tmp_path / "out") == 0
    (pair,) = rendered
    assert pair.settings.rig.distortion_k1 == pytest.approx(-0.1)
    assert 0.01 < pair.settings.rig.overscan < 0.2
    assert read_pair(pair.folder(tmp_path / "out" / "twins")).settings.rig.distortion_k1 == pytest.approx(-0.1)
    assert "were interpolated" not in (tmp_path / "out" / "twin.html").read_text(encoding="utf-8")


def test_rectified_images_keep_their_own_principal_points(tmp_path, rendered):
    files, calibration = photographs(tmp_path / "in", shift=6.0)
    assert run(files, calibration, tmp_path / "out", "--rectified") == 0
    assert rendered[0].settings.rig.principal_x_px == pytest.approx(0, abs=1e-6)
    assert "were interpolated" in (tmp_path / "out" / "twin.html").read_text(encoding="utf-8")


@pytest.mark.long
def test_exchanged_images_are_told_and_measured_all_the_same(tmp_path, rendered, capsys):
    files, calibration = photographs(tmp_path / "in")
    assert run(files, calibration, tmp_path / "right") == 0
    assert "match better" not in capsys.readouterr().err
    assert run(files[::-1], calibration, tmp_path / "wrong") == 0
    assert "match better with the right image first; exchange them" in capsys.readouterr().err
    assert "match better with the right image first" in (tmp_path / "wrong" / "twin.html").read_text(encoding="utf-8")


def test_images_without_common_places_and_a_depth_of_something_else_are_told(tmp_path, rendered, capsys):
    files, calibration = photographs(tmp_path / "in")
    # The images show 12 px everywhere; this depth has 12 px too, then 6 px.
    np.save(tmp_path / "depth.npy", np.full((HEIGHT, WIDTH), FOCAL_PX * BASELINE_M / 12))
    np.save(tmp_path / "twice.npy", np.full((HEIGHT, WIDTH), FOCAL_PX * BASELINE_M / 6))
    pose = ("--set", "rig.height_m=1.5")
    assert run(files, calibration, tmp_path / "a", "--depth", tmp_path / "depth.npy", *pose) == 0
    assert not capsys.readouterr().err
    assert run(files, calibration, tmp_path / "b", "--depth", tmp_path / "twice.npy", *pose) == 0
    assert "twice.npy contradicts the images" in capsys.readouterr().err
    other, _ = photographs(tmp_path / "other", count=2)
    assert run([other[0], other[3]], calibration, tmp_path / "c", *pose) == 0
    assert "match in few places" in capsys.readouterr().err


def test_a_damaged_photograph_is_told_before_anything_is_rendered(tmp_path, rendered, capsys):
    files, calibration = photographs(tmp_path / "in", count=2)
    (tmp_path / "in" / "right2.png").write_bytes(b"no image")
    assert run(files, calibration, tmp_path / "out") == 1
    assert "right2.png" in capsys.readouterr().err
    assert not rendered


def test_a_height_map_is_the_ground(tmp_path, rendered):
    files, calibration = photographs(tmp_path / "in")
    np.save(tmp_path / "dem.npy", np.zeros((5, 5)))
    more = ("--ground", tmp_path / "dem.npy", "--set", "source.metres_per_pixel=0.5")
    assert run(files, calibration, tmp_path / "out", *more) == 0
    source = rendered[0].settings.source
    assert (source.kind, source.file) == ("HEIGHT_MAP", str(tmp_path / "dem.npy"))
    html = (tmp_path / "out" / "twin.html").read_text(encoding="utf-8")
    assert "dem.npy: whatever is smaller than its cells is missing" in html


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--set", "rig.width_px=10"], "The images, 10 x 112 px, are too small for StereoBM"),
        (["--ground", "dem.npy"], "dem.npy: does not state the size of its pixels; set source.metres_per_pixel"),
        (["--ground", "dem.asc"], "gdal_translate"),
        (
            ["--ground", "dem.npy", "--set", "source.site=MAP", "--set", "source.metres_per_pixel=2"],
            "replaces the map of the file",
        ),
    ],
)
def test_images_and_ground_that_cannot_be_used_are_told_before_anything_is_rendered(
    tmp_path, monkeypatch, rendered, capsys, more, words
):
    files, calibration = photographs(tmp_path / "in")
    monkeypatch.chdir(tmp_path)
    np.save(tmp_path / "dem.npy", np.zeros((5, 5)))
    (tmp_path / "dem.asc").write_text("ncols 5\n", encoding="utf-8")
    assert run(files, calibration, tmp_path / "out", *more, "--methods", "bm") == 1
    shown = capsys.readouterr().err.strip()
    assert words in shown.splitlines()[-1]
    assert not rendered


@pytest.mark.parametrize(
    ("words", "more"),
    [
        ("no partner", ["left1.png"]),
        ("none.yml cannot be read", ["--calibration", "none.yml"]),
        ("--depth names 2 files for 1 pair", ["--depth", "a.npy", "b.npy"]),
        ("Unknown matcher 'sgmb'", ["--methods", "sgmb"]),
        ("Unknown preset", ["--preset", "no_such_preset"]),
    ],
)
def test_what_is_wrong_is_one_sentence_before_anything_is_rendered(tmp_path, rendered, capsys, words, more):
    files, calibration = photographs(tmp_path / "in")
    if more[0] == "left1.png":
        files, more = files[:1], []
    assert run(files, calibration, tmp_path / "out", *more) == 1
    shown = capsys.readouterr().err.strip()
    assert words in shown
    assert len(shown.splitlines()) == 1
    assert not rendered
    assert not (tmp_path / "out").exists()
