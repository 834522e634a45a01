"""The lander: its materials and objects, and the pose of its arm."""
