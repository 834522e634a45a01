"""The export for Mitsuba: lights, camera and meshes by laws; Hapke's law where Mitsuba is installed."""

from __future__ import annotations

import ast
import importlib.util
import math
import os
import subprocess
import sys
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pairs
import pytest
from icymoon.physics.light.planetshine import VisibleCap, irradiance_wm2
from icymoon.physics.light.scene_sun import SceneSun
from icymoon.physics.light.sky import compute_sky
from icymoon.render.pairs.pair_folder import Pair
from icymoon.settings.description import check, defaults, merged
from icymoon.stereo.export import mitsuba
from icymoon.support.errors import IcyMoonError
from icymoon.support.version import ROOT

ADAPTERS = ROOT / "stereo" / "adapters"
PLANET = {
    "light": {
        "planet": True,
        "planet_elevation_deg": 40.0,
        "planet_azimuth_deg": 250.0,
        "planet_flattening": 0.098,
        "sun_azimuth_deg": 200.0,
        "sun_elevation_deg": -20.0,
    }
}


def settings(*parts):
    return merged(defaults(), *(check(part, "test") for part in parts))


@pytest.mark.long
@pytest.mark.parametrize(
    ("changes", "error"),
    [({}, 1e-3), ({"planet_azimuth_deg": 30.0}, 2e-3), ({"planet_elevation_deg": 5.0}, 2e-2)],
    ids=str,
)
def test_the_map_of_the_sky_brings_the_planets_light(changes, error):
    shown = compute_sky(settings(PLANET, {"light": changes}).light)
    found = mitsuba._make_sky_map(VisibleCap(shown.planet))[..., 0].astype(float)
    rows = len(found)
    polar, around = np.arange(rows) / (rows - 1) * math.pi, (np.arange(2 * rows) + 0.5) / rows * math.pi
    solid = np.sin(polar)[:, None] * math.pi / (rows - 1) * math.pi / rows
    # Directions by Mitsuba's own convention, turned by the matrix that the file states.
    ray = np.stack(
        np.broadcast_arrays(
            np.sin(around) * np.sin(polar)[:, None], np.cos(polar)[:, None], -np.cos(around) * np.sin(polar)[:, None]
        ),
        axis=-1,
    )
    up = (ray @ mitsuba._SKY_TO_WORLD[:3, :3].T)[..., 2]
    # A limb, and a horizon that cuts the disc, in pixels of 0.1 degrees, on a disc of 29.
    assert np.sum(found * solid * np.maximum(up, 0)) == pytest.approx(
        irradiance_wm2(shown.planet, np.array([0.0, 0.0, 1.0])), rel=error
    )


def test_what_the_planet_hides_of_the_sun_is_left_out_once(tmp_path):
    """A pair's record states the irradiance without what is hidden."""
    half = SceneSun(np.array([0.0, 0.6, 0.8]), 7.0, 0.05, "ANGLES", eclipse=0.5)
    pair = Pair(tmp_path, "0" * 12, settings(), pairs.camera(), {"light": {"sun": half.to_json()}})
    shown = compute_sky(settings({"light": {"planet": False}}).light)
    lights = mitsuba._light_plugins(pair, shown, tmp_path)
    radiance, angle = lights["sun"]["emitter"]["radiance"][0], math.radians(0.05 / 2)
    assert radiance * math.pi * math.sin(angle) ** 2 == pytest.approx(7.0)


@pytest.mark.parametrize("diameter_deg", [0.0556, 2.0])
def test_the_suns_disk_has_its_irradiance_and_faces_the_ground(diameter_deg):
    direction = np.array([0.6, -0.48, 0.64])
    found = mitsuba._sun_plugin(direction, 14.82, diameter_deg)
    matrix, radiance = found["to_world"], found["emitter"]["radiance"][0]
    distance = np.linalg.norm(matrix[:3, 3])
    radius = np.linalg.norm(matrix[:3, 0])
    assert matrix[:3, 3] / distance == pytest.approx(direction)
    assert matrix[:3, 2] == pytest.approx(-direction)
    assert radius / distance == pytest.approx(math.tan(math.radians(diameter_deg / 2)))
    assert radiance * math.pi * radius**2 / (distance**2 + radius**2) == pytest.approx(14.82)
    assert np.linalg.det(matrix[:3, :3]) > 0
    assert mitsuba._sun_plugin(direction, 14.82, 0.0)["irradiance"] == [14.82] * 3


