"""The costs of matching a pair: time and memory."""

from __future__ import annotations

#: Processor seconds, wall seconds, seconds and MiB of a GPU, MiB of memory. Only the first two are known for all
#: matchers.
COSTS = ("seconds", "wall_seconds", "gpu_seconds", "gpu_mb", "memory_mb")
