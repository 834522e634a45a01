"""Common mistakes of users: each is reported by one sentence with what is wrong, where, and the fix.

``docs/make/mistakes.py`` lists them for the manual. Each is made here, and its sentence compared with the list.
"""

from __future__ import annotations

import errno
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import icymoon
import numpy as np
import pytest
from icymoon.commands import cli, doctor
from icymoon.nodes import build_scene as scenes
from icymoon.operators import preferences, presets
from icymoon.physics.camera.blur import find_blur
from icymoon.render import cycles_settings, render_pair
from icymoon.render.cycles_settings import check_possible
from icymoon.render.workers.job_commands import python_command
from icymoon.settings import preset_files
from icymoon.settings.blender import scene_properties
from icymoon.support import files, system
from icymoon.support.blender import compat
from icymoon.support.errors import IcyMoonError
from rendering import complete

ROOT = Path(icymoon.__file__).parent
_spec = importlib.util.spec_from_file_location("mistakes", ROOT / "docs" / "make" / "mistakes.py")
mistakes = importlib.util.module_from_spec(_spec)
sys.modules["mistakes"] = mistakes
_spec.loader.exec_module(mistakes)

ALL = [mistake for some in mistakes.MISTAKES.values() for mistake in some]

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n{0} 0 0\n0 {0} 0\n3 0 1 2\n"
)


