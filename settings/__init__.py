"""The settings of a scene: the table of all there are, how they are read, what pairs are named by."""
