"""The folder of a pair: its content, how it takes its place, which files are ours."""
