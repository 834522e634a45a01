"""Preregistered studies: render settings compared with converged renders on many grounds."""
