"""Exports in the formats of the field: read back, by foreign readers where there are any, and projected again."""

from __future__ import annotations

import json
import math
import shutil
from typing import Any

import cv2
import numpy as np
import pairs
import pytest
from icymoon.formats.cahvor import read_model
from icymoon.formats.fits import Image, encode_fits
from icymoon.physics.camera.lens_distortion import distort_points
from icymoon.physics.camera.rotations import quaternion
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.export import exports_with_blender, find_plugins
from icymoon.stereo.export.cameras import make_pixel_rays
from icymoon.stereo.export.layouts import export
from icymoon.stereo.export.radiance_factor import measure_angle_deg
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

RIG = pairs.camera(96, 72)
SCENE = pairs.Scene(sky_rows=6)
SUN_WM2, TILT = 14.0, 0.5


def pose(eye: str, turn: float = 0.3) -> Array:
    """A camera that looks down, turned about the vertical: camera axes (right, down, forward) to world (4, 4)."""
    c, s, tilt = math.cos(turn), math.sin(turn), TILT
    heading = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    looking = np.array([[1, 0, 0], [0, -math.sin(tilt), math.cos(tilt)], [0, -math.cos(tilt), -math.sin(tilt)]])
    found = np.eye(4)
    found[:3, :3] = heading @ looking
    found[:3, 3] = [5.0, -2.0, 1.5] + found[:3, 0] * (RIG.baseline_m if eye == "right" else 0.0)
    return found


def described(heading: float, **light):
    """The settings of which this heading in radians, counterclockwise, gives the ``pose``, and the Sun of the pairs."""
    return merged(
        defaults(),
        {
            "rig": {"heading_deg": -math.degrees(heading), "pitch_deg": math.degrees(TILT), "x_m": 5.0, "y_m": -2.0},
            "light": {
                "directions_from": "ANGLES",
                "sun_azimuth_deg": 90.0,
                "sun_irradiance_wm2": SUN_WM2,
                "sun_elevation_deg": math.degrees(math.atan2(0.8, 0.6)),
                "planet": False,
                **light,
            },
        },
    )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two frames of one scene, with what rendered pairs state of their poses and of the Sun."""
    root = tmp_path_factory.mktemp("set")
    for k, name in enumerate(("0123456789ab", "ba9876543210")):
        settings = merged(described(0.3 + k), {"rig": {"frame": k, "stamp": f"{k}"}})
        folder = pairs.write_pair(root / "pairs" / name, SCENE, RIG, settings=settings)
        data = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
        data["poses_rectified_to_world"] = {eye: pose(eye, 0.3 + k).tolist() for eye in ("left", "right")}
        data["light"] = {"sun": {"direction_to_world": [0.6, 0.0, 0.8], "irradiance_wm2": SUN_WM2}}
        (folder / "pair.json").write_text(json.dumps(data), encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def points() -> tuple[Array, Array]:
    """World coordinates of what the first pair's left pixels see, and the columns of the right image; NaN for sky."""
    depth = pairs.view(SCENE, RIG, "left")[0]
    eye = pose("left")
    world = (make_pixel_rays(RIG) * depth[..., None]) @ eye[:3, :3].T + eye[:3, 3]
    return world, np.arange(RIG.width_px) - RIG.disparity(depth)


#: Where the site lies on a map, far from its origin.
PLACE = {
    "crs": "+proj=tmerc +lon_0=20 +x_0=5000000 +R=1560800 +units=m +no_defs",
    "unit_m": 0.3048,
    "origin": [5020000.0625, -4649990.123456789],
    "scale": [0.5, 0.25],
    "height_zero_m": 1234.5,
}


@pytest.fixture
def mapped(dataset, tmp_path):
    """The same pairs on a map."""
    shutil.copytree(dataset, tmp_path / "mapped")
    for file in (tmp_path / "mapped").glob("pairs/*/pair.json"):
        file.write_text(
            json.dumps(json.loads(file.read_text(encoding="utf-8")) | {"ground": {"map": PLACE}}), encoding="utf-8"
        )
    return tmp_path / "mapped"


