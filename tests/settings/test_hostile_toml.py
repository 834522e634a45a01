"""Settings and plans of strangers: a sentence, in bounded time, whatever the text is."""

from __future__ import annotations

import os
from contextlib import suppress

import numpy as np
import pytest
from icymoon.formats.toml_lines import find_line
from icymoon.render.pairs.scene_splits import DEFAULT_SPLITS, read_splits
from icymoon.render.plans.plan_file import HEADER, read_plan
from icymoon.settings.description import override
from icymoon.settings.preset_files import load
from icymoon.stereo.datasets.plain_folder import parse_pairs_toml
from icymoon.stereo.decisions.rules import read_rules
from icymoon.support.errors import IcyMoonError

pytestmark = pytest.mark.timeout(60)
PLAN = '[plan]\ntitle = "a"\nseeds = 2\n[terrain]\nsize_m = 20.0\n'


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 10**5,
        "a = " + "{a=" * 10**5,
        "a" + ".a" * 10**5 + " = 1",
        f"[{'a.' * 10**5}a]\nb = 1",
        "a = " + "9" * 5000,
        "a = 1e9999",
        "a = nan",
        "[terrain]\nsize_m = inf",
        "[terrain]\nsize_m = 1" + "0" * 4000,
        "\0",
        "\x1b[31m",
        'a = "\x1b"',
        "a = '",
        "[a",
        "[a]\n[a]",
        "a = 1\na = 2",
        "= 1",
        "[[terrain]]\nsize_m = 1",
        "terrain = 1",
        "terrain = []",
        "a.b = 1",
        '"\x1b[31m" = 1',
        '"' + "a" * 10**5 + '" = 1',
        "[terrain]\nsize_m = [[[[[[[[1]]]]]]]]",
        "plan = 1",
        "sweep = 1",
        "a = {" + "b = {" * 300 + "}" * 300 + "}",
        "a = 99999-99-99",
        "[terrain]\nsize_m = 2020-01-01",
        "[source]\nfile = 3",
    ],
    ids=range(30),
)
@pytest.mark.parametrize("read", [load, read_plan])
def test_a_hostile_file_is_a_sentence(tmp_path, text, read):
    (tmp_path / "a.toml").write_text((PLAN if read is read_plan else "") + text, encoding="utf-8")
    with pytest.raises(IcyMoonError) as caught:
        read(tmp_path / "a.toml")
    assert str(caught.value).startswith(f"{tmp_path / 'a.toml'}")
    assert len(str(caught.value)) < 3000


@pytest.mark.long
@pytest.mark.heavy
@pytest.mark.parametrize(
    "text",
    [
        "\n".join(f"a{k} = 1" for k in range(300_000)),
        "\n".join(f"[a{k}]" for k in range(400_000)),
        "#" * 70_000_000,
        PLAN + "[rig]\n" + "\n".join(f"a{k} = 1" for k in range(200_000)),
        PLAN + "#\n" * 10**6 + "[rig]\nzz = 1",
    ],
    ids=range(5),
)
def test_a_large_file_is_refused_in_bounded_time(tmp_path, text):
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    with pytest.raises(IcyMoonError):
        read_plan(tmp_path / "a.toml")


HEX = "0x" + "f" * 20000
VALUES = [
    "9" * 5000,
    HEX,
    "9" * 300,
    "1979-05-27T07:32:00Z",
    "1979-05-27",
    "07:32:00",
    "{a = 1}",
    "[1, 2, [3]]",
    "[{}]",
    "true",
    "nan",
    "-inf",
    "1e400",
    '"' + "x" * 3000 + '"',
    '"\\u202e\\u0000\\u001b"',
    "[nan]",
    f"[{HEX}]",
    f"{{uniform = [1, {HEX}]}}",
    f"{{uniform = [1, 0x{'f' * 255}]}}",
    "{normal = [1979-05-27, 1]}",
    "10000000000",
]
#: Words of Python in place of what the file contains.
PYTHON = ("datetime", "sys.", "<class", "object at", "True", "False", "None", "{'", "inf px")


@pytest.mark.parametrize("value", VALUES, ids=range(len(VALUES)))
def test_a_value_of_another_kind_is_named_plainly(tmp_path, value):
    plans = [f"[plan]\n{key} = {value}\n" for key in HEADER if key != "without"]
    plans += [
        "[plan]\n[[sweep]]\n" + text
        for text in (
            f"kind = {value}\n",
            f'kind = "grid"\nname = {value}\n',
            f'kind = "grid"\nrig.width_px = {value}\n',
            f'kind = "grid"\npreset = {value}\n',
            f'kind = "random"\ncount = 2\nrig.width_px = {value}\n',
            f'kind = "sobol"\ncount = {value}\nrig.width_px = {{uniform = [100, 200]}}\n',
            f'kind = "cases"\ncase = {value}\n',
            f'kind = "panorama"\nheadings = {value}\n',
            f'kind = "panorama"\npitches_deg = {value}\n',
            f'kind = "descent"\nheights_m = {value}\n',
        )
    ]
    presets = [f"[preset]\n{key} = {value}\n" for key in ("include", "title", "made_with")]
    presets += [
        f"[{topic}]\n{key} = {value}\n"
        for topic, key in (
            ("rig", "width_px"),
            ("rig", "baseline_m"),
            ("light", "stars"),
            ("surface", "model"),
            ("terrain", "layers"),
        )
    ]
    others = [f"[site]\nslope_deg = {value}\n", f"site = {value}\n", f"[camera]\nfocal_px = {value}\n"]
    file = tmp_path / "a.toml"
    for read, texts in (
        (lambda path: read_plan(path).pairs(), plans),
        (load, presets),
        (read_rules, others[:2]),
        (parse_pairs_toml, [*others[2:], f"images.left = {value}\n"]),
    ):
        for text in texts:
            file.write_text(text, encoding="utf-8")
            try:
                read(file)
            except IcyMoonError as error:
                message = str(error)
                assert message.startswith(str(file)), text[:100]
                assert len(message) < 900, text[:100]
                assert not [word for word in PYTHON if word in message], message


