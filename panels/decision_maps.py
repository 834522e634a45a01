"""The buttons that show decisions on the ground, a line of buttons for each matcher, and the meaning of the colours."""

from __future__ import annotations

import bpy

from ..nodes import painted_decisions
from ..operators.decisions_in_view import MAPS, list_decided_methods
from ..operators.session import session
from ..stereo.matchers.methods import describe_method
from .fields import draw_sentence


def draw_decisions(layout: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """Draw the last decisions of a scene, and a button for each map of each matcher that has decisions.

    The meanings of the colours follow below the buttons of the shown matcher: near the eye, and without moving a button
    from under the mouse.
    """
    for sentence in session.decided.get(scene.session_uid, ()):
        draw_sentence(layout, sentence, "INFO")
    shown, meanings = painted_decisions.find_shown_map(scene), painted_decisions.make_legend(scene)
    for method in list_decided_methods(scene):
        layout.separator(factor=0.5)
        column = layout.column(align=True)  # no box, because text in a box has too little contrast in the light theme
        name = describe_method(method)
        column.label(text=name[:1].upper() + name[1:])  # "true depth" begins with a capital letter as a title
        buttons = column.row(align=True)
        for kind, text, _ in MAPS:
            button = buttons.operator("icymoon.paint_decisions", text=text, depress=shown == (name, kind))
            button.method, button.map = method, kind
        if shown[0] == name:
            _draw_legend(column, meanings)
            meanings = ()
    if meanings:  # the decisions of this matcher were removed
        _draw_legend(layout.column(align=True), meanings)


def _draw_legend(column: bpy.types.UILayout, meanings: tuple[tuple[str, str], ...]) -> None:
    for meaning, icon in meanings:
        draw_sentence(column, meaning, icon)
    column.operator("icymoon.hide_decisions", icon="X")
