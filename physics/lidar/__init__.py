"""Laser ranging: scan patterns, beams, instruments, and the returns of a pulse. Imports no Blender."""
