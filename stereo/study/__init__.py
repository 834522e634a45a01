"""Preregistered studies: recipes of rendering compared with converged renders on many grounds."""
