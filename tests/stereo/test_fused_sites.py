"""Sites under several Suns: which pairs are one site, what is joined, and what a calibration of them holds for."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.stereo import decide
from icymoon.stereo.decide import TRUE_DEPTH, count_suns, decide_pairs
from icymoon.stereo.decisions.calibrated_run import CalibrationOrder
from icymoon.stereo.decisions.rules import read_rules
from icymoon.stereo.evaluated_pairs import RenderedPair, find_sources
from icymoon.stereo.fused_sites import FusedSite, find_fused_sites, list_pairs
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError
from workspaces import write_under_sun as write

pytestmark = pytest.mark.filterwarnings("error")
#: The settings of a sensor whose images of one scene are equal to the last digit.
QUIET = {"read_noise_e": 0.0, "prnu": 0.0, "dsnu_e": 0.0, "full_well_e": 1e7}


def run(paths, out, methods="bm", **options):
    return decide_pairs(paths, parse_methods(methods), out, read_rules(), **options)


def strip(row):
    """A row's numbers without its processor seconds."""
    return {key: value for key, value in row["numbers"].items() if key != "cpu_s"}


@pytest.fixture
def suns(tmp_path):
    """Two pairs of a site, under Suns 90 degrees apart."""
    return [write(tmp_path / "set" / "pairs" / name, azimuth, noise=0.05) for name, azimuth in (("a", 0), ("b", 90))]


def test_a_site_has_one_row_which_states_its_suns(suns, tmp_path):
    report = run(suns, tmp_path / "out", fuse_suns=True)
    assert [(row["pair"], row["method"], row["suns"]) for row in report["rows"]] == [
        ("b", TRUE_DEPTH, 2),
        ("b", "bm", 2),
    ]
    assert report["summary"][1]["pairs"] == 1
    assert report["provenance"]["fuse_suns"] is True
    assert any("joined disparities of its pairs under 2 Suns" in note for note in report["notes"])
    assert "under 2 Suns, the last at 60°" in report["head"][0]
    with (tmp_path / "out" / "decisions.csv").open(encoding="utf-8", newline="") as stream:
        assert [line["suns"] for line in csv.DictReader(stream)] == ["2", "2"]
    facts = json.loads((tmp_path / "out" / "pairs" / "b" / "decisions.json").read_text())
    assert [fact["pair"] for fact in facts["suns"]] == ["a", "b"]
    page = (tmp_path / "out" / "decisions.html").read_text(encoding="utf-8")
    assert "2 Suns, at 60°, 60°" in page


def test_the_page_counts_sites_where_suns_are_fused_and_pairs_elsewhere(suns, tmp_path):
    for name, fused, count, other in (("fused", True, "1 site", "pair"), ("alone", False, "2 pairs", "site")):
        report = run(suns, tmp_path / name, fuse_suns=fused)
        page = (tmp_path / name / "decisions.html").read_text(encoding="utf-8")
        unit = count.split()[1].rstrip("s")
        assert f"<small>{count}, 1 scene</small>" in page
        assert f"{count} ·" in page
        assert f"Means over {unit}s" in page
        assert f"Means over {other}s" not in page
        assert f" of {count}, an unsafe one in " in report["head"][0]


def test_a_site_states_the_noise_of_each_of_its_pairs(suns, tmp_path):
    run(suns, tmp_path / "fused", fuse_suns=True)
    run(suns, tmp_path / "alone")
    fused, *alone = (
        json.loads((tmp_path / out / "pairs" / pair / "decisions.json").read_text())
        for out, pair in (("fused", "b"), ("alone", "a"), ("alone", "b"))
    )
    assert [fact["noise"] for fact in fused["suns"]] == [fact["noise"] for fact in alone]
    assert alone[0]["noise"]["lit"] != alone[1]["noise"]["lit"]  # so that they cannot be mixed up
    assert "noise" not in fused