def test_the_film_has_a_filter_as_wide_as_that_of_cycles():
    # The window over three pixels, with the coefficients of Harris 1978, Proc. IEEE 66, 51.
    x = np.linspace(-1.5, 1.5, 30001)
    turn = 2 * np.pi * x / 3
    window = 0.35875 + 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) + 0.01168 * np.cos(3 * turn)
    deviation = math.sqrt((window * x * x).sum() / window.sum())
    assert deviation == pytest.approx(mitsuba._FILTER_PX, abs=1e-4)


def test_what_is_left_out_is_named():
    described = settings(
        {"surface": {"model": "PRINCIPLED", "grain_amplitude_m": 0.01, "salt_share": 0.2}, "textures": {"set": "FROST"}}
    )
    text = " ".join(mitsuba.find_left_out(described, compute_sky(described.light)))
    for word in ("PRINCIPLED", "grain_amplitude_m", "salt_share", "textures.set"):
        assert word in text
    layered = settings(
        {
            "surface": {
                "ice_colour": "SNOW",
                "trough_dirt": -0.2,
                "glint_share": 0.1,
                "crust_share": 0.1,
                "frost_share": 0.1,
                "bubble_share": 0.01,
            }
        }
    )
    text = " ".join(mitsuba.find_left_out(layered, compute_sky(layered.light)))
    for key in ("ice_colour", "trough_dirt", "glint_share", "crust_share", "frost_share", "bubble_share"):
        assert f"surface.{key} is left out" in text
    plain = settings({"surface": {"model": "LAMBERT", "grain_amplitude_m": 0.0, "albedo_variation": 0.0}})
    assert not mitsuba.find_left_out(plain, compute_sky(plain.light))


@pytest.mark.parametrize(
    ("data", "toe_in", "shutter", "word"),
    [
        ({"edited_by_hand": True}, 0.0, None, "edited by hand"),
        ({}, 2.0, None, "toe-in"),
        ({}, 0.0, object(), "rolling shutter"),
    ],
)
def test_pairs_that_cannot_be_exported_are_refused(data, toe_in, shutter, word):
    camera: Any = SimpleNamespace(looks_elsewhere=toe_in != 0, rendered_px=(4, 4), width_px=4, height_px=4)
    pair: Any = SimpleNamespace(data=data, folder="pair", camera=camera, rolling_shutter=shutter)
    with pytest.raises(IcyMoonError, match=word):
        mitsuba._refuse_unexportable(pair)


def test_the_scene_is_xml_with_every_value_named():
    text = mitsuba._to_xml(
        {
            "integrator": {"type": "path", "max_depth": 5, "hide_emitters": True},
            "terrain": {
                "type": "ply",
                "filename": "a & b.ply",
                "bsdf": {"type": "diffuse", "reflectance": [0.5, 0.5, 0.5]},
            },
            "sun": mitsuba._sun_plugin(np.array([0.0, 0.0, 1.0]), 1.0, 0.0),
        }
    )
    root = ElementTree.fromstring(text)
    assert [child.tag for child in root] == ["integrator", "shape", "emitter"]
    assert root.find("shape/string").get("value") == "a & b.ply"
    assert root.find("integrator/boolean").get("value") == "true"
    assert root.find("emitter/vector").get("value").split() == ["-0", "-0", "-1"]


HAPKE = """
import sys
import numpy as np
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
sys.path.insert(0, sys.argv[1])
import mitsuba_hapke
from icymoon.physics.surfaces.hapke import HapkeParameters, brdf, porosity_factor
random = np.random.default_rng(1)
i, e, azimuth = random.uniform(0, 1.5, 2000), random.uniform(0, 1.5, 2000), random.uniform(0, np.pi, 2000)
def ray(angle, around):
    return mi.Vector3f(*(np.float32(a) for a in (np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around),
                                                 np.cos(angle))))
for kind in ("1981", "1993", "2002"):
    for theta in (0.0, 10.0, 30.0):
        q = dict(w=0.95, b=0.3, c=0.2, b_s0=0.8, h_s=0.05, b_c0=0.4, h_c=0.02)
        known = HapkeParameters(**q, theta_bar=np.radians(theta), filling_factor=0.2, h_function=kind)
        ours = brdf(i, e, azimuth, known)
        theirs = np.array(mitsuba_hapke.brdf(
            q | dict(theta_bar_deg=theta, k=float(porosity_factor(0.2)), h_function=int(kind)),
            ray(e, azimuth), ray(i, 0 * i)))
        print(kind, theta, np.abs(theirs / ours - 1).max())
        assert np.abs(theirs / ours - 1).max() < 2e-3, (kind, theta)  # single precision at grazing angles
        assert np.median(np.abs(theirs / ours - 1)) < 2e-6, (kind, theta)
print("ok")
"""


