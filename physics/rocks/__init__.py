"""Rocks: how many of which size, their shapes, where they lie."""
