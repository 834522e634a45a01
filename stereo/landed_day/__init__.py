"""A landed day, step by step: look, choose a site, dig, verify, stop."""
