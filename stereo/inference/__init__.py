"""Statistics over scenes: typical scenes, means and shares, with confidence intervals of the stated coverage. Works on
arrays only."""
