"""Programs for the user's own Python. Each needs NumPy there, but not Icy Moon."""
