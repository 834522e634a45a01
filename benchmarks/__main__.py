"""``python benchmarks`` lists the studies; ``python benchmarks NAME`` runs one."""

from __future__ import annotations

import importlib.util
import os
import sys


def run(words: list[str]) -> int:
    """Run the study, or the function of a study, in the command line's words; return the exit status."""
    from icymoon.benchmarks.common import own_process, studies

    if words[:1] == [own_process.CALL]:
        own_process.answer(*words[1:])
        return 0
    return studies.run(words)


if __name__ == "__main__":
    if importlib.util.find_spec("icymoon") is None:
        sys.exit("This Python has no icymoon; `make env` installs it, then use .venv/bin/python.")
    status = run(sys.argv[1:])
    if "bpy" in sys.modules:
        # Blender as a module may crash or hang when the interpreter ends.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)
