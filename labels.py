"""Names and numbers that the truth in the images is labelled with. Imports nothing."""

BEAUTY, TRUTH = "Beauty", "Truth"  # the view layers, and so the layers of each EXR
NORMAL_AOV = "GeometricNormal"  # value pass: the facet's normal, without bump or smooth shading

#: Values of the semantic channel (material index). 0 with a finite depth is an object without label.
SEMANTIC = {0: "sky", 1: "terrain", 2: "rock", 3: "lander", 4: "planet"}
TERRAIN, ROCK = 1, 2
#: Values of the instance channel (object index): the terrain, and the first of the blocks.
TERRAIN_INSTANCE = 1
FIRST_ROCK_INSTANCE = 1000
