"""Cutting along lines: closed, unfolded, straight; and the crests of penitentes, without teeth."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.physics.mesh.cut_along_lines import cut_along_lines
from icymoon.physics.mesh.graded_mesh import grade_ground
from icymoon.physics.mesh.vertex_rings import VertexRings
from icymoon.physics.terrain.terrain import make_terrain
from icymoon.settings.description import defaults, merged

STEP = 0.05


def _disc():
    """Places, triangles and steps of rings 5 cm apart, to 2 m."""
    radii = np.arange(1, 41) * STEP
    rings = VertexRings.of(radii, np.full(len(radii), STEP))
    return np.stack(rings.map_positions(), axis=1), rings.faces(), np.full(rings.vertices, STEP)


def _areas(places, faces):
    a, b, c = (places[faces[:, k], :2] for k in range(3))
    return _cross(b - a, c - a) / 2


def _cross(a, b):
    """The third component of a cross product; numpy 2 has none of vectors in a plane."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _edge_counts(faces):
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


LINES = {
    "straight": lambda x, y: 0.6 * x - 0.8 * y + 0.013,
    "circle": lambda x, y: np.hypot(x, y) - 0.777,
    "waves": lambda x, y: y - 0.3 * np.sin(3.0 * x) - 0.2,
    # Jumps half way between lines 1 m apart.
    "rows": lambda x, y: (x + 0.1 * y + 0.37) - np.floor(x + 0.1 * y + 0.37 + 0.5),
}


@pytest.mark.parametrize("name", LINES)
def test_the_mesh_stays_closed_and_unfolded_and_follows_the_line(name):
    places, faces, step = _disc()
    cut = cut_along_lines(places, faces, step, LINES[name], 1.0)
    area = _areas(cut.places, cut.faces)
    assert (area > 0).all()
    # Only vertices of the rim that were moved change the outline.
    assert area.sum() == pytest.approx(_areas(places, faces).sum(), rel=2e-3)
    before, after = _edge_counts(faces), _edge_counts(cut.faces)
    assert after.max() == 2
    assert (after == 1).sum() - (before == 1).sum() <= 8  # where lines meet the rim
    # On the line to a thousandth of a step, moved by less than half of one, and no edge crosses it any more.
    line = LINES[name]
    assert np.abs(line(*cut.places[cut.on_line].T)).max() < 1e-3 * STEP
    assert np.hypot(*(cut.places[: len(places)] - places).T).max() < 0.5 * STEP
    assert cut.places[0].tolist() == [0, 0]
    value = line(*cut.places.T)
    value[cut.on_line] = 0.0
    ends = value[cut.faces]
    crossing = (ends.min(axis=1) < -1e-9) & (ends.max(axis=1) > 1e-9) & (np.ptp(ends, axis=1) < 0.4)
    assert not crossing.any()
    # The sharp edges are as long as the line.
    sharp = cut.places[cut.find_sharp_edges()]
    length = np.linalg.norm(sharp[:, 0] - sharp[:, 1], axis=1).sum()
    expected = {"straight": 4.0, "circle": 2 * np.pi * 0.777}.get(name)
    assert len(sharp) > 30
    assert expected is None or length == pytest.approx(expected, rel=0.02)


def test_triangles_that_are_too_coarse_stay_whole():
    places, faces, step = _disc()
    cut = cut_along_lines(places, faces, step, LINES["straight"], 0.1)
    assert cut.places is places
    assert cut.faces is faces
    assert not cut.on_line.any()


def _penitentes(crests, disorder):
    settings = merged(
        defaults(),
        {
            "terrain": {"rms_slope_deg": 0.0},
            "penitentes": {"height_m": 2.0, "spacing_m": 1.1, "lean_deg": 8.0, "disorder": disorder},
            "mesh": {"crests": crests, "error_px": 4.0, "farthest_m": 40.0, "most": 60_000},
            "rig": {"width_px": 160, "height_px": 120},
        },
    )
    ground = make_terrain(settings, 1)
    return ground, grade_ground(ground, settings)


