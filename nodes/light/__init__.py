"""Sun, planet, rings, stars and sky as lamps and world."""
