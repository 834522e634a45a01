"""Programs of the user's that answer wrongly: each fails its pair in one sentence, in bounded time and memory."""

from __future__ import annotations

import resource
import shlex
import sys
import time

import numpy as np
import pytest
from icymoon.stereo.matchers import match
from icymoon.stereo.matchers.resident_process import stop_residents
from icymoon.stereo.matchers.user_programs import read_array, read_last_line
from icymoon.support.errors import IcyMoonError

SHAPE = 20, 30
IMAGE = np.random.default_rng(0).integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
START = (
    "import json, os, sys, time, subprocess\nimport numpy as np\n"
    "def say(**m): print(json.dumps(m), flush=True)\n"
    "def header(text):\n"
    "    body = text.encode() + b'\\n'\n"
    "    return b'\\x93NUMPY\\1\\0' + len(body).to_bytes(2, 'little') + body\n"
)
ANSWER = START + "say(hello=1)\nfor line in sys.stdin:\n    r = json.loads(line); out = r['out']\n    "
GOOD = "np.save(out, np.full((20, 30), 5.0)); say(id=r['id'], ok=True)"
#: What may lie at ``out`` instead of a map of disparities.
FILES = {
    "fifo": "os.mkfifo(out)",
    "folder": "os.mkdir(out)",
    "device": "os.symlink('/dev/zero', out)",
    "sparse": "open(out, 'wb').truncate(10**10)",
    "link": "os.symlink('/nowhere', out)",
    "empty": "open(out, 'wb')",
    "loop": "os.symlink(out, out)",
    "text": "open(out, 'w').write('1 2 3')",
    "zip": "np.savez(open(out, 'wb'), a=[1.0])",
    "large": "open(out, 'wb').write(header(\"{'descr': '<f8', 'fortran_order': False, 'shape': (10**12,), }\"))",
    "negative": "open(out, 'wb').write(header(\"{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -600), }\"))",
    "digits": "open(out, 'wb').write(header(\"{'descr': '<f8', 'fortran_order': False, 'shape': (\" + '9' * 999))",
    "deep": "open(out, 'wb').write(header('(' * 9000))",
    "object": "open(out, 'wb').write(header(\"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }\") + b'cos')",
    "record": "np.save(out, np.zeros((20, 30), [('a', 'f4'), ('b', 'f4')]))",
    "dates": "np.save(out, np.zeros((20, 30), 'M8[s]'))",
    "complex": "np.save(out, np.ones((20, 30), complex))",
    "flags": "np.save(out, np.ones((20, 30), bool))",
    "nan": "np.save(out, np.full((20, 30), np.nan))",
    "infinite": "np.save(out, np.full((20, 30), np.inf))",
    "long": "np.save(out, np.ones((2, 20, 30)))",
    "cut": "np.save(out, np.ones((20, 30))); os.truncate(out, 1000)",
    "more": "np.save(out, np.ones((20, 30))); open(out, 'ab').write(b'0')",
}


@pytest.fixture(autouse=True)
def _none_is_left():
    yield
    stop_residents()


def ask(folder, body, method="resident", **options):
    script = folder / "program.py"
    script.write_text(body, encoding="utf-8")
    fields = " {left} {right} {out}" if method == "external" else ""
    text = f"{shlex.quote(sys.executable)} {shlex.quote(str(script))}{fields}"
    return match(method, IMAGE, IMAGE, {"command": text, "timeout_s": 30} | options)


def refused(folder, body, **options):
    begun = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(IcyMoonError) as caught:
        ask(folder, body, **options)
    text = str(caught.value)
    assert text.isprintable()
    assert len(text) < 1000
    assert time.process_time() - begun[0] < 5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - begun[1] < 200_000  # KiB
    return text


@pytest.mark.ci_takes(8)
@pytest.mark.parametrize("what", FILES)
def test_a_file_that_is_no_map_is_refused(what, tmp_path):
    assert refused(tmp_path, ANSWER + FILES[what] + "\n    say(id=r['id'], ok=True)")
    external = START + "out = sys.argv[3]\n" + FILES[what]
    assert refused(tmp_path, external, method="external")


