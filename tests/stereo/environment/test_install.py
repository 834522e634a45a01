"""Making the evaluator's environment: it is complete and has only tested packages, or it does not exist."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import sys
import tomllib
import zipfile
from types import SimpleNamespace

import pytest
from icymoon.stereo.environment import install, packages
from icymoon.stereo.matchers.onnx import REQUIREMENT
from icymoon.support.version import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def locked() -> dict[str, tuple[str, list[str]]]:
    """(version, hashes) of each package of the lock file."""
    found = {}
    for requirement, *hashes in map(split_line, read_lines()):
        found[requirement.name] = (next(iter(requirement.specifier)).version, hashes)
    return found


def read_lines() -> list[str]:
    """The lines of the lock file, one for each package."""
    lines = re.sub(r"\\\n\s*", " ", install.LOCK_FILE.read_text(encoding="utf-8")).splitlines()
    return [line for line in lines if not line.startswith("#")]


def split_line(line: str) -> tuple[Requirement, *tuple[str, ...]]:
    """The requirement of a line, and its hashes."""
    requirement, *hashes = line.split(" --hash=")
    return Requirement(requirement), *(f"--hash={each}".rstrip() for each in hashes)


def test_every_package_is_locked_within_the_bounds_that_are_tested():
    found = locked()
    for module in packages.PACKAGES:
        need = Requirement(packages.format_requirement(module))
        assert found[canonicalize_name(need.name)][0] in need.specifier
    for name, (version, hashes) in found.items():
        assert re.fullmatch(r"[0-9][0-9.]*(post\d+)?", version), name
        assert hashes, name
        assert all(re.fullmatch("--hash=sha256:[0-9a-f]{64}", word) for word in hashes), name


def test_what_the_packages_need_is_locked_too():
    """Of any system: a dependency that pip finds in no line of the file ends the installation."""
    found = locked()
    for name in found:
        try:
            needs = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            continue  # needed by another version of what needs it
        for need in map(Requirement, needs):
            if "extra" not in str(need.marker):
                assert canonicalize_name(need.name) in found, f"{name} needs {need}"


def test_the_package_and_the_button_have_the_same_bounds():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = map(Requirement, [*project["dependencies"], *project["optional-dependencies"]["evaluate"]])
    assert {(canonicalize_name(need.name), need.specifier) for need in stated} == {
        (canonicalize_name(need.name), need.specifier)
        for need in map(Requirement, map(packages.format_requirement, packages.PACKAGES))
    }


@pytest.mark.parametrize(
    ("version", "usable"), [("4.10.0", False), ("4.11.0", True), ("5.0.0", True), ("6.0.0", False)]
)
def test_an_untested_version_is_named(version, usable, monkeypatch):
    monkeypatch.setattr(packages.importlib, "import_module", lambda name: SimpleNamespace(__version__=version))
    problem = packages._import_package("cv2")[1]
    assert problem == ("" if usable else f"opencv-contrib-python-headless>=4.11,<6 (it has {version})")


CHECK = install._CHECK_COMMAND


def wheel(folder, content="VALUE = 1\n"):
    """A package of one module, as a wheel."""
    file = folder / "tiny-1.0-py3-none-any.whl"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("tiny.py", content)
        archive.writestr("tiny-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n")
        archive.writestr("tiny-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr("tiny-1.0.dist-info/RECORD", "")
    return file


@pytest.fixture
def registry(tmp_path, monkeypatch):
    """A registry of one package, and a lock file for it; the current folder is somebody else's."""
    served = tmp_path / "served"
    served.mkdir()
    file = wheel(served)
    lock = tmp_path / "evaluator.lock"
    lock.write_text(f"tiny==1.0 --hash=sha256:{hashlib.sha256(file.read_bytes()).hexdigest()}\n", encoding="utf-8")
    monkeypatch.setattr(install, "LOCK_FILE", lock)
    monkeypatch.setattr(install, "_CHECK_COMMAND", ("-c", "import tiny"))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(served))
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    for name in ("venv", "ensurepip", "pip"):
        (theirs / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n", encoding="utf-8")
    monkeypatch.chdir(theirs)
    return served


@pytest.mark.long
@pytest.mark.slow
def test_pip_installs_what_is_locked_and_runs_nothing_of_the_current_folder(registry, tmp_path, capsys):
    assert install.main([str(tmp_path / "evaluator")]) == 0, capsys.readouterr().out
    assert list((tmp_path / "evaluator").rglob("site-packages/tiny.py"))
    assert not (tmp_path / "ran").exists()


@pytest.mark.long
@pytest.mark.slow
def test_a_package_that_is_not_the_one_we_released_with_is_refused_in_a_sentence(registry, tmp_path, capsys):
    wheel(registry, "VALUE = 2\n")
    assert install.main([str(tmp_path / "evaluator")]) == 1
    said = json.loads(capsys.readouterr().out.splitlines()[-1])["message"]
    assert "its hash differs), so nothing is installed" in said
    assert "\n" not in said
    assert not (tmp_path / "evaluator").exists()
    assert not (tmp_path / "ran").exists()


def test_the_lock_has_the_runtime_of_icynet_where_it_has_a_build():
    ((required, *hashes),) = [split_line(line) for line in read_lines() if line.startswith("onnxruntime==")]
    assert Requirement(REQUIREMENT).specifier.contains(locked()["onnxruntime"][0])
    assert required.marker is not None
    assert required.marker.evaluate({"sys_platform": "linux", "platform_machine": "x86_64"})
    assert required.marker.evaluate({"sys_platform": "darwin", "platform_machine": "arm64"})
    assert not required.marker.evaluate({"sys_platform": "darwin", "platform_machine": "x86_64"})
    assert len(hashes) >= 16  # four Pythons on four systems


def test_on_a_system_without_a_build_the_error_gives_the_fix(python, tmp_path, capsys):
    python += [
        makes,
        lambda command: SimpleNamespace(
            returncode=1,
            stdout="",
            stderr=(
                "ERROR: Could not find a version that satisfies the requirement numpy==2.4.6\n"
                "ERROR: No matching distribution found for numpy==2.4.6\n"
            ),
        ),
    ]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    assert "no build for this Python and system" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "WARNING: Retrying after connection broken by 'SSLError(SSLCertVerificationError(1, '[SSL: "
            "CERTIFICATE_VERIFY_FAILED] certificate verify failed: self-signed certificate in chain'))': "
            "/simple/numpy/",
            "certificate is not trusted",
        ),
        (
            "WARNING: Retrying after connection broken by 'ProxyError('Cannot connect to proxy.', OSError())'",
            "the proxy did not answer",
        ),
        (
            "WARNING: Retrying after connection broken by 'NewConnectionError('<pip>: Failed to establish a "
            "new connection: "
            "[Errno -3] Temporary failure in name resolution')'",
            "cannot be reached",
        ),
        ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device", "needs 450 MB"),
    ],
)
def test_the_cause_of_a_failure_is_named_not_what_pip_makes_of_it(python, tmp_path, capsys, line, said):
    """pip ends all of these with the same last line, as if the package did not exist."""
    python += [
        makes,
        lambda command: SimpleNamespace(
            returncode=1, stdout="", stderr=(f"{line}\nERROR: No matching distribution found for numpy==2.4.6\n")
        ),
    ]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    assert said in capsys.readouterr().out


