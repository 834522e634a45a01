"""From a scene to files: what Cycles is told, the pair folder, the worker process and its queue."""
