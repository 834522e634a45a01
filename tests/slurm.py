"""A real SLURM on this machine, without installing anything: Debian's packages, unpacked into a folder.

    python tests/slurm.py fetch          download and unpack them into .slurm (needs apt-get and dpkg-deb)
    python tests/slurm.py run COMMAND    start a cluster of this one machine, run a command in it, stop it

In the command's environment PATH holds sbatch, squeue and scontrol.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1] / ".slurm"
PACKAGES = ("slurmctld", "slurmd", "slurm-client", "slurm-wlm-basic-plugins", "libhwloc15", "liblua5.1-0", "libmunge2")
_CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/none
CredType=cred/none
MpiDefault=none
PluginDir={plugins}
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SchedulerType=sched/builtin
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SlurmctldPort={controller}
SlurmdPort={daemon}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
KillWait=5
MinJobAge=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} Sockets=1 CoresPerSocket={cpus} ThreadsPerCore=1 RealMemory=2000
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def fetch() -> None:
    """Download and unpack the packages."""
    with tempfile.TemporaryDirectory() as folder:
        # apt-get leaves the privileges of root, which needs a folder that anyone may write to.
        os.chmod(folder, 0o777)
        subprocess.run(["apt-get", "download", "-q", *PACKAGES], cwd=folder, check=True)
        for package in sorted(Path(folder).glob("*.deb")):
            subprocess.run(["dpkg-deb", "-x", str(package), str(ROOT)], check=True)


def missing() -> str:
    """Why no cluster can be started here; empty if one can."""
    if not (ROOT / "usr" / "sbin" / "slurmctld-wlm").is_file():
        return "SLURM is not here; `python tests/slurm.py fetch` unpacks Debian's packages"
    return ""


def _environment() -> dict[str, str]:
    libraries = ":".join(str(p.parent) for p in (ROOT / "usr" / "lib").rglob("libslurmfull.so"))
    plain = ":".join(str(p) for p in (ROOT / "usr" / "lib").glob("*-linux-gnu*"))
    return {
        **os.environ,
        "LD_LIBRARY_PATH": f"{libraries}:{plain}",
        "PATH": f"{ROOT}/usr/bin:{ROOT}/usr/sbin:{os.environ['PATH']}",
    }


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


@contextlib.contextmanager
def cluster(cpus: int = 2) -> Iterator[dict[str, str]]:
    """A cluster of this machine while the block runs; gives the environment for commands."""
    folder = Path(tempfile.mkdtemp(prefix="slurm-"))
    environment = {**_environment(), "SLURM_CONF": str(folder / "slurm.conf")}
    host = socket.gethostname().split(".")[0]
    plugins = next((ROOT / "usr" / "lib").rglob("auth_none.so")).parent
    controller, daemon = _free_ports(2)
    (folder / "state").mkdir()
    (folder / "spool").mkdir()
    (folder / "slurm.conf").write_text(
        _CONFIGURATION.format(
            host=host,
            user=getpass.getuser(),
            plugins=plugins,
            controller=controller,
            daemon=daemon,
            folder=folder,
            cpus=cpus,
        )
    )
    daemons = []
    try:
        step = str(ROOT / "usr" / "sbin" / "slurmstepd-wlm")
        for name, words in (("slurmctld-wlm", ["-D"]), ("slurmd-wlm", ["-D", "-N", host, "-d", step])):
            log = (folder / f"{name}.out").open("w")
            daemons.append(
                subprocess.Popen([str(ROOT / "usr" / "sbin" / name), *words], env=environment, stdout=log, stderr=log)
            )
        deadline = time.monotonic() + 60
        while True:
            state = subprocess.run(
                ["sinfo", "-h", "-o", "%T"], env=environment, capture_output=True, text=True, check=False
            )
            if state.stdout.strip() in ("idle", "mixed", "allocated"):
                break
            ended = [d.args for d in daemons if d.poll() is not None]
            if ended or time.monotonic() > deadline:
                said = "\n".join(p.read_text(errors="replace")[-2000:] for p in folder.glob("*.out"))
                raise RuntimeError(f"SLURM does not start ({state.stdout}{state.stderr}{ended}):\n{said}")
            time.sleep(0.5)
        yield environment
    finally:
        subprocess.run(["scancel", "--state=RUNNING"], env=environment, check=False, capture_output=True)
        for process in reversed(daemons):
            process.terminate()
        for process in daemons:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20)
            process.kill()
        shutil.rmtree(folder, ignore_errors=True)


def main(arguments: list[str]) -> int:
    """Fetch the packages, or run a command in a cluster."""
    if arguments[:1] == ["fetch"]:
        fetch()
        return 0
    if arguments[:1] == ["run"] and len(arguments) > 1:
        with cluster() as environment:
            return subprocess.run(arguments[1:], env=environment, check=False).returncode
    print(__doc__)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