def _low_m(ground, positions, faces):
    """How low the mesh is under the unrounded crests within 4 m of the site, at points along them."""
    crests = ground.landforms[0].crests
    x = np.repeat(np.linspace(-3.0, 3.0, 61), 600)
    y = np.tile(np.linspace(-3.0, 3.0, 600), 61)
    across = crests.lines[0](x, y).reshape(61, 600)
    k, j = np.nonzero((across[:, :-1] * across[:, 1:] < 0) & (np.abs(np.diff(across, axis=1)) < 0.1))
    share = across[k, j] / (across[k, j] - across[k, j + 1])
    x = x.reshape(61, 600)[k, j]
    y = y.reshape(61, 600)[k, j] + share * 6.0 / 599
    made = _interpolated(positions, faces, x, y)
    return ground.with_sharp_crests().heights(x, y, 0.0) - made


def _interpolated(positions, faces, x, y):
    """Heights of a mesh at places, by the triangle that each is in."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    near = np.hypot(*(a[:, :2]).T) < 6.0
    a, b, c = a[near], b[near], c[near]
    whole = _cross(b[:, :2] - a[:, :2], c[:, :2] - a[:, :2])
    heights = []
    for place in np.stack([x, y], axis=1):
        v = _cross(place - a[:, :2], c[:, :2] - a[:, :2]) / whole
        w = _cross(b[:, :2] - a[:, :2], place - a[:, :2]) / whole
        best = np.argmax(np.minimum(np.minimum(v, w), 1 - v - w))
        heights.append(a[best, 2] + v[best] * (b[best, 2] - a[best, 2]) + w[best] * (c[best, 2] - a[best, 2]))
    return np.array(heights)


@pytest.mark.parametrize("disorder", [0.0, 0.8])
def test_the_crests_of_penitentes_have_no_teeth(disorder):
    """Along a crest the mesh is as high as the law: what is left is what its edges leave of blades' own points."""
    low = {}
    for crests in ("ROUNDED", "CUT"):
        ground, graded = _penitentes(crests, disorder)
        positions, faces, sharp = graded.mesh()
        assert (len(sharp) > 0) == (crests == "CUT")
        assert _edge_counts(faces).max() == 2
        assert (_areas(positions, faces) > 0).all()
        low[crests] = _low_m(ground, positions, faces)
    assert np.median(low["CUT"]) < 0.1 * np.median(low["ROUNDED"])
    assert np.quantile(np.abs(low["CUT"]), 0.9) < 0.3 * np.quantile(low["ROUNDED"], 0.9)


@pytest.mark.long
@pytest.mark.parametrize("sets", [1, 3])
def test_the_crests_and_troughs_of_ridges_are_edges_of_the_mesh(sets):
    low = {}
    for crests in ("ROUNDED", "CUT"):
        settings = merged(
            defaults(),
            {
                "terrain": {"rms_slope_deg": 0.0},
                "mesh": {"crests": crests, "error_px": 1.0, "edge_px": 3.0, "farthest_m": 12.0, "most": 60_000},
                "ridges": {"height_m": 1.0, "width_m": 6.0, "spacing_m": 7.5, "sets": sets},
                "rig": {"width_px": 160, "height_px": 120},
            },
        )
        ground = make_terrain(settings, 1)
        positions, faces, sharp = grade_ground(ground, settings).mesh()
        assert (len(sharp) > 0) == (crests == "CUT")
        assert _edge_counts(faces).max() == 2
        assert (_areas(positions, faces) > 0).all()
        low[crests] = np.abs(_low_m(ground, positions, faces))
    # Where sets cross, the edges of a younger one cut those of an older one, whose vertices are then on neither line.
    assert np.quantile(low["CUT"], 0.8) < 0.2 * np.quantile(low["ROUNDED"], 0.8)


@pytest.mark.parametrize("penitentes", [{}, {"height_m": 2.0, "sharpness": 0.0}])
def test_ground_without_sharp_crests_is_not_cut(penitentes):
    settings = merged(
        defaults(), {"mesh": {"crests": "CUT", "error_px": 4.0, "most": 20_000}, "penitentes": penitentes}
    )
    assert not grade_ground(make_terrain(settings, 1), settings).cuts_crests
