"""Programs for the user's own Python: each runs alone there, with NumPy and without Icy Moon."""
