"""Plug-ins: what packages that the user installed in this Python add to ours."""
