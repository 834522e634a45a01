"""Scan with LiDAR: the command that scans, the folder of its returns, and its points in the view."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest
from icymoon.nodes import lidar_in_view
from icymoon.operators import jobs, lidar
from icymoon.operators.session import session
from icymoon.panels import active_sensors
from icymoon.render.pairs.dataset_file_names import folder_of_pair
from icymoon.settings.blender.scene_properties import OWN_SCANNER
from icymoon.settings.preset_files import LIDARS
from icymoon.support.errors import IcyMoonError
from lidar_scans import write_folder
from panel_drawing import drawn, texts


@pytest.fixture
def started(monkeypatch):
    """The commands that are started, in place of their processes, with the content of their job's file."""
    commands: list[tuple[list[str], dict]] = []

    def start(title, command, **words):
        job = next(word for word in command if word.endswith("job.json"))
        commands.append((command[command.index("scan") :], json.loads(Path(job).read_text(encoding="utf-8"))))
        words["clean_up"]()
        assert not Path(job).exists()

    monkeypatch.setattr(jobs.Job, "start", start)
    return commands


def start() -> None:
    lidar.ICYMOON_OT_scan_lidar.start(type("Scope", (), {"bl_label": "Scan with LiDAR"})(), bpy.context)


def test_a_scan_is_the_job_of_the_command_line(small, started):
    group = small.icymoon.lidar
    group.scanner, group.rows, group.ice, group.detector = "livox_hap", 12, False, False
    start()
    (_, _, folder, file, asked), job = started[0]
    dataset = Path(small.icymoon.dataset.folder)
    assert Path(folder) == dataset.parent / "dataset_lidar"  # there is no rendered pair
    assert Path(file) == LIDARS / "livox_hap.toml"
    asked = json.loads(asked)
    assert (asked["rows"], asked["columns"], asked["without"]) == (12, None, ["ice", "detector"])
    assert [pair["id"] for pair in job["pairs"]] == [lidar.plan_scans(small)[0].id]


def test_waveforms_of_the_panel_are_asked_for_or_refused_before_a_scan(small, started):
    group = small.icymoon.lidar
    group.scanner = "livox_hap"
    start()
    group.waveforms = "128"
    start()
    assert [json.loads(command[-1])["waveforms"] for command, _ in started] == [None, 128]
    for detector, scanner, why in ((False, "livox_hap", "this scan has no detector"), (True, "elsa", "single photons")):
        group.detector, group.scanner = detector, scanner
        with pytest.raises(IcyMoonError, match=why):
            start()
    assert len(started) == 2


def test_a_rendered_pair_has_its_scan_in_its_own_folder(small, started, monkeypatch):
    monkeypatch.setattr(lidar, "is_complete", lambda folder: True)
    (planned,) = lidar.plan_scans(small)
    pair = folder_of_pair(Path(small.icymoon.dataset.folder), planned.id)
    write_folder(pair, measured=True)
    (pair / "lidar.ply").write_bytes(b"")
    start()
    assert Path(started[0][0][2]) == pair.parent
    assert not (pair / "lidar.ply").exists()  # of the earlier scan
    assert (pair / "lidar.npz").exists()  # until there is another


def test_points_follow_the_panel_and_a_build_removes_them(small, monkeypatch):
    write_folder(lidar.find_scan_folders(lidar.plan_scans(small))[0], measured=True)
    assert bpy.ops.icymoon.show_scan() == {"FINISHED"}
    assert session.ended == "Show LiDAR Points: 2 of 6 beams returned"  # it stays where the progress was
    session.ended = ""
    item = lidar_in_view.find_points(small)
    small.icymoon.lidar.points = 2
    small.icymoon.lidar.colour = "RETURN_NUMBER"
    assert len(item.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons) == 2
    assert any("alarm" in text for text, _ in lidar_in_view.make_legend(small, "RETURN_NUMBER"))
    shown = texts(drawn(active_sensors.ICYMOON_PT_lidar))
    assert "2 of 6 beams returned" in shown  # of two beams, one has two returns
    assert "Remove LiDAR Points" in shown
    assert bpy.ops.icymoon.hide_scan() == {"FINISHED"}
    assert not bpy.ops.icymoon.hide_scan.poll()
    assert not bpy.ops.icymoon.show_beams.poll()  # before there is a scene
    bpy.ops.icymoon.show_scan()
    bpy.ops.icymoon.build_scene()
    assert lidar_in_view.find_shown(small) is None  # the ground may be another
    assert bpy.ops.icymoon.show_beams() == {"FINISHED"}
    assert lidar_in_view.find_shown(small).name == lidar_in_view.BEAMS
    shown = texts(drawn(active_sensors.ICYMOON_PT_lidar))
    assert "Remove LiDAR Beams" in shown
    assert "beams meet the ground" in shown
    assert "Points Shown" not in shown
    assert bpy.ops.icymoon.clear_scene() == {"FINISHED"}
    assert lidar_in_view.find_shown(small) is None  # the beams end on ground that is gone


def test_all_headings_are_scanned_and_shown(small, started):
    small.icymoon.dataset.headings = 3
    start()
    (_, _, folder, *_), job = started[0]
    planned = lidar.plan_scans(small)
    assert len({each.settings.rig.heading_deg for each in planned}) == 3
    assert [pair["id"] for pair in job["pairs"]] == [each.id for each in planned]
    folders = lidar.find_scan_folders(planned)
    assert {each.parent for each in folders} == {Path(folder)}
    for count, each in enumerate(folders[:2], 1):
        write_folder(each, measured=True)
        assert bpy.ops.icymoon.show_scan() == {"FINISHED"}  # a stopped scan has some of them
        legend = [text for text, _ in lidar_in_view.make_legend(small, "INTENSITY")]
        assert f"{2 * count} of {6 * count} beams returned" in legend
        assert f"{3 * count} points" in legend


def refuse(operator: str, words: str) -> None:
    with pytest.raises(RuntimeError, match=words):
        getattr(bpy.ops.icymoon, operator)()


def test_what_cannot_be_scanned_is_refused_with_a_fix(small, tmp_path, started):
    refuse("show_scan", "no scan of the present settings yet; press Scan with LiDAR")
    group = small.icymoon.lidar
    group.scanner = OWN_SCANNER
    refuse("scan_lidar", "no file of a scanner; choose one under Scanner File")
    group.file = str(tmp_path / "none.toml")
    refuse("scan_lidar", "none.toml")
    (tmp_path / "bad.toml").write_text("[lidar]\nrows = 0\n", encoding="utf-8")
    group.file = str(tmp_path / "bad.toml")
    refuse("scan_lidar", "bad.toml")
    assert not started
    group.scanner = "ouster_os1"
    small.icymoon.dataset.folder = str(tmp_path / "dataset")
    bpy.ops.icymoon.build_scene()
    terrain = next(item for item in bpy.data.objects if item.get("icymoon") == "terrain")
    terrain.location.z += 1.0
    refuse("scan_lidar", "edited by hand, and a scan shows the settings; press Build Scene")
