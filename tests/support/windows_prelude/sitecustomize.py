"""Puts a process under the layer of tests that behaves as Windows does; see ``windows``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import windows

sys.path.pop(0)
windows.prelude()
