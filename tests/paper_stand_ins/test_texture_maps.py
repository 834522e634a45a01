"""The stand-in textures: seamless, consistent maps with the stated statistics, all different, always the same."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np
import pytest
from icymoon.paper_stand_ins import ice_colours, periodic_fields
from icymoon.paper_stand_ins.periodic_fields import FieldGenerator
from icymoon.paper_stand_ins.texture_maps import make_maps
from icymoon.physics.random_numbers.seeds import make_generator
from icymoon.settings.topics.stand_ins import TEXTURES
from marks import heavy_but

KEYS = [item.key for item in TEXTURES]
#: Small maps for what does not depend on the size.
SIZE = 256


@pytest.fixture(scope="module")
def small():
    return {key: make_maps(key, size=SIZE) for key in KEYS}


def test_there_are_the_papers_fourteen():
    assert [item.number for item in TEXTURES] == list(range(1, 15))
    assert sum(item.photograph for item in TEXTURES) == 6  # six photographs, eight materials, five with transmission
    assert sum("transmission" in item.kinds for item in TEXTURES) == 5
    assert all(
        item.kinds == ("albedo",) if item.photograph else {"roughness", "normal"} < set(item.kinds) for item in TEXTURES
    )


@pytest.mark.long
@pytest.mark.parametrize("key", KEYS)
def test_opposite_edges_continue(small, key):
    maps = small[key]
    pictures = {"albedo": maps.albedo, "roughness": maps.roughness, "height": maps.height_m, "normal": maps.normal}
    for name, picture in pictures.items():
        for axis in (0, 1):
            # The step from the last row to the first is one of the steps between rows: no larger than the largest of
            # them, and not out of line with the others, of which there are 255.
            others = tuple(k for k in range(picture.ndim) if k != axis)
            steps = np.abs(np.diff(picture, axis=axis)).mean(axis=others)
            seam = np.abs(picture.take(0, axis) - picture.take(-1, axis)).mean()
            assert seam <= max(steps.mean() + 5 * steps.std(), 1e-9), (name, axis)


@pytest.mark.long
@pytest.mark.parametrize("key", KEYS)
def test_the_normals_are_those_of_the_heights(small, key):
    """The heights are integrated from the normals (Frankot and Chellappa 1988), by the wave numbers of the same central
    differences, which lose the shortest wave of each axis and nothing else."""
    item, maps = next(item for item in TEXTURES if item.key == key), small[key]
    assert np.linalg.norm(maps.normal, axis=-1) == pytest.approx(1.0)
    slope = -maps.normal[..., :2] / maps.normal[..., 2:]
    k_x, k_y = periodic_fields.list_wave_numbers(SIZE)
    s_x, s_y = np.sin(2 * np.pi * k_x / SIZE), np.sin(2 * np.pi * k_y / SIZE)
    power = s_x**2 + s_y**2
    lost = power < 1e-12
    power[lost] = 1.0
    spectrum = -1j * (s_x * np.fft.rfft2(slope[..., 0]) + s_y * np.fft.rfft2(slope[..., 1])) / power
    kept = np.fft.rfft2(maps.height_m / (item.width_m / SIZE))
    kept[lost] = 0.0
    height = np.fft.irfft2(kept, (SIZE, SIZE))
    assert np.fft.irfft2(spectrum, (SIZE, SIZE)) == pytest.approx(height, abs=1e-6 * float(np.ptp(height)))


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize("key", KEYS)
def test_the_mean_of_the_albedo_is_the_stated_one(small, key):
    item = next(item for item in TEXTURES if item.key == key)
    maps = small[key]
    assert maps.albedo[..., 1].mean() == pytest.approx(item.mean, abs=0.01)  # what is cut off at 1 takes some
    assert 0.0 <= maps.albedo.min() <= maps.albedo.max() <= 1.0
    assert (maps.albedo >= 1.0).mean() < 0.02  # light is lost in few pixels
    assert 0.05 <= maps.roughness.min() <= maps.roughness.max() <= 1.0


def test_any_two_differ(small):
    # Independent pictures of a thousand independent patches correlate by 0.03; 0.2 is a shared pattern.
    grey = {key: periodic_fields.normalise(maps.albedo[..., 1]) for key, maps in small.items()}
    # Without the longest waves, of which each has only a few.
    relief = {
        key: periodic_fields.normalise(maps.height_m - periodic_fields.blur(maps.height_m, SIZE / 24))
        for key, maps in small.items()
    }
    for one, other in itertools.combinations(KEYS, 2):
        assert abs((grey[one] * grey[other]).mean()) < 0.2, (one, other)
        assert abs((relief[one] * relief[other]).mean()) < 0.2, (one, other)


def test_a_seed_is_one_texture_and_another_seed_another():
    once, again, other = (make_maps("FIRN", seed, 64) for seed in (0, 0, 1))
    assert once.albedo.tobytes() == again.albedo.tobytes()
    assert once.height_m.tobytes() == again.height_m.tobytes()
    assert not np.array_equal(once.height_m, other.height_m)


@pytest.mark.parametrize("slope", [2.0, 3.0, 4.0])
def test_waves_have_the_stated_spectrum(slope):
    n = 512
    field = FieldGenerator(make_generator(0, "stand_ins", 9), n).waves(slope, 4 / n, 1 / 2)
    k_x, k_y = periodic_fields.list_wave_numbers(n)
    k, power = np.hypot(k_x, k_y), np.abs(np.fft.rfft2(field)) ** 2
    inside = (k >= 4) & (k <= n / 8)
    rings = np.geomspace(4, n / 8, 11)
    which = np.digitize(k[inside], rings)
    mean = [np.log([k[inside][which == i].mean(), power[inside][which == i].mean()]) for i in range(1, 11)]
    x, y = np.array(mean).T
    # The innermost ring has about 50 waves, whose mean power is sure within 14 %: a slope within 0.1.
    assert np.polyfit(x, y, 1)[0] == pytest.approx(-slope, abs=0.15)
    assert field.std() == pytest.approx(1.0)
    assert power[k > n / 4 + 1].max() < 1e-12 * power.max()


def test_colours_of_snow_and_ice_follow_from_absorption():
    # Warren and Wiscombe: fresh snow is white within 1 % in green, old coarse snow is darker and bluer; ice with fewer
    # bubbles is darker and bluer. 0.97 to 0.99 for grains of 0.1 mm: their figure 8 at 0.5 to 0.6 µm.
    fresh, old = ice_colours.snow_albedo(np.array([0.0001, 0.002]))
    assert 0.97 < fresh[1] < 0.99
    assert (old < fresh).all()
    assert (np.diff(old) > 0).all()
    few, many = ice_colours.ice_albedo(np.array([0.001, 0.05]))
    assert (few < many).all()
    assert few[2] / few[0] > many[2] / many[0] > 1.0


@pytest.mark.long
@pytest.mark.parametrize("key", heavy_but([], ["POWDER_SNOW"]))
def test_another_process_makes_the_same_bytes(key):
    code = (
        "import hashlib, sys; from icymoon.paper_stand_ins import cached_files, shown_items;"
        "made = cached_files._encode_texture(shown_items.find_texture_item(sys.argv[1]))[1];"
        "print(hashlib.sha256(b''.join(made.values())).hexdigest())"
    )
    found = [
        subprocess.run(
            [sys.executable, "-c", code, key],
            capture_output=True,
            text=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "OMP_NUM_THREADS": threads, "PATH": ""},
        ).stdout
        for seed, threads in (("1", "1"), ("2", "2"))
    ]
    assert found[0] == found[1] != ""