def test_the_files_for_mitsuba_find_what_they_take_from_each_other():
    """They are copied into exports and import each other by their bare names, which no type checker follows."""
    trees = {path.stem: ast.parse(path.read_text("utf-8")) for path in ADAPTERS.glob("*.py")}
    taken = [
        (node.module, alias.name)
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and not node.level and node.module in trees
        for alias in node.names
    ]
    assert ("mitsuba_hapke", "register_bsdf") in taken
    for module, name in taken:
        assert name in {getattr(node, "name", "") for node in trees[module].body}, (module, name)


SNOW = """
import sys
import numpy as np
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
sys.path.insert(0, sys.argv[1])
import mitsuba_snow
from icymoon.physics.surfaces.snow import reflectance_factor
random = np.random.default_rng(1)
i, e, azimuth = random.uniform(0, 1.5, 2000), random.uniform(0, 1.5, 2000), random.uniform(0, np.pi, 2000)
def ray(angle, around):
    return mi.Vector3f(*(np.float32(a) for a in (np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around),
                                                 np.cos(angle))))
for albedo in (0.2, 0.9, 1.0):
    theirs = np.array(mitsuba_snow.brdf({"albedo": albedo}, ray(e, azimuth), ray(i, 0 * i)))
    apart = np.abs(np.pi * theirs / reflectance_factor(i, e, azimuth, albedo) - 1)
    print(albedo, apart.max())
    assert apart.max() < 1e-5, albedo  # single precision: 1e-7, a hundred times in the exponent of the phase function
mitsuba_snow.register()
assert "albedo" in str(mi.load_dict({"type": "icymoon_snow", "albedo": 0.8}))
# Light from all sides is reflected by the law as by its own albedo, or the BSDF has no factor too much.
scene = mi.load_dict({"type": "scene", "integrator": {"type": "path", "max_depth": 2}, "ground": {
    "type": "rectangle", "bsdf": {"type": "icymoon_snow", "albedo": 0.9}}, "sky": {"type": "constant"}, "sensor": {
    "type": "perspective", "fov": 1.0,
    "to_world": mi.ScalarTransform4f().look_at([0, 0, 9], [0, 0, 0], [0, 1, 0]), "film": {
        "type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}}})
seen = float(np.array(mi.render(scene, spp=40000)).mean())
mu = (np.arange(400) + 0.5) / 400
turn = (np.arange(720) + 0.5) / 720 * 2 * np.pi
factor = reflectance_factor(np.arccos(mu)[:, None], 0.0, turn[None], 0.9).mean(axis=1)
print(seen, (2 * mu * factor).mean())
assert abs(seen / (2 * mu * factor).mean() - 1) < 0.003
print("ok")
"""


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="needs pip install icymoon[validate]")
@pytest.mark.parametrize("script", [HAPKE, SNOW], ids=["hapke", "snow"])
def test_a_law_in_mitsuba_is_the_formula(script):
    done = subprocess.run(
        [sys.executable, "-c", script, str(ROOT / "stereo" / "adapters")],
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    if "LLVM" in done.stderr and "ok" not in done.stdout:
        pytest.skip("no LLVM library that this Mitsuba knows")
    assert done.stdout.endswith("ok\n"), done.stderr


def test_snow_is_exported_as_snow():
    described = settings(
        {"surface": {"model": "SNOW", "albedo": 0.93, "grain_amplitude_m": 0.0, "albedo_variation": 0.0}}
    )
    assert mitsuba._surface_plugin(described, "terrain") == {"type": "icymoon_snow", "albedo": 0.93}
    assert not mitsuba.find_left_out(described, compute_sky(described.light))


def test_code_that_comes_with_a_scene_is_not_run(tmp_path):
    (tmp_path / "mitsuba_hapke.py").write_text("raise SystemExit('code of the scene was run')\n")
    (tmp_path / "scene_left.xml").write_text('<scene version="3.0.0"><bsdf type="icymoon_hapke"/></scene>')
    (tmp_path / "fake").mkdir()
    (tmp_path / "fake" / "mitsuba.py").write_text("def set_variant(name): pass\n")
    script = ROOT / "stereo" / "adapters" / "mitsuba_render.py"
    ended = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "scene_left.xml")],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "fake")},
    )
    assert ended.returncode == 1
    assert "code of the scene" not in ended.stderr
