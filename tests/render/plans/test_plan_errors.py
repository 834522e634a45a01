"""Plans that cannot be carried out: refused before anything is built, with the line at fault."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as trials
from hypothesis import strategies as st
from icymoon.formats.toml_lines import Place, find_line
from icymoon.render.plans.plan_file import find_plan, read_plan
from icymoon.settings.table import TOPICS, list_all_settings
from icymoon.support.errors import IcyMoonError

HEAD = '[plan]\ntitle = "Test"\n'

#: What is wrong (the line that says so ends in "# !"), and what the error says.
WRONG = {
    "a key of the plan": ('[plan]\ntitel = "x"  # !', ("titel", "title")),
    "a title that is none": ("[plan]\ntitle = 3  # !", ("title", "a text")),
    "a topic": (HEAD + "[terain]  # !\nsize_m = 3", ("terain", "terrain")),
    "a setting": (HEAD + "[terrain]\nhurst = 0.5\nsizem = 3  # !", ("terrain.sizem", "size_m")),
    "a range": (HEAD + "\n[terrain]\n# 20 would do\nsize_m = -1  # !", ("-1 m", "0.01 to")),
    "an include": (HEAD + 'include = ["terrains/low_1", "terrains/low"]  # !', ("terrains/low", "low_3")),
    "an include on lines": (HEAD + 'include = [\n  "terrains/low_1",\n  "terrains/low",  # !\n]', ("low_3",)),
    "a file that it extends": (HEAD + 'extends = "absent.toml"  # !', ("absent.toml", "cannot be read")),
    "seeds": (HEAD + "seeds = 0  # !", ("seeds", "a list of seeds")),
    "no seeds": (HEAD + "seeds = []  # !", ("seeds", "a list of seeds")),
    "a seed": (HEAD + "seeds = [1, -4]  # !", ("dataset.seed", "-4")),
    "grounds": (HEAD + "grounds = 0  # !", ("grounds", "from 1 up")),
    "grounds listed": (HEAD + "grounds = [1, 2]  # !", ("grounds", "whole number")),
    "at_most": (HEAD + "at_most = 0  # !", ("at_most", "from 1 up")),
    "a home folder": (HEAD + 'extends = "~nouser/x.toml"  # !', ("~nouser/x.toml", "no such home folder")),
    "a home folder of files": (HEAD + 'files = "~nouser/x"  # !', ("~nouser/x", "no such home folder")),
    "a home folder of a preset": (
        HEAD + '[[sweep]]\nkind = "grid"\npreset = ["~nouser/x.toml"]  # !',
        ("home folder",),
    ),
    "a home folder of a ground": (HEAD + '[source]\nkind = "MESH"\nfile = "~nouser/x.ply"  # !', ("home folder",)),
    "a path with a zero": (HEAD + 'extends = "a\\u0000b.toml"  # !', ("a\\x00b.toml", "a path cannot have")),
    "a ground with a zero": (HEAD + '[source]\nkind = "MESH"\nfile = "a\\u0000b.ply"  # !', ("a path cannot have",)),
    "a long name": (HEAD + f'extends = "{"n" * 3000}.toml"  # !', ("n…", "255 bytes")),
    "a long name of a ground": (HEAD + f'[source]\nkind = "MESH"\nfile = "{"n" * 3000}.ply"  # !', ("255 bytes",)),
    "a long way": (HEAD + f'files = "{"n/" * 3000}"  # !', ("4095",)),
    "a year of many digits": (
        HEAD + '[light]\ndirections_from = "DATE"\ndate_utc = "99999999999999999999-01-01"  # !',
        ("2035-03-01",),
    ),
    "headings of many seeds": (HEAD + "seeds = 1000\n[dataset]\nheadings = 360  # !", ("360000 pairs", "100000")),
    "more views than pairs": (
        HEAD + f'[[sweep]]  # !\nkind = "view_sphere"\ndistances_m = 2\nelevations_deg = {[30] * 400}\n'
        f"azimuths_deg = {[1] * 400}",
        ("160000 pairs", "100000"),
    ),
    "sweeps without end": (
        HEAD + '[[sweep]]\nkind = "panorama"\n' * 100 + '[[sweep]]  # !\nkind = "panorama"',
        ("a plan may have 100 sweeps",),
    ),
    "a plan extended without end": (
        HEAD + f"extends = {['datasets/guiss_smoke'] * 101}  # !",
        ("more than 100 plans",),
    ),
    "without": (HEAD + 'without = ["suns"]  # !', ("suns",)),
    "no kind": (HEAD + "[[sweep]]  # !\nsurface.albedo = [0.1]", ("kind", "grid")),
    "a kind": (HEAD + '[[sweep]]\nkind = "gird"  # !', ("gird", "'grid'")),
    "a second name": (
        HEAD + '[[sweep]]\nname = "a"\nkind = "panorama"\n[[sweep]]\nkind = "panorama"\nname = "a"  # !',
        ("already", "replaces"),
    ),
    "nothing to replace": (HEAD + '[[sweep]]\nkind = "panorama"\nreplaces = "b"  # !', ("no sweep 'b'",)),
    "an empty block": (HEAD + '[[sweep]]  # !\nkind = "grid"', ("varies nothing",)),
    "an empty list": (HEAD + '[[sweep]]\nkind = "grid"\nsurface.albedo = []  # !', ("surface.albedo", "must list")),
    "one value": (HEAD + '[[sweep]]\nkind = "grid"\nsurface.albedo = 0.3  # !', ("must list", "0.3")),
    "a swept setting": (HEAD + '[[sweep]]\nkind = "grid"\nsurface.albdo = [0.1]  # !', ("albdo", "albedo")),
    "a swept topic": (HEAD + '[[sweep]]\nkind = "grid"\nsurfaces.albedo = [0.1]  # !', ("surfaces", "surface")),
    "a swept setting in quotes": (
        HEAD + '[[sweep]]\nkind = "grid"\n"surface.albedo" = [0.1]  # !',
        ("quotes", "surface.albedo", "without"),
    ),
    "a case in quotes": (
        HEAD + '[[sweep]]\nkind = "cases"\ncase = [\n{ "surface.albedo" = 0.5 },  # !\n]',
        ("quotes", "surface.albedo", "without"),
    ),
    "a topic as factor": (HEAD + '[[sweep]]\nkind = "grid"\nsurface = [0.1]  # !', ("is a topic", "surface.")),
    "a value out of range": (HEAD + '[[sweep]]\nkind = "grid"\nsurface.albedo = [0.1, 1.5]  # !', ("1.5", "0 to 1")),
    "a value of another type": (HEAD + '[[sweep]]\nkind = "grid"\nsurface.albedo = [0.1, "a"]  # !', ("a number",)),
    "a swept camera response": (HEAD + '[[sweep]]\nkind = "grid"\nsensor.gain = [1, 2]  # !', ("--set", "evaluated")),
    "a swept folder": (HEAD + '[[sweep]]\nkind = "grid"\ndataset.folder = ["a"]  # !', ("changes no pair",)),
    "a swept preset": (HEAD + '[[sweep]]\nkind = "grid"\npreset = ["terrains/low"]  # !', ("low_3",)),
    "a preset without a name": (HEAD + '[[sweep]]\nkind = "grid"\npreset = [3]  # !', ("quotes", "3")),
    "cases": (HEAD + '[[sweep]]\nkind = "cases"\ncase = 3  # !', ("case = [",)),
    "an empty case": (HEAD + '[[sweep]]\nkind = "cases"\ncase = [\n{ rig.x_m = 1 },\n{},  # !\n]', ("sets nothing",)),
    "a case": (HEAD + '[[sweep]]\nkind = "cases"\ncase = [\n{ rig.x_m = 1 },\n{ rig.x = 1 },  # !\n]', ("x_m",)),
    "a key of cases": (HEAD + '[[sweep]]\nkind = "cases"\ncases = []  # !', ("'case'",)),
    "no count": (HEAD + '[[sweep]]  # !\nkind = "random"\nsurface.albedo = { uniform = [0, 1] }', ("count",)),
    "a count": (HEAD + '[[sweep]]\nkind = "random"\ncount = -3  # !\nsurface.albedo = { uniform = [0, 1] }', ("-3",)),
    "a list to draw from": (HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.albedo = [0, 1]  # !', ("choice",)),
    "a distribution": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.albedo = { unifrm = [0, 1] }  # !',
        ("unifrm", "uniform"),
    ),
    "its order": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.albedo = { uniform = [0.5, 0.5] }  # !',
        ("below",),
    ),
    "its range": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nterrain.size_m = { uniform = [0, 3] }  # !',
        ("outside", "0.01", " m"),
    ),
    "its numbers": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.albedo = { uniform = [0.5] }  # !',
        ("two numbers",),
    ),
    "a logarithm": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.albedo = { log_uniform = [0, 1] }  # !',
        ("above 0",),
    ),
    "a deviation": (HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nhapke.w = { normal = [0.5, 0] }  # !', ("above 0",)),
    "a far mean": (HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nhapke.w = { normal = [9, 0.1] }  # !', ("widen",)),
    "an empty choice": (HEAD + '[[sweep]]\nkind = "sobol"\ncount = 3\nsurface.model = { choice = [] }  # !', ("list",)),
    "a choice": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 9\nsurface.model = { choice = ["LAMBRT"] }  # !',
        ("LAMBERT",),
    ),
    "a text as a number": (
        HEAD + '[[sweep]]\nkind = "sobol"\ncount = 9\nsurface.model = { uniform = [0, 1] }  # !',
        ("is not a number",),
    ),
    "too many dimensions": (
        HEAD
        + '[[sweep]]  # !\nkind = "sobol"\ncount = 2\n'
        + "".join(
            f"{t}.{s.key} = {{ choice = [{s.default}] }}\n"
            for t, s in list_all_settings()
            if s.kind == "float" and t in ("surface", "hapke", "rocks")
        ),
        ("latin_hypercube",),
    ),
    "headings": (HEAD + '[[sweep]]\nkind = "panorama"\nheadings = 0  # !', ("headings",)),
    "no headings": (HEAD + '[[sweep]]\nkind = "panorama"\nheadings = []  # !', ("headings",)),
    "a heading out of range": (HEAD + '[[sweep]]  # !\nkind = "panorama"\nheadings = [1000]', ("rig.heading_deg",)),
    "a key of a panorama": (HEAD + '[[sweep]]\nkind = "panorama"\nheading = 4  # !', ("headings",)),
    "a view sphere without distances": (
        HEAD + '[[sweep]]  # !\nkind = "view_sphere"\nelevations_deg = 3\nazimuths_deg = 0',
        ("distances_m",),
    ),
    "a view from underground": (
        HEAD + '[[sweep]]  # !\nkind = "view_sphere"\nelevations_deg = -30\nazimuths_deg = 0\ndistances_m = 3',
        ("under the ground", "target_height_m"),
    ),
    "a view from beyond the ground": (
        HEAD + '[mesh]\nkind = "GRID"\n[[sweep]]  # !\nkind = "view_sphere"\n'
        "elevations_deg = 30\nazimuths_deg = 0\ndistances_m = 30",
        ("beyond the ground",),
    ),
    "no room for sites": (
        HEAD + '[[sweep]]  # !\nkind = "sites"\ncount = 9\napart_m = 12',
        ("has room for", "apart_m"),
    ),
    "sites on a patch too small": (HEAD + '[[sweep]]  # !\nkind = "sites"\ncount = 1\nmargin_m = 10', ("room for 0",)),
    "a site outside": (HEAD + '[mesh]\nkind = "GRID"\n[rig]\nx_m = 12  # !', ("outside the ground",)),
    "a swept site outside": (
        HEAD + '[mesh]\nkind = "GRID"\n[[sweep]]\nkind = "grid"\nrig.x_m = [1, 12]  # !',
        ("east 12 m", "outside the ground"),
    ),
    "an eye in the ground": (
        HEAD + "[terrain]\nrms_slope_deg = 40\n[rig]\nheight_m = 0.001  # !\nbaseline_m = 5",
        ("right eye", "under the ground"),
    ),
    "an eye in a rock": (
        HEAD + "[terrain]\nrms_slope_deg = 0\n"
        "[rocks]\ncoverage = 0.5\nsmallest_m = 1\nlargest_m = 1\n"
        "height_ratio = 3\nburial = 0\n[rig]\nbaseline_m = 3\nheight_m = 0.5\n[[sweep]]  # !\n"
        'kind = "panorama"\nheadings = [10]',
        ("in a rock",),
    ),
    "contradictory sizes": (HEAD + "[rocks]\ncoverage = 0.1\nlargest_m = 0.05  # !\nsmallest_m = 0.1", ("below",)),
    "a texture that is not there": (
        HEAD + '[textures]\nset = "OWN"\nalbedo_file = "ice.png"  # !',
        ("ice.png", "is missing", "plan.files"),
    ),
    "a mesh that is not there": (
        HEAD + '[[sweep]]\nkind = "cases"\ncase = [\n'
        '{ source.kind = "PROCEDURAL" },\n'
        '{ source.kind = "MESH", source.file = "a.ply" },  # !\n]',
        ("a.ply", "is missing"),
    ),
    "a mesh without a name": (HEAD + '[source]\nkind = "MESH"  # !', ("source.file", "empty")),
    "sites on a mesh": (
        HEAD + '[source]\nkind = "MESH"\n[[sweep]]  # !\nkind = "sites"\ncount = 2',
        ("ground from a file",),
    ),
    "a date": (HEAD + '[light]\ndirections_from = "DATE"\ndate_utc = "soon"  # !', ("date_utc",)),
    "too many pairs": (
        HEAD + '[[sweep]]\nkind = "random"\ncount = 1000000  # !\nsurface.albedo = { uniform = [0, 1] }',
        ("1000000", "100000"),
    ),
    "sweep as a table": (HEAD + '[sweep]  # !\nkind = "grid"', ("[[sweep]]",)),
}


@pytest.mark.parametrize(("text", "words"), WRONG.values(), ids=WRONG.keys())
def test_an_error_names_the_file_the_line_and_the_mend(tmp_path, text, words):
    tomllib.loads(text)  # what is wrong is what is said, not TOML
    file = tmp_path / "plan.toml"
    file.write_text(text)
    with pytest.raises(IcyMoonError) as caught:
        read_plan(file).pairs()
    line = next(k for k, each in enumerate(text.splitlines(), 1) if each.endswith("# !"))
    message = str(caught.value)
    assert message.startswith(f"{file}, line {line}: "), message
    assert message[-1] in ".?", message
    assert "\n" not in message
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    ("text", "words"),
    [("[plan\n", ("not valid TOML", "line 1")), ("[rig]\nx_m = 1\n", ("no [plan]",)), ("plan = 3", ("no [plan]",))],
)
def test_a_file_that_is_no_plan(tmp_path, text, words):
    file = tmp_path / "plan.toml"
    file.write_text(text)
    with pytest.raises(IcyMoonError, match=re.escape(str(file))) as caught:
        read_plan(file)
    assert all(word in str(caught.value) for word in words)


def test_what_is_wrong_in_a_plan_that_is_extended_is_told_there(tmp_path):
    (tmp_path / "parent.toml").write_text(HEAD + "[terrain]\nsizem = 3\n")
    (tmp_path / "child.toml").write_text(HEAD + 'extends = "parent.toml"\n')
    with pytest.raises(IcyMoonError, match=r"child\.toml, line 3: .*parent\.toml, line 4: .*sizem"):
        read_plan(tmp_path / "child.toml")


def test_plans_that_extend_each_other(tmp_path):
    for name, other in (("a.toml", "b.toml"), ("b.toml", "a.toml")):
        (tmp_path / name).write_text(HEAD + f'extends = "{other}"\n')
    with pytest.raises(IcyMoonError, match="in turn"):
        read_plan(tmp_path / "a.toml")


def test_an_unknown_plan():
    with pytest.raises(IcyMoonError, match="Unknown plan"):
        find_plan("../../pyproject")


_KEYS = st.sampled_from(
    [
        "title",
        "extends",
        "include",
        "seeds",
        "grounds",
        "at_most",
        "files",
        "without",
        "kind",
        "count",
        "case",
        "headings",
        "rig",
        "surface",
        "preset",
        "name",
        "replaces",
        "x_m",
        "albedo",
        "uniform",
    ]
)
_VALUES = st.recursive(
    st.one_of(
        st.integers(-3, 9),
        st.booleans(),
        st.floats(-1, 3),
        st.just([]),
        st.sampled_from(["grid", "random", "sites", "panorama", "cases", "low_1", ""]),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(_KEYS, inner, max_size=3)),
    max_leaves=6,
)


def _toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)


@trials(deadline=None)  # each reads files
@given(
    st.dictionaries(_KEYS, _VALUES, max_size=3),
    st.lists(st.dictionaries(_KEYS, _VALUES, max_size=4), max_size=2),
    st.sampled_from(
        [
            None,
            "grid",
            "one_at_a_time",
            "cases",
            "random",
            "sobol",
            "latin_hypercube",
            "panorama",
            "view_sphere",
            "sites",
        ]
    ),
)
def test_nothing_but_pairs_or_a_sentence_comes_of_any_plan(tmp_path_factory, header, sweeps, kind):
    lines = ["[plan]", *(f"{k} = {_toml(v)}" for k, v in header.items())]
    for table in sweeps:
        table = table | ({"kind": kind} if kind else {})
        lines += ["[[sweep]]", *(f"{k} = {_toml(v)}" for k, v in table.items())]
    file = tmp_path_factory.mktemp("plan") / "plan.toml"
    file.write_text("\n".join(lines))
    said = ""
    try:
        pairs = read_plan(file).pairs()
    except IcyMoonError as error:
        pairs, said = [], str(error)
    assert bool(pairs) != (str(file) in said)


def test_a_line_is_found_in_every_spelling():
    text = (
        '# a comment\n\n[a]\n"b c" = """\n[a.d]\n"""\n\nd.e = [\n  # first\n  1,\n  { f = 2 },\n]\n'
        "[[g]]\nh = 1\n[[g]]\n# more\n[g.i]\nh = [[1,\n2]]\n"
    )
    for key, line in (
        (("a",), 3),
        (("a", "b c"), 4),
        (("a", "d", "e"), 8),
        (("a", "d", "e", 0), 10),
        (("a", "d", "e", 1, "f"), 11),
        (("g", 0, "h"), 14),
        (("g", 1), 15),
        (("g", 1, "i", "h"), 18),
        (("g", 2), None),
        (("x",), None),
    ):
        assert find_line(text, key) == line, key
    assert str(Place(Path("f"), text, ("g", 1, "absent", 3))) == "f, line 15"


def test_every_setting_of_a_plan_is_found_in_its_line():
    lines, where = [], {}
    for topic in TOPICS.values():
        lines.append(f"[{topic.key}]")
        for setting in topic.settings:
            lines.append(f"{setting.key} = 1")
            where[topic.key, setting.key] = len(lines)
    keys = list(where)[::17]
    assert [find_line("\n".join(lines), key) for key in keys] == [where[key] for key in keys]


def test_a_height_map_whose_pixels_have_no_size_is_refused_with_its_line(tmp_path):
    np.save(tmp_path / "dem.npy", np.zeros((5, 5)))
    plan = tmp_path / "plan.toml"
    text = HEAD + '[source]\nkind = "HEIGHT_MAP"\nfile = "dem.npy"\n'
    plan.write_text(text, encoding="utf-8")
    with pytest.raises(
        IcyMoonError, match=r"plan\.toml, line 5: .*dem\.npy: does not state the size of its pixels; set so"
    ):
        read_plan(plan).pairs()
    plan.write_text(text + "metres_per_pixel = 0.5\n", encoding="utf-8")
    assert len(read_plan(plan).pairs()) == 1


def test_each_head_of_a_sweep_is_read(tmp_path):
    good = '[[camera]]\nname = "a"\nmodel = "PINHOLE"\nwidth_px = 16\nheight_px = 12\nfield_deg = 60\n'
    (tmp_path / "good.toml").write_text(good, encoding="utf-8")
    (tmp_path / "bad.toml").write_text(good.replace("PINHOLE", "PINHOLES"), encoding="utf-8")
    plan = tmp_path / "plan.toml"
    plan.write_text(HEAD + '[[sweep]]\nkind = "grid"\nrig.head_file = ["good.toml", "bad.toml"]\n', encoding="utf-8")
    with pytest.raises(IcyMoonError, match=r"line 5: .*bad\.toml"):
        read_plan(plan).pairs()
