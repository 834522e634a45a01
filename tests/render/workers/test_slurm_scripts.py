"""The job script for SLURM: only shares that lack pairs, and what the shell does with it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from icymoon.render.plans import frozen_plan as datasets
from icymoon.render.plans.render_order import choose_shard, order_pairs
from icymoon.render.workers.slurm_scripts import SlurmRequest, format_array_ranges, write_script
from icymoon.support.errors import IcyMoonError
from plans import grid
from stand import Stand

ASKED = SlurmRequest(4, 2, 3, "2G", "00:10:00", ("--partition=long",))


@pytest.mark.parametrize(("numbers", "text"), [([1], "1"), ([1, 2, 3], "1-3"), ([1, 3, 4, 9], "1,3-4,9"), ([], "")])
def test_ranges(numbers, text):
    assert format_array_ranges(numbers) == text


def frozen_in(dataset):
    return datasets.freeze_plan(dataset, order_pairs(grid(seeds=3)), "")


def test_the_array_is_the_shares_that_lack_pairs(tmp_path):
    stand = Stand(tmp_path)
    frozen = frozen_in(stand.dataset)
    stand.run()
    assert write_script(stand.dataset, frozen, ASKED, sys.executable, str(stand.blender)) is None
    for number in (2, 3):
        shutil.rmtree(choose_shard(frozen.pairs, number, 4)[0].folder(stand.dataset))
    script = write_script(stand.dataset, frozen, ASKED, sys.executable, str(stand.blender))
    text = script.read_text()
    assert "#SBATCH --array=2-3%2\n" in text
    for line in ("--cpus-per-task=3", "--mem=2G", "--time=00:10:00", "--partition=long", "--requeue"):
        assert f"#SBATCH {line}\n" in text


def sbatch_words(line):
    """The words of a #SBATCH line as sbatch reads them: quotes group, a backslash escapes also within them, an
    unquoted # begins a comment."""
    words, word, quote, escaped = [], "", "", False
    for character in f"{line.removeprefix('#SBATCH')} ":
        if escaped:
            word, escaped = word + character, False
        elif character == "\\":
            escaped = True
        elif quote or character in "'\"":
            word += character if quote and character != quote else ""
            quote = "" if character == quote else quote or character
        elif character == "#":
            break
        elif character.isspace():
            words, word = [*words, *filter(None, [word])], ""
        else:
            word += character
    assert not quote
    return words


@pytest.mark.parametrize("name", ["my data set", "it's", 'a "b"', "50 % #1", "%j", "$HOME `id` ; x", "ünï\u00a0ö"])
def test_the_log_is_named_rightly_wherever_the_data_set_is(name, tmp_path):
    dataset = tmp_path / name
    dataset.mkdir()
    script = write_script(dataset, frozen_in(dataset), ASKED, sys.executable, "blender")
    lines = [line for line in script.read_text(encoding="utf-8").splitlines() if line.startswith("#SBATCH")]
    words = [sbatch_words(line) for line in lines]
    assert all(len(found) == 1 for found in words)
    (log,) = [word.removeprefix("--output=") for found in words for word in found if word.startswith("--output")]
    assert log.replace("%%", "\0").count("%") == 2  # of the job and of its share
    assert log.replace("%%", "%").replace("%A_%a", "7_1") == str(dataset / "slurm" / "7_1.log")


@pytest.mark.parametrize(
    "change", [{"options": ("--comment=a\ntouch ran",)}, {"memory": "1G\ntouch ran"}, {"time": "1\rtouch ran"}]
)
def test_an_option_that_would_be_a_line_of_its_own_is_refused(change, tmp_path):
    with pytest.raises(IcyMoonError, match="line break"):
        write_script(tmp_path, frozen_in(tmp_path), replace(ASKED, **change), sys.executable, "blender")
    assert not (tmp_path / "slurm").exists()


@pytest.mark.parametrize(("name", "said"), [("a\ntouch ran\n", "line break"), ("a\\b", "backslash")])
def test_a_folder_that_no_line_can_hold_is_refused(name, said, tmp_path):
    dataset = tmp_path / name
    dataset.mkdir()
    with pytest.raises(IcyMoonError, match=said):
        write_script(dataset, frozen_in(dataset), ASKED, sys.executable, "blender")


@pytest.fixture
def cluster(tmp_path):
    """A stand in a folder whose name needs quotes, its script, and an scontrol that notes what it is told."""
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    folder = tmp_path / "my $HOME folder"
    folder.mkdir()
    stand = Stand(folder)
    script = write_script(
        stand.dataset,
        frozen_in(stand.dataset),
        SlurmRequest(1, 0, 1, "1G", "1", ()),
        sys.executable,
        str(stand.blender),
    )
    tool = tmp_path / "bin" / "scontrol"
    tool.parent.mkdir()
    tool.write_text(f'#!/bin/sh\necho "$@" >> "{tmp_path}/requeued"\n')
    tool.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{tool.parent}:{os.environ['PATH']}",
        "SLURM_ARRAY_JOB_ID": "7",
        "SLURM_ARRAY_TASK_ID": "1",
        "SLURM_CPUS_PER_TASK": "1",
        "SLURM_RESTART_COUNT": "0",
    }
    return stand, script, environment, tmp_path / "requeued"


def test_the_script_renders_its_share(cluster):
    stand, script, environment, requeued = cluster
    done = subprocess.run(
        ["bash", str(script)], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    stand.assert_done()
    assert not requeued.exists()


@pytest.mark.long
def test_a_share_that_fails_is_requeued_but_not_for_ever(cluster):
    stand, script, environment, requeued = cluster
    bad = grid(seeds=3)[1].id
    stand.behave(**{bad: "refuse"})
    subprocess.run(["bash", str(script)], env=environment, capture_output=True, timeout=120, check=False)
    assert requeued.read_text() == "requeue 7_1\n"
    last = subprocess.run(
        ["bash", str(script)],
        env={**environment, "SLURM_RESTART_COUNT": "3"},
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert last.returncode == 1
    assert requeued.read_text() == "requeue 7_1\n"
    stand.assert_done(bad)


def test_when_the_time_is_nearly_up_the_share_stops_and_is_requeued(cluster):
    stand, script, environment, requeued = cluster
    slow = grid(seeds=3)[1].id
    stand.behave(**{slow: "hang"})
    process = subprocess.Popen(
        ["bash", str(script)],
        env={**environment, "SLURM_RESTART_COUNT": "9"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    deadline = time.monotonic() + 60
    while not (stand.folder / "log").exists() or slow not in stand.rendered:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(10)  # SIGUSR1, as SLURM sends it
    process.wait(60)
    assert requeued.read_text() == "requeue 7_1\n"
    assert not list(stand.dataset.rglob("*.part"))
    assert not (stand.dataset / "claims").exists()