class Place:
    """Where a mistake is made: an empty folder, the open scene, and patching."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.patch, self.scene = folder, monkeypatch, bpy.context.scene

    def file(self, name: str, text: str = "") -> Path:
        path = self.folder / name
        path.write_text(text)
        return path

    def program(self, name: str, text: str) -> Path:
        path = self.file(name, text)
        path.chmod(0o755)
        return path


def raised(what: Callable[[], Any]) -> str:
    """The sentence with which something is refused."""
    with pytest.raises(IcyMoonError) as caught:
        what()
    return str(caught.value)


def reported(operator: Any, **options: Any) -> str:
    """The sentence with which an operator is refused."""
    with pytest.raises(RuntimeError) as caught:
        operator(**options)
    return str(caught.value).strip().removeprefix("Error: ")


def build(*parts: dict) -> str:
    return raised(lambda: scenes.build_scene(bpy.context.scene, complete(*parts)))


def command(*words: str) -> str:
    """The sentence that the command line ends with, in this process."""
    return raised(lambda: (options := cli.make_parser().parse_args(words)).run(options))


def stereo(*words: str) -> str:
    """The sentence that the evaluator ends with."""
    done = subprocess.run(python_command(sys.executable, "stereo", *words), capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stderr.strip().split(": ", 1)[1]


def ground(place: Place, name: str, text: str = "", **source: Any) -> str:
    path = place.file(name, text)
    kind = "HEIGHT_MAP" if name.endswith((".npy", ".tif")) else "MESH"
    return build({"source": {"kind": kind, "file": str(path), **source}})


def full_disk(place: Place) -> str:
    def refuse(path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    place.patch.setattr(system, "flush", refuse)
    said = raised(lambda: files.write_text(place.folder / "settings.toml", "x"))
    assert list(place.folder.iterdir()) == [], "nothing half-written stays"
    return said


def no_evaluator(place: Place) -> str:
    place.patch.delenv("ICYMOON_EVALUATOR", raising=False)
    place.patch.setattr(preferences, "find_own_evaluator_python", lambda: place.folder / "python")
    place.patch.setattr(
        preferences,
        "bpy",
        SimpleNamespace(
            app=SimpleNamespace(binary_path="blender", background=False), context=bpy.context, path=bpy.path
        ),
    )
    return raised(preferences.find_evaluator_python)


def wrong_python(place: Place) -> str:
    finding = doctor.examine_evaluator(str(place.program("python", "#!/bin/sh\necho Hello\n")))[0]
    return f"{finding.fact}; {finding.fix}"


def bare_python(place: Place) -> str:
    bare = place.program("python", f'#!/bin/sh\nexec {sys.executable} -S -E "$@"\n')
    return doctor.examine_evaluator(str(bare))[0].fix


def evaluate_with(place: Place, methods: str) -> str:
    pair = place.folder / "pairs" / "a"
    pair.mkdir(parents=True)
    return stereo("evaluate", str(place.folder), "--methods", methods, "--out", str(place.folder / "report"))


def half_written(place: Place) -> str:
    pair = place.folder / "pairs" / "0123456789ab"
    pair.mkdir(parents=True)
    (pair / "left.exr").write_bytes(b"half")
    return stereo("evaluate", str(pair), "--methods", "bm", "--out", str(place.folder / "report"))


def newer_preset(place: Place) -> str:
    place.patch.setattr(presets, "find_extension_folder", lambda: place.folder)
    (place.folder / "presets").mkdir()
    place.file("presets/new.toml", "[preset]\nmade_with = '9.0.0'\n[terrain]\nfractality = 1\n")
    return reported(bpy.ops.icymoon.load_preset, preset="own/new")


def plan(place: Place, text: str) -> str:
    from icymoon.render.plans.plan_file import read_plan

    path = place.file("plan.toml", f'[plan]\ntitle = "Test"\n{text}')
    return raised(lambda: read_plan(path).pairs())


def edited(place: Place) -> str:
    settings = complete()
    scene_properties.write_settings(place.scene.icymoon, settings)
    scene_properties.write_settings(place.scene.icymoon, {"dataset": {"folder": str(place.folder)}})
    built = scenes.build_scene(place.scene, scene_properties.read_settings(place.scene.icymoon))
    built.terrain.data.vertices[0].co.z += 1.0
    place.scene.icymoon.terrain.hurst = 0.6
    return reported(bpy.ops.icymoon.render_pair)


def little_room(place: Place) -> str:
    from icymoon.render.plans.planned_pair import expand_headings

    place.patch.setattr(render_pair.shutil, "disk_usage", lambda path: SimpleNamespace(free=1000))
    return raised(lambda: render_pair.check_space(place.folder, expand_headings(complete())))


def unwritable(place: Place) -> str:
    def refuse(*_: Any, **__: Any) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    from icymoon.render.plans.planned_pair import expand_headings

    place.patch.setattr(Path, "write_bytes", refuse)
    return raised(lambda: render_pair.check_space(place.folder, expand_headings(complete())))


def own_texture(place: Place, text: str | None) -> str:
    path = place.folder / "frost.png"
    if text is not None:
        path.write_text(text)
    return build({"textures": {"set": "OWN", "albedo_file": str(path)}})


def no_osl(place: Place) -> str:
    place.patch.setattr(compat, "has_osl", lambda: False)
    return build({"surface": {"model": "HAPKE"}, "hapke": {"backend": "OSL"}})


def no_denoiser(place: Place) -> str:
    place.patch.setattr(compat, "has_oidn", lambda: False)
    return raised(lambda: check_possible(complete({"quality": {"denoiser": "OIDN"}}).quality))


def no_card(place: Place) -> str:
    place.patch.setattr(cycles_settings, "select_cards", list)
    return raised(lambda: check_possible(complete({"quality": {"device": "GPU"}}).quality))


def leap_seconds_only(place: Place) -> str:
    pytest.importorskip("spiceypy")
    kernel = place.file(
        "leap.tls",
        "KPL/LSK\n\\begindata\nDELTET/DELTA_T_A = 32.184\nDELTET/K = 1.657D-3\n"
        "DELTET/EB = 1.671D-2\nDELTET/M = ( 6.239996D0 1.99096871D-7 )\n"
        "DELTET/DELTA_AT = ( 37, @2017-JAN-1 )\n\\begintext\n",
    )
    return build({"light": {"directions_from": "KERNELS", "kernels": str(kernel)}})


def kernels_missing(place: Place) -> str:
    pytest.importorskip("spiceypy")
    return build({"light": {"directions_from": "KERNELS", "kernels": str(place.folder / "none.tm")}})


def unsaved(place: Place) -> str:
    place.scene.icymoon.dataset.folder = "//pairs"
    return reported(bpy.ops.icymoon.render_pair)


def file_as_folder(place: Place) -> str:
    place.scene.icymoon.dataset.folder = str(place.file("notes.txt"))
    return reported(bpy.ops.icymoon.render_pair)


def not_rendered(place: Place) -> str:
    place.scene.icymoon.dataset.folder = str(place.folder)
    return reported(bpy.ops.icymoon.evaluate, scope="SCENE")


def moving(place: Place) -> str:
    return raised(lambda: find_blur(complete({"rig": {"speed_right_m_s": 1.0}})))


def centimetres(place: Place) -> str:
    path = place.file("site.ply", PLY.format(3.0e4))
    built = scenes.build_scene(place.scene, complete({"source": {"kind": "MESH", "file": str(path)}}))
    return next(said for said in built.warnings if "unit" in said)


def network(place: Place) -> str:
    left = place.folder / "left.png"
    from icymoon.stereo.images.image_files import write_png

    write_png(left, np.zeros((64, 96), np.uint8))
    return stereo(
        "match", "--method", "igev", "--left", str(left), "--right", str(left), "--out", str(place.folder / "d.npz")
    )


def empty_dataset(place: Place) -> str:
    return stereo("evaluate", str(place.folder), "--methods", "bm", "--out", str(place.folder / "report"))


def settings_file(text: str) -> Callable[[Place], str]:
    return lambda place: raised(lambda: preset_files.load(place.file("site.toml", text)))


MADE: dict[str, Callable[[Place], str]] = {
    "no evaluator": no_evaluator,
    "wrong python": wrong_python,
    "bare python": bare_python,
    "evaluator gone": lambda place: (
        place.patch.setenv("ICYMOON_EVALUATOR", str(place.folder / "python")),
        raised(preferences.find_evaluator_python),
    )[1],
    "no blender": lambda place: command(
        "render", "--preset", "europa_rough_ice", "--blender", "/nowhere/blender", "--out", str(place.folder)
    ),
    "no osl": no_osl,
    "no denoiser": no_denoiser,
    "no card": no_card,
    "unsaved": unsaved,
    "read-only": unwritable,
    "full disk": full_disk,
    "little room": little_room,
    "file as folder": file_as_folder,
    "unknown key": settings_file("[terrain]\nhurts = 0.5\n"),
    "unknown topic": settings_file("[terain]\nhurst = 0.5\n"),
    "wrong units": settings_file("[terrain]\nsize_m = 20000000\n"),
    "wrong type": settings_file("[terrain]\nsize_m = '20 m'\n"),
    "wrong choice": settings_file("[surface]\nmodel = 'LAMBERTIAN'\n"),
    "not toml": settings_file("[terrain\nhurst = 0.5\n"),
    "camera under the ground": settings_file("[rig]\nheight_m = -1.0\n"),
    "eye in the ground": lambda place: plan(
        place, "[terrain]\nrms_slope_deg = 40\n[rig]\nheight_m = 0.001\nbaseline_m = 5\n"
    ),
    "eye in a rock": lambda place: plan(
        place,
        "[terrain]\nrms_slope_deg = 0\n[rocks]\ncoverage = 0.5\nsmallest_m = 1\nlargest_m = 1\nheight_ratio = 3"
        "\nburial = 0\n[rig]\nbaseline_m = 3\nheight_m = 0.5\n[[sweep]]\nkind = 'panorama'\nheadings = [10]\n",
    ),
    "impossible sweep": lambda place: plan(place, "[[sweep]]\nkind = 'grid'\nsurface.albedo = []\n"),
    "no room for sites": lambda place: plan(place, "[[sweep]]\nkind = 'sites'\ncount = 9\napart_m = 12\n"),
    "unknown preset": lambda place: command("settings", "--preset", "europe_rough_ice"),
    "newer preset": newer_preset,
    "bad --set": lambda place: command("settings", "--set", "terrain.size_m:20"),
    "mesh in the wrong unit": lambda place: ground(place, "site.ply", PLY.format(3.0e9)),
    "mesh in centimetres": centimetres,
    "not a mesh": lambda place: ground(place, "site.ply", "Dear diary"),
    "unknown mesh format": lambda place: reported(bpy.ops.icymoon.import_ground, filepath=str(place.file("site.docx"))),
    "mesh gone": lambda place: build({"source": {"kind": "MESH", "file": str(place.folder / "gone.obj")}}),
    "no mesh chosen": lambda place: build({"source": {"kind": "MESH"}}),
    "folder as mesh": lambda place: (
        os.mkdir(place.folder / "site.obj"),
        build({"source": {"kind": "MESH", "file": str(place.folder / "site.obj")}}),
    )[1],
    "height map without scale": lambda place: (
        np.save(place.folder / "dem.npy", np.zeros((9, 9))),
        build({"source": {"kind": "HEIGHT_MAP", "file": str(place.folder / "dem.npy")}}),
    )[1],
    "texture gone": lambda place: own_texture(place, None),
    "not a texture": lambda place: own_texture(place, "no picture"),
    "no date": lambda place: build({"light": {"directions_from": "DATE", "date_utc": "next summer"}}),
    "unknown body": lambda place: build({"light": {"directions_from": "DATE", "body": "TITANIA"}}),
    "kernels gone": kernels_missing,
    "kernels without the date": leap_seconds_only,
    "motion without exposure": moving,
    "edited by hand": edited,
    "nothing rendered": not_rendered,
    "empty data set": empty_dataset,
    "half-written pair": half_written,
    "unknown matcher": lambda place: evaluate_with(place, "sgmb"),
    "unknown option": lambda place: evaluate_with(place, "bm:windw=9"),
    "network without weights": network,
}


def test_every_mistake_of_the_manual_is_made_here():
    assert set(MADE) == {mistake.key for mistake in ALL}
    assert len({mistake.key for mistake in ALL}) == len(ALL) >= 30


@pytest.mark.ci_takes(4)
@pytest.mark.parametrize("mistake", ALL, ids=lambda m: m.key)
def test_a_mistake_is_reported_by_one_sentence_with_its_fix(scene, tmp_path, monkeypatch, mistake):
    said = MADE[mistake.key](Place(tmp_path, monkeypatch))
    assert "Traceback" not in said
    assert "\n" not in said
    assert said.endswith((".", "?")), said
    assert mistake.message in said
    assert mistake.fix in said
    assert said.index(mistake.message) < said.index(mistake.fix), "what is wrong comes first"
