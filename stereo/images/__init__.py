"""The images of a pair: read, developed, and what the truth says of each pixel."""
