"""The evaluator as a process: interface, exit codes, one sentence per error, nothing left behind."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import icymoon
import numpy as np
import pairs
import pytest
from icymoon.stereo import cli
from icymoon.stereo.measure.guiss_reference_code import compute_reference_metrics
from icymoon.stereo.report.table_columns import RANKING_METRIC, SUMMARY_COLUMNS
from icymoon.support.errors import IcyMoonError

ROOT = Path(icymoon.__file__).parent
BY_PATH = [sys.executable, str(ROOT / "__main__.py"), "stereo"]


def run(*arguments, command=BY_PATH, **options):
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, timeout=240, **options)


def run_with(preparation, *arguments):
    """Run the command line after some Python statements."""
    program = (
        f"import sys; sys.path[:0] = [{str(ROOT.parent)!r}]; {preparation}\n"
        "import importlib.util\n"
        f"spec = importlib.util.spec_from_file_location('icymoon', {str(ROOT / '__init__.py')!r},"
        f" submodule_search_locations=[{str(ROOT)!r}])\n"
        "sys.modules['icymoon'] = importlib.util.module_from_spec(spec)\n"
        "from icymoon.stereo.cli import main\n"
        "code = main(sys.argv[1:])\n"
        "assert not {'torch', 'bpy'} & {name for name, module in sys.modules.items() if module}\n"
        "sys.exit(code)"
    )
    return run(*arguments, command=[sys.executable, "-c", program])


def assert_refused(result, *words, code=1):
    assert result.returncode == code, result.stderr
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("icymoon.stereo: ")
    assert all(word in lines[0] for word in words), lines[0]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    for eye in ("left", "right"):
        light = pairs.view(pairs.Scene(rock=False), pairs.camera(), eye)[1]
        cv2.imwrite(str(folder / f"{eye}.png"), np.rint(light / 6 * 255).astype(np.uint8))
        cv2.imwrite(str(folder / f"{eye}16.png"), np.rint(light / 6 * 65535).astype(np.uint16))
    whole = (folder / "left.png").read_bytes()
    (folder / "cut.png").write_bytes(whole[: len(whole) // 2])
    (folder / "flipped.png").write_bytes(whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:])
    (folder / "empty.png").write_bytes(b"")
    (folder / "text.png").write_text("no picture")
    cv2.imwrite(str(folder / "small.png"), np.zeros((10, 12), np.uint8))
    pairs.write_pair(folder / "set" / "pairs" / "good")
    return folder


def match(inputs, out, *more, left="left.png", right="right.png", method="sgbm"):
    return run("match", "--method", method, "--left", inputs / left, "--right", inputs / right, "--out", out, *more)


@pytest.mark.parametrize("bits", ["", "16"])
def test_match_writes_disparity(inputs, tmp_path, bits):
    out = tmp_path / "deep" / "D.npz"
    result = match(
        inputs, out, "--option", "window=7", "disparities=64", left=f"left{bits}.png", right=f"right{bits}.png"
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    with np.load(out) as stored:
        disparity = stored["disparity"]
    assert disparity.dtype == np.float32
    truth = pairs.camera().disparity(pairs.view(pairs.Scene(rock=False), pairs.camera(), "left")[0])
    valid = np.isfinite(disparity)
    assert valid.mean() > 0.8
    assert np.isnan(disparity[~valid]).all()
    assert np.median(np.abs(disparity - truth)[valid]) < 0.1
    assert [path.name for path in out.parent.iterdir()] == ["D.npz"]


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"left": "none.png"}, ["none.png", "No such file"]),
        ({"left": "cut.png"}, ["cut.png", "not a whole PNG image"]),
        ({"left": "flipped.png"}, ["flipped.png", "checksum is wrong"]),
        ({"left": "empty.png"}, ["empty.png", "not a PNG"]),
        ({"right": "text.png"}, ["text.png", "not a PNG"]),
        ({"right": "small.png"}, ["256 x 144", "12 x 10"]),
        ({"left": "small.png", "right": "small.png", "method": "bm"}, ["12 x 10", "too small for StereoBM"]),
        ({"method": "sbgm"}, ["did you mean 'sgbm'"]),
    ],
)
def test_match_refuses_in_one_sentence_and_writes_nothing(inputs, tmp_path, changes, words):
    assert_refused(match(inputs, tmp_path / "D.npz", **changes), *words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("windw=9", ["did you mean 'window'"]),
        ("window", ["key=value"]),
        ("window=-1", ["outside 1 to 25"]),
    ],
)
def test_match_refuses_wrong_options(inputs, tmp_path, option, words):
    assert_refused(match(inputs, tmp_path / "D.npz", "--option", option), *words)


def test_output_that_cannot_be_written(inputs, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert_refused(match(inputs, tmp_path / "file" / "D.npz"), "Cannot write", "file")
    assert_refused(run("evaluate", inputs / "set", "--out", tmp_path / "file"), "Cannot write", "file")
    assert (tmp_path / "file").read_text() == "in the way"


def save(folder, name, array):
    np.save(folder / name, array)
    return folder / name


def test_metrics_prints_json_with_the_promised_keys(tmp_path):
    truth = save(tmp_path, "z.npy", np.array([[1.0, 2.0], [4.0, np.nan]]))
    result = run(
        "metrics", "--prediction", save(tmp_path, "p.npy", np.array([[1.05, 2.5], [np.nan, 1.0]])), "--truth", truth
    )
    assert (result.returncode, result.stderr) == (0, "")
    values = json.loads(result.stdout)
    assert {"l1_m", "l1_rate_10", "si_mse", "si_rmse", "dod", "coverage", "n"} <= set(values)
    assert values["l1_m"] == pytest.approx(0.275)
    assert (values["l1_rate_10"], values["n"], values["coverage"]) == (0.5, 2, pytest.approx(2 / 3))
    empty = run("metrics", "--prediction", save(tmp_path, "e.npy", np.full((2, 2), np.nan)), "--truth", truth)
    values = json.loads(empty.stdout)
    assert (values["n"], values["coverage"], values["l1_m"], values["dod"]) == (0, 0, None, None)


@pytest.mark.long
def test_metrics_refuses_a_file_without_depths(tmp_path):
    good = save(tmp_path, "z.npy", np.ones((3, 4)))
    (tmp_path / "cut.npy").write_bytes(good.read_bytes()[:-10])
    (tmp_path / "header.npy").write_bytes(b"\x93NUMPY\x01\x00\x46\x00{{{" + b" " * 67)
    (tmp_path / "empty.npy").write_bytes(b"")
    np.savez(tmp_path / "many.npz", a=np.ones(3))
    for bad, words in [
        ("none.npy", ["none.npy"]),
        ("cut.npy", ["cut.npy"]),
        ("empty.npy", ["empty.npy"]),
        ("header.npy", ["header.npy"]),
        ("many.npz", ["several arrays"]),
        (".", [str(tmp_path)]),
        (save(tmp_path, "o.npy", np.array([{}, None])).name, ["o.npy"]),
        (save(tmp_path, "c.npy", np.ones((3, 4), complex)).name, ["complex128"]),
        (save(tmp_path, "s.npy", np.ones((4, 3))).name, ["(4, 3)", "(3, 4)"]),
    ]:
        assert_refused(run("metrics", "--prediction", tmp_path / bad, "--truth", good), *words)


@pytest.mark.long
def test_evaluate_at_a_terminal(inputs, tmp_path):
    result = run("evaluate", inputs / "set", "--methods", "bm,sgbm", "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    assert "SGBM" in result.stdout
    assert "sgbm" not in result.stdout
    assert not re.search(r"\b1 (\w+ )?(pairs|scenes|methods|images)\b", result.stdout + result.stderr)
    assert "all pixels with a true depth" in result.stdout
    assert "only the pixels that each method measured" in result.stdout
    assert "> 1 px or missing (%)" in result.stdout
    assert "One scene" in result.stdout
    assert result.stdout.splitlines()[-1] == str(tmp_path / "out" / "report.html")
    assert "Depth (m), log, ends at 1 and 99 %" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Traceback" not in result.stderr


def test_evaluate_for_a_program_without_bpy_or_torch(inputs, tmp_path):
    result = run_with(
        "sys.modules['bpy'] = None",
        "evaluate",
        inputs / "set",
        "--methods",
        "bm,sgbm",  # by default icynet, too, where PyTorch is
        "--out",
        tmp_path / "out",
        "--json-lines",
        "--option",
        "bm.window=21",
        "--set",
        "sensor.bits=12",
    )
    assert (result.returncode, result.stderr) == (0, "")
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert [line["type"] for line in lines] == ["progress", "progress", "result"]
    assert lines[0] == {"type": "progress", "fraction": 0.5, "done": 1, "total": 2, "message": "good StereoBM"}
    assert Path(lines[-1]["report"]).is_file()
    assert [row["method"] for row in lines[-1]["rows"]] == ["bm", "sgbm"]
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["format"], report["version"]) == ("icymoon-report", 4)
    assert report["shared_settings"]["sensor"]["bits"] == 12
    assert report["rows"][0]["options"]["window"] == 21


def test_fuse_writes_its_curves_and_the_report_of_its_methods(inputs, tmp_path):
    options = ("--methods", "bm", "--points", "50,200", "--jobs", 1, "--json-lines")
    result = run("fuse", inputs / "set", *options, "--out", tmp_path / "out")
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "out" / "fusion.csv").read_text().startswith("pair,")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert len(report["rows"]) == 5  # the matcher, and for both numbers of points the LiDAR alone and the two joined
    assert {row["status"] for row in report["rows"]} == {"ok"}


def test_measures_of_confidence_are_named_in_any_order():
    assert cli._read_confidence_measures("sweep, own") == ["own", "sweep"]
    assert cli._read_confidence_measures("left-right") == ["left_right"]
    assert cli._read_confidence_measures("none") == []
    for text, words in (("left_right", "did you mean 'left-right'"), ("own,none", "none stands alone")):
        with pytest.raises(IcyMoonError, match=words):
            cli._read_confidence_measures(text)


def test_evaluate_with_a_broken_pair_does_the_rest_and_fails(tmp_path):
    pairs.write_pair(tmp_path / "pairs" / "a")
    pairs.write_pair(tmp_path / "pairs" / "b")
    content = (tmp_path / "pairs" / "a" / "left.exr").read_bytes()
    (tmp_path / "pairs" / "a" / "left.exr").write_bytes(content[:2000])
    result = run("evaluate", tmp_path, "--methods", "bm", "--out", tmp_path / "out", "--json-lines")
    assert_refused(result, "left.exr")
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    assert [line["type"] for line in lines] == ["error", "progress", "progress", "result", "error"]
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "rig.baseline_m=1"], ["needs a new render"]),
        (["--set", "sensor.bits=99"], ["8 to 16"]),
        (["--methods", "igevv"], ["Unknown matcher"]),
        (["--option", "bm.windo=3"], ["did you mean 'window'"]),
    ],
)
def test_evaluate_refuses_wrong_settings_before_it_writes(inputs, tmp_path, arguments, words):
    assert_refused(run("evaluate", inputs / "set", "--out", tmp_path / "out", *arguments), *words)
    assert not list(tmp_path.iterdir())


def test_evaluate_without_pairs(tmp_path):
    result = run("evaluate", tmp_path, "--out", tmp_path / "out", "--json-lines")
    assert_refused(result, "no complete stereo pair")
    assert json.loads(result.stdout)["type"] == "error"


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals and limits")
class TestInterruptions:
    def test_an_interrupt_ends_it_cleanly(self, tmp_path):
        packages = [sys.executable, "-I", "-c", "import numpy, cv2"]
        if subprocess.run(packages, capture_output=True, check=False).returncode:
            pytest.skip("this Python has its packages by PYTHONPATH, which the measuring processes do not get")
        for name in "abcdefgh":
            pairs.write_pair(tmp_path / "pairs" / name)
        command = [*BY_PATH, "evaluate", str(tmp_path), "--out", str(tmp_path / "out"), "--json-lines"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert json.loads(process.stdout.readline())["done"] == 1
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=240)
        assert process.returncode == 130
        assert errors == "icymoon.stereo: interrupted\n"
        assert not list((tmp_path / "out").rglob("*.part"))
        rows = [json.loads(line) for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines()]
        assert 1 <= len(rows) < 16
        assert not (tmp_path / "out" / "report.json").exists()

    @pytest.mark.parametrize("limit", [3000, 30000])
    def test_a_full_disk_is_one_sentence_and_no_half_file(self, inputs, tmp_path, limit):
        # A limit on file size is as near to a full disk as a test can come.
        result = run_with(
            f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))",
            "evaluate",
            inputs / "set",
            "--out",
            tmp_path / "out",
            "--json-lines",
        )
        assert_refused(result, "Cannot write")
        assert not list((tmp_path / "out").rglob("*.part"))
        for path in (tmp_path / "out").rglob("*.png"):
            assert cv2.imread(str(path)) is not None
        for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines():
            json.loads(line)


def test_check_reports_the_versions():
    result = run("check")
    assert (result.returncode, result.stderr) == (0, "")
    report = json.loads(result.stdout)
    assert report["ok"] is True
    assert report["missing"] == []
    assert report["numpy"] == np.__version__
    assert {"python", "numpy", "cv2", "OpenEXR", "jinja2", "matplotlib", "torch"} <= set(report)


def test_check_does_not_import_torch():
    assert run_with("pass", "check").returncode == 0


@pytest.mark.ci_takes(2)
@pytest.mark.parametrize("module", ["numpy", "cv2", "OpenEXR", "jinja2", "matplotlib"])
def test_a_missing_package_is_reported_with_the_fix(tmp_path, module):
    result = run_with(f"sys.modules[{module!r}] = None", "check")
    assert_refused(result, {"cv2": "opencv", "jinja2": "Jinja2"}.get(module, module), "pip install")
    report = json.loads(result.stdout)
    assert (report["ok"], report[module]) == (False, None)
    assert len(report["missing"]) == (4 if module == "numpy" else 1)  # three others need NumPy to load
    result = run_with(f"sys.modules[{module!r}] = None", "evaluate", tmp_path, "--out", tmp_path / "out")
    assert_refused(result, "pip install")


def test_a_package_that_does_not_load_is_reported_with_the_reason(tmp_path):
    (tmp_path / "cv2.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    result = run_with(f"sys.path[:0] = [{str(tmp_path)!r}]", "check")
    assert_refused(result, "libGL.so.1")


def test_a_package_that_is_too_old_is_named(tmp_path):
    (tmp_path / "jinja2.py").write_text("__version__ = '2.11.3'")
    assert_refused(run_with(f"sys.path[:0] = [{str(tmp_path)!r}]", "check"), "Jinja2>=3.1,<4 (it has 2.11.3)")


def test_runs_by_path_from_a_folder_of_any_name(tmp_path):
    (tmp_path / "some folder").symlink_to(ROOT, target_is_directory=True)
    program = tmp_path / "some folder" / "__main__.py"
    result = run("check", command=[sys.executable, str(program), "stereo"], cwd=tmp_path)
    assert json.loads(result.stdout)["ok"] is True


def test_wrong_usage():
    result = run("evaluate")
    assert result.returncode == 2
    assert "usage:" in result.stderr


def test_metrics_of_a_disparity_and_the_reference_codes_beside_them(tmp_path):
    random = np.random.default_rng(0)
    truth = random.uniform(2, 6, (480, 640))
    np.savez(tmp_path / "d.npz", disparity=np.where(random.random(truth.shape) < 0.2, np.nan, 85.333 / truth))
    result = run(
        "metrics",
        "--disparity",
        tmp_path / "d.npz",
        "--truth",
        save(tmp_path, "z.npy", truth),
        "--focal-baseline",
        "85.333",
        "--guiss",
    )
    assert (result.returncode, result.stderr) == (0, "")
    found = json.loads(result.stdout)
    assert found["l1_m"] < 1e-6  # npz in double precision, as it was saved
    assert found["guiss_l1_m"] == pytest.approx(0.0625 * truth.mean(), rel=0.01)
    assert (found["epe_px"], found["bad_1"]) == (pytest.approx(0, abs=1e-6), 0)
    assert found["total_bad_1"] == pytest.approx(0.2, abs=0.005)
    assert found["dod"] == found["dod_antisymmetric"] == found["dod_sampled"] == 0


def test_metrics_of_the_reference_code_know_stereobm(inputs, tmp_path):
    """Its columns are cut and its failed matches are taken for disparities: from the npz of match, or as stated."""
    out, truth = tmp_path / "d.npz", np.full((144, 256), 2.0)
    result = match(inputs, out, "--option", "preset=guiss", "window=7", "disparities=48", method="bm")
    assert result.returncode == 0, result.stderr
    with np.load(out) as stored:
        disparity, least = stored["disparity"], int(stored["bm_min_disparity"])
    assert least == 4
    expected = compute_reference_metrics(disparity.astype(float), truth, 4)
    assert expected["guiss_n"] != compute_reference_metrics(disparity.astype(float), truth)["guiss_n"]
    plain = save(tmp_path, "d.npy", disparity)
    for words in ([out], [plain, "--bm-min-disparity", "4"]):
        result = run(
            "metrics",
            "--disparity",
            *words,
            "--truth",
            save(tmp_path, "z.npy", truth),
            "--focal-baseline",
            "34",
            "--guiss",
        )
        found = json.loads(result.stdout)
        assert {key: found[key] for key in ("guiss_n", "guiss_l1_m")} == {
            key: pytest.approx(expected[key]) for key in ("guiss_n", "guiss_l1_m")
        }


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--focal-baseline", "0"], "positive number"),
        (["--focal-baseline", "nan"], "positive number"),
        ([], "give --focal-baseline"),
    ],
)
def test_metrics_of_a_disparity_needs_a_camera(tmp_path, words, reason):
    good = save(tmp_path, "z.npy", np.ones((3, 4)))
    assert_refused(run("metrics", "--disparity", good, "--truth", good, *words), reason)


@pytest.mark.parametrize("size", [0, 1, 2])
def test_metrics_of_hardly_any_pixel(tmp_path, size):
    depth = save(tmp_path, "z.npy", np.ones((1, size)))
    result = run("metrics", "--prediction", depth, "--truth", depth, "--focal-baseline", "85", "--guiss")
    assert (result.returncode, result.stderr) == (0, "")
    found = json.loads(result.stdout)
    assert found["n"] == size
    assert found["l1_m"] == (0 if size else None)
    assert found["dod"] == (0 if size == 2 else None)


def test_the_printed_tables_rank_what_the_scenes_allow_and_call_nothing_a_zero(capsys):
    numbers = dict.fromkeys((column.key for column in SUMMARY_COLUMNS), 0.25)
    ranked = {RANKING_METRIC: (1, 2), "common_l1_m": (2, 3)}
    rows = [
        numbers | {"method": "bm", "pairs": 8, "n": 9, "ranks": ranked},
        numbers | {"method": "sgbm", "pairs": 8, "n": 9, "ranks": {}},
        numbers | {"method": "igev", "pairs": 0, "n": 0, "ranks": {}, "coverage": 0.0, "seconds": 4.5},
    ]
    report: Any = {"summary": rows, "verdicts": "8 scenes [of 9].", "notes": ["A note."], "plug_ins": []}
    cli._print_summary(report)
    printed = capsys.readouterr().out
    lines = [re.split(r"\s*│\s*", line)[1:-1] for line in printed.splitlines() if "│" in line]
    assert [line[:2] for line in lines] == [
        ["StereoBM", "1–2"],
        ["SGBM", "–"],
        ["IGEV-Stereo", "no result"],
        ["StereoBM", "2–3"],
        ["SGBM", "–"],
        ["IGEV-Stereo", "no result"],
    ]
    assert lines[2][2:] == ["–", "–", "–", "4.500"]  # what it cost stands
    assert set(lines[5][2:]) == {"–"}
    assert "8 scenes [of 9].\nA note." in printed


def test_there_is_no_empty_table_where_every_pair_fails(tmp_path, monkeypatch, capsys):
    nothing = {
        "summary": [{"method": "bm", "pairs": 0, "failed": 2}],
        "notes": [],
        "verdicts": "",
        "failed": [{"message": "a reason"}] * 2,
    }
    monkeypatch.setattr("icymoon.stereo.evaluate.evaluate", lambda *arguments: nothing)
    assert cli.main(["evaluate", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr()
    assert "Means over" not in printed.out
    assert "2 of the evaluations failed, the first one: a reason" in printed.err
