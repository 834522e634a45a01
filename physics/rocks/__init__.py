"""Rocks: their numbers by size, their shapes and their places."""
