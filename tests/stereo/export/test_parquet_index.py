"""A table of pairs, read back by pyarrow: where they are, their split, and what varies."""

from __future__ import annotations

import sys
from pathlib import Path

import pairs
import pytest
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.render.pairs.scene_splits import find_split_of_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo.export.layouts import export
from icymoon.support.errors import IcyMoonError


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    root = tmp_path_factory.mktemp("set")
    for k in range(4):
        settings = merged(defaults(), {"dataset": {"seed": k}, "light": {"sun_elevation_deg": 10.0 + 20 * (k % 2)}})
        pairs.write_pair(root / "pairs" / f"{k:012x}", pairs.Scene(), pairs.camera(64, 48), settings=settings)
    return root


def test_rows_lead_to_the_pairs_and_can_be_chosen_by_what_varies(dataset, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pip install icymoon[parquet]")
    assert not export([dataset], "parquet-index", tmp_path / "index")
    file = tmp_path / "index" / "index.parquet"
    low = parquet.read_table(file, filters=[("light.sun_elevation_deg", "<", 20.0)]).to_pylist()
    assert len(low) == 2
    for row in low:
        pair = read_pair(tmp_path / "index" / row["folder"])
        assert (pair.id, pair.settings.light.sun_elevation_deg) == (row["key"], 10.0)
        assert (row["split"], row["focal_px"], row["cx_px"]) == (
            find_split_of_pair(pair),
            pair.camera.focal_px,
            pair.camera.cx_px,
        )
    columns = parquet.read_schema(file).names
    assert {"dataset.seed", "light.sun_elevation_deg"} == {name for name in columns if "." in name}
    assert not Path(low[0]["folder"]).is_absolute()


def test_without_pyarrow_it_is_a_sentence(dataset, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(IcyMoonError, match=r'pip install "icymoon\[parquet\]"'):
        export([dataset], "parquet-index", tmp_path / "index")
    assert not (tmp_path / "index").exists()
