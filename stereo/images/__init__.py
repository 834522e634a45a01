"""The images of a pair: reading, developing, and the truth of each pixel."""
