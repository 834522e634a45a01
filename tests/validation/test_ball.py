"""The mesh of the ball, and what a ball shows of a law in Cycles."""

from __future__ import annotations

import numpy as np
import pytest
from icymoon.formats.ply import read_vertices, write_triangles
from icymoon.physics.surfaces import photometry
from icymoon.settings.description import check, defaults, merged
from icymoon.validation.ball import make_ball_mesh, render_ball
from icymoon.validation.comparison import Bench


def test_the_ball_is_closed_outward_and_round(tmp_path):
    vertices, faces = make_ball_mesh(24)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.allclose(np.linalg.norm(vertices, axis=1), 1.0)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    volume = np.einsum("ij,ij->", np.cross(a, b), c) / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.01)  # chords of 7.5 degrees lose 0.9 %
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    write_triangles(tmp_path / "ball.ply", vertices, faces, vertices)
    assert np.allclose(read_vertices(tmp_path / "ball.ply"), vertices, atol=1e-7)


@pytest.mark.long
@pytest.mark.heavy
def test_a_lambert_ball_has_lamberts_phase_curve(tmp_path):
    """Φ(g) = 2/3 A [sin g + (π - g) cos g]/π, Lambert's own (Hapke 2012, section 11.4)."""
    settings = merged(
        defaults(),
        check(
            {"surface": {"model": "LAMBERT", "albedo": 0.6, "albedo_variation": 0.0, "grain_amplitude_m": 0.0}}, "test"
        ),
    )
    ((full, half),) = render_ball(Bench(tmp_path), [settings], (0.0, 90.0), 1000.0, pixels=96)
    assert full.brightness == pytest.approx(0.4, rel=3e-3)  # pixels at the limb, chords of a degree
    assert half.brightness == pytest.approx(0.4 / np.pi, rel=5e-3)
    disc = ~np.isnan(full.emission) & (full.emission < 1.0)
    law = photometry.lunar_lambert(0.6, 0.0)
    # Across a pixel the cosine changes by 7 % at most there, which 16 samples average to well within 2 %. Toward the
    # limb it changes by its own size, and pixels see the sky; the brightness of the whole disc tests that.
    assert full.radiance_factor[disc] == pytest.approx(
        np.pi * law(full.incidence, full.emission, full.azimuth)[disc], rel=0.02
    )
