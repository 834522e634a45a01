"""The settings of a scene: their table, how they are read and checked, and the ids of pairs."""
