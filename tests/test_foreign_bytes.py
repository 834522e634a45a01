"""The door for foreign bytes: what it lets in, what it refuses, and that there is no way around it."""

from __future__ import annotations

import ast
import io
import os
import re
import resource
import struct
import subprocess
import sys
import zipfile
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from icymoon.support.foreign_bytes import (
    Budget,
    Cursor,
    ForeignBytes,
    OverBudgetError,
    RefusedError,
    decode_text,
    inflate,
    parse_json,
    parse_npy,
    parse_npz,
    parse_part,
    parse_toml,
    parse_whole_numbers,
    parse_xml,
    read,
    read_regular,
    split_lines,
)
from sources import ROOT, SOURCES, check_each, tree_of


def foreign(data: bytes, memory: int = 10**6) -> ForeignBytes:
    return ForeignBytes(data, len(data), Budget(memory))


def packed(**arrays: Array) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def saved(array: Array) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_a_cursor_takes_what_is_there_once():
    cursor = Cursor(b"\1\0\0\0name\0" + np.arange(3, dtype="<f4").tobytes() + b"rest", Budget(), start=100)
    assert cursor.number("<I") == 1
    assert cursor.take_until(b"\0", 10) == b"name"
    assert cursor.numbers("<f4", 3).tolist() == [0, 1, 2]
    assert cursor.at == 121
    cursor.skip_to(122)
    assert (cursor.take(3), cursor.left) == (b"est", 0)


@pytest.mark.parametrize(
    "act",
    [
        lambda c: c.take(-1),
        lambda c: c.take(11),
        lambda c: c.skip(-1),
        lambda c: c.skip(11),
        lambda c: c.skip_to(0),
        lambda c: c.numbers("<f8", -1),
        lambda c: c.numbers("<f8", 2),
        lambda c: c.numbers("O", 1),
        lambda c: c.take_until(b"!", 5),
        lambda c: c.unpack("<4I"),
    ],
)
def test_a_cursor_goes_neither_back_nor_past_the_end(act):
    cursor = Cursor(b"0123456789ab", Budget())
    cursor.skip(2)
    with pytest.raises(ValueError, match=r"byte|ends|type"):
        act(cursor)
    assert cursor.take(1) == b"2"  # nothing was taken


def test_a_budget_is_charged_before_room_is_made():
    budget = Budget(100)
    assert budget.charge(60) == 60
    with pytest.raises(OverBudgetError):
        budget.charge(41)
    with pytest.raises(ValueError, match="-1"):
        budget.charge(-1)
    assert budget.left == 40


def test_the_same_bytes_are_not_read_for_ever():
    data = foreign(bytes(2**20))
    for _ in range(4):
        data.part(0, 2**20)
    with pytest.raises(OverBudgetError, match="again and again"):
        data.part(0, 2**20)
    for start, count in ((-1, 5), (0, -1), (0, 2**20 + 1), (2**20, 1)):
        with pytest.raises(ValueError, match="bytes"):
            data.part(start, count)


def test_reading_gives_what_the_parser_makes(tmp_path):
    file = tmp_path / "a.bin"
    file.write_bytes(b"abc")
    assert read(file, lambda f: (f.size, f.part(1, 1), f.cursor().take(3)), "a file", "make it again") == (
        3,
        b"b",
        b"abc",
    )


class OwnError(Exception):
    """An error of a library."""


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ValueError("it is torn.\nmore"), "is not a thing that can be read (it is torn); make it again."),
        (RefusedError("has two of them; take one."), "has two of them; take one."),
        (OverBudgetError("asks for more"), "asks for more; make it again."),
        (MemoryError(), "needs more memory than this machine has; make it again."),
        (RecursionError("maximum recursion depth exceeded"), "is nested too deeply"),
        (OwnError(), "OwnError"),
        (KeyError("name"), "'name' is missing"),
        (AssertionError(), "AssertionError"),
        (NotImplementedError("x"), "(x)"),
        (IcyMoonError("Already a sentence."), "Already a sentence."),
    ],
)
def test_whatever_a_parser_raises_is_one_sentence(tmp_path, error, text):
    file = tmp_path / "a.bin"
    file.write_bytes(b"abc")

    def parse(_: ForeignBytes) -> None:
        raise error

    with pytest.raises(IcyMoonError) as caught:
        read(file, parse, "a thing", "make it again")
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


