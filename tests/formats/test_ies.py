"""IES files: their table, its flux and intensity against closed forms, symmetry, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats.ies import make_table, read_ies, write_for_cycles
from icymoon.support.errors import IcyMoonError


def write_ies(
    path: Path,
    vertical: list[float],
    horizontal: list[float],
    values: list[list[float]],
    kind: int = 1,
    head: str = "IESNA:LM-63-2002\n[TEST] a lamp\n",
    tilt: str = "NONE",
) -> Path:
    rows = [vertical, horizontal, *values]
    table = "\n".join(" ".join(map(str, row)) for row in rows)
    numbers = f"1 -1 1 {len(vertical)} {len(horizontal)} {kind} 2 0 0 0\n1 1 20"
    path.write_text(f"{head}TILT={tilt}\n{numbers}\n{table}\n")
    return path


def test_an_even_lamp_a_half_and_a_cosine_have_their_closed_flux(tmp_path):
    even = read_ies(write_ies(tmp_path / "a.ies", [0, 90, 180], [0], [[5, 5, 5]], head=""))
    assert even.flux == pytest.approx(5 * 4 * math.pi, rel=1e-12)
    assert even.find_intensity(33.0, 200.0) == pytest.approx(5)
    down = read_ies(write_ies(tmp_path / "b.ies", [0, 90], [0], [[2, 2]]))
    assert down.flux == pytest.approx(2 * 2 * math.pi, rel=1e-7)
    assert down.find_intensity(91.0, 0.0) == 0.0
    angles = np.arange(91.0)
    lambert = make_table(angles, np.zeros(1), np.cos(np.radians(angles))[None])
    assert lambert.flux == pytest.approx(math.pi, rel=3e-5)  # a chord of 1° is 2.5e-5 below the cosine
    toward = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(lambert.find_share(toward) * math.pi, [1.0, math.sqrt(0.5), 0.0], atol=5e-5)


def test_a_coarse_table_is_linear_between_its_angles_and_its_flux_is_its_integral():
    table = make_table(np.array([0.0, 45.0, 90.0]), np.array([0.0, 90.0, 180.0, 360.0]), np.arange(12.0).reshape(4, 3))
    assert table.find_intensity(15.0, 30.0) == pytest.approx(1 / 3 + 1.0)
    theta, phi = (np.arange(360) + 0.5) / 4, (np.arange(360) + 0.5)
    found = table.find_intensity(theta[:, None], phi[None])
    sum_of = (found * np.sin(np.radians(theta))[:, None]).sum() * np.radians(0.25) * np.radians(1.0)
    assert table.flux == pytest.approx(sum_of, rel=1e-5)


@pytest.mark.parametrize(
    ("horizontal", "same"),
    [
        ([0.0, 45.0, 90.0], [(30, 150), (30, 210), (30, 330)]),
        ([0.0, 90.0, 180.0], [(30, 330), (120, 240)]),
        ([90.0, 180.0, 270.0], [(30, 150), (300, 240)]),
    ],
)
def test_planes_that_a_file_leaves_out_follow_by_symmetry(horizontal, same):
    values = np.array([[1.0, 1.0], [3.0, 2.0], [8.0, 4.0]])
    table = make_table(np.array([0.0, 90.0]), np.array(horizontal), values)
    for one, other in same:
        assert table.find_intensity(60.0, one) == pytest.approx(float(table.find_intensity(60.0, other)))
    assert table.find_intensity(0.0, horizontal[1]) == pytest.approx(3.0)
    assert (table.horizontal_deg[0], table.horizontal_deg[-1]) == (0.0, 360.0)


def test_the_table_for_cycles_is_fine_and_keeps_the_flux(tmp_path):
    table = make_table(np.array([0.0, 45.0, 90.0]), np.zeros(1), np.array([[4.0, 1.0, 0.0]]))
    path = tmp_path / "fine.ies"
    path.write_text(write_for_cycles(table))
    fine = read_ies(path)
    assert np.diff(fine.vertical_deg).max() <= 1.0
    assert fine.flux * 0.0706650768394 == pytest.approx(4 * math.pi, rel=1e-3)
    np.testing.assert_allclose(
        fine.find_intensity(np.linspace(0, 89, 100), 0.0) / fine.flux,
        table.find_intensity(np.linspace(0, 89, 100), 0.0) / table.flux,
        rtol=1e-3,
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"kind": 2}, "photometry of type B"),
        ({"kind": 3}, "photometry of type A"),
        ({"tilt": "INCLUDE"}, "depends on the tilt"),
        ({"vertical": [0, 60]}, "do not go from 0° or 90° to 90° or 180°"),
        ({"vertical": [90, 0]}, "do not increase"),
        ({"horizontal": [5]}, "horizontal angles do not go from 0°"),
        ({"values": [[0, 0]]}, "intensities are not positive"),
        ({"values": [[-1, 2]]}, "intensities are not positive"),
        ({"values": [["nan", 2]]}, "'nan' is not a number"),
        ({"values": [["x", 2]]}, "could not convert"),
        ({"values": [[1]]}, "it has 17 numbers"[:10]),
    ],
)
def test_files_that_no_lamp_has_are_one_sentence(tmp_path, change, told):
    given = {"vertical": [0, 90], "horizontal": [0], "values": [[1, 1]]} | change
    with pytest.raises(IcyMoonError) as error:
        read_ies(write_ies(tmp_path / "wrong.ies", **given))
    assert told in str(error.value)
    assert str(error.value).count("\n") == 0


@pytest.mark.parametrize("text", ["", "TILT=NONE", "no IES file", "TILT=NONE\n1 -1 1 9e9 9e9 1 2 0 0 0 1 1 1"])
def test_broken_files_are_one_sentence(tmp_path, text):
    (tmp_path / "wrong.ies").write_text(text)
    with pytest.raises(IcyMoonError, match="export it as LM-63"):
        read_ies(tmp_path / "wrong.ies")
