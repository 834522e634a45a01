"""Presets in the window: the shipped ones by their pictures, the user's own saved, loaded and removed."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from icymoon.nodes.build_scene import find_collection
from icymoon.operators import live_preview, presets
from icymoon.panels import previews, sidebar
from icymoon.settings import description, preset_files, toml_text
from icymoon.settings.blender import scene_properties
from icymoon.settings.description import merged
from icymoon.settings.topics.scene import Settings
from icymoon.support.errors import IcyMoonError
from panel_drawing import drawn

NEWER = "9.0.0"


@pytest.fixture
def own(scene, tmp_path, monkeypatch):
    """A folder for the user's own presets; the package is not an installed extension here."""
    monkeypatch.setattr(presets, "find_extension_folder", lambda: tmp_path)
    return tmp_path / "presets"


def choice() -> str:
    return getattr(bpy.context.window_manager, previews.CHOICE)


def test_a_preset_of_ones_own_comes_back_as_it_was(scene, own):
    scene.icymoon.terrain.hurst, scene.icymoon.dataset.seed = 0.55, 7
    scene.icymoon.terrain.layers.add().amplitude_m = 0.3
    before = scene_properties.read_settings(scene.icymoon)
    assert bpy.ops.icymoon.add_preset(title="Zürich, 2nd try") == {"FINISHED"}
    name = scene.icymoon.preset
    assert name == "own/zürich_2nd_try"
    assert presets.find_title(name) == "Zürich, 2nd try"
    bpy.ops.icymoon.load_preset(preset="scenes/europa_chaos")
    scene.icymoon.dataset.seed = 9
    assert bpy.ops.icymoon.load_preset(preset=name) == {"FINISHED"}
    after = scene_properties.read_settings(scene.icymoon)
    assert after.pop("dataset")["seed"] == 9, "a preset is not of the data set"
    before.pop("dataset")
    assert after == before
    assert preset_files.load(own / "zürich_2nd_try.toml") == before, "the command line reads it too"


def test_a_preset_of_ones_own_says_where_its_values_are_from(scene, own):
    own.mkdir(parents=True, exist_ok=True)
    (own / "ganymede.toml").write_text(
        """[preset]
include = ["bodies/europa"]
[terrain]
body_radius_m = 2631200.0
[rocks]
coverage = 0.07
[sources]
"terrain.body_radius_m" = "Archinal et al. 2018, \\"mean\\""
"rocks.coverage" = "Counted"
""",
        encoding="utf-8",
    )
    bpy.ops.icymoon.load_preset(preset="own/ganymede")
    scene.icymoon.rocks.coverage = 0.08  # which the source does not speak of
    scene.icymoon.light.planet_albedo = 0.123
    assert bpy.ops.icymoon.add_preset(title="Again") == {"FINISHED"}
    sources = toml_text.read_toml(own / "again.toml")["sources"]
    assert sources["terrain.body_radius_m"] == 'Archinal et al. 2018, "mean"'
    assert "Celest" not in sources["terrain.body_radius_m"]
    assert sources["light.sun_irradiance_wm2"].startswith("1361 W/m²")
    assert not {"rocks.coverage", "light.planet_albedo"} & set(sources)
    assert preset_files.load(own / "again.toml").rocks.coverage == pytest.approx(0.08)


def test_removing_a_preset_of_ones_own(scene, own):
    bpy.ops.icymoon.add_preset(title="Gone")
    assert bpy.ops.icymoon.remove_preset.poll()
    assert bpy.ops.icymoon.remove_preset() == {"FINISHED"}
    assert list(own.iterdir()) == []
    assert scene.icymoon.preset == ""
    assert not bpy.ops.icymoon.remove_preset.poll()
    bpy.ops.icymoon.load_preset(preset="scenes/europa_chaos")
    assert not bpy.ops.icymoon.remove_preset.poll(), "shipped presets stay"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[preset\n", "is not valid TOML"),
        ("[terrain]\nhurts = 1\n", "did you mean 'hurst'"),
        (f"[preset]\nmade_with = '{NEWER}'\n[terrain]\nfractality = 1\n", f"saved by Icy Moon {NEWER}"),
        (f"[preset]\nmade_with = '{NEWER}'\nmood = 1\n", "update Icy Moon"),
        ("preset = 3\n", "[preset] must be a table"),
        ("[preset]\ninclude = 5\n", "preset.include must be a list"),
    ],
)
def test_a_preset_that_cannot_be_read_is_one_sentence_and_changes_nothing(scene, own, text, said):
    own.mkdir()
    (own / "bad.toml").write_text(text)
    before = scene_properties.read_settings(scene.icymoon)
    with pytest.raises(RuntimeError, match=r"bad\.toml") as raised:
        bpy.ops.icymoon.load_preset(preset="own/bad")
    assert said in str(raised.value)
    assert scene_properties.read_settings(scene.icymoon) == before
    assert scene.icymoon.preset == ""


