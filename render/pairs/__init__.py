"""The folder of a pair: its content, its publication, and the names of its files."""
