"""The images of a pair: read, developed, and with the truth of each pixel."""
