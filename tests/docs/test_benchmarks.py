"""Every study of ``benchmarks/`` is listed and has help, and every place that names one names it as it is called."""

import re
import shlex
import subprocess

import pytest
from icymoon.benchmarks.common import own_process, studies
from icymoon.support.version import ROOT

from commands import study_fault

pytest.importorskip("bpy")  # which many studies import

STUDIES = studies.find_studies()
#: A call up to the end of the code or of the line; columns of explanations are apart by more than one space.
_CALL = re.compile(r"python benchmarks(?: (?! )[^`\n>|#)\"]*)?")


def calls(text: str) -> list[str]:
    """The calls of studies in a text, without their optional words in brackets."""
    text = re.sub(r"\\\n\s*", "", text)
    found = []
    for call in _CALL.findall(text):
        call = re.split(r" {2,}", call)[0].replace("…", "").replace("...", "")
        while "[" in call:
            shorter = re.sub(r"\[[^\[\]]*(\]|$)", "", call)
            assert shorter != call, call
            call = shorter
        found.append(call)
    return found


def fault_of(call: str) -> str:
    """What is wrong with a call; nothing if it is a bare name, by which a sentence speaks of a study."""
    words = shlex.split(call)[2:]
    fault = study_fault(words)
    return "" if len(words) == 1 and "arguments are required" in fault else fault


def test_a_study_is_found_by_one_name_only():
    files = [path for path in studies.FOLDER.glob("*/*.py") if path.parent.name != studies.COMMON]
    assert len({path.name for path in files}) == len(files)
    assert {path.stem for path in files} - set(STUDIES) == {"first_hour_window"}  # which runs in Blender


def test_the_list_has_each_study_with_a_sentence():
    lines = studies.list_studies().splitlines()
    assert [line.split()[0] for line in lines if line.startswith("  ")] == list(STUDIES)
    assert all(len(line.split()) > 5 and line.endswith(".") for line in lines if line.startswith("  "))


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_tells_how_it_is_called(name):
    text = studies.make_parser(name).format_help()
    assert f"python benchmarks {name}" in text.split("\n", 2)[2]


def test_every_call_in_the_repository_is_understood():
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    found = []
    for name in names:
        if name.endswith((".py", ".md", ".toml", ".json")) and (ROOT / name).is_file() and name not in EXAMPLES:
            text = (ROOT / name).read_text(encoding="utf-8")
            assert not re.search(r"benchmarks/(?!\w+/)\w+\.py", text.replace("benchmarks/used.py", "")), name
            found += [(name, call) for call in calls(text)]
    assert len(found) > 150
    faults = {f"{name}: {call}: {fault}" for name, call in found if (fault := fault_of(call))}
    assert not faults, "\n".join(sorted(faults))


#: Files with calls that are wrong or incomplete on purpose.
EXAMPLES = (
    "tests/docs/test_benchmarks.py",
    "tests/docs/test_docs.py",
    "tests/support/commands.py",
    "benchmarks/common/studies.py",
    "benchmarks/__main__.py",
    "benchmarks/cost/qualities.py",
)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("(`python benchmarks rocks objects`)", ["python benchmarks rocks objects"]),
        ("    python benchmarks blur [WIDTH [SAMPLES]]\n", ["python benchmarks blur "]),
        ("    python benchmarks live chaos …     those", ["python benchmarks live chaos "]),
        ("python benchmarks furnace > a.json", ["python benchmarks furnace "]),
    ],
)
def test_a_call_is_cut_out_of_its_text(text, found):
    assert calls(text) == found


def test_a_wrong_name_and_a_wrong_option_are_told():
    assert "There is no study rock;" in study_fault(["rock"])
    assert "unrecognized arguments: --nowhere" in study_fault(["rocks", "--nowhere"])


def test_a_function_is_called_in_a_process_of_its_own(capfd):
    import os

    from icymoon.benchmarks.common.processor import resident_mib

    assert own_process.call(os.getpid) != os.getpid()
    assert 1 < own_process.call(resident_mib) < 1000
    with pytest.raises(RuntimeError, match="ended with status 1"):
        own_process.call(resident_mib, "nowhere")
    assert "StopIteration" in capfd.readouterr().err
