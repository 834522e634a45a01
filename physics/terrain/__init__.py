"""The ground as a random surface with stated statistics, and the landforms on it."""
