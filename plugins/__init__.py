"""Plug-ins: additions from packages that the user installed in this Python."""
