"""A pair that is exported in another layout and evaluated there gives the numbers of the pair itself."""

import numpy as np
import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.export.layouts import export
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.by_pixel_class import FACTORS
from icymoon.stereo.measure.metrics import COSTS
from icymoon.stereo.measure.row_metrics import NUMBERS

pytestmark = [pytest.mark.filterwarnings("error"), pytest.mark.usefixtures("undrawn")]

#: Half a step of a disparity, px, in each layout.
ROUNDING = {"kitti": 0.5 / 256, "png16": 0.5 / 256, "middlebury": 4e-6, "pfm": 4e-6}
#: Numbers that jump where an error crosses a bound.
SHARES = ("rate", "bad", "d1", "dod")
RIG, SCENE = pairs.camera(160, 96), pairs.Scene(sky_rows=10)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    pairs.write_pair(root / "pairs" / "one", SCENE, RIG)
    return root


@pytest.fixture(scope="module")
def predictions(tmp_path_factory):
    """A prediction, under the names of the pair in all layouts, with holes and with errors of up to 3 px."""
    folder = tmp_path_factory.mktemp("net")
    disparity = RIG.disparity(pairs.view(SCENE, RIG, "left")[0])
    disparity += 3 * np.sin(np.arange(RIG.width_px) / 9) * np.cos(np.arange(RIG.height_px) / 7)[:, None]
    disparity[40:50, 20:60] = np.nan
    for name in ("one", "000000_10"):
        np.save(folder / f"{name}.npy", disparity)
    return [f"net={folder}"]


@pytest.fixture
def measure(predictions, tmp_path):
    """The rows of bm, over one range, and of the prediction, and the facts of the only pair at a path."""

    def run(path):
        report = evaluate(
            [path], parse_methods("bm:disparities=64"), tmp_path / f"out_{path.name}", predictions=predictions
        )
        assert report["failed"] == []
        return list(report["rows"]), next(iter(report["pairs"]))

    return run


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("layout", ROUNDING)
def test_an_export_evaluates_as_the_pair_itself(dataset, tmp_path, measure, layout):
    assert export([dataset], layout, tmp_path / layout) == []
    (wanted, wanted_net), facts = measure(dataset)
    (row, net), _ = measure(tmp_path / layout)
    px = ROUNDING[layout]
    metres = px * facts["depth_m"][2] ** 2 / facts["focal_baseline_px_m"]
    # The layout pfm has the radiance, which no sensor has rounded, so bm is given another image there.
    for found, own in ((net, wanted_net), *(((row, wanted),) if layout != "pfm" else ())):
        for key in NUMBERS:
            if key in COSTS or own[key] is None or key.startswith(("guiss", "common")):
                continue
            visible = key.startswith("visible")  # of rounded disparities a few more or fewer pixels are hidden
            allowed = (
                2e-3
                if any(word in key for word in SHARES) or visible
                else px
                if key.endswith("_px")
                else metres
                if key.endswith("_m")
                else 1e-4
            )
            assert found[key] == pytest.approx(own[key], abs=allowed, rel=1e-3 if key.endswith("n") else 1e-6), key
        assert (found["true_pixels"], found["n"]) == (own["true_pixels"], own["n"])
    assert row["epe_px"] == pytest.approx(wanted["epe_px"], abs=0.02)
    assert row["coverage"] == pytest.approx(wanted["coverage"], abs=0.02)


def test_what_an_export_lacks_is_stated_once_and_not_counted(dataset, tmp_path):
    export([dataset], "kitti", tmp_path / "kitti")
    told = []
    report = evaluate([tmp_path / "kitti"], parse_methods("bm"), tmp_path / "out", on_event=told.append)
    assert "warning" not in [event["type"] for event in told]  # a fact makes no result doubtful
    (note,) = [event["message"] for event in told if event["type"] == "note"]
    assert "without normals, labels and the direction of the Sun there are no errors by slope" in note
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("the direction of the Sun") == 1
    assert '<section class="failed">' not in page
    assert "the direction of the Sun" in page[page.index('<section class="notes">') : page.index("<h2>Ranking</h2>")]
    assert "exposed" not in page
    assert "unknown" not in page
    strata = report["summary"][0]["strata"]
    for factor in FACTORS:
        total = sum(strata[factor.key]["true"])
        assert (total == 0) == (factor.key in ("slope", "shadow", "material", "deposits")), factor.key


def test_a_truth_that_fits_nothing_is_a_warning(dataset, tmp_path, monkeypatch):
    monkeypatch.setattr("icymoon.stereo.datasets.foreign_pair.check_truth", lambda *_: ["The map does not fit."])
    export([dataset], "kitti", tmp_path / "kitti")
    told = []
    report = evaluate([tmp_path / "kitti"], parse_methods("bm"), tmp_path / "out", on_event=told.append)
    assert [event["message"].rpartition(": ")[2] for event in told if event["type"] == "warning"] == [
        "The map does not fit."
    ]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    red = page[page.index('<section class="failed">') : page.index("</section>")]
    assert "The map does not fit." in red
    assert "the direction of the Sun" not in red
    assert report["pairs"][0]["warnings"] == ["The map does not fit."]


def test_a_foreign_pair_has_points_in_the_axes_of_its_camera(dataset, tmp_path):
    from icymoon.formats.ply import read_vertices

    export([dataset], "middlebury", tmp_path / "m")
    report = evaluate([tmp_path / "m"], parse_methods("bm"), tmp_path / "out", points=True)
    (row,) = report["rows"]
    points = read_vertices(tmp_path / "out" / row["images"]["points"])
    assert len(points) >= row["n"] > 0
    assert (points[:, 2] > 0).all()  # ahead
    depth = np.median(points[:, 2])
    assert depth == pytest.approx(next(iter(report["pairs"]))["depth_m"][1], rel=0.1)
