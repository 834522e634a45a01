"""The folder of a pair: what it contains, how it takes its place, which files are ours."""