@pytest.mark.parametrize(
    "parse",
    [
        lambda f: [][3],
        lambda f: len(f),
        lambda f: min(3, "a"),
        lambda f: float(10**400),
        lambda f: f.cursor().unpack("<9d"),
        lambda f: struct.unpack("<9d", b""),
    ],
    ids=range(6),
)
def test_mistakes_of_a_parser_are_told_in_words_of_the_file(tmp_path, parse):
    with pytest.raises(IcyMoonError) as caught:
        parse_part(b"abc", "a.bin", parse, "a thing", "make it again")
    assert not [word for word in ("object", "instance", "range", "buffer", "convert") if word in str(caught.value)]


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", Path("/dev/zero"), tmp_path, tmp_path / "absent", tmp_path / "a\0b"):
        with pytest.raises(IcyMoonError, match="cannot be read"):
            read(path, lambda f: f.content(), "a file", "choose another")
        if "\0" not in str(path) and path.exists():  # the usual fix is for its content
            with pytest.raises(IcyMoonError, match=r"it is not a regular file\); put a regular file in its place"):
                read(path, lambda f: f.content(), "a file", "choose another")
        with pytest.raises((OSError, ValueError)):
            read_regular(path, 10)


def test_a_large_file_is_refused_unread(tmp_path):
    file = tmp_path / "large"
    with file.open("wb") as stream:
        stream.truncate(10**12)  # a sparse file
    with pytest.raises(IcyMoonError, match="1000000 MB"):
        read(file, lambda f: f.content(), "a file", "choose another")
    with pytest.raises(ValueError, match="more than"):
        read_regular(file, 10**6)


@pytest.mark.parametrize(
    ("data", "text"), [(b"a\r\nb\rc\n", "a\nb\nc\n"), ("é".encode("utf-16"), "é"), (b"\xef\xbb\xbfa", "a"), (b"", "")]
)
def test_text_is_decoded_by_its_mark(data, text):
    assert decode_text(data) == text


def test_lines_end_as_any_system_ends_them():
    for end in (b"\n", b"\r\n", b"\r"):
        assert [line for _, line in split_lines(end.join((b"a", b"", b"b")) + end)] == [b"a", b"", b"b"]
        assert [number for number, _ in split_lines(end.join((b"a", b"", b"b")))] == [1, 2, 3]
        many = [b"x" * (k % 700) for k in range(2000)] + [b"end"]  # more than a block
        for found in (
            split_lines(end.join(many)),
            foreign(end.join(many)).lines(),
            foreign(b"99" + end.join(many)).lines(2),
        ):
            assert [line for _, line in found] == many
    with pytest.raises(ValueError, match="line 2"):
        list(split_lines(b"a\n" + b"b" * 101 + b"\nc", longest=100))
    with pytest.raises(ValueError, match="line 2"):
        list(foreign(b"a\n" + b"b" * 10**6).lines())
    assert [line for _, line in split_lines(b"a\n" + b"b" * 100 + b"\r\nc", longest=101)] == [b"a", b"b" * 100, b"c"]