@pytest.mark.parametrize(
    "kind", sorted(set(find_plugins().usable) - {*exports_with_blender(), "bop", "head", "parquet-index"})
)
def test_every_layout_states_the_exact_place_on_the_map(mapped, tmp_path, kind):
    if kind == "ros2":
        pytest.importorskip("rosbags", reason="pip install icymoon[ros]")
    root = exported(mapped, tmp_path, kind)
    found = json.loads((root / "map_coordinates.json").read_text(encoding="utf-8"))
    assert found["pairs"] == dict.fromkeys(("0123456789ab", "ba9876543210"), PLACE)
    assert "origin[0] + x / scale[0]" in found["formula"]


@pytest.mark.long
def test_points_of_colmap_go_back_to_the_map_within_a_millimetre(mapped, tmp_path, points):
    root = exported(mapped, tmp_path, "colmap")
    stated = json.loads((root / "map_coordinates.json").read_text(encoding="utf-8"))["pairs"]["0123456789ab"]
    lines = (root / "scene-0000" / "sparse" / "0" / "points3D.txt").read_text(encoding="utf-8").splitlines()
    found = np.array([line.split()[1:4] for line in lines if "1" in line.split()[8::2]], float)  # of its left image
    true = points[0].reshape(-1, 3)
    true = true[np.isfinite(true).all(axis=1)]

    def on_map(local):
        x, y = ((stated["origin"][k] + local[:, k] / stated["scale"][k]) / stated["unit_m"] for k in range(2))
        return np.stack([x, y, local[:, 2] + stated["height_zero_m"]], axis=1)

    distances = np.linalg.norm(on_map(found)[:, None] - on_map(true)[None], axis=2).min(axis=1)
    assert len(found) > 100
    assert distances.max() < 1e-3


def exported(dataset, tmp_path, kind, *overrides):
    response = {"rig": dict(overrides)} if overrides else None
    assert export([dataset], kind, tmp_path / kind, response) == []
    return tmp_path / kind


def test_camera_models_see_the_points_of_the_truth_where_they_are(dataset, tmp_path, points):
    folder = exported(dataset, tmp_path, "cahvor") / "0123456789ab"
    world, right_columns = points
    known = np.isfinite(world[..., 0])
    rows, columns = np.nonzero(known)
    for name, wanted in (("left", columns), ("right", right_columns[known])):
        for suffix in (".cahvor", ".lbl"):
            model = read_model(folder / f"{name}{suffix}")
            assert (model.kind, model.width_px) == ("CAHV", RIG.width_px)
            seen = model.project(world[known])
            assert np.abs(seen - np.stack([wanted, rows], axis=1)).max() < 1e-6
        assert cv2.imread(str(folder / f"{name}.png")).shape == (72, 96, 3)
    assert not list(folder.glob("*sensor*"))


def test_the_sensors_model_has_its_distortion(dataset, tmp_path, points):
    folder = exported(dataset, tmp_path, "cahvor", ("distortion_k1", -0.2), ("distortion_k2", 0.05)) / "0123456789ab"
    model = read_model(folder / "left_sensor.cahvor")
    assert model.kind == "CAHVOR"
    world, _ = points
    bent = (
        distort_points(make_pixel_rays(RIG)[..., :2], (float(np.float32(-0.2)), float(np.float32(0.05)), 0, 0, 0))
        * RIG.focal_px
    )
    known = np.isfinite(world[..., 0])
    wanted = bent + np.array([RIG.cx_px - 0.5, RIG.cy_px - 0.5])
    assert np.abs(model.project(world[known]) - wanted[known]).max() < 1e-6