def test_a_run_that_joins_nothing_stays_as_it_is(suns, tmp_path):
    report = run(suns, tmp_path / "out")
    assert [row["pair"] for row in report["rows"]] == ["a", "a", "b", "b"]
    assert not any("suns" in row for row in report["rows"])
    assert "fuse_suns" not in report["provenance"]
    assert "with the Sun at 60°" in report["head"][0]
    assert "suns" not in json.loads((tmp_path / "out" / "pairs" / "b" / "decisions.json").read_text())


def test_equal_images_decide_as_one_of_them_does(tmp_path):
    """The mean of two equal numbers is exact."""
    first = write(tmp_path / "set" / "pairs" / "a", 0, {"sensor": QUIET})
    last = write(tmp_path / "set" / "pairs" / "b", 90, {"sensor": QUIET}, id_of=first)
    joined = run([first, last], tmp_path / "joined", fuse_suns=True)
    alone = run([last], tmp_path / "alone")
    assert [strip(row) for row in joined["rows"]] == [strip(row) for row in alone["rows"]]


def test_the_order_of_paths_does_not_matter(suns, tmp_path):
    found = [run(own, tmp_path / name, fuse_suns=True) for name, own in (("one", suns), ("other", suns[::-1]))]
    assert [strip(row) for row in found[0]["rows"]] == [strip(row) for row in found[1]["rows"]]


def test_noise_of_two_images_is_less_than_of_one(tmp_path):
    folders = [
        write(tmp_path / "set" / "pairs" / name, 90 * k, {"sensor": {"read_noise_e": 400.0}})
        for k, name in enumerate("abcd")
    ]
    joined = run(folders, tmp_path / "joined", "sgbm", fuse_suns=True)["rows"][1]["numbers"]["dem"]["nmad_m"]
    alone = run(folders, tmp_path / "alone", "sgbm")["summary"][1]["dem.nmad_m"]
    assert joined < 0.8 * alone  # half of it, if errors were independent and none was a false match


def test_a_second_start_takes_the_rows_of_the_first_and_other_suns_are_other_rows(suns, tmp_path, monkeypatch):
    run(suns, tmp_path / "out", fuse_suns=True)
    matched = []
    kept = decide._match_pair

    def match(prepared, *rest):
        matched.append(prepared.pair.name)
        return kept(prepared, *rest)

    monkeypatch.setattr(decide, "_match_pair", match)
    run(suns, tmp_path / "out", fuse_suns=True)
    assert matched == []
    third = write(tmp_path / "set" / "pairs" / "0", 200, noise=0.05)
    run([*suns, third], tmp_path / "out", fuse_suns=True)
    assert sorted(matched) == ["0", "a", "b"]


def test_the_latest_date_is_the_last_sun(tmp_path):
    dated = {"directions_from": "DATE", "body": "EUROPA"}
    for name, azimuth, date in (("a", 0, "2038-06-03"), ("b", 90, "2038-06-01"), ("c", 180, "2038-06-02T23:00:00")):
        write(tmp_path / "set" / "pairs" / name, azimuth, {"light": {**dated, "date_utc": date}})
    (site,) = find_fused_sites(find_sources([tmp_path / "set"]))
    assert [pair.name for pair in list_pairs(site)] == ["b", "c", "a"]
    assert site.name == "a"


@pytest.mark.parametrize(
    "changes",
    [
        {"rocks": {"coverage": 0.01}},
        {"quality": {"samples": 7}},
        {"dataset": {"seed": 9}},
        {"sensor": {"read_noise_e": 9.0}},
    ],
)
def test_another_camera_or_ground_is_another_site(suns, changes, tmp_path):
    other = write(tmp_path / "set" / "pairs" / "c", 180, changes)
    said = (
        r"No other pair has the site, the camera and the pose of .*c; give pairs of it .*or decide without fusing Suns"
    )
    with pytest.raises(IcyMoonError, match=said):
        run([*suns, other], tmp_path / "out", fuse_suns=True)
    assert not (tmp_path / "out").exists()


