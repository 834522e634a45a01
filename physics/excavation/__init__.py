"""Digging: what a scoop takes out of the ground, whether walls stand, and the heap beside the trench."""