def test_a_deep_text_is_no_traceback():
    for parse, text in (
        (parse_json, "[" * 10**5),
        (parse_toml, "a = " + "[" * 10**5),
        (parse_toml, "a = " + "{a=" * 10**5),
        (parse_toml, "a = " + "1" * 5000),
        (parse_toml, "a" + ".a" * 10**6 + " = 1"),
        (parse_toml, f"[{'a.' * 10**6}a]"),
        (parse_toml, f"[{'a.' * 10**6}a]\n" + "b = 1\n" * 10**5),
        (parse_toml, "a = 1\n" * 10**6),
        (parse_toml, "\n".join(f"{k}.b.c.d.e.f.g.h = 1" for k in range(10**5))),
        (parse_json, "[" + "[]," * 10**6 + "[]]"),
        (parse_json, "[" + "1," * 6 * 10**6 + "1]"),
        (parse_json, '{"a": NaN}'),
        (parse_json, "1" * 5000),
        (parse_xml, "<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>"),
        (parse_xml, "<a>"),
    ):
        with pytest.raises(ValueError, match=r"deep|number|digits|document|element|parts|million|tables in|values"):
            parse(text)


def test_whole_numbers_are_of_digits_only():
    assert parse_whole_numbers(b" 3 0\t12\r\n 7 \n").tolist() == [3, 0, 12, 7]
    assert parse_whole_numbers(b" \n").size == parse_whole_numbers(b"").size == 0
    assert parse_whole_numbers(b"9" * 5000 + b" 18446744073709551617").tolist() == [2**63 - 1] * 2
    for text in (b"1 -1", b"1.5", b"1,5", b"0x1", b"1_0", b"nan", b"1 \0", "３".encode()):
        with pytest.raises(ValueError, match="whole numbers"):
            parse_whole_numbers(text)


def test_elements_and_attributes_of_xml_are_charged():
    assert parse_xml("<a b='1'/>", Budget(512)).get("b") == "1"
    for text in ("<a b='1' c='2'/>", "<a><b/><c/></a>", "<a>&#65;&#66;&#67;</a>"):
        with pytest.raises(OverBudgetError, match="elements and attributes"):
            parse_xml(text, Budget(512))


def test_packed_data_are_of_the_size_that_is_stated():
    data = zlib.compress(bytes(1000))
    budget = Budget(1000)
    assert inflate(data, 1000, budget) == bytes(1000)
    assert budget.left == 0
    for size in (999, 1001):
        with pytest.raises(ValueError, match="instead of"):
            inflate(data, size)
    with pytest.raises(OverBudgetError):
        inflate(data, 1000, Budget(10))


def test_arrays_come_as_they_were_saved():
    array = np.arange(12, dtype=">f8").reshape(3, 4)
    for each in (array, array.T, array[:, :0], np.array(1.5), np.array([True])):
        np.testing.assert_array_equal(parse_npy(foreign(saved(each))), each)
    found = parse_npz(foreign(packed(a=array, b=np.zeros(2))), {"a", "c"})
    assert list(found) == ["a"]
    np.testing.assert_array_equal(found["a"], array)


def header(text: str, version: int = 1) -> bytes:
    body = text.encode() + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + len(body).to_bytes(2 if version == 1 else 4, "little") + body


@pytest.mark.parametrize(
    "data",
    [
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000,), }"),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (%s,), }" % ("9" * 300)),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, -1), }") + bytes(4),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (True,), }") + bytes(4),
        header("{'descr': '|O', 'fortran_order': False, 'shape': (1,), }") + bytes(8),
        header("{'descr': [('a', '|O')], 'fortran_order': False, 'shape': (1,), }") + bytes(8),
        header("{'descr': '<M8[s]', 'fortran_order': False, 'shape': (1,), }") + bytes(8),
        header("{'descr': '<f4', 'fortran_order': False, 'shape': (%s), }" % ("1," * 40)) + bytes(4),
        header("(" * 5000),
        header("{" * 5000, 2),
        header("x" * 20000, 2),
        b"\x93NUMPY\4\0",
        b"\x93NUMPY\2\0\xff\xff\xff\xff",
        b"",
        b"\x80\4N.",
        saved(np.zeros(4))[:-1],
        saved(np.zeros(4)) + b"\0",
    ],
    ids=range(17),
)
def test_what_is_no_array_is_refused(data):
    with pytest.raises(IcyMoonError):
        parse_part(data, "a.npy", parse_npy, "an array", "save it again")
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a.npy", data)
    with pytest.raises(IcyMoonError):
        parse_part(stream.getvalue(), "a.npz", parse_npz, "an archive", "save it again")


