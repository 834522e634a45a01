"""Exports of plug-ins."""

import json

import numpy as np
import pairs
import pytest
from icymoon.stereo.cli import main
from plugin_packages import add_package

EXPORT = '''\
"""Arrays of NumPy."""
import json
import numpy as np
ICYMOON_API = 1

def write_pair(pair, folder):
    np.save(folder / "left.npy", pair.left)
    (folder / "truth").mkdir()
    np.save(folder / "truth" / "disparity.npy", pair.disparity_left_px)
    (folder / "camera.json").write_text(json.dumps([pair.name, pair.focal_px, pair.baseline_m, pair.bits,
                                                    pair.settings["rig"]["width_px"]]))

def finish(names, folder):
    (folder / "names.txt").write_text(" ".join(names))
'''


@pytest.fixture
def export(tmp_path, monkeypatch, capsys):
    rig = pairs.camera(96, 64)
    for name in ("one", "two"):
        pairs.write_pair(tmp_path / "data" / "pairs" / name, pairs.Scene(), rig)

    def run(source, name="arrays", kind=None):
        if not (tmp_path / "site").exists():
            add_package(tmp_path / "site", monkeypatch, "export", name, source)
        status: object
        try:
            status = main(["export", str(tmp_path / "data"), "--format", kind or name, "--out", str(tmp_path / "out")])
        except SystemExit as end:
            status = end.code
        said = " ".join(capsys.readouterr().err.split())
        assert "Traceback" not in said
        assert not list(tmp_path.rglob("*.part"))
        return status, said, tmp_path / "out"

    return run


def test_it_writes_each_pair_and_then_what_belongs_to_all(export):
    status, _, out = export(EXPORT)
    assert status == 0
    assert (out / "names.txt").read_text() == "one two"
    rig = pairs.camera(96, 64)
    truth = rig.disparity(pairs.view(pairs.Scene(), rig, "left")[0])
    np.testing.assert_allclose(np.load(out / "two" / "truth" / "disparity.npy"), truth, rtol=1e-6)
    assert np.load(out / "one" / "left.npy").dtype == np.uint16
    name, focal, baseline, bits, width = json.loads((out / "one" / "camera.json").read_text())
    assert (name, baseline, width) == ("one", 0.25, 96)
    assert focal == pytest.approx(96 * 32 / 60)
    assert np.load(out / "one" / "left.npy").max() < 2**bits


def test_again_it_replaces_its_files_and_keeps_others(export):
    _, _, out = export(EXPORT)
    (out / "one" / "notes.txt").write_text("mine")
    (out / "one" / "left.npy").write_text("old")
    assert export(EXPORT)[0] == 0
    assert (out / "one" / "notes.txt").read_text() == "mine"
    assert np.load(out / "one" / "left.npy").shape == (64, 96)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (EXPORT.replace('folder / "truth" / ', 'folder / "nowhere" / '), "failed (FileNotFoundError"),
        ("ICYMOON_API = 1\ndef write_pair(pair, folder):\n    pass\n", "wrote no file for one"),
        ("ICYMOON_API = 1\ndef write_pair(pair):\n    pass\n", "failed (TypeError"),
        ("ICYMOON_API = 1\n", "has no function write_pair"),
        (EXPORT.replace('" ".join(names)', "names"), "failed (TypeError"),
    ],
)
def test_what_it_does_wrong_is_one_sentence_and_nothing_is_half_written(export, source, said):
    status, told, out = export(source)
    assert status == 1
    assert f"The export arrays of the package icymoon-test-arrays 1.0 {said}" in told
    if "names" not in source:
        assert not any(path.is_file() for path in out.rglob("*"))


def test_a_link_does_not_get_out(export, tmp_path):
    (tmp_path / "secret").write_text("mine")
    status, _, out = export(
        EXPORT + f"\n_write = write_pair\ndef write_pair(pair, folder):\n    _write(pair, folder)\n"
        f"    (folder / 'link').symlink_to({str(tmp_path / 'secret')!r})\n"
    )
    assert status == 0
    assert not (out / "one" / "link").exists()
    assert (tmp_path / "secret").read_text() == "mine"


def test_an_unknown_one_and_one_with_the_name_of_ours(export):
    status, told, _ = export(EXPORT, kind="arays")
    assert status == 2
    assert "invalid choice: 'arays'" in told
    assert "arrays" in told.partition("choose from")[2]  # in quotes up to Python 3.11
    status, _, out = export(EXPORT, name="png8")
    assert status == 0
    assert (out / "one" / "left.png").is_file()  # ours is what is used


def test_two_of_one_name_say_so(export, tmp_path, monkeypatch):
    add_package(tmp_path / "other", monkeypatch, "export", "arrays", EXPORT, package="another")
    status, told, _ = export(EXPORT)
    assert status == 2
    assert "another 1.0 and icymoon-test-arrays 1.0 both add it" in told
