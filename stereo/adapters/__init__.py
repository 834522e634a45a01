"""Programs for the user's own Python. Each needs NumPy there, and not Icy Moon."""
