"""Comparisons with independent results: measurements, other programs, another renderer. Imports no Blender."""
