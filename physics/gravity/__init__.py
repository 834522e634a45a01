"""Strength against gravity: the gravity of a moon, the slopes that stand, and slides to the angle of repose."""
