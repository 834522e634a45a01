"""Inputs of kinds that users of such tools report: each gives its right result through the command line.

The files in ``tests/data/cases`` were made for these tests.
"""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
from icymoon.commands.cli import main
from icymoon.physics.arm.link_mesh import read_link_mesh
from icymoon.physics.arm.urdf import read_urdf
from icymoon.stereo.images.exr import read_view
from icymoon.support.arrays import Array
from icymoon.support.version import ROOT

CASES = ROOT / "tests" / "data" / "cases"


def case(number: int, tmp_path: Path) -> Path:
    """A copy of a case, to be written beside."""
    (source,) = CASES.glob(f"{number:02d}_*")
    return Path(shutil.copytree(source, tmp_path / source.name))


def evaluated(folder: Path, out: Path, capsys) -> tuple[int, dict, str]:
    """Exit status, report by method and what is printed."""
    status = main(["evaluate", str(folder / "data"), "--methods", "bm,sgbm", "--out", str(out)])
    captured = capsys.readouterr()
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return status, report, " ".join((captured.out + captured.err).split())


def rows_of(report: dict) -> dict[str, dict]:
    return {row["method"]: row for row in report["rows"]}


def test_03_a_sky_at_1e10_is_no_truth(tmp_path, capsys):
    status, report, shown = evaluated(case(3, tmp_path), tmp_path / "out", capsys)
    assert status == 0
    for row in rows_of(report).values():
        assert 0.05 < row["l1_m"] < 0.1
    assert "pixels have the depth 1e+10 m to the bit" in shown


def test_07_a_distance_along_the_ray_is_found_and_read(tmp_path, capsys):
    folder = case(7, tmp_path)
    status, _, shown = evaluated(folder, tmp_path / "out", capsys)
    assert status == 1
    assert 'state truth.along = "ray" in pairs.toml' in shown
    toml = folder / "data" / "pairs.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace("[truth]", '[truth]\nalong = "ray"'), encoding="utf-8")
    status, report, _ = evaluated(folder, tmp_path / "again", capsys)
    assert status == 0
    assert rows_of(report)["sgbm"]["epe_px"] < 0.3


@pytest.mark.parametrize(
    ("number", "names", "focal_mm"),
    [
        (14, ("L.LBL", "R.LBL"), 70.3125),
        (15, ("L.LBL", "R.LBL"), 70.3125),
        (22, ("left.yaml", "right.yaml"), 70.3125),
        (24, ("L.LBL", "R.LBL"), (1200.3 + 1203.8) / 2 / 1024 * 60),
    ],
)
def test_two_cameras_are_a_rig(tmp_path, capsys, number, names, focal_mm):
    """14: a thumbnail in the label; 15: vectors over several lines; 22: YAML of ROS; 24: eyes that differ."""
    folder = case(number, tmp_path)
    alike = ["--alike"] if number == 24 else []
    assert main(["camera", *(str(folder / name) for name in names), *alike]) == 0
    shown = dict(line.split(" = ") for line in capsys.readouterr().out.splitlines() if " = " in line)
    assert int(shown["width_px"]) == int(shown["height_px"]) == 1024
    assert float(shown["focal_length_mm"]) == pytest.approx(focal_mm, rel=1e-6)
    assert float(shown["baseline_m"]) == pytest.approx(0.2)
    assert (float(shown["distortion_k1"]), float(shown["distortion_k2"])) == (-0.05, 0.01)
    centre = (509.1 + 515.4) / 2 - 511.5 if number == 24 else 0.0
    assert float(shown["principal_x_px"]) == pytest.approx(centre, abs=1e-6)


def test_24_two_eyes_that_differ_are_kept_as_they_are(tmp_path, capsys):
    folder = case(24, tmp_path)
    assert main(["camera", str(folder / "L.LBL"), str(folder / "R.LBL")]) == 0
    stated = tomllib.loads(capsys.readouterr().out)
    assert stated["rig"]["eyes"] == "CALIBRATED"
    assert [stated[eye]["fx_px"] for eye in ("left_eye", "right_eye")] == pytest.approx([1200.3, 1203.8])
    assert [stated[eye]["cx_px"] for eye in ("left_eye", "right_eye")] == pytest.approx([509.1, 515.4])


def test_05_a_depth_is_never_a_normal(tmp_path, capsys):
    status, report, _ = evaluated(case(5, tmp_path), tmp_path / "out", capsys)
    assert status == 0
    assert rows_of(report)["sgbm"]["epe_px"] < 0.5
    assert 3.2 < report["pairs"][0]["depth_m"][0] < 3.4


@pytest.mark.parametrize("number", [16, 17, 19])
def test_files_of_other_programs_are_read(tmp_path, capsys, number):
    """16: bytes behind the end of a JPEG; 17: PFM with line ends of Windows; 19: disparities of 8 bits."""
    status, report, _ = evaluated(case(number, tmp_path), tmp_path / "out", capsys)
    assert status == 0
    assert rows_of(report)["sgbm"]["total_bad_1"] == pytest.approx(0.077, abs=0.003)


