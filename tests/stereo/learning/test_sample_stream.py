"""Made pairs for PyTorch: workers share the grounds, and no sample depends on them."""

from __future__ import annotations

from itertools import islice
from types import SimpleNamespace

import pytest
from icymoon.stereo import torch_data
from icymoon.stereo.learning import sample_stream
from icymoon.stereo.learning.made_pairs import MadePairs


@pytest.mark.parametrize(("worker", "expected"), [(None, [0, 1, 2, 3]), ((1, 3), [1, 4, 7, 10])])
def test_workers_share_the_grounds(monkeypatch, worker, expected):
    monkeypatch.setattr(MadePairs, "list_ground", lambda self, number: iter([{"pair": number}]))
    info = worker and SimpleNamespace(id=worker[0], num_workers=worker[1])
    monkeypatch.setattr(sample_stream, "get_worker_info", lambda: info)
    stream = torch_data.stream_made_pairs("sun")
    assert [each["pair"] for each in islice(stream, 4)] == expected
