"""Pictures of a pair for the window: the camera's own numbers and the analytic depth, without OpenCV and OpenEXR."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pairs
import pytest
from icymoon.physics.light.directions import direction_toward
from icymoon.physics.light.scene_sun import SceneSun
from icymoon.render.pairs.pair_folder import read_pair
from icymoon.settings.description import defaults, merged
from icymoon.stereo import pair_views
from icymoon.stereo.images.colours import SKY_GREY, Scale, draw_colour_bar
from icymoon.stereo.images.image_files import read_png
from icymoon.stereo.images.lettering import measure_text_width_px
from icymoon.stereo.pair_views import describe_darkness, read_pair_views
from icymoon.stereo.reexpose import reexpose
from icymoon.support.errors import IcyMoonError

SCENE = pairs.Scene(sky_rows=12)
RESPONSES = (
    {},
    {"sensor": {"auto_exposure": False, "exposure_s": 2.0e-6, "bits": 8}},
    {"sensor": {"encoding": "SQUARE_ROOT", "psf_sigma_px": 0.8, "gain": 2.0, "read_noise_e": 40.0}},
    {"sensor": {"brackets": 3}},
    {"light": {"planet_scale": 3.0}},
)


@pytest.fixture
def folder(tmp_path):
    return pairs.write_pair(tmp_path / "pair", SCENE, planet_share=0.25)


@pytest.mark.parametrize("response", RESPONSES, ids=str)
@pytest.mark.parametrize("layout", ["4.x view", "5.x"])
def test_the_eyes_are_what_the_evaluator_develops(tmp_path, layout, response, monkeypatch):
    folder = pairs.write_pair(tmp_path / "pair", SCENE, layout=layout, planet_share=0.25)
    response = {"sensor": {"bits": 8, **response.get("sensor", {})}, "light": response.get("light", {})}
    (out,) = reexpose([folder], tmp_path / "out", response)
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    monkeypatch.setitem(sys.modules, "cv2", None)
    views = read_pair_views(folder, response)
    for eye in ("left", "right"):
        wanted = read_png(out / f"{eye}.png")
        if wanted.dtype == np.uint16:  # merged brackets; matchers, and so the view, get 8 bits of them
            wanted = np.rint(wanted / 65535 * 255).astype(np.uint8)
        if response["sensor"].get("encoding") == "SQUARE_ROOT":
            wanted = np.rint(255 * np.sqrt(wanted / 255)).astype(np.uint8)
        np.testing.assert_array_equal(getattr(views, eye), wanted)
        np.testing.assert_array_equal(views.pictures(eye.upper())[0], np.repeat(wanted[..., None], 3, -1))
    assert views.warnings == ()


def test_depth_is_the_analytic_one_and_its_colours_rise_with_it(folder):
    depth, _, _ = pairs.view(SCENE, pairs.camera(), "left")
    views = read_pair_views(folder, {})
    np.testing.assert_array_equal(views.depth, depth.astype(np.float32))
    assert views.range_m == pytest.approx((np.nanmin(depth), np.nanmax(depth)))
    (picture,) = views.pictures("SIDE_BY_SIDE")
    assert picture.shape[1] > 3 * 2 * 256  # each pixel is a square of 2 x 2, since letters need room
    for down, right in ((0, 1), (1, 0), (1, 1)):
        np.testing.assert_array_equal(picture[down : 2 * 144 : 2, right:512:2], picture[: 2 * 144 : 2, :512:2])
    picture = picture[: 2 * 144 : 2, ::2]
    shown = picture[:, -depth.shape[1] :].astype(int)
    assert (shown[:12] == SKY_GREY).all()
    column = shown[12:, 10]  # beside the rock, depth falls steadily from top to bottom
    assert (np.diff(column[:, 0] + column[:, 1]) <= 2).all()  # viridis: red and green rise with the value
    assert column[0, 1] - column[-1, 1] > 100
    np.testing.assert_array_equal(picture[: depth.shape[0], : depth.shape[1], 0], views.left)


@pytest.mark.parametrize("columns", [8, 64, 160, 320])
def test_the_legend_of_a_small_image_can_be_read(monkeypatch, folder, columns):
    views = read_pair_views(folder, {})
    parts: dict[str, Any] = {name: getattr(views, name)[:, :columns].repeat(2, axis=1) for name in EYES_AND_DEPTH}
    small = replace(views, **{name: part[:, :columns] for name, part in parts.items()})
    ((title, fits),) = titles_of(monkeypatch, small, "SIDE_BY_SIDE")
    assert title.startswith(("True depth", "Depth (m)"))
    assert fits


def test_the_overlay_mixes_image_and_colour_and_has_the_legend_below(folder):
    views = read_pair_views(folder, {})
    (picture,) = views.pictures("DEPTH")
    (side,) = views.pictures("SIDE_BY_SIDE")
    height, width = 2 * 144, 2 * 256
    colour, grey = side[:height, -width:].astype(float), views.left.repeat(2, axis=0).repeat(2, axis=1)
    assert np.abs(picture[:height] - (0.6 * colour + 0.4 * grey[..., None])).max() <= 0.51
    assert len(picture) > height
    assert len(np.unique(picture[height:].reshape(-1, 3), axis=0)) > 100  # the colours of the bar


def test_a_pair_without_sky_has_no_sky_in_its_legend(tmp_path, folder):
    ground = read_pair_views(pairs.write_pair(tmp_path / "ground", pairs.Scene()), {})
    sky = replace(ground, depth=np.where(np.arange(144)[:, None] < 12, np.nan, ground.depth))
    legends = [views.pictures("DEPTH")[0][2 * 144 :] for views in (ground, sky)]
    assert not (legends[0] == SKY_GREY).all(axis=-1).any(axis=0)[-60:].any()
    assert (legends[1] == SKY_GREY).all(axis=-1)[:, -60:].sum() > 50


def titles_of(monkeypatch, views, view):
    """The title that the colour bar of a view is drawn with, and whether it fits."""
    drawn = []

    def draw(width, scale, size, ink, paper):
        drawn.append((scale.title, measure_text_width_px(scale.title, 8 * size) <= width))
        return draw_colour_bar(width, scale, size, ink, paper)

    monkeypatch.setattr(pair_views, "draw_colour_bar", draw)
    views.pictures(view)
    return drawn


@pytest.mark.parametrize("view", ["DEPTH", "SIDE_BY_SIDE"])
@pytest.mark.parametrize("repeats", [1, 3])
def test_the_legend_says_that_its_colours_end_before_the_depth(monkeypatch, folder, view, repeats):
    views = read_pair_views(folder, {})
    wide: dict[str, Any] = {name: np.repeat(getattr(views, name), repeats, axis=1) for name in EYES_AND_DEPTH}
    ((title, fits),) = titles_of(monkeypatch, replace(views, **wide), view)
    assert "ends at 1 and 99 %" in title.lower()
    assert fits
    whole = replace(views, scale=Scale(*views.range_m))
    ((title, fits),) = titles_of(monkeypatch, whole, view)
    assert title == f"True depth, {views.range_m[0]:.3g} to {views.range_m[1]:.3g} m"
    assert titles_of(monkeypatch, replace(views, range_m=None), view)[0][0] == "No depth"


EYES_AND_DEPTH = "left", "right", "shown_left", "shown_right", "depth"


def test_eyes_are_aligned_at_the_median_depth(tmp_path):
    """On a wall that faces the camera, all of the ground then is in the same columns of both."""
    wall = pairs.Scene(slope_x=0.0, slope_y=0.0, rock=False, distance_m=2.0)
    rig = pairs.camera(256, 144, baseline_m=0.3)  # f B = 40.96 px m, so a disparity of 20.48 px
    views = read_pair_views(pairs.write_pair(tmp_path / "pair", wall, rig), {"sensor": {"shot_noise": False}})
    assert views.shift_px == 20
    left, right = (eye.astype(float) for eye in views.aligned)
    apart = [
        np.abs(left[:, max(0, k) : 236 + min(0, k)] - right[:, max(0, -k) : 236 - max(0, k)]).mean()
        for k in range(-3, 4)
    ]
    assert np.argmin(apart) in (3, 4)  # half a pixel is left
    (anaglyph,), flicker = views.pictures("ANAGLYPH"), views.pictures("FLICKER")
    assert [picture.shape for picture in (anaglyph, *flicker)] == [(144, 236, 3)] * 3
    np.testing.assert_array_equal(anaglyph[..., 0], flicker[0][..., 0])
    np.testing.assert_array_equal(anaglyph[..., 1], flicker[1][..., 0])
    np.testing.assert_array_equal(anaglyph[..., 2], flicker[1][..., 0])


def test_large_images_are_reduced_by_whole_factors_and_that_is_stated(folder):
    whole, views = read_pair_views(folder, {}), read_pair_views(folder, {}, most_px=100)
    assert views.reduced == 3
    assert views.left.shape == views.depth.shape == (48, 85)
    np.testing.assert_array_equal(views.left[5, 7], np.rint(whole.left[15:18, 21:24].mean()))
    assert set(views.depth[np.isfinite(views.depth)]) <= set(whole.depth.ravel())  # no depth between two surfaces
    assert (views.range_m, views.saturated, views.scale) == (whole.range_m, whole.saturated, whole.scale)
    assert "shown at 1/3 of its size" in views.lines[-1]
    assert views.shift_px == whole.shift_px // 3


def test_lines_state_exposure_and_depth_of_the_pair(folder):
    views = read_pair_views(folder, {"sensor": {"auto_exposure": False, "exposure_s": 0.0125}})
    assert views.saturated > 0.5
    lines = views.lines
    assert lines[:2] == ["Exposure 12.5 ms", f"{100 * views.saturated:.2g} % saturated"]
    assert lines[2] == f"Depth {views.range_m[0]:.3g} to {views.range_m[1]:.3g} m"
    assert all(len(line) <= 36 for line in lines)
    assert any("saturated" in warning for warning in views.warnings)
    assert replace(views, exposures_s=(2.0, 0.5, 8e-5)).lines[0] == "Exposure 2 s to 80 µs"
    assert replace(views, saturated=0.0, range_m=None).lines == [
        "Exposure 12.5 ms",
        "None saturated",
        "All sky",
    ]


def test_a_dark_image_is_told_with_its_cause():
    levels = np.full((10, 100), 0.5)
    assert describe_darkness(levels) == ""
    levels[:6] = 0.0
    assert describe_darkness(levels) == "60 % dark: shadow or sky"
    assert describe_darkness(np.full(9, 0.06)) == ""  # dim, but not black
    assert describe_darkness(0.02 * levels) == "100 % dark: low exposure"


def test_a_pair_is_told_from_others_by_its_sun_and_size(folder):
    pair = read_pair(folder)
    size = f"{pair.camera.width_px} x {pair.camera.height_px}"  # of the render, however small the picture is
    assert read_pair_views(folder, {}).about == read_pair_views(folder, {}, 100).about == size
    record = json.loads((folder / "pair.json").read_text())
    light = pair.settings.light
    sun = SceneSun(
        direction_toward(light.sun_azimuth_deg, light.sun_elevation_deg),
        light.sun_irradiance_wm2,
        light.sun_angular_diameter_deg,
    )
    (folder / "pair.json").write_text(json.dumps(record | {"light": {"sun": sun.to_json()}}))
    assert read_pair_views(folder, {}).about == f"Sun {light.sun_elevation_deg:.0f}°, {size}"


def test_the_lines_of_a_pair_name_its_darkness(folder):
    bright = read_pair_views(folder, {})
    dark = read_pair_views(folder, {"sensor": {"auto_exposure": False, "exposure_s": 1e-9}})
    assert np.mean(dark.left) < 0.01 * np.mean(bright.left)
    assert len(bright.lines) == 3
    assert dark.lines[3] == "100 % dark: low exposure"
    assert len(dark.lines[3]) <= 30  # beside an icon


def test_what_needs_opencv_is_left_out_and_named(tmp_path, folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    plain, bent = (read_pair_views(folder, {"rig": {"distortion_k1": k1}}) for k1 in (0.0, 0.1))
    np.testing.assert_array_equal(plain.left, bent.left)
    assert plain.warnings == ()
    assert bent.warnings == ("Shown without lens distortion; Show Camera Image includes that.",)
    rig = replace(pairs.camera(), toe_in_deg=2.0, margin_x_px=8, margin_y_px=5)
    toed = pairs.write_pair(tmp_path / "toed", SCENE, replace(rig, width_px=272, height_px=154, cx_px=136, cy_px=77))
    views = read_pair_views_of_margins(toed, rig)
    assert views.left.shape == (144, 256)
    assert "the rectification of toed-in eyes" in views.warnings[0]
    assert views.shift_px == 0


def read_pair_views_of_margins(folder, rig):
    """The views of a pair whose images have this rig's margins."""
    import json

    data = json.loads((folder / "pair.json").read_text())
    data |= {
        "camera": rig.to_json(),
        "settings": merged(defaults(), {"rig": {**pairs.described(rig), "overscan": 8 / 256, "toe_in_deg": 2.0}}),
    }
    (folder / "pair.json").write_text(json.dumps(data))
    return read_pair_views(folder, {})


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: [path.unlink() for path in folder.iterdir()], r"not a complete stereo pair.*render it again"),
        (lambda folder: (folder / "right.exr").unlink(), r"right\.exr is missing; .*render the pair again"),
        (
            lambda folder: (folder / "left.exr").write_bytes((folder / "left.exr").read_bytes()[:-100]),
            r"left\.exr is not the file that was rendered.*render the pair again",
        ),
    ],
)
def test_what_is_gone_or_damaged_is_one_sentence(folder, spoil, said):
    spoil(folder)
    with pytest.raises(IcyMoonError, match=said):
        read_pair_views(folder, {})