def test_a_camera_that_moved_is_another_site(suns, tmp_path):
    """Its height is over the ground, so equal settings do not make equal poses."""
    data = json.loads((suns[1] / "pair.json").read_text())
    for eye in ("left", "right"):
        data["poses_camera_to_world"][eye][2][3] += 0.001
    (suns[1] / "pair.json").write_text(json.dumps(data))
    read_pair(suns[1])
    with pytest.raises(IcyMoonError, match="No other pair has the site"):
        find_fused_sites(find_sources(suns))


def test_exposures_and_seeds_of_noise_may_differ(suns, tmp_path):
    other = {"sensor": {"noise_seed": 5, "auto_exposure": False, "exposure_s": 0.01}}
    third = write(tmp_path / "set" / "pairs" / "c", 180, other)
    (site,) = find_fused_sites(find_sources([*suns, third]))
    assert len(list_pairs(site)) == 3


def test_two_pairs_under_one_sun_are_refused(suns, tmp_path):
    same = write(tmp_path / "set" / "pairs" / "c", 90)
    with pytest.raises(IcyMoonError, match=r"b and .*c are of one site under one Sun; leave one"):
        run([*suns, same], tmp_path / "out", fuse_suns=True)


def test_a_pair_that_is_damaged_fails_its_site(suns, tmp_path):
    (suns[0] / "left.exr").write_bytes(b"damaged")
    report = run(suns, tmp_path / "out", fuse_suns=True)
    assert [(row["pair"], row["status"]) for row in report["rows"]] == [("b", "failed"), ("b", "failed")]
    assert "left.exr" in report["failed"][0]["message"]


def test_a_site_whose_other_pair_cannot_be_read_names_it(suns, tmp_path):
    """The pair that is whole is not at fault."""
    (suns[1] / "pair.json").write_text("{")
    with pytest.raises(IcyMoonError, match=r"pose of .*a, and .*b cannot be read; render that one again, give pairs"):
        run(suns, tmp_path / "out", fuse_suns=True)
    with pytest.raises(IcyMoonError, match=r"No other pair has .* of .*a; give pairs of it under other Suns"):
        run(suns[:1], tmp_path / "out", fuse_suns=True)
    assert not (tmp_path / "out").exists()


def test_a_site_is_suspect_if_one_of_its_pairs_is(suns, tmp_path, monkeypatch):
    describe = decide._describe_sun
    monkeypatch.setattr(decide, "_describe_sun", lambda prepared: describe(prepared) | {"suspect": True})
    assert {row["status"] for row in run(suns, tmp_path / "out", fuse_suns=True)["rows"]} == {"suspect"}


def test_a_calibration_takes_one_number_of_suns(suns, tmp_path):
    one, two = FusedSite((RenderedPair(suns[0]),)), FusedSite(tuple(map(RenderedPair, suns)))
    assert count_suns([two, two]) == 2
    with pytest.raises(IcyMoonError, match="site a has 1, site b has 2; give as many"):
        count_suns([one, two])
    with pytest.raises(IcyMoonError, match="1 ground cannot guarantee"):
        run(suns, tmp_path / "out", fuse_suns=True, calibrate=CalibrationOrder(tmp_path / "c.json"))


def test_disparities_of_suns_are_joined_before_they_are_heights(suns, tmp_path, monkeypatch):
    """Of one pair 8 px, and of the other 8.5 px: the depth is that of 8.25 px."""
    monkeypatch.setattr(
        decide,
        "_match_pair",
        lambda prepared, *_: (np.full(prepared.truth.shape, 8.0 if prepared.pair.name == "a" else 8.5), 1.0),
    )
    report = run(suns, tmp_path / "out", fuse_suns=True)
    (row,) = [row for row in report["rows"] if row["method"] == "bm"]
    height = np.load(tmp_path / "out" / row["images"]["dem"])
    camera = decide.find_sources(suns)[0].prepare({}).pair.camera
    expected = 2.0 - camera.focal_baseline_px_m / 8.25
    np.testing.assert_allclose(height[np.isfinite(height)], expected, atol=1e-4)
    assert row["numbers"]["cpu_s"]["match"] == 2.0