def test_the_pythons_that_install_look_into_no_current_folder(python, tmp_path):
    seen = []
    python += [
        lambda command: seen.append(command) or makes(command),
        *[lambda command: seen.append(command) or works(command)] * 2,
    ]
    install.main([str(tmp_path / "evaluator")])
    assert [command[1] for command in seen] == ["-I"] * 3
    assert seen[0][0] == sys.executable
    assert {"--require-hashes", "--only-binary=:all:"} <= set(seen[1])


@pytest.fixture
def python(monkeypatch):
    """Replaces the programs that are run by what each is to do, in order."""
    acts = []
    monkeypatch.setattr(install.system, "run", lambda command: acts.pop(0)(command))
    return acts


def makes(command):
    folder = install.Path(command[-1])
    folder.mkdir(exist_ok=True)
    (folder / "python").touch()
    return SimpleNamespace(returncode=0, stdout="", stderr="")


def fails(command):
    return SimpleNamespace(returncode=1, stdout="", stderr="WARNING: retrying\nERROR: no route to host\n")


def works(command):
    return SimpleNamespace(returncode=0, stdout="", stderr="")


def stopped(command):
    raise KeyboardInterrupt


def test_progress_and_the_end_are_printed(python, tmp_path, capsys):
    python += [makes, works, works]
    assert install.main([str(tmp_path / "evaluator")]) == 0
    said = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [message["type"] for message in said] == [*["progress"] * 4, "done"]
    assert (tmp_path / "evaluator" / "python").is_file()
    assert not install.is_unfinished(tmp_path / "evaluator")


def test_a_failure_is_reported_and_removes_the_incomplete_environment(python, tmp_path, capsys):
    python += [makes, fails]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert said["type"] == "error"
    assert "no route to host; check network and disk" in said["message"]
    assert not (tmp_path / "evaluator").exists()


def test_a_stop_removes_the_incomplete_environment(python, tmp_path):
    python += [makes, stopped]
    with pytest.raises(KeyboardInterrupt):
        install.main([str(tmp_path / "evaluator")])
    assert not (tmp_path / "evaluator").exists()


def test_an_existing_environment_stays(python, tmp_path):
    (tmp_path / "evaluator").mkdir()
    python += [makes, fails]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    assert (tmp_path / "evaluator" / "python").is_file()
    assert not install.is_unfinished(tmp_path / "evaluator")


def test_the_rest_of_a_killed_installation_is_no_evaluator_and_is_removed_with_the_next_failure(python, tmp_path):
    def killed(command):
        assert install.is_unfinished(tmp_path / "evaluator")
        raise SystemExit

    python += [makes, killed]
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(install.system, "remove_folder", lambda folder: None)
        with pytest.raises(SystemExit):
            install.main([str(tmp_path / "evaluator")])
    assert install.is_unfinished(tmp_path / "evaluator")
    python += [makes, fails]
    assert install.main([str(tmp_path / "evaluator")]) == 1
    assert not (tmp_path / "evaluator").exists()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("variable", [pytest.param("PIP_DRY_RUN", marks=pytest.mark.long), "PIP_TARGET"])
def test_packages_that_pip_installed_elsewhere_make_no_evaluator(registry, tmp_path, monkeypatch, capsys, variable):
    """A user's settings of pip may make it do nothing, or install elsewhere."""
    monkeypatch.setattr(install, "_CHECK_COMMAND", CHECK)
    monkeypatch.setenv(variable, str(tmp_path / "elsewhere") if variable == "PIP_TARGET" else "1")
    assert install.main([str(tmp_path / "evaluator")]) == 1
    said = json.loads(capsys.readouterr().out.splitlines()[-1])["message"]
    assert "pip did not install the packages there; look for settings of pip" in said
    assert not (tmp_path / "evaluator").exists()
