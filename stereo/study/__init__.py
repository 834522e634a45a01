"""Preregistered studies: recipes of rendering held against converged renders on many grounds."""
