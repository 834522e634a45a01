"""Another program as a matcher: what it gets, what it may write, and every way in which it can fail."""

import os
import shlex
import signal
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pairs
import pytest
from icymoon.stereo.images.image_files import read_pfm
from icymoon.stereo.matchers import check_options, match
from icymoon.stereo.matchers.methods import parse_methods
from icymoon.support.errors import IcyMoonError

IMAGE = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
EXPECTED = np.arange(600, dtype=np.float32).reshape(20, 30) / 16 + 1
FIELDS = "{left} {right} {out}"


def command(tmp_path, body, fields=FIELDS):
    """A program of Python statements, after ``left``, ``right``, ``out`` and ``rest``."""
    script = tmp_path / "a program.py"
    script.write_text("import sys\nimport numpy as np\nleft, right, out, *rest = sys.argv[1:]\n" + body)
    return f"{shlex.quote(sys.executable)} {shlex.quote(str(script))} {fields}"


def run(tmp_path, body, fields=FIELDS, camera=None, image=IMAGE, **options):
    return match("external", image, image, {"command": command(tmp_path, body, fields)} | options, camera)


WRITE = {
    "npy": "np.save(out, values)",
    "npy of a batch": "np.save(out, values[None, :, :, None].astype(np.float64))",
    "pfm": "open(out, 'wb').write(b'Pf\\n30 20\\n-1.0\\n' + values[::-1].astype('<f4').tobytes())",
    "pfm of another machine": "open(out, 'wb').write(b'Pf 30 20 2.5\\n' + values[::-1].astype('>f4').tobytes())",
    "png": "import cv2; cv2.imwrite(out, (values * 256).astype(np.uint16))",
}


@pytest.mark.parametrize("kind", WRITE)
def test_each_kind_of_file_is_read(kind, tmp_path):
    values = "values = (np.arange(600, dtype=np.float32).reshape(20, 30) / 16 + 1)\n"
    disparity, valid, info = run(tmp_path, values + WRITE[kind], format=kind[:3])
    assert valid.all()
    np.testing.assert_array_equal(disparity, EXPECTED)
    assert info["seconds"] > 0.01  # Python and numpy took that to start, in the program


def test_what_is_no_positive_number_is_no_measurement(tmp_path):
    """Nor is its expected error looked at."""
    body = "v = np.ones((20, 30)); v[0, :5] = 0, -1, np.nan, np.inf, -np.inf\nnp.save(out, v); np.save(rest[0], v)"
    disparity, valid, info = run(tmp_path, body, f"{FIELDS} {{error_px}}")
    assert valid.sum() == 595
    assert not valid[0, :5].any()
    np.testing.assert_allclose(info["confidence"], np.where(valid, np.exp(-1), 0), rtol=1e-6)
    body = "import cv2; v = np.full((20, 30), 512, np.uint16); v[0, :5] = 0; cv2.imwrite(out, v)"
    disparity, valid, _ = run(tmp_path, body, format="png", png_scale=128)
    assert valid.sum() == 595
    assert (disparity[valid] == 4).all()


@pytest.mark.parametrize("colour", [True, False])
def test_it_gets_the_images_and_the_camera(colour, tmp_path):
    keep = tmp_path / "kept.npz"
    body = (
        "import cv2\nnp.savez(rest[0], left=cv2.imread(left, -1), right=cv2.imread(right, -1),"
        " text=open(rest[1]).read(), rest=[float(word) for word in rest[2].split('/')])\n"
        "np.save(out, np.ones((20, 30)))"
    )
    image = IMAGE if colour else IMAGE[..., 0]
    rig = pairs.camera(30, 20)
    run(
        tmp_path,
        body,
        FIELDS + f" {shlex.quote(str(keep))} {{calibration}} {{focal_px}}/{{cx_px}}/{{cy_px}}/{{baseline_m}}",
        rig,
        image,
    )
    with np.load(keep) as kept:
        expected = image if colour else np.repeat(image[..., None], 3, axis=-1)
        np.testing.assert_array_equal(kept["left"], expected)
        np.testing.assert_array_equal(kept["right"], expected)
        np.testing.assert_array_equal(kept["rest"], [16, 15, 10, 0.25])
        matrix, baseline = str(kept["text"]).splitlines()
        assert [float(word) for word in matrix.split()] == [16, 0, 15, 0, 16, 10, 0, 0, 1]
        assert float(baseline) == 0.25


def test_no_shell_reads_the_command(tmp_path):
    body = "np.save(out, np.ones((20, 30))); open(rest[0], 'w').write(repr(rest[1:]))"
    run(tmp_path, body, FIELDS + f" {tmp_path}/seen '; touch {tmp_path}/broken' '$HOME' '`id`' '*'")
    assert (tmp_path / "seen").read_text() == repr([f"; touch {tmp_path}/broken", "$HOME", "`id`", "*"])
    assert not (tmp_path / "broken").exists()


