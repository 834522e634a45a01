"""The Sun, the planet, its rings and the stars, as seen from a place at a time."""
