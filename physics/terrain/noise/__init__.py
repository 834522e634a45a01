"""Noise of which terrain is made: on a lattice, between random points, and sums of octaves."""
