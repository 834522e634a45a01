"""Random numbers that follow from one seed."""
