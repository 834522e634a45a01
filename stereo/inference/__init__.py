"""Statistics over scenes: typical scenes, means and shares, with confidence intervals of the stated coverage.

The modules work on arrays only.
"""
