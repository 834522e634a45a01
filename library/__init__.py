"""Icy Moon as a Python library: the names that ``import icymoon`` offers to programs and notebooks."""
