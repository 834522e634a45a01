"""What a panel draws, recorded without a window."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import bpy


class Layout:
    """Stands in for ``UILayout``: takes everything that one does, and refuses what Blender has not."""

    real = bpy.types.UILayout.bl_rna
    record: list[Any]

    def __init__(self, record: list[Any] | None = None) -> None:
        self.__dict__["record"] = [] if record is None else record

    def __setattr__(self, name: str, value: object) -> None:
        assert name in self.real.properties, f"a layout has no {name}"

    def __getattr__(self, name: str) -> Callable[..., Layout]:
        assert name in self.real.functions, f"a layout has no {name}"

        def call(*arguments: object, **options: object) -> Layout:
            known = self.real.functions[name].parameters
            assert set(options) <= set(known.keys()), f"{name} does not take {set(options) - set(known.keys())}"
            self.check_icon(options.get("icon", "NONE"))
            self.record.append((name, arguments, options))
            return Layout(self.record)

        return call

    def check_icon(self, icon: object) -> None:
        assert icon in self.real.functions["label"].parameters["icon"].enum_items, f"there is no icon {icon}"

    def panel(self, name: str, *, default_closed: bool = False) -> tuple[Layout, Layout]:
        return Layout(self.record), Layout(self.record)

    def prop(self, data: bpy.types.bpy_struct, key: str, **options: object) -> None:
        assert key in data.bl_rna.properties, f"{data} has no {key}"
        self.record.append(("prop", data.path_from_id(key) if data.id_data else key, options))

    def prop_search(self, data: bpy.types.bpy_struct, key: str, _: object, listed: str, **options: object) -> None:
        assert listed in bpy.data.bl_rna.properties, f"a file has no {listed}"
        self.prop(data, key, **options)

    def operator(self, name: str, *, text: str = "", icon: str = "NONE", **options: object) -> object:
        category, _, verb = name.partition(".")
        assert verb in dir(getattr(bpy.ops, category)), f"there is no operator {name}"
        self.check_icon(icon)
        rna = getattr(getattr(bpy.ops, category), verb).get_rna_type()
        self.record.append(("operator", name, text))
        return _Settable(rna)

    def template_list(
        self,
        kind: str,
        _: str,
        data: bpy.types.bpy_struct,
        key: str,
        active: bpy.types.bpy_struct,
        active_key: str,
        **options: object,
    ) -> None:
        assert active_key in active.bl_rna.properties, f"{active} has no {active_key}"
        self.prop(data, key)
        for item in getattr(data, key):
            cls = getattr(bpy.types, kind)
            cls.draw_item(cls, bpy.context, self, data, item, 0, active, active_key)

    def menu(self, name: str, **options: object) -> None:
        assert hasattr(bpy.types, name), f"there is no menu {name}"
        self.check_icon(options.get("icon", "NONE"))
        self.record.append(("menu", name, options))


class _Settable:
    """Stands in for the properties of an operator on a button."""

    rna: bpy.types.Struct

    def __init__(self, rna: bpy.types.Struct) -> None:
        self.__dict__["rna"] = rna

    def __setattr__(self, name: str, value: object) -> None:
        prop = self.rna.properties[name]
        if prop.type == "ENUM" and prop.enum_items:
            assert value in prop.enum_items, f"{self.rna.identifier}.{name} cannot be {value!r}"


def drawn(cls: Any) -> list[Any]:
    """What a panel or menu draws now; nothing where its poll says so."""
    if not getattr(cls, "poll", lambda context: True)(bpy.context):
        return []
    layout = Layout()
    instance = SimpleNamespace(
        layout=layout, **{name: getattr(cls, name) for name in ("topic", "section", "kind") if hasattr(cls, name)}
    )
    if "draw_header" in cls.__dict__:
        cls.draw_header(instance, bpy.context)
    cls.draw(instance, bpy.context)
    return layout.record


def texts(record: list[Any]) -> str:
    return " ".join(str(entry) for entry in record)
