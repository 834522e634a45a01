"""Materials: the laws of reflection as shader nodes and OSL."""
