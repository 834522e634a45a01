"""Numbers as texts for the user. Imports nothing."""

from __future__ import annotations


def show_rounded(value: float, digits: int = 2) -> str:
    """Format a number with ``digits`` significant digits, no exponent, and a space between thousands: 0.0012, 1 200.
    (The format ``.2g`` would turn 100 into 1e+02.)"""
    return f"{float(f'{value:.{digits}g}'):,.10g}".replace(",", " ")


def show_place(latitude_deg: float, longitude_deg: float, form: str = "g") -> str:
    """Format a site on a globe, as in "80° S, 29° E"; ``form`` is the format of the numbers."""
    sides = "S" if latitude_deg < 0 else "N", "W" if longitude_deg < 0 else "E"
    return ", ".join(
        f"{abs(value):{form}}° {side}" for value, side in zip((latitude_deg, longitude_deg), sides, strict=True)
    )


def format_count(number: int, thing: str, things: str = "") -> str:
    """Format a count with its noun: 1 pair, 0 pairs, 12 pairs.

    ``things`` is the plural, if it is not ``thing`` with an s.
    """
    return f"{number} {thing if number == 1 else things or f'{thing}s'}"
