"""Landforms of plug-ins on the ground."""

import numpy as np
import pytest
from icymoon.physics.terrain import terrain
from icymoon.physics.terrain.landforms import plug_in
from icymoon.plugins.installed import find_installed
from icymoon.plugins.landforms import read_landform
from icymoon.settings.description import defaults
from icymoon.settings.topics.declaration import Table
from icymoon.settings.topics.scene import Settings, typed
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from plugin_packages import LANDFORM, add_package

X = np.array([-3.0, -1.0, 1.0, 3.0])


@pytest.fixture
def install(tmp_path, monkeypatch):
    found = {}

    def run(name="steps", source=LANDFORM):
        add_package(tmp_path / name, monkeypatch, "landform", name, source)
        found[f"landform_{name}"] = read_landform(find_installed("landform", ()).usable[name])
        monkeypatch.setattr(plug_in, "load_landform_plugins", lambda: (found, {}))

    return run


def with_steps(height_m: float, made_by: str = "", name: str = "steps") -> Settings:
    return typed({**defaults(), f"landform_{name}": Table(height_m=height_m, count=3, made_by=made_by)})


def relief(settings: Settings, shortest_m: float = 0.0, seed: int = 0) -> Array:
    """What the landforms add."""
    flat = terrain.make_terrain(defaults(), seed).heights(X, 0 * X, shortest_m)
    return np.asarray(terrain.make_terrain(settings, seed).heights(X, 0 * X, shortest_m) - flat)


def test_its_heights_are_added_to_the_ground(install):
    install()
    np.testing.assert_allclose(relief(with_steps(0.7)), [0, 0, 0.7, 0.7], atol=1e-12)
    assert not relief(with_steps(0.0)).any()


def test_a_mesh_that_is_too_coarse_leaves_it_out_and_says_so(install):
    install()
    assert not relief(with_steps(0.7), shortest_m=2.0).any()
    advice = " ".join(terrain.advise_on_terrain(with_steps(0.7), 2.0))
    assert "The mesh is too coarse for the landform_steps" in advice
    assert "landform_steps" not in " ".join(terrain.advise_on_terrain(with_steps(0.7), 0.1))


def test_one_that_is_not_installed_is_refused_and_never_left_out():
    with pytest.raises(IcyMoonError, match=r"landform_steps is of a plug-in, some-package 2\.0, that is not installed"):
        terrain.make_terrain(with_steps(0.7, "some-package 2.0"), 0)


def test_another_release_is_refused(install):
    install()
    terrain.make_terrain(with_steps(0.7, "icymoon-test-steps 1.0"), 0)
    with pytest.raises(
        IcyMoonError,
        match=r"landform_steps was made by icymoon-test-steps 0\.9, and "
        r"icymoon-test-steps 1\.0 is installed; install icymoon-test-steps 0\.9, or",
    ):
        terrain.make_terrain(with_steps(0.7, "icymoon-test-steps 0.9"), 0)
    terrain.make_terrain(with_steps(0.0, "icymoon-test-steps 0.9"), 0)  # it is off


RANDOM = LANDFORM.replace(
    "return np.where(x > 0, settings['height_m'], 0.0)",
    "return np.full(x.shape, settings['height_m'] * (settings['seed'] % 1000))",
)


def test_its_random_numbers_follow_from_the_seed_and_its_name_alone(install):
    install(source=RANDOM)
    alone = relief(with_steps(0.7))
    assert alone.any()
    np.testing.assert_array_equal(relief(with_steps(0.7)), alone)
    assert not np.allclose(relief(with_steps(0.7), seed=1), alone)
    install("a_first_one", RANDOM)
    np.testing.assert_array_equal(relief(with_steps(0.7)), alone)
    assert not np.allclose(relief(with_steps(0.7, name="a_first_one")), alone)
