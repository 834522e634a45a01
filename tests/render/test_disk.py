"""What a pair takes on the disk is what was expected, and the disk is asked for no more."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from icymoon.render import render_pair
from icymoon.render.cost import estimate
from icymoon.render.plans.planned_pair import expand_headings
from icymoon.support.errors import IcyMoonError
from marks import heavy_but
from rendering import complete, render

VIEW = {"rig": {"width_px": 160, "height_px": 120}, "quality": {"samples": 16}, "mesh": {"kind": "GRADED"}}
FULL = {"quality": {"files": "FULL"}}
PLANET = {"light": {"planet": True, "planet_elevation_deg": 40.0}}


@pytest.mark.long
@pytest.mark.parametrize(
    "change",
    heavy_but(
        [{}, FULL, PLANET, {"rig": {"pitch_deg": 10.0}}],
        [
            {},
            FULL,
            PLANET,
            {"quality": {"denoiser": "OIDN"}},
            {"quality": {"truth": "DEPTH"}},
            {"rig": {"toe_in_deg": 1.0, "overscan": 0.1}},
            {"rig": {"pitch_deg": 10.0}},
        ],
        [{"quality": {"denoiser": "OIDN"}}, {"quality": {"truth": "DEPTH"}}],
    ),
    ids=["as it is", "full", "planet", "denoised", "depth alone", "toed in, overscan", "sky above"],
)
def test_a_pair_takes_what_is_expected_within_a_tenth(registered, tmp_path: Path, change):
    """The tenth is what the manual promises; how far each pass varies over scenes stands in the study ``disk``."""
    pair, _ = render(tmp_path, VIEW, change)
    found = sum(fact["bytes"] for fact in pair.data["files"].values())
    assert estimate.estimate_bytes(pair.settings) == pytest.approx(found, rel=0.1)
    assert found == sum(file.stat().st_size for file in pair.folder.glob("*.exr"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "least"), [({}, 0.1), ({**PLANET, "quality": {"denoiser": "OIDN", "truth_by": "CYCLES"}}, 0.4)]
)
def test_blenders_own_files_take_no_more_than_there_is_room_for(registered, tmp_path: Path, monkeypatch, change, least):
    sizes: list[int] = []
    read = render_pair._read_layers

    def weigh(written, *rest):
        sizes.extend(file.stat().st_size for file in written.values())
        return read(written, *rest)

    monkeypatch.setattr(render_pair, "_read_layers", weigh)
    pair, _ = render(tmp_path, VIEW, change)
    room = render_pair._TEMPORARY_BYTES_PER_PIXEL * estimate.count_pixels(pair.settings)
    assert least * room < sum(sizes) < room


def test_a_disk_that_holds_the_pairs_is_not_refused(tmp_path: Path, monkeypatch):
    pairs = expand_headings(complete(VIEW, {"dataset": {"headings": 20}}))
    expected = estimate.estimate_remaining_bytes(pairs, tmp_path)
    room = render_pair._TEMPORARY_BYTES_PER_PIXEL * estimate.count_pixels(pairs[0].settings)
    for free, fits in ((1.01 * expected + room, True), (0.99 * expected + room, False)):
        monkeypatch.setattr(render_pair.shutil, "disk_usage", lambda path, free=free: SimpleNamespace(free=free))
        if fits:
            render_pair.check_space(tmp_path, pairs)
        else:
            with pytest.raises(IcyMoonError, match=r"20 pairs may need \d+ MB more"):
                render_pair.check_space(tmp_path, pairs)
