"""The images of a pair: reading, developing, and what the truth tells about each pixel."""
