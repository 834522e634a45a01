"""Variants rendered by real workers, measured, and searched through."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from icymoon.operators import sidebar_text, trade
from icymoon.operators.job_operators import JobOperator
from icymoon.render.cost import machine_speed
from icymoon.render.workers.job_commands import python_command
from icymoon.settings import description, preset_files
from icymoon.settings.blender import scene_properties
from icymoon.support import cache_folder

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
SCENE = (
    "--preset",
    "europa_rough_ice",
    "--scale",
    "0.15",
    "--reference-samples",
    "32",
    "--methods",
    "sgbm",
    "--set",
    "mesh.most=20000",
)


def icymoon(*words):
    ended = subprocess.run(
        python_command(sys.executable, *words), capture_output=True, text=True, timeout=600, check=False
    )
    return ended.returncode, ended.stdout, ended.stderr


@pytest.mark.long
def test_a_trade_says_what_was_measured_and_renders_nothing_twice(tmp_path):
    words = ("trade", *SCENE, "--groups", "bounces", "--out", str(tmp_path), "--json-lines")
    code, out, err = icymoon(*words)
    assert code == 0, err
    messages = [json.loads(line) for line in out.splitlines()]
    report = messages[-1]
    assert report["type"] == "result"
    rows = {row["name"]: row for row in report["rows"]}
    # Without interreflection ice in daylight loses some per cent of its light, and never gains any.
    assert rows["0 bounces"]["bias"] < -0.01
    assert abs(rows["16 bounces"]["bias"]) < abs(rows["0 bounces"]["bias"]) / 3
    for row in rows.values():
        assert min(row["cpu_s"], row["noise"]) > 0
        assert row["memory_mib"] > 50
        assert row["depth_px"] == 0
    assert (tmp_path / "trade.html").is_file()
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("pair.json")}
    code, _, err = icymoon(*words)
    assert code == 0, err
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("pair.json")} == before


@pytest.mark.long
def test_auto_stops_at_the_first_that_is_good_enough(tmp_path):
    words = ("auto", *SCENE, "--out", str(tmp_path), "--json-lines")
    code, out, err = icymoon(*words, "--tolerance-px", "0.5")
    assert code == 0, err
    found = json.loads(out.splitlines()[-1])
    chosen = next(step for step in found["tried"] if step["name"] == found["chosen"])
    assert chosen["loss"]["sgbm"]["epe_px"] + chosen["loss_doubt"]["sgbm"]["epe_px"] <= 0.5
    assert chosen["within"] is True
    ladder = [step for step in found["tried"] if step["name"].removesuffix(", denoised").endswith(("ple", "ples"))]
    assert [step["within"] for step in ladder].count(True) == 1  # stopped there
    description.check(found["settings"], "auto")
    assert preset_files.load(Path(found["file"])) == found["settings"]


@pytest.mark.ci_takes(3)
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("trade", *SCENE, "--groups", "hapke"), "nothing to vary in hapke"),
        (("trade", *SCENE, "--scale", "3"), "scaled by 3"),
        (("auto", *SCENE, "--tolerance-px", "0"), "tolerance of 0 px"),
        (("auto", *SCENE, "--tolerance-px", "nan"), "tolerance of nan px"),
        (("auto", *SCENE, "--tolerance-bad-1", "80%"), "tolerance of 80 % bad-1"),
        (("auto", *SCENE, "--reference-samples", "999999"), "choose 2 to 131072"),
        (("auto", *SCENE, "--methods", "magic"), "magic"),
        (("trade", *SCENE, "--repeats", "0"), "--repeats is 0"),
        (("trade", *SCENE, "--methods", "magic"), "magic"),
    ],
)
def test_bad_input_is_one_sentence(words, said, tmp_path):
    code, _, err = icymoon(*words, "--out", str(tmp_path))
    assert code == 1
    assert said in err
    assert "Traceback" not in err
    assert not list(tmp_path.rglob("*.exr"))


@pytest.mark.long
def test_the_button_sets_what_the_search_finds(tmp_path):
    import bpy

    scene = bpy.data.scenes.new("Trade")
    scene_properties.write_settings(
        scene.icymoon,
        description.merged(
            preset_files.load_preset("europa_rough_ice"),
            {"mesh": {"most": 20000}, "dataset": {"folder": str(tmp_path), "methods": "sgbm"}},
        ),
    )
    with bpy.context.temp_override(scene=scene):
        assert bpy.ops.icymoon.auto_quality(scale=0.15, reference_samples=32, tolerance_px=0.5) == {"FINISHED"}
        by_error = trade.last_results["Trade"]
        # What is rendered by now is not rendered again.
        assert bpy.ops.icymoon.auto_quality(
            scale=0.15, reference_samples=32, judged_by="BAD_1", tolerance_bad_1=25.0
        ) == {"FINISHED"}
    assert list((tmp_path / "trade" / "data" / "pairs").iterdir())
    tried = trade.last_results["Trade"]
    assert any(line.startswith(f"{scene.icymoon.quality.samples} sample") for line in tried)
    assert " px" in " ".join(by_error)
    assert "bad" in " ".join(tried)
    found = preset_files.load(tmp_path / "trade" / "auto.toml").quality
    assert {key: getattr(scene.icymoon.quality, key) for key in found} == pytest.approx(found)
    bpy.data.scenes.remove(scene)


def test_a_dialog_that_is_closed_has_nothing_to_stop():
    JobOperator().cancel(None)  # as Blender calls it at Esc in the dialog, before any job


@pytest.mark.long
def test_this_machine_is_measured_by_a_button_and_shown(tmp_path, monkeypatch):
    import bpy

    monkeypatch.setenv(cache_folder.FOLDER_VARIABLE, str(tmp_path))
    sidebar_text.recall_known_speed.cache_clear()
    settings = description.defaults()
    assert "another machine" in sidebar_text.describe_speed(settings)
    assert bpy.ops.icymoon.measure_machine() == {"FINISHED"}
    found = machine_speed.recall_speed("CPU", bpy.app.version_string)
    # A renderer on this planet's processors is within a factor of 30 of the one that the estimates were made on.
    assert 1 / 30 < found.factor < 30
    assert "this machine" in sidebar_text.describe_speed(settings)
    sidebar_text.recall_known_speed.cache_clear()
