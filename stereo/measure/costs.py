"""The costs of matching a pair: time and memory."""

from __future__ import annotations

#: CPU seconds, seconds until the result, seconds and MiB of a GPU, MiB of memory. Only the first two are known of every
#: matcher.
COSTS = ("seconds", "wall_seconds", "gpu_seconds", "gpu_mb", "memory_mb")
