"""Collada meshes of a link: places by hand, and what a stranger's file may not do."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from icymoon.physics.arm import link_mesh
from icymoon.physics.arm.link_mesh import read_link_mesh
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError

XYZ = '<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>'
#: Corners of a unit square, and one above its first.
SQUARE = "0 0 0 1 0 0 1 1 0 0 1 0 0 0 1"


def source(
    name: str = "p",
    numbers: str = SQUARE,
    accessor: str = 'count="5" stride="3"',
    params: str = XYZ,
    count: int | None = None,
) -> str:
    count = len(numbers.split()) if count is None else count
    return (
        f'<source id="{name}"><float_array id="{name}a" count="{count}">{numbers}</float_array><technique_common>'
        f'<accessor source="#{name}a" {accessor}>{params}</accessor></technique_common></source>'
    )


def vertices(name: str = "v", of: str = "p") -> str:
    return f'<vertices id="{name}"><input semantic="POSITION" source="#{of}"/></vertices>'


INPUT = '<input semantic="VERTEX" source="#v" offset="0"/>'
TRIANGLE = f'<triangles count="1">{INPUT}<p>0 1 2</p></triangles>'


def geometry(inside: str = source() + vertices() + TRIANGLE, name: str = "g") -> str:
    return f'<geometry id="{name}"><mesh>{inside}</mesh></geometry>'


def document(
    geometries: str = geometry(),
    nodes: str = '<node><instance_geometry url="#g"/></node>',
    asset: str = '<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>',
    rest: str = "",
    scene: str = '<scene><instance_visual_scene url="#s"/></scene>',
) -> str:
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" '
        f'version="1.4.1">{asset}<library_geometries>{geometries}</library_geometries>{rest}'
        f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>{scene}'
        "</COLLADA>"
    )


def faces_of(path, text: str) -> Array:
    """Corners (m, 3, 3) of the triangles of a file."""
    path.write_text(text, encoding="utf-8")
    found, triangles = read_link_mesh(path)
    return found[triangles]


def primitives(text: str) -> str:
    return document(geometry(source() + vertices() + text))


CORNERS = np.array(SQUARE.split(), float).reshape(5, 3)


@pytest.mark.parametrize(
    ("text", "triangles"),
    [
        (TRIANGLE, [(0, 1, 2)]),
        (TRIANGLE.replace("0 1 2", "\n0\t1\r\n2\n"), [(0, 1, 2)]),
        (
            f'<polylist count="3">{INPUT}<vcount>4 2 3</vcount><p>0 1 2 3 0 1 4 3 2</p></polylist>',
            [(0, 1, 2), (0, 2, 3), (4, 3, 2)],
        ),
        (f'<polygons count="2">{INPUT}<p>0 1 2 3</p><p>4 3 2</p></polygons>', [(0, 1, 2), (0, 2, 3), (4, 3, 2)]),
        (f'<trifans count="1">{INPUT}<p>0 1 2 3 4</p></trifans>', [(0, 1, 2), (0, 2, 3), (0, 3, 4)]),
        (f'<tristrips count="2">{INPUT}<p>0 1 3 2</p><p>4 0 1</p></tristrips>', [(0, 1, 3), (3, 1, 2), (4, 0, 1)]),
        # Three numbers for each corner, of which the second is the vertex; one input shares its place.
        (
            '<triangles count="2"><input semantic="NORMAL" source="#n" offset="0"/><input semantic="VERTEX" '
            'source="#v" '
            'offset="1"/><input semantic="TEXCOORD" source="#t" offset="2" set="0"/><input semantic="COLOR" '
            'source="#c" '
            'offset="1"/><p>9 0 7 9 1 7 9 2 7  9 2 7 9 3 7 9 4 7</p></triangles>',
            [(0, 1, 2), (2, 3, 4)],
        ),
        (
            TRIANGLE + TRIANGLE.replace("0 1 2", "4 3 2") + f'<lines count="1">{INPUT}<p>0 1</p></lines>',
            [(0, 1, 2), (4, 3, 2)],
        ),
        (f'{TRIANGLE}<triangles count="0">{INPUT}</triangles>', [(0, 1, 2)]),
    ],
)
def test_each_kind_of_face_is_its_triangles(tmp_path, text, triangles):
    assert np.array_equal(faces_of(tmp_path / "m.dae", primitives(text)), CORNERS[np.array(triangles)])


def test_numbers_are_taken_as_the_accessor_states(tmp_path):
    numbers = "77 " + " ".join(f"{x} 66 {y} {z} 55" for x, y, z in CORNERS)
    params = (
        '<param name="X" type="float"/><param type="float"/><param name="Y" type="float"/>'
        '<param name="Z" type="float"/>'
    )
    text = document(
        geometry(
            source(numbers=numbers, accessor='count="5" offset="1" stride="5"', params=params) + vertices() + TRIANGLE
        )
    )
    assert np.array_equal(faces_of(tmp_path / "m.dae", text)[0], CORNERS[:3])


def test_a_source_may_be_shared_and_a_geometry_may_have_two(tmp_path):
    second = source("q", "5 5 5 6 5 5 5 6 5", 'count="3" stride="3"')
    one = geometry(
        source()
        + second
        + vertices()
        + vertices("w", "q")
        + TRIANGLE
        + TRIANGLE.replace("#v", "#w")
        + TRIANGLE.replace("0 1 2", "2 3 4")
    )
    other = geometry(vertices("x") + TRIANGLE.replace("#v", "#x").replace("0 1 2", "4 1 0"), "h")
    found = faces_of(
        tmp_path / "m.dae",
        document(one + other, '<node><instance_geometry url="#g"/><instance_geometry url="#h"/></node>'),
    )
    late = [[5, 5, 5], [6, 5, 5], [5, 6, 5]]
    assert np.array_equal(found, np.array([CORNERS[[0, 1, 2]], late, CORNERS[[2, 3, 4]], CORNERS[[4, 1, 0]]]))


def test_transforms_are_nested_and_in_their_order(tmp_path):
    # Inside out: twice as long in x, a quarter turn about z, one along x, then the outer node: three along y, and a
    # quarter turn about x after it.
    nodes = (
        "<node><translate>0 3 0</translate><rotate>1 0 0 90</rotate><node><translate>1 0 0</translate>"
        '<rotate sid="z">0 0 2 90</rotate><scale>2 1 1</scale><instance_geometry url="#g"/></node></node>'
    )
    found = faces_of(tmp_path / "m.dae", document(nodes=nodes))[0]
    # (0,0,0), (1,0,0), (1,1,0) -> x doubled (0,0,0), (2,0,0), (2,1,0) -> turned (0,0,0), (0,2,0), (-1,2,0)
    # -> moved (1,0,0), (1,2,0), (0,2,0) -> turned about x: y to z -> moved by 3 along y
    assert found == pytest.approx(np.array([[1, 3, 0], [1, 3, 2], [0, 3, 2]]), abs=1e-15)


def test_a_matrix_is_by_rows_and_a_mirror_keeps_the_outside(tmp_path):
    nodes = '<node><matrix>0 -1 0 5\n 1 0 0 6\n 0 0 -2 7\n 0 0 0 1</matrix><instance_geometry url="#g"/></node>'
    text = document(geometry(source() + vertices() + TRIANGLE.replace("0 1 2", "0 1 4")), nodes)
    found = faces_of(tmp_path / "m.dae", text)[0]
    assert np.array_equal(found, np.array([[5, 6, 5], [5, 7, 7], [5, 6, 7]]))  # (4), (1), (0): turned around


def test_nodes_of_a_library_are_shown_where_they_are_named(tmp_path):
    library = (
        '<library_nodes><node id="n"><translate>0 0 1</translate><instance_geometry url="#g"/></node>'
        '<node id="m"><scale>3 3 3</scale><instance_node url="#n"/></node></library_nodes>'
    )
    nodes = (
        '<node><instance_node url="#n"/><translate>10 0 0</translate></node><node><instance_node url="#m"/></node>'
        '<node><instance_camera url="#c"/><instance_light url="#l"/><extra/></node>'
    )
    found = faces_of(tmp_path / "m.dae", document(nodes=nodes, rest=library))
    assert np.array_equal(found, [CORNERS[:3] + np.array([10, 0, 1]), 3 * CORNERS[:3] + np.array([0, 0, 3])])


@pytest.mark.parametrize("axis", ["X_UP", "Y_UP", "Z_UP"])
def test_the_unit_counts_and_the_upward_axis_does_not(tmp_path, axis):
    text = document(
        asset=f'<asset><unit name="inch" meter="0.0254"/><up_axis>{axis}</up_axis></asset>',
        nodes='<node><translate>2 0 0</translate><instance_geometry url="#g"/></node>',
    )
    assert faces_of(tmp_path / "m.DAE", text)[0] == pytest.approx(0.0254 * (CORNERS[:3] + np.array([2, 0, 0])))
    assert faces_of(tmp_path / "m.dae", document(asset=""))[0] == pytest.approx(CORNERS[:3])


def test_only_the_scene_that_is_shown_is_read(tmp_path):
    other = '</visual_scene><visual_scene id="t"><node><instance_geometry url="#absent"/></node>'
    text = document(nodes='<node><instance_geometry url="#g"/></node>' + other)
    assert len(faces_of(tmp_path / "m.dae", text)) == 1
    assert len(faces_of(tmp_path / "m.dae", document(scene=""))) == 1
    (tmp_path / "m.dae").write_text(text.replace('<scene><instance_visual_scene url="#s"/></scene>', ""))
    with pytest.raises(IcyMoonError, match="2 scenes"):
        read_link_mesh(tmp_path / "m.dae")


def polylist(count: object = 1, vcount: str = "3", p: str = "0 1 2", inputs: str = INPUT) -> str:
    return primitives(f'<polylist count="{count}">{inputs}<vcount>{vcount}</vcount><p>{p}</p></polylist>')


def laughing(levels: int = 40) -> str:
    """Nodes that show each other twice, again and again."""
    nodes = "".join(
        f'<node id="n{k}"><instance_node url="#n{k + 1}"/><instance_node url="#n{k + 1}"/></node>'
        for k in range(levels)
    )
    last = f'<node id="n{levels}"><instance_geometry url="#g"/></node>'
    return document(
        nodes='<node><instance_node url="#n0"/></node>', rest=f"<library_nodes>{nodes}{last}</library_nodes>"
    )


def many(count: int, start: str, each: str, end: str) -> str:
    return start + each * count + end


ENTITY = '<!DOCTYPE a [<!ENTITY l0 "0 ">' + "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(9)) + "]>"
BIG = "9" * 5000
HOSTILE = {
    "entities": (document().replace("<COLLADA", ENTITY + "<COLLADA").replace("0 1 2", "&l9;"), "document type"),
    "outside": (document().replace("<COLLADA", '<!DOCTYPE a SYSTEM "/etc/passwd"><COLLADA'), "document type"),
    "empty": ("", "no element"),
    "cut": (document()[:-30], "not a Collada mesh"),
    "other root": ("<robot/>", "<robot>"),
    "zeros": ("\0" * 10**6, "not well-formed"),
    "no scene": ("<COLLADA/>", "0 scenes"),
    "nothing": (document(nodes=""), "shows no triangle"),
    "absent": (document(nodes='<node><instance_geometry url="#x"/></node>'), "no <geometry> has the id 'x'"),
    "no url": (document(nodes="<node><instance_geometry/></node>"), "no <geometry> has the id ''"),
    "twice": (document(geometry() + geometry("")), "2 <geometry> have the id 'g'"),
    "other file": (document(nodes='<node><instance_geometry url="../x.dae#g"/></node>'), "in another file"),
    "net": (document(nodes='<node><instance_node url="http://x/y.dae#g"/></node>'), "in another file"),
    "skin": (document(nodes='<node><instance_controller url="#c"/></node>'), "instance_controller"),
    "ring": (document(nodes='<node id="a"><node id="b"><instance_node url="#a"/></node></node>'), "more than 100000"),
    "laughs": (laughing(), "more than 100000"),
    "many parts": (document(nodes="<node>" + '<instance_geometry url="#g"/>' * 100_001 + "</node>"), "join its"),
    "deep": (document(nodes="<node>" * 200_000 + "</node>" * 200_000), "join its"),
    "holes": (primitives(f'<polygons count="1">{INPUT}<ph><p>0 1 2 3</p><h>4 1 2</h></ph></polygons>'), "holes"),
    "corners": (
        primitives('<polygons count="1"><input semantic="VERTEX" source="#v" offset="1"/><p>0 1 2</p></polygons>'),
        "2 numbers for each corner",
    ),
    "few": (primitives(TRIANGLE.replace("0 1 2", "0 1")), "are 2 numbers in"),
    "many": (primitives(TRIANGLE.replace("0 1 2", "0 1 2 3")), "are 4 numbers in"),
    "no faces": (primitives(f'<triangles count="1">{INPUT}</triangles>'), "are 0 numbers in"),
    "count": (primitives(TRIANGLE.replace('"1"', '"-1"')), "the count of <triangles> is '-1'"),
    "huge count": (primitives(TRIANGLE.replace('"1"', '"999999999"')), "more than 1000000 triangles"),
    "digits": (primitives(TRIANGLE.replace('"1"', f'"{BIG}"')), "the count of <triangles>"),
    "beyond": (primitives(TRIANGLE.replace("0 1 2", "0 1 5")), "vertex 5, and the vertices are 0 to 4"),
    "negative": (primitives(TRIANGLE.replace("0 1 2", "0 1 -1")), "vertex -1"),
    "index digits": (primitives(TRIANGLE.replace("0 1 2", f"0 1 {BIG}")), "something else than whole numbers"),
    "index of 64 bits": (primitives(TRIANGLE.replace("0 1 2", f"0 1 {'9' * 30}")), "too large"),
    "fraction": (primitives(TRIANGLE.replace("0 1 2", "0 1 2.5")), "something else than whole numbers"),
    "offset": (primitives(TRIANGLE.replace('offset="0"', 'offset="999999999"')), "more than 100 inputs"),
    "no offset": (primitives(TRIANGLE.replace('offset="0"', "")), "the offset of <input> is ''"),
    "no input": (primitives('<triangles count="1"><p>0 1 2</p></triangles>'), "not one input VERTEX"),
    "no vertices": (document(geometry(source() + TRIANGLE)), "no <vertices> has the id 'v'"),
    "no position": (document(geometry(source() + '<vertices id="v"/>' + TRIANGLE)), "exactly one input POSITION"),
    "no source": (document(geometry(vertices() + TRIANGLE)), "no <source> has the id 'p'"),
    "vcount": (polylist(vcount="-3"), "negative"),
    "vcount of few": (polylist(2, "3"), "are 1 numbers in"),
    "huge vcount": (polylist(vcount="999999999999"), "more than 1000000 triangles"),
    "huge polylist": (polylist("999999999"), "more than 3000000 polygons"),
    "polygon": (polylist(vcount="1000003", p=many(1000003, "", "0 ", "")), "more than 1000000 triangles"),
    "nan": (
        document(geometry(source(numbers=SQUARE.replace("1", "nan", 1)) + vertices() + TRIANGLE)),
        "is not a number",
    ),
    "infinite": (document(geometry(source(numbers="1e999" + SQUARE[1:]) + vertices() + TRIANGLE)), "is not a number"),
    "comma": (document(geometry(source(numbers=SQUARE.replace("1", "0,5", 1)) + vertices() + TRIANGLE)), "else than n"),
    "array": (document(geometry(source(count=16) + vertices() + TRIANGLE)), "are 15 numbers in"),
    "huge array": (document(geometry(source(count=999_999_999) + vertices() + TRIANGLE)), "MB of memory"),
    "accessor": (document(geometry(source(accessor='count="6" stride="3"') + vertices() + TRIANGLE)), "accessor of 6"),
    "huge accessor": (
        document(geometry(source(accessor='count="5" stride="999999999"') + vertices() + TRIANGLE)),
        "accessor of 5",
    ),
    "still": (document(geometry(source(accessor='count="3000000" stride="0"') + vertices() + TRIANGLE)), "parameters"),
    "flat": (document(geometry(source(params=XYZ[:-30]) + vertices() + TRIANGLE)), "three named"),
    "unit": (document(asset='<asset><unit meter="0"/></asset>'), "its unit is 0 m"),
    "no unit": (document(asset='<asset><unit meter="x"/></asset>'), "numbers in the unit"),
    "nan unit": (document(asset='<asset><unit meter="nan"/></asset>'), "its unit is nan m"),
    **{
        f"{tag} {k}": (document(nodes=f'<node><{tag}>{text}</{tag}><instance_geometry url="#g"/></node>'), words)
        for k, (tag, text, words) in enumerate(
            [
                ("matrix", "1 0 0", "are 3 numbers in"),
                ("matrix", "1 " * 16, "must have the last row 0 0 0 1"),
                ("matrix", "nan " * 16, "a value that is not a number"),
                ("rotate", "0 0 0 90", "an axis without a length"),
                ("rotate", "0 0 1 1e999", "a value that is not a number"),
                ("scale", "1e300 1 1", "a value that is not a number"),
                ("lookat", "0 " * 9, "<lookat>"),
                ("skew", "0 " * 7, "<skew>"),
                ("translate", "", "are 0 numbers in"),
                ("translate", "0 0 0,5", "else than numbers in"),
            ]
        )
    },
    "growing": (
        document(nodes="<node><scale>1e9 1 1</scale>" * 40 + '<instance_geometry url="#g"/>' + "</node>" * 40),
        "a place that is not finite",
    ),
}


def shared_array(count: int = 9_000) -> str:
    """Geometries that all have their places from one array, which is empty and long."""
    geometries = "".join(
        geometry(
            source(f"p{k}").replace(f"#p{k}a", "#a") + vertices(f"v{k}", f"p{k}") + TRIANGLE.replace("#v", f"#v{k}"),
            f"g{k}",
        )
        for k in range(count)
    )
    return document(
        geometries,
        "".join(f'<node><instance_geometry url="#g{k}"/></node>' for k in range(count)),
        rest=f'<extra><float_array id="a" count="9">{" " * 20_000_000}</float_array></extra>',
    )


def attributes(count: int) -> str:
    return "<COLLADA " + " ".join(f'a{k}=""' for k in range(count)) + "/>"


#: Files that are large, or would grow; made only where they are read.
HEAVY: dict[str, tuple[Callable[[], str], str]] = {
    "newlines": (lambda: document().replace("0 1 2", "\n" * 30_000_000), "are 0 numbers in"),
    "newlines before": (lambda: "\n" * 30_000_000 + document(), "declaration"),
    "short lines": (lambda: document().replace("0 1 2", "12\n" * 10_000_000), "are 10000000 numbers in"),
    "wide text": (lambda: document().replace("0 1 2", "\U0001f311 " + "1 " * 18_000_000), "are 18000001 numbers in"),
    "elements": (lambda: many(9_000_000, "<COLLADA>", "<a/>", "</COLLADA>"), "MB of memory for its elements"),
    "attributes": (lambda: attributes(3_000_000), "MB of memory for its elements"),
    "just not too many": (lambda: attributes(1_040_000), "0 scenes"),
    "references": (lambda: many(6_000_000, "<COLLADA>", "&#300;", "</COLLADA>"), "MB of memory for its elements"),
    "long numbers": (
        lambda: document(nodes=f"<node><translate>0 0 {'1' * 38_000_000}</translate></node>"),
        "is not a number",
    ),
    "all vertices": (
        lambda: document(
            geometry(
                source(numbers="0.12345678 " * 3_000_000, accessor='count="1000001" stride="3"') + vertices() + TRIANGLE
            )
        ),
        "an accessor of 1000001 places",
    ),
    "all triangles": (
        lambda: primitives(TRIANGLE.replace('"1"', '"1000000"').replace("0 1 2", "0 1 5 " * 10**6)),
        "vertex 5",
    ),
    "one array for all": (shared_array, "are 0 numbers in"),
    "large": (lambda: document() + " " * 40_000_000, "40 MB are the most"),
}
#: Prints the message, the CPU seconds and the highest memory in kB of reading a file.
PROGRAM = """
import sys, time
from pathlib import Path
from icymoon.support.errors import IcyMoonError
from icymoon.physics.arm.link_mesh import read_link_mesh
begin = time.process_time()
try:
    read_link_mesh(Path(sys.argv[1]))
