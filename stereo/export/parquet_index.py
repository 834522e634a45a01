"""The export ``parquet-index``: a table of the pairs' places, splits, conditions and calibrations.

The package pyarrow writes it. No image is copied: a row leads to the folder of its pair.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from ...render.pairs.scene_splits import find_split_of_pair
from ...settings.table import list_all_settings
from ...settings.topics.scene import Settings
from ...support.files import write_atomically
from ..measure.prepare_pair import LoadedPair
from .losses import Each
from .training import describe_row

TITLES = {"parquet-index": "Parquet Index: a table of the pairs and their conditions, for training"}
INDEX = "index.parquet"


def check() -> str:
    """Return the reason why no table can be written here; empty if it can."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError as error:
        return f'The export parquet-index needs the package pyarrow ({error}); pip install "icymoon[parquet]".'
    return ""


def write_all(each: Each, out: Path) -> None:
    """Write ``index.parquet``.

    Its columns are those in ``index.csv`` of the other exports, ``folder`` (the pair's path, relative to the index),
    the principal point, and as ``topic.key`` each setting that differs between the pairs.
    """
    import pyarrow
    from pyarrow import parquet

    rows: list[dict[str, Any]] = []
    described: list[Settings] = []

    def add(pair: LoadedPair) -> None:
        folder = os.path.relpath(pair.pair.folder.resolve(), out.resolve())
        camera = pair.pair.camera
        rows.append(
            {
                **describe_row(pair, find_split_of_pair(pair.pair)),
                "folder": Path(folder).as_posix(),
                "cx_px": camera.cx_px,
                "cy_px": camera.cy_px,
                "doffs_px": camera.doffs_px,
            }
        )
        described.append(pair.pair.settings)

    each(add)
    varied = [
        (topic, s.key)
        for topic, s in list_all_settings()
        if any(settings[topic][s.key] != described[0][topic][s.key] for settings in described)
    ]
    for row, settings in zip(rows, described, strict=True):
        row.update({f"{topic}.{key}": _to_column_value(settings[topic][key]) for topic, key in varied})
    table = pyarrow.Table.from_pylist(rows)
    write_atomically(out / INDEX, lambda part: parquet.write_table(table, part))


def _to_column_value(value: object) -> object:
    """Convert a value to the type of a column; lists and tables become text."""
    return json.dumps(value) if isinstance(value, list | dict) else value