@pytest.mark.parametrize(
    "parse",
    [
        lambda: parse_part(header("{'descr': 3"), "a", parse_npy, "an array", "save it again"),
        lambda: parse_part(header("__import__('os')"), "a", parse_npy, "an array", "save it again"),
        lambda: parse_part(b"1" * 5000, "a", lambda f: int(f.content()), "a number", "save it again"),
        lambda: parse_json("1" * 5000),
        lambda: parse_toml("a = " + "1" * 5000),
        lambda: parse_toml("a = 0x" + "f" * 5000),
        lambda: parse_toml("a = [{b = 0b1" + "0" * 1023 + "}]"),
    ],
    ids=range(7),
)
def test_no_word_of_python_is_in_a_sentence(parse):
    with pytest.raises((IcyMoonError, ValueError)) as caught:
        parse()
    assert not [word for word in ("sys.", "EOF", "<", "object at", "integer string") if word in str(caught.value)]
    assert re.search("number of more than 308 digits|its header does not describe an array", str(caught.value))


def test_a_whole_number_that_a_float_holds_is_read():
    assert parse_toml("a = 0x" + "f" * 255) == {"a": 16**255 - 1}
    assert float(16**255 - 1)


def test_an_archive_that_unfolds_without_end_is_refused():
    bomb = packed(a=np.zeros(10**7))
    with pytest.raises(OverBudgetError):
        parse_npz(foreign(bomb))
    many = io.BytesIO()
    with zipfile.ZipFile(many, "w") as archive:
        for k in range(1001):
            archive.writestr(f"{k}.npy", b"")
    with pytest.raises(ValueError, match="members"):
        parse_npz(foreign(many.getvalue()))
    # Lists of members that are long, or that are said to be elsewhere, or none at all.
    small = packed(a=np.zeros(3))
    end = small.rindex(b"PK\x05\x06")
    directory = small.index(b"PK\x01\x02")
    for data in (
        small[:end],
        small[: end + 10],
        small[:directory] + small[directory:end] * 1100 + small[end:],
        small[: end + 10] + b"\xff\xff" + small[end + 12 :],
        small + bytes(2**17),
        small[: end + 12] + (2**21).to_bytes(4, "little") + small[end + 16 :],
        small[:end] + b"PK\x06\x07" + bytes(16) + small[end:],
    ):
        with pytest.raises(IcyMoonError):
            parse_part(data, "a.npz", parse_npz, "an archive", "save it again")
    assert parse_npz(foreign(b"before" + small))["a"].tolist() == [0, 0, 0]  # as zipfile takes it
    # A member whose stated size is smaller than what it holds.
    torn = bytearray(packed(a=np.zeros(1000)))
    at = torn.index(b"PK\x01\x02") + 24
    torn[at : at + 4] = (100).to_bytes(4, "little")
    with pytest.raises(IcyMoonError):
        parse_part(bytes(torn), "a.npz", parse_npz, "an archive", "save it again")


@pytest.mark.parametrize("seed", range(40))
def test_random_damage_is_a_sentence_or_nothing(seed):
    random = np.random.default_rng(seed)
    whole = packed(a=np.arange(50.0), b=np.zeros((3, 4), "<f4"))
    for _ in range(50):
        data = bytearray(whole)
        for at in random.integers(0, len(data), 3):
            data[at] = random.integers(0, 256)
        with suppress(IcyMoonError):
            parse_part(bytes(data), "a.npz", parse_npz, "an archive", "save it again")


