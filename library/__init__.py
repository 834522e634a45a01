"""Icy Moon as a Python library: what ``import icymoon`` offers to programs and notebooks."""