#: Lines that are no answer to the first request.
LINES = [
    "say(id=0, ok=True)",
    "say(id=2, ok=True)",
    "say(id=True, ok=True)",
    "say(id='1', ok=True)",
    "say(id=1.0, ok=True)",
    "say(id=None, ok=True)",
    "say(id=[1], ok=True)",
    "say(ok=True)",
    "print('[1]')",
    "print('1')",
    "print('null')",
    "print('{\"id\": 1, \"ok\": true, \"a\": ' + '[' * 60000 + '}')",
    "print('\\0' * 100)",
    'print(\'{"id": 1, "id": 2, "ok": true}\')',
    "print('{\"id\": ' + '1' * 6000 + '}')",
    "print('\\x1b[2J')",
    "sys.stdout.buffer.write(b'\\xff' * 3000 + b'\\n')",
    "print('x' * 10**6 + json.dumps({'id': 1, 'ok': True}))",
    "[print('x' * 1000) for _ in range(3000)]",
    "os.write(2, b'x' * 10**7)",
]


def test_what_is_no_answer_is_none(tmp_path):
    """Nor is it taken for one to a later request: the program fails by its time."""
    body = "\n    ".join(["np.save(out, np.full((20, 30), 5.0))", *LINES])
    assert "timeout_s" in refused(tmp_path, ANSWER + body, timeout_s=2, start_s=4)


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("pass", "timeout_s"),
        ("print('{\"id\": 1, \"ok\"', end='', flush=True); time.sleep(30)", "timeout_s"),
        ("os.close(1); time.sleep(30)", "keep it open"),
        ("print('{\"id\": 1, \"ok\"', end=''); break", "ended with status 0"),
    ],
)
def test_half_an_answer_is_none(body, reason, tmp_path):
    assert reason in refused(tmp_path, ANSWER + body, timeout_s=1, start_s=4)


@pytest.mark.long
def test_a_line_without_end_takes_no_memory(tmp_path):
    """While nobody waits for an answer, too."""
    endless = "    while True: sys.stdout.write('x' * 2**20)"
    text = refused(tmp_path, ANSWER + "\n" + endless, timeout_s=3, start_s=3)
    assert "took more than" in text
    chatty = ANSWER + GOOD + "\n    [print('x' * 10**6) for _ in range(200)]"
    for _ in range(3):
        np.testing.assert_array_equal(ask(tmp_path, chatty)[0], np.full(SHAPE, 5, np.float32))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    time.sleep(1)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize("hello", ["True", "'1'", "1.0", "[1]", "None", "2", "10**30", "'x' * 60000"])
def test_another_greeting_is_refused(hello, tmp_path):
    assert "speaks version" in refused(tmp_path, START + f"say(hello={hello})\ntime.sleep(30)", start_s=20)


def test_a_child_that_keeps_the_output_open_holds_nothing_up(tmp_path):
    child = (
        "subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'], start_new_session={})\n    os._exit(3)"
    )
    for apart in (False, True):
        begun = time.monotonic()
        assert "ended with status 3" in refused(tmp_path, ANSWER + child.format(apart), start_s=60, timeout_s=60)
        assert time.monotonic() - begun < 20


def test_facts_are_few_short_and_numbers(tmp_path):
    for stated in (
        "{**{f'k{k}': k for k in range(1000)}, 'a': 'x' * 10000}",
        "{'x' * 5000: 1, 'nested': {'a': 1}, 'b': 'y' * 999}",
    ):
        found = ask(
            tmp_path,
            ANSWER + "np.save(out, np.full((20, 30), 5.0)); "
            f"say(id=r['id'], ok=True, seconds='no', gpu=3, gpu_mb=-1, facts={stated})",
        )[2]["facts"]
        assert len(found) < 60
        assert all(len(key) <= 200 for key in found)
        assert all(len(value) <= 200 for value in found.values() if isinstance(value, str))
        stop_residents()


@pytest.mark.parametrize("facts", ["{'a': float('nan')}", "{'a': np.float32(1)}", "{'a': object()}", "1 / 0"])
def test_facts_that_json_lacks_fail_their_pair_at_once(facts, tmp_path):
    text = refused(
        tmp_path,
        "import numpy as np\nfrom icymoon_serve import serve\n"
        f"serve(lambda left, right, camera: np.ones(left.shape[:2]), facts=lambda: {facts})",
    )
    assert "reports" in text


def test_last_words_are_read_from_the_end(tmp_path):
    with (tmp_path / "errors").open("wb") as stream:
        stream.truncate(10**10)
        stream.seek(0, 2)
        stream.write(b"\nfirst\nlast \xff words\n\n")
    assert read_last_line(tmp_path / "errors") == "last \ufffd words"
    assert read_last_line(tmp_path / "absent") == ""


def test_arrays_of_all_orders_are_read(tmp_path):
    for array in (np.arange(600.0).reshape(SHAPE), np.arange(600.0).reshape(SHAPE).T, np.ones((1, *SHAPE), ">f4")):
        np.save(tmp_path / "a.npy", array)
        np.testing.assert_array_equal(read_array(tmp_path / "a.npy", SHAPE), array)