@pytest.mark.parametrize("value", VALUES, ids=range(len(VALUES)))
def test_a_value_of_set_is_named_plainly(value):
    for name in ("rig.width_px", "rig.baseline_m", "light.stars", "terrain.layers", "surface.model"):
        with suppress(IcyMoonError):
            override(f"{name}={value}")
            continue
        with pytest.raises(IcyMoonError) as caught:
            override(f"{name}={value}")
        assert len(str(caught.value)) < 400
        assert not [word for word in PYTHON if word in str(caught.value)]


def test_a_preset_that_a_file_includes_is_named_with_the_file(tmp_path):
    file = tmp_path / "a.toml"
    for name, words in (
        ("a.toml", "names this file itself; leave it out"),
        ("./a.toml", "names this file itself"),
        ("b.toml", "names the file 'b.toml', and only shipped presets"),
        ("zzz", "Unknown preset 'zzz'"),
        ("scenes/europa_rough_icy", "did you mean 'scenes/europa_rough_ice'"),
        ("scenes/europa_rough_ice.toml", "did you mean 'scenes/europa_rough_ice'"),
        ("../a\\u0000.toml", "names the file"),
    ):
        file.write_text(f'[preset]\ninclude = ["{name}"]\n', encoding="utf-8")
        with pytest.raises(IcyMoonError) as caught:
            load(file)
        assert str(caught.value).startswith(f"{file}: preset.include")
        assert words in str(caught.value)
        assert len(str(caught.value)) < 400


def test_what_is_no_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    for path in (tmp_path / "pipe.toml", tmp_path, tmp_path / "absent.toml"):
        for read in (load, read_plan):
            with pytest.raises(IcyMoonError):
                read(path)


@pytest.mark.parametrize("seed", range(5))
def test_a_damaged_file_is_read_or_refused(tmp_path, seed):
    random = np.random.default_rng(seed)
    for _ in range(200):
        data = bytearray(PLAN.encode())
        for at in random.integers(0, len(data), 2):
            data[at] = random.integers(0, 256)
        (tmp_path / "a.toml").write_bytes(data)
        for read in (load, read_plan):
            with suppress(IcyMoonError):
                read(tmp_path / "a.toml")


LINES = {
    ("a",): 1,
    ("b",): 4,
    ("b", 0): 5,
    ("b", 1): 6,
    ("c",): 9,
    ("d",): None,
    ("e",): 12,
    ("e", "f", "g"): 13,
    ("h", 0): 14,
    ("h", 0, "i", "j"): 15,
    ("h", 1): 16,
    ("h", 1, "k", "l"): 17,
    ("h", 2): None,
    ("a", "b"): None,
}
TEXT = """a = 1

# b
b = [
  1,
  [2,
   3],
]
c = '''
d = 4
'''
[e.f]
g = 1
[[h]]
i = {j = 1}
[[h]]
k.l = 2
"""


@pytest.mark.parametrize("key", LINES)
def test_the_line_of_a_key_is_that_of_its_beginning(key):
    assert find_line(TEXT, key) == LINES[key]


@pytest.mark.parametrize(
    "text",
    ["a = 1\n" * 1000 + "b = 2", "a = [\n" + "1,\n" * 2000 + "]\nb = 2", "a = '''\n" + "\n" * 10**6 + "'''\nb = 2"],
)
def test_a_line_is_found_in_bounded_time_or_not_at_all(text):
    assert find_line(text, ("b",)) in (None, len(text.splitlines()))


LONG = {
    "[rig]\nzz = 1": 2,
    "[rig]\nwidth_px = 'a'": 2,
    "rig.width_px = 1": 1,
    "[[sweep]]\nname = 'x'": 1,
    "[[sweep]]\nkind = 'grid'\nrig.width_px = [10]\n[[sweep]]\nkind = 'grid'\nrig.pitch_deg = [1, 'x']": 6,
    "[[sweep]]\nkind = 'grid'\n[sweep.rig]\nwidth_px = ['x']": 4,
    "['rig']\n  'width_px' = 1 # = 2\n": 2,
}


@pytest.mark.long
@pytest.mark.parametrize("text", LONG, ids=range(len(LONG)))
def test_the_line_is_named_a_million_lines_down(tmp_path, text):
    file = tmp_path / "a.toml"
    file.write_text(PLAN + "#\n" * 10**6 + text, encoding="utf-8")
    with pytest.raises(IcyMoonError) as caught:
        read_plan(file).pairs()
    assert str(caught.value).startswith(f"{file}, line {10**6 + 5 + LONG[text]}: ")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\n",
        b"{}",
        b"[]",
        b'{"plan": 3}',
        b'{"plan": "[plan"}',
        b'{"plan": "plan = 1"}',
        b"[" * 10**5,
        b"\xff" * 10**5,
        b"x" * 10**7,
        b'{"plan": "a = ' + b"[" * 10**5 + b'"}',
    ],
    ids=range(11),
)
def test_the_splits_of_a_damaged_plan_are_the_usual_ones(tmp_path, content):
    (tmp_path / "plan.jsonl").write_bytes(content)
    assert read_splits(tmp_path) == DEFAULT_SPLITS
