"""Statistics over scenes: typical scenes, means and shares, with intervals that cover. Works on arrays only."""