def built(folder: Path, *settings: str):
    """A scene on the height map of a case, and its warnings."""
    from icymoon.nodes.build_scene import build_scene
    from icymoon.settings import description, preset_files
    from rendering import empty_scene

    stated = ("source.kind=HEIGHT_MAP", f"source.file={folder / 'dem.tif'}", *settings)
    presets = (preset_files.load_preset(name) for name in ("europa_rough_ice", "qualities/draft"))
    return build_scene(
        empty_scene(),
        description.merged(
            description.defaults(),
            *presets,
            {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 65}, "rocks": {"coverage": 0.0}},
            *(description.override(text) for text in stated),
        ),
    )


def ground_of(scene) -> Array:
    vertices = np.empty(3 * len(scene.terrain.data.vertices))
    scene.terrain.data.vertices.foreach_get("co", vertices)
    return vertices.reshape(-1, 3)


def test_09_a_web_map_at_60_degrees_has_its_slope(tmp_path):
    x, y, z = ground_of(built(case(9, tmp_path), "terrain.size_m=40")).T
    rise, *_ = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=1), z, rcond=None)[0]
    steepest = np.hypot(rise, np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=1), z, rcond=None)[0][1])
    assert np.degrees(np.arctan(steepest)) == pytest.approx(26.6, abs=0.3)


def test_11_missing_heights_without_a_mark_are_no_pit(tmp_path):
    scene = built(case(11, tmp_path), "terrain.size_m=2000")
    assert "9 pixels of exactly -9999" in " ".join(scene.warnings)
    assert np.ptp(ground_of(scene)[:, 2]) < 1000


def test_13_a_site_in_a_map_of_a_region_is_built(tmp_path):
    scene = built(case(13, tmp_path), "terrain.size_m=4000")
    assert np.ptp(ground_of(scene)[:, 0]) == pytest.approx(4000, rel=1e-3)


#: Settings of a pair that takes about 4 s.
SMALL = (
    "terrain.resolution=65",
    "terrain.rms_slope_deg=0",
    "rocks.coverage=0",
    "rig.width_px=96",
    "rig.height_px=72",
    "quality.samples=1",
)


def rendered(out: Path, preset: str, *settings: str) -> tuple[Path, dict]:
    """The folder of the pair that a command renders, and what it states."""
    changes = [word for each in (*SMALL, *settings) for word in ("--set", each)]
    assert main(["render", "--preset", preset, "--preset", "qualities/draft", *changes, "--out", str(out)]) == 0
    (stated,) = out.glob("pairs/*/pair.json")
    return stated.parent, json.loads(stated.read_text(encoding="utf-8"))


@pytest.mark.long
@pytest.mark.heavy
def test_20_the_sun_is_that_of_kernels_in_a_folder_of_a_mac(tmp_path):
    spiceypy = pytest.importorskip("spiceypy")  # of the extra "ephemeris"
    kernels = case(20, tmp_path) / "kernels"
    assert (kernels / ".DS_Store").is_file()
    _, stated = rendered(
        tmp_path / "out",
        "europa_chaos",
        "light.directions_from=KERNELS",
        f"light.kernels={kernels}",
        "light.date_utc=2035-03-01T12:00:00",
        "light.longitude_deg=331",
        "light.latitude_deg=10",
    )
    for name in ("body.tpc", "leap.tls", "toy.bsp"):
        spiceypy.furnsh(str(kernels / name))
    try:
        sun, _ = spiceypy.spkpos("10", spiceypy.str2et("2035-03-01T12:00:00"), "IAU_EUROPA", "LT+S", "502")
    finally:
        spiceypy.kclear()
    north, east = math.radians(10), math.radians(331)
    site = np.array([math.cos(north) * math.cos(east), math.cos(north) * math.sin(east), math.sin(north)])
    up = site / np.square([1562.6, 1560.3, 1559.5])  # of the ellipsoid in body.tpc
    sine = np.dot(sun, up) / np.linalg.norm(sun) / np.linalg.norm(up)
    assert stated["light"]["sun"]["source"] == "KERNELS"
    # Mean orbits, without the kernels, differ by 7 degrees.
    assert stated["light"]["sun"]["elevation_deg"] == pytest.approx(math.degrees(math.asin(sine)), abs=1e-3)


@pytest.mark.heavy
@pytest.mark.parametrize(("number", "urdf", "triangles"), [(25, "dae.urdf", 1), (26, "robots/two_up.urdf", 800)])
def test_a_mesh_of_a_published_arm_is_seen(tmp_path, number, urdf, triangles):
    """25: a Collada mesh; 26: a package.xml two folders above. The next link is made thin, which hides the mesh."""
    file = case(number, tmp_path) / "pkg" / "urdf" / urdf
    file.write_text(
        file.read_text(encoding="utf-8")
        .replace("0.5 0.05 0.05", "0.5 0.005 0.005")
        .replace("0.02 0.02 0.02", "0.2 0.2 0.2"),
        encoding="utf-8",
    )
    pair, stated = rendered(tmp_path / "out", "workspace_europa_lander", "lander.kind=OWN", f"lander.file={file}")
    labels = {link["name"]: link["instance"] for link in stated["lander"]["links"]}
    assert (read_view(pair / "left.exr").instance == labels["base_link"]).sum() > 3
    (mesh,) = read_urdf(file).files
    assert len(read_link_mesh(mesh)[1]) == triangles