def test_a_huge_stated_size_takes_no_memory():
    """In a process of its own, whose memory is limited: the parser must refuse before it makes room."""
    program = (
        "import sys\nfrom icymoon.support.errors import IcyMoonError\n"
        "from icymoon.support.foreign_bytes import parse_npy, parse_part\n"
        "try:\n    parse_part(sys.stdin.buffer.read(), 'a', parse_npy, 'an array', 'save it again')\n"
        "except IcyMoonError as error:\n    print(error)\n"
    )
    data = header("{'descr': '<f4', 'fortran_order': False, 'shape': (400000000,), }") + bytes(16)

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))

    ended = subprocess.run(
        [sys.executable, "-c", program],
        input=data,
        capture_output=True,
        timeout=60,
        check=False,
        preexec_fn=limit,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert b"not as its header states" in ended.stdout, ended.stderr


# No way around the door

#: Calls that read or parse bytes, by the last name; those of ``re`` search at every place of a text.
READERS = {
    "read_bytes",
    "read_text",
    "fromfile",
    "loadtxt",
    "genfromtxt",
    "memmap",
    "imread",
    "imdecode",
    "ZipFile",
    "is_zipfile",
    "decompress",
    "decompressobj",
    "LZMADecompressor",
    "ZstdDecompressor",
    "fromstring",
    "furnsh",
}
QUALIFIED = {
    "np.load",
    "numpy.load",
    "json.load",
    "json.loads",
    "tomllib.load",
    "tomllib.loads",
    "torch.load",
    "OpenEXR.File",
    "csv.reader",
    "csv.DictReader",
    "tarfile.open",
    "ElementTree.parse",
    "onnx.load",
    "bpy.data.images.load",
    "re.search",
    "re.findall",
    "re.finditer",
    "onnxruntime.InferenceSession",
}


def reads(tree: ast.AST) -> set[str]:
    """What a source uses to read or parse bytes by itself."""
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        text = ast.unparse(node.func)
        last = text.split(".")[-1]
        if text in QUALIFIED or (last in READERS and text != last) or last in READERS - {"read_text"}:
            found.add(text if text in QUALIFIED else last)
        is_open = isinstance(node.func, ast.Attribute | ast.Name) and last == "open"
        if is_open and text not in ("os.open", "webbrowser.open", "tarfile.open", "archive.open"):
            modes = [
                a.value
                for a in [*node.args, *(w.value for w in node.keywords if w.arg == "mode")]
                if isinstance(a, ast.Constant) and isinstance(a.value, str)
            ]
            # A path such as 'a' comes first only where open is no method.
            if not any(
                set(mode) <= set("rwxab+t") and set(mode) & set("wxa")
                for mode in (modes[1:] if text == "open" else modes)
            ):
                found.add("open")
    return found


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("path.read_bytes()", {"read_bytes"}),
        ("np.load(path)", {"np.load"}),
        ("open('a')", {"open"}),
        ("path.open('rb')", {"open"}),
        ("path.open('wb')", set()),
        ("read_text(path)", set()),
        ("path.read_text(encoding='utf-8')", {"read_text"}),
        ("json.loads(text)", {"json.loads"}),
        ("zipfile.ZipFile(f)", {"ZipFile"}),
        ("re.search('a', text)", {"re.search"}),
        ("cv2.imread(p)", {"imread"}),
    ],
)
def test_a_way_around_is_found(code, found):
    assert reads(ast.parse(code)) == found