def test_a_newer_preset_that_is_understood_is_loaded(scene, own):
    own.mkdir()
    (own / "new.toml").write_text(f"[preset]\nmade_with = '{NEWER}'\n[terrain]\nhurst = 0.5\n")
    assert bpy.ops.icymoon.load_preset(preset="own/new") == {"FINISHED"}
    assert scene.icymoon.terrain.hurst == 0.5


@pytest.mark.parametrize("title", ["", " ?! "])
def test_a_preset_needs_a_name(scene, own, title):
    with pytest.raises(RuntimeError, match="give it a name"):
        bpy.ops.icymoon.add_preset(title=title)
    assert not own.exists()


@pytest.mark.parametrize(("title", "stem"), [("CON", "con_"), ("com1", "com1_"), ("Lpt9!", "lpt9_"), ("Cone", "cone")])
def test_a_preset_is_called_what_every_system_takes(scene, own, title, stem):
    assert bpy.ops.icymoon.add_preset(title=title) == {"FINISHED"}
    assert [path.name for path in own.iterdir()] == [f"{stem}.toml"]
    assert presets.find_title(scene.icymoon.preset) == title


def test_a_file_with_a_preset_of_another_machine_still_draws(scene, own):
    scene.icymoon.preset = "own/lost"
    assert presets.find_title("own/lost") == "lost"
    with pytest.raises(IcyMoonError, match="does not exist on this machine"):
        presets.find_preset("own/lost")


def test_without_an_installed_extension_there_is_no_place_for_presets(scene):
    assert presets.list_own_presets() == {}
    with pytest.raises(RuntimeError, match="does not run as an installed extension"):
        bpy.ops.icymoon.add_preset(title="Nowhere")


def test_every_shipped_scene_has_a_picture_that_chooses_it(scene):
    pictures = [item[0] for item in previews.load_choices()][1:]
    assert pictures == [*preset_files.preset_names("gallery"), *preset_files.preset_names("scenes")]
    assert choice() == "NONE"
    for name in pictures:
        setattr(bpy.context.window_manager, previews.CHOICE, name)
        assert scene.icymoon.preset == name
        assert choice() == name
        assert preset_files.find_preview(name).stat().st_size < 20_000, "it goes into the zip"
    scene.icymoon.preset = ""
    assert choice() == "NONE"


@pytest.mark.heavy
def test_a_scene_that_is_chosen_by_its_picture_is_shown_at_once(scene, monkeypatch):
    setattr(bpy.context.window_manager, previews.CHOICE, "gallery/fresh_snow")
    assert find_collection(scene) is None, "without a window nothing is built"
    monkeypatch.setattr(live_preview, "has_window", lambda: True)
    monkeypatch.setattr(
        preset_files,
        "load",
        lambda path, load=preset_files.load: merged(
            load(path), {"mesh": {"kind": "GRID"}, "terrain": {"resolution": 33}}
        ),
    )
    setattr(bpy.context.window_manager, previews.CHOICE, "gallery/ridge")
    built = find_collection(scene)
    assert built is not None
    setattr(bpy.context.window_manager, previews.CHOICE, "gallery/block_field")
    assert find_collection(scene) == built, "the live preview shows it"


@pytest.mark.heavy
def test_a_preset_that_is_saved_after_a_render_has_its_picture(small, own, tmp_path):
    shipped = len(previews.load_choices())
    small.icymoon.dataset.folder = str(tmp_path / "set")
    bpy.ops.icymoon.add_preset(title="Before")
    assert len(previews.load_choices()) == shipped
    assert bpy.ops.icymoon.render_pair() == {"FINISHED"}
    bpy.ops.icymoon.add_preset(title="Site")
    image = bpy.data.images.load(str(own / "site.png"))
    assert 16 < max(image.size) <= presets.PICTURE_PX
    assert np.ptp(np.array(image.pixels)[::4]) > 0.1, "it shows something"
    assert previews.load_choices()[-1][0] == "own/site"
    assert len({item[4] for item in previews.load_choices()}) == shipped + 1
    small.icymoon.terrain.size_m += 1.0
    bpy.ops.icymoon.add_preset(title="Site")  # of settings that have no pair
    assert not (own / "site.png").exists()
    assert len(previews.load_choices()) == shipped
    assert bpy.ops.icymoon.remove_preset() == {"FINISHED"}
    assert not list(own.glob("site*"))


