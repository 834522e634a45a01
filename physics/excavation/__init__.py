"""Digging: the volume that a scoop removes, walls that stand or slide, and the heap beside the trench."""