def test_a_pair_without_depth_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(pairs, "write_exr", without_depth(pairs.write_exr))
    with pytest.raises(IcyMoonError, match=r"has no channel Truth\.Depth\.Z; render the pair again"):
        read_pair_views(pairs.write_pair(tmp_path / "pair", layout="5.x"), {})


def without_depth(write):
    import OpenEXR

    def written(path, *arguments):
        write(path, *arguments)
        parts = [part for part in OpenEXR.File(str(path), separate_channels=True).parts if "Depth" not in part.name()]
        OpenEXR.File(parts).write(str(path))

    return written


def test_it_is_read_where_only_numpy_is(folder):
    program = (
        "import sys\n"
        "for name in ('cv2', 'OpenEXR', 'torch', 'jinja2', 'matplotlib', 'rich', 'bpy', 'PIL', 'scipy'):\n"
        "    sys.modules[name] = None\n"
        "from pathlib import Path\n"
        "from icymoon.stereo.pair_views import read_pair_views\n"
        "from icymoon.formats.png import encode_png\n"
        "views = read_pair_views(Path(sys.argv[1]), {})\n"
        "for view in ('SIDE_BY_SIDE', 'LEFT', 'RIGHT', 'FLICKER', 'ANAGLYPH', 'DEPTH'):\n"
        "    print(view, *map(len, map(encode_png, views.pictures(view))))"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, str(folder)], capture_output=True, text=True, timeout=120, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert len(ended.stdout.splitlines()) == 6
