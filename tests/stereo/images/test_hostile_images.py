"""Images and maps of strangers: each is one sentence, and costs little memory and time; what is right is read."""

from __future__ import annotations

import io
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import cv2
import hostile_images
import numpy as np
import OpenEXR
import pytest
from hostile_images import HEIGHT, IMAGES, MAPS, WHOLE, WIDTH, encode, png, texture
from icymoon.stereo.datasets.data_files import MapFile, read_image, read_map, resolve_inside
from icymoon.stereo.images import bounded_decoding
from icymoon.stereo.images.image_files import read_pfm, read_png
from icymoon.support.errors import IcyMoonError
from icymoon.support.system import count_processors, find_process_scope, has_ended, is_ended_by_time_limit

READERS = {
    "image": read_image,
    "map": lambda path: read_map(MapFile(path)),
    "map with steps": lambda path: read_map(MapFile(path, steps=8)),
}


def refuse(read, path: Path) -> str:
    """The sentence by which a file is refused."""
    with pytest.raises(IcyMoonError) as caught:
        read(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert text.endswith((".", "_new.tif"))  # nothing follows a command
    assert ";" in text  # what to do
    assert text.isprintable()
    return text


@pytest.mark.parametrize("name", IMAGES)
def test_a_hostile_image_is_one_sentence(tmp_path, name):
    path = tmp_path / f"a.{name.partition(':')[0]}"
    path.write_bytes(IMAGES[name])
    refuse(read_image, path)


@pytest.mark.ci_takes(70)
@pytest.mark.parametrize("name", MAPS)
def test_a_hostile_map_is_one_sentence(tmp_path, name):
    path = tmp_path / f"a.{name.partition(':')[0]}"
    path.write_bytes(MAPS[name])
    refuse(READERS["map with steps"], path)


@pytest.mark.parametrize("name", WHOLE)
def test_what_a_reader_need_not_read_is_left_out(tmp_path, name):
    path = tmp_path / f"a.{name.partition(':')[0]}"
    path.write_bytes(WHOLE[name])
    image = read_image(path)
    expected = cv2.imdecode(np.frombuffer(WHOLE[name], np.uint8), cv2.IMREAD_UNCHANGED)
    expected = expected // 257 if expected.dtype == np.uint16 else expected
    np.testing.assert_array_equal(image, expected[..., :3] if expected.ndim == 3 else expected)
    assert image.shape[:2] == (HEIGHT, WIDTH)


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, read):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    for name in ("pipe", "loop", "absent", "."):
        refuse(read, tmp_path / name)
    with (tmp_path / "sparse.png").open("wb") as stream:
        stream.write(png())
        stream.truncate(2**36)
    assert "MB" in refuse(read, tmp_path / "sparse.png")
    with pytest.raises(IcyMoonError, match="characters that a path cannot have"):
        resolve_inside(tmp_path, "a\0b")


@pytest.mark.parametrize("kind", [".png", ".jpg", ".webp", ".tif"])
@pytest.mark.parametrize("bands", [1, 3, 4])
def test_the_other_process_gives_what_opencv_gives(tmp_path, kind, bands):
    image = texture(bands)
    path = tmp_path / f"a{kind}"
    path.write_bytes(encode(kind, image))
    expected = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read_image(path), expected[..., :3] if expected.ndim == 3 else expected)
    if kind == ".png":
        np.testing.assert_array_equal(read_png(path), image)
        np.testing.assert_array_equal(read_png(path, bounded_decoding.decode), image)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.uint32])
def test_a_channel_is_chosen_by_its_name(tmp_path, kind):
    values = np.arange(1, 13).reshape(3, 4)
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"A": np.zeros((3, 4), kind), "view.Z": values.astype(kind)}).write(str(path))
    np.testing.assert_array_equal(read_map(MapFile(path)), values)
    parts = [
        OpenEXR.Part(header | {"name": name}, {channel: (k * values).astype(kind)})
        for k, (name, channel) in enumerate({"a": "a.V", "b": "b.V", "c": "depth"}.items(), 1)
    ]
    OpenEXR.File(parts).write(str(path))
    np.testing.assert_array_equal(read_map(MapFile(path)), 3 * values)


def test_tiles_are_read(tmp_path):
    values = np.arange(1, 5001, dtype=np.float32).reshape(50, 100)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    OpenEXR.File(header, {"Z": values}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_map(MapFile(tmp_path / "a.exr")), values)


def whole_files() -> dict[str, bytes]:
    """A small valid file of each kind."""
    values = np.random.default_rng(1).uniform(1, 50, (HEIGHT, WIDTH)).astype(np.float32)
    return {
        "png": encode(".png", (values * 256).astype(np.uint16)),
        "jpg": encode(".jpg", texture(3)),
        "webp": encode(".webp", texture(3)),
        "npz": hostile_images.npz(disparity=values),
        "npy": hostile_images.npy(f"({HEIGHT}, {WIDTH})", body=values.tobytes()),
        "pfm": b"Pf\n%d %d\n-1\n" % (WIDTH, HEIGHT) + values.tobytes(),
    }