#: What still reads by itself, and why that is right: files of ours that were shipped with the program, text that this
#: process wrote, or a format that a library parses within bounds.
ALLOWED: dict[str, str] = {
    "formats/lidar_points.py": "ZipFile: arrays that it writes, and arrays of stated shapes, in parts",
    "formats/mesh_checks.py": "ZipFile: the directory of an archive whose members are counted before; none is unpacked",
    "formats/tiff.py": "LZMADecompressor, ZstdDecompressor, decompress, decompressobj: each to the size of a tile",
    "nodes/assets.py": "bpy.data.images.load: previews of presets, shipped with the program",
    "nodes/ground/import_heights.py": "bpy.data.images.load: after its structure was checked",
    "nodes/ground/mesh_edges.py": "np.load: arrays that our own process has just written; no pickles",
    "nodes/surface/hapke_osl.py": "read_text: shipped with the program, as compiled by Cycles",
    "nodes/surface/images.py": "bpy.data.images.load: after its header was checked",
    "operators/manual.py": "json.loads, re.search, read_text: shipped with the program",
    "operators/results.py": "bpy.data.images.load: pictures of our evaluation, in the user's folder",
    "operators/show_pair.py": "bpy.data.images.load: a picture that this process has just written to its own folder",
    "physics/excavation/dig_site.py": "json.loads: keys of its cache, which it has written itself",
    "physics/light/spice.py": "furnsh: kernels that physics/light/kernels.py has looked at",
    "physics/light/stars.py": "csv.DictReader, open: shipped with the program",
    "physics/surfaces/principled.py": "json.loads, read_text: shipped with the program",
    "plugins/installed.py": "read_text: of installed packages, which Python reads by itself too",
    "render/ground_maps.py": "read_bytes: an image that Blender wrote just now",
    "render/cycles_occlusion.py": "read_bytes: images that Blender wrote just now",
    "render/lander_record.py": "read_bytes: an image that Blender wrote just now",
    "render/render_pair.py": "read_bytes: images that Blender wrote just now",
    "settings/pair_ids.py": "json.loads: what this process counted",
    "stereo/adapters/icymoon_serve.py": "json.loads, np.load, open: for another Python, on what we wrote",
    "stereo/adapters/mitsuba_render.py": "ElementTree.parse, read_text: for another Python, on its user's file",
    "stereo/export/training.py": "tarfile.open: archives that this process writes",
    "stereo/images/bounded_decoding.py": "OpenEXR.File, json.loads: in the process with bounds; our requests to it",
    "stereo/images/exr.py": "OpenEXR.File, open: checked before; the null device",
    "stereo/images/image_files.py": "ZipFile, imdecode: written; our pictures, and others' with bounds",
    "stereo/learning/train.py": "np.load, torch.load: what this program wrote; weights_only, and no pickles",
    "stereo/matchers/network_matchers.py": "ZipFile, torch.load: weights_only, and no archive that unfolds",
    "stereo/matchers/onnx.py": "onnxruntime.InferenceSession: a file of the user's, never a scene's",
    "stereo/measuring_cluster.py": "json.loads: text that this program wrote",
    "stereo/measuring_processes.py": "json.loads: lines that the process wrote that started it",
    "stereo/paper/figures.py": "read_bytes: a chart that was written just now",
    "stereo/paper/page.py": "read_bytes: sheets that were written just now",
    "stereo/report/html.py": "read_text: shipped with the program",
    "stereo/report/row_log.py": "open: a regular file that it appends to, line by line with a limit",
    "support/printer.py": "open: the null device",
    "support/system.py": "open, read_text: what Linux states of processes; the door itself",
    "validation/second_renderer.py": "np.load: arrays that our own process has just written",
    "support/version.py": "read_text, tomllib.loads: shipped with the program",
}


@check_each(SOURCES)
def test_there_is_no_way_around_the_door(path):
    name = path.relative_to(ROOT).as_posix()
    used = reads(tree_of(path)) if name != "support/foreign_bytes.py" else set()
    allowed = ALLOWED.get(name, ":").partition(":")[0]
    assert used == set(filter(None, allowed.split(", ")))


@pytest.mark.parametrize("name", ALLOWED)
def test_what_reads_by_itself_has_a_reason(name):
    assert ALLOWED[name].partition(":")[2].strip()