def test_colmap_projects_its_points_onto_its_pixels(dataset, tmp_path):
    root = exported(dataset, tmp_path, "colmap")
    assert [path.name for path in root.iterdir()] == ["scene-0000"], "both pairs are of one scene"
    sparse = root / "scene-0000" / "sparse" / "0"
    (camera,) = (sparse / "cameras.txt").read_text(encoding="utf-8").splitlines()
    kind, _, _, *numbers = camera.split()[1:]
    assert kind == "PINHOLE"
    fx, fy, cx, cy = map(float, numbers)
    points = {
        int(line.split()[0]): line.split()
        for line in (sparse / "points3D.txt").read_text(encoding="utf-8").splitlines()
    }
    lines = (sparse / "images.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 8
    frames = json.loads((root / "scene-0000" / "transforms.json").read_text(encoding="utf-8"))["frames"]
    for k in range(4):
        number, qw, qx, qy, qz, tx, ty, tz, _, name = lines[2 * k].split()
        w, x, y, z = map(float, (qw, qx, qy, qz))
        rotation = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        seen = np.array(lines[2 * k + 1].split(), float).reshape(-1, 3)
        world = np.array([points[int(p)][1:4] for p in seen[:, 2]], float)
        eye = world @ rotation.T + [float(tx), float(ty), float(tz)]
        again = eye[:, :2] / eye[:, 2:] * [fx, fy] + [cx, cy]
        assert len(seen) > 100
        assert np.abs(again - seen[:, :2]).max() < 1e-3
        tracks = {tuple(points[int(p)][8:]) for p in seen[:3, 2]}
        assert all(number in track[::2] for track in tracks)
        # nerfstudio: camera to world in OpenGL's axes, y up and z back.
        matrix = np.array(frames[k]["transform_matrix"]) @ np.diag([1, -1, -1, 1.0])
        assert frames[k]["file_path"] == f"images/{name}"
        assert np.abs(matrix[:3, :3] - rotation.T).max() < 1e-12
        assert np.abs(matrix[:3, 3] + rotation.T @ [float(tx), float(ty), float(tz)]).max() < 1e-12
        assert (root / "scene-0000" / frames[k]["file_path"]).is_file()


def test_a_colour_sensor_gives_colours_to_images_and_points(dataset, tmp_path):
    # Without white balance grey ground is not grey.
    colour = {"sensor": {"colour": "BAYER", "white_balance": "NONE"}}
    for kind, name in (("cahvor", "left.png"), ("colmap", "0123456789ab_left.png")):
        assert export([dataset], kind, tmp_path / kind, colour) == []
        image = cv2.imread(str(next((tmp_path / kind).rglob(name))), cv2.IMREAD_UNCHANGED)
        assert np.ptp(image, axis=-1).max() > 20
    lines = next((tmp_path / "colmap").rglob("points3D.txt")).read_text(encoding="utf-8").splitlines()
    levels = np.array([line.split()[4:7] for line in lines if line and line[0] != "#"], int)
    assert np.ptp(levels, axis=1).max() > 20


def test_quaternions_are_those_of_their_rotations():
    for turn in np.linspace(-3, 3, 9):
        m = pose("left", turn)[:3, :3]
        w, x, y, z = quaternion(m)
        assert w * w + x * x + y * y + z * z == pytest.approx(1.0)
        assert 2 * (x * y + z * w) == pytest.approx(m[1, 0], abs=1e-12)
        assert 1 - 2 * (y * y + z * z) == pytest.approx(m[0, 0], abs=1e-12)
        assert 2 * (y * z + x * w) == pytest.approx(m[2, 1], abs=1e-12)


def test_the_radiance_factor_is_that_of_its_formula(dataset, tmp_path):
    folder = exported(dataset, tmp_path, "tiff") / "0123456789ab"
    depth, light, _ = pairs.view(SCENE, RIG, "left")
    factor = cv2.imread(str(folder / "left_radiance_factor.tif"), cv2.IMREAD_UNCHANGED)
    angles = cv2.imread(str(folder / "left_geometry.tif"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    known = np.isfinite(depth)
    assert factor[..., 0][known] == pytest.approx(math.pi * light[known] / SUN_WM2, rel=1e-6)
    assert np.isnan(factor[~known]).all()
    # Normals of the synthetic pair point up, so the incidence is that of the Sun everywhere.
    assert angles[..., 0][known] == pytest.approx(math.degrees(math.acos(0.8)), abs=1e-3)
    row, column = 60, 30
    ray = pose("left")[:3, :3] @ make_pixel_rays(RIG)[row, column]
    ray /= np.linalg.norm(ray)
    assert angles[row, column, 1] == pytest.approx(math.degrees(math.acos(-ray[2])), abs=1e-3)
    assert angles[row, column, 2] == pytest.approx(math.degrees(math.acos(-ray @ [0.6, 0.0, 0.8])), abs=1e-3)


def test_small_angles_are_those_of_normals_of_any_length():
    """As compact files round them, by up to 0.04 %: a cosine that is cut off at 1 has no angle below 1.6 degrees."""
    stated = np.array([0.0, 0.05, 0.8, 30.0, 90.0, 179.9])
    turn = np.radians(stated)
    normal = np.stack([np.sin(turn), 0 * turn, np.cos(turn)], axis=-1)
    for length in (0.9996, 1.0, 1.0004):
        assert measure_angle_deg(length * normal, np.array([0.0, 0.0, 1.0])) == pytest.approx(stated, abs=1e-9)


def test_the_radiance_factor_is_that_of_the_band_under_a_lamp_of_another_colour(dataset, tmp_path):
    """Grey ground is as grey under a lamp of 3200 K, whose light is twice as red as blue."""
    folder = pairs.write_pair(
        tmp_path / "lamp" / "pairs" / "0123456789ab", SCENE, RIG, settings=described(0.3, sun_temperature_k=3200.0)
    )
    data = json.loads((dataset / "pairs" / "0123456789ab" / "pair.json").read_text(encoding="utf-8"))
    own = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    own |= {key: data[key] for key in ("poses_rectified_to_world", "light")}
    (folder / "pair.json").write_text(json.dumps(own), encoding="utf-8")
    plain, lit = (
        cv2.imread(
            str(exported(root, tmp_path / root.name, "tiff") / "0123456789ab" / "left_radiance_factor.tif"),
            cv2.IMREAD_UNCHANGED,
        )
        for root in (dataset, tmp_path / "lamp")
    )
    # Bands of one file are R, G, B, which OpenCV turns round. By Planck's law, relative to 5772 K.
    ratio = (np.nanmean(plain / lit, axis=(0, 1)))[::-1]
    wanted = np.array([planck(at, 3200.0) / planck(at, 5772.0) for at in (620e-9, 550e-9, 460e-9)])
    # The constants of physics are rounded there.
    assert ratio / ratio.mean() == pytest.approx(wanted / wanted.mean(), rel=1e-4)


def planck(wavelength_m: float, kelvin: float) -> float:
    """A black body's radiance, in any unit."""
    return wavelength_m**-5 / math.expm1(6.62607015e-34 * 299792458.0 / (wavelength_m * 1.380649e-23 * kelvin))


def test_there_is_no_radiance_factor_under_a_lamp_nearby(tmp_path, dataset):
    folder = pairs.write_pair(
        tmp_path / "pairs" / "0123456789ab", SCENE, RIG, settings=described(0.3, sun_distance_m=3.0)
    )
    data = json.loads((dataset / "pairs" / "0123456789ab" / "pair.json").read_text(encoding="utf-8"))
    own = json.loads((folder / "pair.json").read_text(encoding="utf-8"))
    data["light"]["sun"]["distance_m"] = 3.0
    (folder / "pair.json").write_text(
        json.dumps(own | {key: data[key] for key in ("poses_rectified_to_world", "light")}), encoding="utf-8"
    )
    (failure,) = export([tmp_path], "tiff", tmp_path / "out")
    assert "light.sun_distance_m" in failure


def test_fits_files_are_cards_and_blocks_with_the_bottom_row_first(dataset, tmp_path):
    folder = exported(dataset, tmp_path, "fits") / "0123456789ab"
    data = (folder / "left.fits").read_bytes()
    assert len(data) % 2880 == 0
    cards = [data[k : k + 80].decode("ascii") for k in range(0, 2880, 80)]
    assert cards[0] == "SIMPLE  =                    T / conforms to FITS standard".ljust(80)
    assert "NAXIS3  =                    3".ljust(80) in cards
    assert any(card.startswith("PAIR    = '0123456789ab'") for card in cards)
    assert b"EXTNAME = 'INCIDENCE' / from the facet's normal to the Sun" in data
    cube = np.frombuffer(data[2880 : 2880 + 4 * 3 * 72 * 96], ">f4").reshape(3, 72, 96)
    light = pairs.view(SCENE, RIG, "left")[1]
    assert cube[0, 0] == pytest.approx(math.pi * light[-1] / SUN_WM2, rel=1e-6), "the bottom row comes first"


def test_astropy_reads_them_and_finds_no_fault(dataset, tmp_path):
    fits = pytest.importorskip("astropy.io.fits", reason="pip install astropy, which only this test needs")
    with fits.open(exported(dataset, tmp_path, "fits") / "0123456789ab" / "right.fits") as opened:
        opened.verify("exception")
        assert [each.name for each in opened] == ["RADIANCE FACTOR", "INCIDENCE", "EMISSION", "PHASE", "DEPTH"]
        assert opened[1].header["BUNIT"] == "deg"
        assert opened["INCIDENCE"].header.comments["EXTNAME"] == "from the facet's normal to the Sun"
        assert opened["EMISSION"].header.comments["EXTNAME"] == "from the facet's normal to the camera"
        depth = pairs.view(SCENE, RIG, "right")[0]
        assert opened["DEPTH"].data[::-1] == pytest.approx(depth, rel=1e-6, nan_ok=True)


def test_what_no_card_can_contain_is_an_error():
    for cards in ({"TOOLONGKEY": (1, "")}, {"KEY": (math.nan, "")}, {"KEY": ("x" * 90, "")}, {"KEY": ("µ", "")}):
        with pytest.raises(ValueError, match="FITS header"):
            encode_fits([Image("A", np.zeros((2, 2)), "", cards)])


def test_a_pair_without_sun_or_pose_is_a_sentence(tmp_path):
    pairs.write_pair(tmp_path / "pairs" / "0123456789ab", SCENE, RIG)
    for kind in ("fits", "cahvor"):
        (failure,) = export([tmp_path], kind, tmp_path / kind)
        assert "does not contain" in failure


def test_a_bag_that_was_stopped_leaves_nothing(dataset, tmp_path):
    pytest.importorskip("rosbags", reason="pip install icymoon[ros]")

    def stop(event):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export([dataset], "ros2", tmp_path / "bag", on_event=stop)
    assert not list((tmp_path / "bag").iterdir())
    assert (exported(dataset, tmp_path, "ros2") / "pairs" / "pairs.mcap").is_file(), "and the next one is whole"


def test_a_bag_gives_back_what_was_put_in(dataset, tmp_path, points):
    pytest.importorskip("rosbags", reason="pip install icymoon[ros]")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    root = exported(dataset, tmp_path, "ros2")
    types = get_typestore(Stores.ROS2_JAZZY)
    with Reader(root / "pairs") as reader:
        found = [(c.topic, t, types.deserialize_cdr(raw, c.msgtype)) for c, t, raw in reader.messages()]
    assert len(found) == 14
    first: dict[str, Any] = {topic: message for topic, time, message in found if time == 0}
    left, right, disparity = (
        first[f"/stereo/{name}"] for name in ("left/camera_info", "right/camera_info", "disparity")
    )
    camera = read_pair(dataset / "pairs" / "0123456789ab").camera
    assert right.p[3] == pytest.approx(-camera.focal_px * camera.baseline_m)
    assert left.k[2] == pytest.approx(camera.cx_px - 0.5)
    depth = pairs.view(SCENE, RIG, "left")[0]
    shown = np.frombuffer(disparity.image.data.tobytes(), "<f4").reshape(72, 96)
    assert shown == pytest.approx(RIG.disparity(depth), rel=1e-6, nan_ok=True)
    assert disparity.f * disparity.t == pytest.approx(camera.focal_px * camera.baseline_m, rel=1e-6)
    cloud = np.frombuffer(first["/stereo/points2"].data.tobytes(), "<f4").reshape(72, 96, 3)
    assert cloud == pytest.approx(make_pixel_rays(RIG) * depth[..., None], rel=1e-5, abs=1e-5, nan_ok=True)
    (transform, _) = first["/tf"].transforms
    assert transform.transform.translation.x == pytest.approx(5.0)
    with pytest.raises(IcyMoonError, match="exists already"):
        export([dataset], "ros2", root)


def test_a_lens_without_an_equal_leaves_no_half_of_a_pair(dataset, tmp_path):
    """The rectified models could be written, those of the sensor could not."""
    out = tmp_path / "cahvor"
    failed = export([dataset], "cahvor", out, {"rig": {"distortion_p1": 0.1}})
    assert failed
    assert "distortion" in failed[0] or "CAHVOR" in failed[0]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert export([dataset], "cahvor", out) == []
