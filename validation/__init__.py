"""Comparisons with what no one here made: measurements, other programs, another renderer. Imports no Blender."""
