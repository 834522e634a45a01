"""A job file states what its pairs share once, and loses nothing of it."""

from __future__ import annotations

import json

import pytest
from icymoon.render.plans.planned_pair import PlannedPair
from icymoon.render.workers.job_commands import Job, read_job, read_planned_pairs
from icymoon.settings import description
from icymoon.settings.pair_ids import make_pair_id
from icymoon.settings.topics.scene import Settings, typed
from plans import grid, planned


def written(tmp_path, pairs) -> tuple[dict, list[PlannedPair]]:
    """The content of a job file with these pairs, and the pairs that a worker reads from it."""
    job = Job(tmp_path, pairs=pairs)
    read = read_job(job.file)
    content = json.loads(job.file.read_text())
    job.discard()
    return content, read_planned_pairs(read)


def test_pairs_state_only_what_they_do_not_share(tmp_path):
    pairs = grid()
    content, read = written(tmp_path, pairs)
    assert read == pairs
    assert {topic: set(table) for pair in content["pairs"] for topic, table in pair["settings"].items()} == {
        "dataset": {"seed"},
        "light": {"sun_elevation_deg"},
        "rig": {"heading_deg"},
    }
    assert len(json.dumps(content["pairs"])) < len(json.dumps(pairs[0].settings))


@pytest.mark.parametrize("count", [1, 2])
def test_pairs_that_are_alike_share_all(tmp_path, count):
    content, read = written(tmp_path, count * [planned()])
    assert read == count * [planned()]
    assert [pair["settings"] for pair in content["pairs"]] == count * [{}]


def test_minus_zero_is_not_shared(tmp_path):
    pairs = [planned({"rig": {"heading_deg": value}}) for value in (0.0, -0.0)]
    assert [make_pair_id(pair.settings) for pair in written(tmp_path, pairs)[1]] == [pair.id for pair in pairs]


@pytest.mark.parametrize("first", [True, False])
def test_what_only_one_pair_has_stays_its_own(tmp_path, first):
    """As the table of a landform that is not installed here."""
    plain = planned()
    more = Settings(plain.settings) | typed({"landform_of_others": {"count": 3.0, "made_by": "others 1.0"}})
    pairs = [plain, PlannedPair("0" * 12, more, 0.0)]
    pairs = pairs[::-1] if first else pairs
    assert [pair.settings for pair in written(tmp_path, pairs)[1]] == [pair.settings for pair in pairs]


def test_each_table_of_a_job_is_checked_once(tmp_path, monkeypatch):
    checked: list[str] = []
    check_table = description._check_table
    monkeypatch.setattr(
        description,
        "_check_table",
        lambda topic, *rest, **named: checked.append(topic) or check_table(topic, *rest, **named),
    )
    pairs = grid(headings=tuple(map(float, range(8))))
    checked.clear()
    written(tmp_path, pairs)
    assert (checked.count("terrain"), checked.count("rig"), checked.count("light")) == (1, 8, 2)