except IcyMoonError as error:
    print(error)
print(time.process_time() - begin)
print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1])
"""


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("name", HEAVY)
@pytest.mark.timeout(60)
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux states the memory of a process there")
def test_a_heavy_mesh_is_a_sentence_within_time_and_memory(tmp_path, name):
    path, (make, words) = tmp_path / "m.dae", HEAVY[name]
    path.write_text(make(), encoding="utf-8", newline="")
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path)], capture_output=True, text=True, timeout=60, check=True
    )
    message, seconds, memory_kb = ended.stdout.splitlines()
    assert message.startswith(f"{path}")
    assert words in message
    assert len(message) < 500
    assert float(seconds) < 5
    assert int(memory_kb) < 500_000


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.timeout(20)
def test_a_hostile_mesh_is_a_sentence(tmp_path, name):
    content, words = HOSTILE[name]
    path = tmp_path / "m.dae"
    path.write_text(content, encoding="utf-8", newline="")
    with pytest.raises(IcyMoonError) as caught:
        read_link_mesh(path)
    assert str(caught.value).startswith(f"{path}")
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
    assert str(caught.value).endswith(".")
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TRIANGLE.replace('"1"', '"101"').replace("0 1 2", "0 1 2 " * 101), "more than 100 triangles"),
        (TRIANGLE * 101, "more than 100 triangles"),
        (f'<polylist count="1">{INPUT}<vcount>103</vcount><p>{"0 " * 103}</p></polylist>', "more than 100 triangles"),
        (f'<tristrips count="1">{INPUT}<p>{"0 " * 103}</p></tristrips>', "more than 100 triangles"),
    ],
)
def test_triangles_are_counted_before_they_are_made(tmp_path, monkeypatch, text, words):
    monkeypatch.setattr(link_mesh, "MAX_TRIANGLES", 100)
    with pytest.raises(IcyMoonError, match=words):
        faces_of(tmp_path / "m.dae", primitives(text))


def test_what_is_shown_many_times_is_counted_before_it_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(link_mesh, "MAX_TRIANGLES", 100)
    nodes = '<node><instance_geometry url="#g"/></node>' * 61
    with pytest.raises(IcyMoonError, match="more than 300 vertices"):
        faces_of(tmp_path / "m.dae", document(nodes=nodes))
    with pytest.raises(IcyMoonError, match="more than 100 triangles"):
        faces_of(tmp_path / "m.dae", document(geometry(source() + vertices() + 2 * TRIANGLE), nodes))
    with pytest.raises(IcyMoonError, match="more than 300 vertices"):
        faces_of(
            tmp_path / "m.dae",
            document(geometry(source(accessor='count="301" stride="3"', numbers="0 " * 903) + vertices() + TRIANGLE)),
        )


@pytest.mark.parametrize("seed", range(6))
def test_a_damaged_mesh_is_a_mesh_or_a_sentence(tmp_path, seed):
    nodes = '<node><matrix>0 -1 0 5 1 0 0 6 0 0 -2 7 0 0 0 1</matrix><instance_geometry url="#g"/></node>'
    whole = polylist(3, "4 2 3", "0 1 2 3 0 1 4 3 2").replace("<node>", nodes + "<node>").encode()
    path, random = tmp_path / "m.dae", np.random.default_rng(seed)
    for _ in range(100):
        data = bytearray(whole)
        for at in random.integers(0, len(data), 2):
            data[at] = random.choice(list(b'0123456789-. <>/"=#&e'))
        path.write_bytes(data)
        with suppress(IcyMoonError):
            found, triangles = read_link_mesh(path)
            assert np.isfinite(found).all()
            assert 0 <= triangles.min() <= triangles.max() < len(found)
