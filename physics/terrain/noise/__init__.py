"""Noise that terrain is made of: on a lattice, between random points, and sums of octaves."""
