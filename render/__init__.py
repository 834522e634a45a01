"""From a scene to files: the settings of Cycles, the pair folder, and the processes that render."""
