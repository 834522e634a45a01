"""What a released version has made is whole, goes on and is measured, whatever came after it."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace

import pytest
from icymoon.commands.cli import main
from icymoon.physics.camera.blur import describe_blur_identity
from icymoon.render.pairs.pair_folder import find_pairs
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.plan_file import read_plan
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.workers.verify_dataset import verify_data_set
from icymoon.settings import description
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.table import TOPICS
from icymoon.stereo.cli import main as stereo
from icymoon.support.errors import IcyMoonError
from olddata import DATA, OLD, copied, upgrade_all

pytestmark = pytest.mark.parametrize("old", OLD)


@pytest.fixture
def dataset(old, tmp_path):
    return copied(old, tmp_path)


def files(folder) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_it_is_whole(dataset, capsys):
    assert main(["verify", str(dataset)]) == 0
    assert "3 pairs, all whole and as planned." in capsys.readouterr().out


def test_its_plan_gives_the_same_pairs(old, dataset):
    plan = read_plan(DATA / old / "plan.toml")
    assert {pair.id for pair in plan.pairs()} == {pair.id for pair in datasets.read_frozen_plan(dataset).pairs}
    for pair in datasets.read_frozen_plan(dataset).pairs:
        assert make_pair_id(pair.settings, describe_blur_identity(pair.settings)) == pair.id


def test_batch_has_nothing_to_render(old, dataset):
    before = files(dataset)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "icymoon",
            "batch",
            str(DATA / old / "plan.toml"),
            "--out",
            str(dataset),
            "--blender",
            "/nowhere/blender",
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    after = files(dataset)
    assert before.keys() == after.keys()
    assert {name for name in before if before[name] != after[name]} <= {"manifest.json"}


def test_it_is_evaluated_exposed_and_exported(dataset, tmp_path):
    assert stereo(["evaluate", str(dataset), "--methods", "bm,sgbm", "--out", str(dataset / "evaluation")]) == 0
    report = json.loads((dataset / "evaluation" / "report.json").read_text())
    assert [row["status"] for row in report["rows"]].count("failed") == 0
    assert {row["pair"] for row in report["rows"]} == {pair.id for pair in find_pairs(dataset)}
    assert stereo(["develop", str(dataset), "--out", str(tmp_path / "images"), "--set", "sensor.gain=2"]) == 0
    assert len(list((tmp_path / "images").glob("*/left.png"))) == 3
    assert stereo(["export", str(dataset), "--out", str(tmp_path / "kitti"), "--format", "kitti"]) == 0
    assert list((tmp_path / "kitti").rglob("*.png"))


def test_settings_that_a_later_version_adds_change_nothing_of_it(old, dataset, monkeypatch):
    upgrade_all(monkeypatch)
    before = files(dataset)
    found = verify_data_set(dataset, remove_broken=True)
    assert (found.complete, found.problems) == (3, ())
    frozen = datasets.read_frozen_plan(dataset)
    assert frozen.find_missing(dataset) == []
    assert files(dataset) == before
    # What was not there does what was done then.
    for settings in (*(pair.settings for pair in frozen.pairs), *(pair.settings for pair in find_pairs(dataset))):
        assert not settings["quality"]["extra_pass"]
        assert (settings["rig"]["wobble_deg"], settings["sensor"]["hum_e"]) == (0.0, 0.0)
        assert all(layer["skew"] == 0.0 for layer in settings["terrain"]["layers"])
    assert any(pair.settings.terrain.layers for pair in frozen.pairs)


def test_its_plan_goes_on_as_it_was_planned_after_defaults_have_changed(old, dataset, monkeypatch):
    upgrade_all(monkeypatch)
    monkeypatch.setattr(datasets, "version", lambda: "9.0.0")
    light = TOPICS["light"]
    monkeypatch.setitem(
        TOPICS,
        "light",
        replace(
            light,
            settings=tuple(replace(s, default=25.0) if s.key == "sun_elevation_deg" else s for s in light.settings),
        ),
    )
    plan, before = read_plan(DATA / old / "plan.toml"), (dataset / datasets.PLAN).read_bytes()
    assert not {pair.id for pair in plan.pairs()} & {pair.id for pair in datasets.read_frozen_plan(dataset).pairs}
    frozen = datasets.freeze_plan(dataset, plan.pairs(), plan.text)
    assert frozen.find_missing(dataset) == []
    assert (dataset / datasets.PLAN).read_bytes() == before
    for words in (
        "light.sun_elevation_deg was 20.0 and is 25.0",
        "quality.extra_pass was false and is true",
        "as Icy Moon 0.1.0 planned it",
    ):
        assert words in frozen.note
    with pytest.raises(IcyMoonError, match=r"another data set.*sun_elevation_deg was 20\.0 and is 25\.0.*icymoon work"):
        datasets.freeze_plan(dataset, plan.pairs(), plan.text + "# mine")


def test_a_pair_that_is_whole_is_not_removed_whatever_is_said_of_it(old, dataset):
    """Its name, its seed, its settings, settings that nobody knows, a plan of something else."""
    pairs = datasets.read_frozen_plan(dataset).pairs
    for pair, change in zip(
        pairs, ({"id": "f" * 12}, {"seeds": {"render": 1}}, {"settings": {"quality": {"new": 1}}}), strict=True
    ):
        path = pair.folder(dataset) / "pair.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | change))
    before = files(dataset)
    found = verify_data_set(dataset, remove_broken=True)
    assert found.complete == 0
    assert {(problem.kind, problem.what) for problem in found.problems} == {("foreign", pair.id) for pair in pairs}
    assert files(dataset) == before
    (dataset / datasets.PLAN).unlink()
    datasets.freeze_plan(dataset, [PlannedPair("0" * 12, pairs[0].settings, 0.0)], "")
    verify_data_set(dataset, remove_broken=True)
    assert before.keys() - files(dataset).keys() == set()


def test_what_a_later_version_has_written_asks_for_an_update(old, dataset, capsys):
    path = dataset / datasets.PLAN
    header, *lines = path.read_text().splitlines()
    stated = json.loads(header)
    stated["settings"]["quality"]["new"] = True
    path.write_text("\n".join((json.dumps(stated | {"icymoon": "99.0.0"}), *lines)))
    assert main(["verify", str(dataset), "--remove"]) == 1
    assert "saved by Icy Moon 99.0.0" in capsys.readouterr().err
    pair = next((dataset / "pairs").iterdir())
    stated = json.loads((pair / "pair.json").read_text())
    stated["settings"]["new"] = {"key": 1}
    (pair / "pair.json").write_text(json.dumps(stated | {"versions": stated["versions"] | {"icymoon": "99.0.0"}}))
    with pytest.raises(IcyMoonError, match=r"pair\.json: was saved by Icy Moon 99\.0\.0.*update Icy Moon"):
        find_pairs(pair)


def test_what_is_accepted_no_more_can_still_be_measured_but_not_rendered_again(old, dataset, tmp_path):
    pair = find_pairs(dataset)[0]
    path = pair.folder / "pair.json"
    stated = json.loads(path.read_text())
    stated["settings"]["surface"]["albedo"] = 22.0
    stated["settings"]["dataset"]["methods"] = "external:command=sh -c evil"
    path.write_text(json.dumps(stated))
    read = find_pairs(pair.folder)[0]
    assert read.settings.surface.albedo == 22.0
    assert "evil" not in read.settings.dataset.methods
    assert stereo(["develop", str(pair.folder), "--out", str(tmp_path / "images")]) == 0
    with pytest.raises(IcyMoonError, match=r"surface\.albedo is 22"):
        description.check(read.settings, "Pair")