def described(group) -> Settings:
    found = scene_properties.read_settings(group)
    del found["dataset"]
    return found


@pytest.mark.long
def test_a_whole_scene_is_the_same_whatever_was_loaded_before(scene):
    """After every other preset; but the quality that a person chose by a preset of qualities stays."""
    names = preset_files.preset_names()
    whole = [name for name in names if preset_files.is_whole_scene(name)]
    assert {name.split("/")[0] for name in whole} == {"scenes", "gallery"}
    alone = {}
    for name in whole:
        scene_properties.write_settings(scene.icymoon, description.defaults())
        scene.icymoon.preset = ""
        bpy.ops.icymoon.load_preset(preset=name)
        alone[name] = described(scene.icymoon)
        assert alone[name] == {
            topic: values
            for topic, values in description.merged(description.defaults(), preset_files.load_preset(name)).items()
            if topic != "dataset"
        }
    for k, before in enumerate(names):  # every one before some whole scene, and each of these after some other
        name = whole[k % len(whole)]
        scene_properties.write_settings(scene.icymoon, description.defaults())
        scene.icymoon.preset = ""
        bpy.ops.icymoon.load_preset(preset=before)
        bpy.ops.icymoon.load_preset(preset=name)
        found, wanted = described(scene.icymoon), alone[name]
        if before.startswith("qualities/"):
            own = preset_files.load_preset(name).get("quality", {})
            chosen = preset_files.load_preset(before).quality
            wanted = description.merged(wanted, {"quality": {**chosen, **own}})
        assert found == wanted, (before, name)
        assert scene.icymoon.preset == name


def test_a_quality_that_a_person_chose_outlives_the_scenes(scene):
    bpy.ops.icymoon.load_preset(preset="scenes/europa_chaos")
    scene.icymoon.quality.samples = 7
    bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    assert scene.icymoon.quality.samples == 7
    bpy.ops.icymoon.load_preset(preset="gallery/ridge")
    assert scene.icymoon.quality.samples == 8, "as the gallery says"
    bpy.ops.icymoon.load_preset(preset="scenes/europa_rough_ice")
    assert scene.icymoon.quality.samples == description.defaults().quality.samples


def test_a_scene_that_differs_from_its_preset_is_shown_as_changed(scene):
    bpy.ops.icymoon.load_preset(preset="scenes/europa_chaos")
    assert button_of_preset() == ("Europa chaos", "PRESET")
    # A preset keeps data set and quality, so these are no change of it.
    scene.icymoon.dataset.seed, scene.icymoon.quality.samples = 7, 11
    bpy.ops.icymoon.load_preset(preset="qualities/draft")
    assert button_of_preset() == ("Europa chaos", "PRESET")
    scene.icymoon.light.sun_elevation_deg += 1.0
    assert button_of_preset() == ("Europa chaos", "GREASEPENCIL")
    # The same picture brings the scene of the preset back.
    shown = choice()
    setattr(bpy.context.window_manager, previews.CHOICE, shown)
    assert button_of_preset() == ("Europa chaos", "PRESET")


def button_of_preset() -> tuple[str, str]:
    """The text and the icon of the button that chooses a preset. An icon is not cut, as words beside a title were."""
    record = drawn(sidebar.ICYMOON_PT_main)
    (options,) = (entry[2] for entry in record if entry[:2] == ("menu", "ICYMOON_MT_presets"))
    return options["text"], options["icon"]


def test_every_preset_of_a_scene_is_unchanged_once_it_is_loaded(scene):
    for name, *_ in presets.list_preset_items():
        if preset_files.is_whole_scene(name):
            bpy.ops.icymoon.load_preset(preset=name)
            assert not presets.is_changed(scene), name


def test_a_preset_that_is_gone_or_broken_is_no_change(scene, own):
    bpy.ops.icymoon.add_preset(title="Mine")
    assert not presets.is_changed(scene)
    scene.icymoon.terrain.hurst = 0.5
    assert presets.is_changed(scene)
    (own / "mine.toml").write_text("[terrain]\nno_such = 1\n")
    assert not presets.is_changed(scene)
    (own / "mine.toml").unlink()
    assert not presets.is_changed(scene)


def test_in_the_search_each_preset_has_a_text_of_its_own(scene):
    items = presets.list_search_items()
    assert [name for name, *_ in items] == [name for name, *_ in presets.list_preset_items()]
    texts = [text for _, text, _ in items]
    assert len({*texts}) == len(texts)