@pytest.mark.parametrize(
    ("body", "options", "reason"),
    [
        ("sys.exit(3)", {}, r"ended with status 3 \(no message\)"),
        (
            "print('hm', file=sys.stderr); raise RuntimeError('no weights')",
            {},
            r"status 1 \(RuntimeError: no weights\)",
        ),
        ("pass", {}, r"wrote no disparity.npy .*external.format, npy"),
        ("pass", {"format": "pfm"}, r"wrote no disparity.pfm"),
        ("np.save(out, np.ones((20, 31)))", {}, r"shape \(20, 31\), the images have \(20, 30\)"),
        ("np.save(out, np.ones(()))", {}, r"shape \(\), the images"),
        ("np.save(out, np.array(['a']))", {}, "without numbers"),
        ("np.save(out, np.array([{}], object), allow_pickle=True)", {}, "cannot be read"),
        ("open(out, 'wb').write(b'\\x93NUMPY')", {}, "cannot be read"),
        (
            "open(out, 'wb').write(b'Pf\\n30 20\\n-1\\n' + bytes(2399))",
            {"format": "pfm"},
            "2399 bytes follow its header, and its size needs 2400",
        ),
        ("open(out, 'wb').write(b'PF\\n30 20\\n-1\\n' + bytes(7200))", {"format": "pfm"}, "not a grey PFM"),
        ("open(out, 'wb').write(b'')", {"format": "pfm"}, "not a grey PFM"),
        ("open(out, 'wb').write(b'x')", {"format": "png"}, "not a PNG"),
    ],
)
def test_failures_are_one_sentence(body, options, reason, tmp_path):
    with pytest.raises(IcyMoonError, match=reason) as caught:
        run(tmp_path, body, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="it asks Linux what became of a process")
def test_a_program_that_hangs_is_stopped_with_all_that_it_started(tmp_path):
    body = (
        "import subprocess, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(3600)'])\n"
        f"open({str(tmp_path / 'child')!r}, 'w').write(str(child.pid))\ntime.sleep(3600)"
    )
    with pytest.raises(IcyMoonError, match=r"took more than 3 s and was stopped.*external.timeout_s"):
        run(tmp_path, body, timeout_s=3)
    child = int((tmp_path / "child").read_text())
    for _ in range(1200):
        try:
            if Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return  # it waits for whoever has inherited it
        except (FileNotFoundError, ProcessLookupError):
            return
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    pytest.fail("its child went on")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "external.command is empty"),
        ("python3 'left", "cannot be split into arguments.*quotes"),
        ("python3 {left} {right}", r"lacks \{out\}"),
        ("python3 run.py", r"lacks \{left\} and \{right\} and \{out\}"),
        ("python3 {left} {right} {outt}", r"field \{outt\}, did you mean 'out'"),
        ("no-such-program-here {left} {right} {out}", "not a program on this machine"),
    ],
)
def test_commands_that_cannot_run_are_refused_before_anything_else(text, reason):
    with pytest.raises(IcyMoonError, match=reason):
        check_options("external", {"command": text})
    with pytest.raises(IcyMoonError, match=reason):
        parse_methods("bm,external", [f"external.command={text}"] if text else [])


def test_a_camera_that_is_asked_for_must_be_known(tmp_path):
    with pytest.raises(IcyMoonError, match="asks for the camera, which is not known; give --camera PAIR"):
        run(tmp_path, "", FIELDS + " {baseline_m}")


def test_match_on_the_command_line_takes_the_camera_of_a_pair(tmp_path):
    from icymoon.stereo.cli import main

    pair = pairs.write_pair(tmp_path / "pair", rig=pairs.camera(30, 20))
    cv2.imwrite(str(tmp_path / "i.png"), IMAGE)
    text = command(tmp_path, "np.save(out, np.full((20, 30), float(rest[0])))", FIELDS + " {focal_px}")
    assert (
        main(
            [
                "match",
                "--method",
                "external",
                "--left",
                str(tmp_path / "i.png"),
                "--right",
                str(tmp_path / "i.png"),
                "--camera",
                str(pair),
                "--option",
                f"command={text}",
                "--out",
                str(tmp_path / "d.npz"),
            ]
        )
        == 0
    )
    with np.load(tmp_path / "d.npz") as stored:
        assert (stored["disparity"] == 16).all()


def test_pfm_files_are_top_row_first(tmp_path):
    (tmp_path / "a.pfm").write_bytes(b"Pf\n2 3\n-1\n" + np.arange(6, dtype="<f4").tobytes())
    np.testing.assert_array_equal(read_pfm(tmp_path / "a.pfm"), [[4, 5], [2, 3], [0, 1]])
    with pytest.raises(IcyMoonError, match=r"none.pfm cannot be read \(No such file"):
        read_pfm(tmp_path / "none.pfm")
