"""Dask's workers measure what one process does."""

import pairs
import pytest
from icymoon.stereo.evaluate import evaluate
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.stereo.measure.metrics import COSTS
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    pytest.importorskip("distributed", reason="Dask is not installed; pip install icymoon[scale]")
    root = tmp_path_factory.mktemp("set")
    for name in "abcde":
        pairs.write_pair(root / "pairs" / name, rig=pairs.camera(96, 48))
    return root


def timeless(report):
    return [{**row, **dict.fromkeys(COSTS)} for row in report["rows"]]


@pytest.mark.slow
def test_workers_of_a_cluster_give_what_one_process_gives(dataset, tmp_path, monkeypatch):
    (dataset / "pairs" / "c" / "left.exr").write_bytes(b"no image")
    monkeypatch.chdir(tmp_path)
    methods, events = parse_methods("bm,sgbm"), []
    one = evaluate([dataset], methods, tmp_path / "one", jobs=1)
    many = evaluate([dataset], methods, tmp_path / "many", on_event=events.append, dask="local:2")
    assert timeless(many) == timeless(one)
    assert many["failed"] == one["failed"]
    assert [event["done"] for event in events if event["type"] == "progress"] == list(range(1, 11))
    for path in (tmp_path / "one" / "pairs").rglob("*.png"):
        assert path.read_bytes() == (tmp_path / "many" / path.relative_to(tmp_path / "one")).read_bytes()


def test_an_address_that_is_none_is_a_sentence(dataset, tmp_path):
    with pytest.raises(IcyMoonError, match="--dask"):
        evaluate([dataset], parse_methods("bm"), tmp_path, dask="local:none")