@pytest.mark.ci_takes(2)
@pytest.mark.heavy
@pytest.mark.parametrize("kind", whole_files())
def test_random_damage_is_a_sentence_or_an_image(tmp_path, kind):
    whole = whole_files()[kind]
    random = np.random.default_rng(7)
    path = tmp_path / f"a.{kind}"
    read = read_image if kind in ("jpg", "webp") else READERS["map"]
    for n in range(1000 if kind in ("npy", "pfm", "png") else 250):
        data = bytearray(whole)
        where = random.integers(0, min(len(data), 200 if n % 2 else len(data)), 2)
        for at in where:
            data[at] = random.integers(0, 256)
        path.write_bytes(data)
        with suppress(IcyMoonError), np.errstate(all="ignore"):
            assert read(path).ndim in (2, 3)


def test_random_damage_of_exr_is_a_sentence_or_a_map(tmp_path):
    values = np.random.default_rng(1).uniform(1, 50, (HEIGHT, WIDTH)).astype(np.float32)
    path = tmp_path / "a.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": values}).write(str(path))
    whole, random = path.read_bytes(), np.random.default_rng(8)
    for _ in range(250):
        data = bytearray(whole)
        for at in random.integers(0, 600, 2):
            data[at] = random.integers(0, 256)
        path.write_bytes(data)
        with suppress(IcyMoonError), np.errstate(all="ignore"):
            assert read_map(MapFile(path)).ndim == 2


# The other process


def decoder() -> bounded_decoding._Decoder:
    return bounded_decoding._running[0]


def test_a_crash_costs_one_image(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(png())
    read_image(path)
    first = decoder()
    os.kill(first._process.pid, signal.SIGSEGV)
    assert "makes the library crash" in refuse(read_image, path)
    assert read_image(path).shape == (HEIGHT, WIDTH)
    assert decoder() is not first


def test_it_finds_packages_where_this_process_finds_them(tmp_path, monkeypatch):
    """Clusters have packages on PYTHONPATH; a module there that Python imports at its start tells that it is read."""
    (tmp_path / "sitecustomize.py").write_text(f"open({str(tmp_path / 'read')!r}, 'w').close()\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    bounded_decoding.stop_decoder()
    path = tmp_path / "a.png"
    path.write_bytes(png())
    read_image(path)
    bounded_decoding.stop_decoder()
    assert (tmp_path / "read").exists()


def test_a_hang_costs_one_image(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(png())
    read_image(path)
    first = decoder()
    os.kill(first._process.pid, signal.SIGSTOP)
    monkeypatch.setattr(bounded_decoding, "_MAX_DECODING_S", 0.3)
    assert "takes more than 0.3 s to decode" in refuse(read_image, path)
    monkeypatch.undo()
    assert read_image(path).shape == (HEIGHT, WIDTH)
    assert first._process.poll() is not None


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux bounds memory and time")
def test_memory_and_processor_time_are_bounded(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    image = np.random.default_rng(1).integers(0, 256, (3000, 3000, 3)).astype(np.uint8)
    path.write_bytes(encode(".png", image, cv2.IMWRITE_PNG_COMPRESSION, 1))
    # Less than the file takes, and without the room for threads.
    monkeypatch.setattr(bounded_decoding, "_PIXEL_COPIES", -2)
    monkeypatch.setattr(bounded_decoding, "_FILE_BYTES", -count_processors() * 2**28)
    assert re_memory(refuse(read_image, path))
    first = decoder()
    monkeypatch.undo()
    np.testing.assert_array_equal(read_image(path), image)
    assert decoder() is first  # it told so itself, and goes on


def re_memory(text: str) -> bool:
    return "memory" in text.lower() or "alloc" in text.lower()


@pytest.mark.heavy
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux bounds memory and time")
def test_a_process_ends_at_its_time():
    program = (
        "from icymoon.support.system import bound_memory_and_time, count_processors\n"
        "with bound_memory_and_time(10**9, 0.1):\n    pass\n"
        "with bound_memory_and_time(10**8, 5):\n"
        "    try:\n        bytes(10**8 + count_processors() * 2**28)\n"
        "    except MemoryError:\n        print('bounded')\n"
        "with bound_memory_and_time(10**8, 0.1):\n    while True:\n        pass\n"
    )
    ended = subprocess.run([sys.executable, "-u", "-c", program], capture_output=True, timeout=60, check=False)
    assert ended.stdout == b"bounded\n"
    assert is_ended_by_time_limit(ended.returncode)


@pytest.mark.heavy
def test_the_other_process_ends_with_this_one(tmp_path):
    (tmp_path / "a.png").write_bytes(png())
    program = (
        "import os, sys\nfrom pathlib import Path\nfrom icymoon.stereo.images import bounded_decoding\n"
        "from icymoon.stereo.datasets.data_files import read_image\nread_image(Path(sys.argv[1]))\n"
        "print(bounded_decoding._running[0]._process.pid, flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "a.png")], capture_output=True, timeout=60, check=False
    )
    pid, end = int(ended.stdout), time.monotonic() + 20
    while not has_ended(pid, find_process_scope()):
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_forked_process_has_a_decoder_of_its_own(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(png())
    read_image(path)
    first = decoder()
    monkeypatch.setattr(first, "owner", first.owner + 1)
    read_image(path)
    assert decoder() is not first
    first.end()


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"{}\n",
        b"no\n",
        b'{"shape": [-1, 2], "type": "|u1"}\n',
        b'{"shape": [99, 99], "type": "|u1"}\n',
        b'{"shape": [1, 1], "type": "|O"}\n',
        b'{"shape": [2, 2], "type": "|u1"}\nabc',
        b"[" * 9000 + b"\n",
        b'{"shape": [1.0, 1], "type": "|u1"}\n',
        b'{"shape": [true, 1], "type": "|u1"}\n',
        b"a" * 20_000,
    ],
)
def test_an_answer_of_another_kind_is_refused(line):
    with pytest.raises(Exception):  # noqa: B017, PT011  whichever it is, the decoder is ended
        bounded_decoding._read_answer(io.BytesIO(line), 100)


@pytest.mark.ci_takes(1)
@pytest.mark.heavy
@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of memory")
@pytest.mark.parametrize(("kind", "those"), [("image", IMAGES), ("map with steps", MAPS)])
def test_hostile_files_take_little_memory_and_time(tmp_path, kind, those):
    """All of them in a process whose memory is limited, as are its children."""
    for n, (name, content) in enumerate(those.items()):
        (tmp_path / f"{n:03d}.{name.partition(':')[0]}").write_bytes(content)
    program = (
        "import sys\nfrom pathlib import Path\nfrom icymoon.support.errors import IcyMoonError\n"
        "from icymoon.stereo.datasets.data_files import MapFile, read_image, read_map\n"
        "count = 0\n"
        "for path in sorted(Path(sys.argv[1]).iterdir()):\n"
        "    try:\n"
        "        read_image(path) if sys.argv[2] == 'image' else read_map(MapFile(path, steps=8))\n"
        "    except IcyMoonError:\n        count += 1\n"
        "print(count)\n"
    )

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (2**30, 2**30))
        resource.setrlimit(resource.RLIMIT_CPU, (20, 20))

    ended = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path), kind],
        capture_output=True,
        timeout=120,
        check=False,
        preexec_fn=limit,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert int(ended.stdout) == len(those), ended.stderr[-2000:]


# PFM


BODY = np.arange(1, 7, dtype="<f4")


@pytest.mark.parametrize(
    "header",
    [
        b"Pf\n3 2\n-1\n",
        b"Pf\r\n3 2\r\n-1.0\r\n",
        b"Pf\n# made by hand\n3 2\n-1\n",
        b"Pf\r\n# a\r\n3 2\r\n# b\r\n-1\r\n",
        b"Pf 3 2 -1 ",
        b"Pf\n3\n2\n-1.000000 \n",
        b"Pf\n3 2\n-1\n# behind\n",
        b"Pf\r3 2\r-1\r",
        b"Pf\n3 2\n-1\r\n",
        b"Pf\r\n3 2\r\n-1\n",
    ],
)
@pytest.mark.parametrize("behind", [b"", b"\n", b"\r\n"])
def test_the_size_of_a_pfm_tells_where_its_body_begins(tmp_path, header, behind):
    path = tmp_path / "a.pfm"
    path.write_bytes(header + BODY.tobytes() + behind)
    np.testing.assert_array_equal(read_pfm(path), BODY.reshape(2, 3)[::-1])


def test_a_body_that_looks_like_a_line_end_is_a_body(tmp_path):
    path = tmp_path / "a.pfm"
    for body in (b"\n" * 24, b"\r\n" * 12, b"# \n\n" * 6):
        path.write_bytes(b"Pf\n3 2\n-1\n" + body)
        expected = np.frombuffer(body, "<f4").reshape(2, 3)[::-1]
        assert read_pfm(path).tobytes() == expected.tobytes()


# 8 bits


def test_eight_bits_are_a_map_where_their_steps_are_stated(tmp_path):
    path = tmp_path / "a.png"
    path.write_bytes(encode(".png", texture()))
    np.testing.assert_array_equal(np.nan_to_num(read_map(MapFile(path, steps=8))), texture() / 8)
    text = refuse(READERS["map"], path)
    assert "truth.steps" in text
    assert "16" not in text.removeprefix(str(path))
    assert "pairs.toml" not in refuse(lambda each: read_map(MapFile(each, predicted=True)), path)
    path.write_bytes(encode(".png", texture(3)))
    assert "colours" in refuse(READERS["map with steps"], path)
