"""The script node of ``hapke.osl``, made without Blender's own Python code for script nodes.

That code needs ``oslquery``, which the wheels from 4.5 on do not contain. All wheels contain the compiler of Cycles.
The sockets of the node are read from its output.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy

from ...support.blender import compat
from ...support.temporary_folders import open_scratch_folder
from ..tree.builder import Node, Tree

SOURCE = Path(__file__).parent / "hapke.osl"
_SOCKET_TYPES = {
    "float": "NodeSocketFloat",
    "int": "NodeSocketInt",
    "color": "NodeSocketColor",
    "vector": "NodeSocketVector",
    "normal": "NodeSocketVector",
    "closure color": "NodeSocketShader",
}
#: Source positions of instructions, which 4.2 writes into its byte code.
_FILE_NAME = re.compile(r' ?%filename\{"[^"\n]*"\}')
_PARAMETER_LINE = re.compile(r"^(o?param)\t(closure color|\w+)\t(\w+)", re.MULTILINE)


@lru_cache(maxsize=1)
def compile_source() -> str:
    """Compile ``hapke.osl`` to byte code. Raises RuntimeError if it does not compile.

    The compiler's comments and file names are removed: file names contain folders of this machine, and comments differ
    at each call.
    """
    with open_scratch_folder() as folder:
        target = folder / "hapke.oso"
        if not compat.compile_osl(SOURCE, target):
            raise RuntimeError(f"Cycles could not compile {SOURCE.name}.")
        lines = target.read_text(encoding="utf-8").splitlines(keepends=True)
        return _FILE_NAME.sub("", "".join(line for line in lines if not line.startswith("#")))


def add_script_node(tree: Tree, label: str, inputs: Mapping[str, Any]) -> Node:
    """Add the script node and set all its inputs. Raises ValueError if an input is missing or unknown."""
    code = compile_source()
    node = tree.tree.nodes.new("ShaderNodeScript")
    node.name = node.label = label
    node.mode = "INTERNAL"
    for kind, type_name, name in _PARAMETER_LINE.findall(code):
        (node.inputs if kind == "param" else node.outputs).new(_SOCKET_TYPES[type_name], name)
    node.bytecode = code
    node.bytecode_hash = hashlib.md5(code.encode(), usedforsecurity=False).hexdigest()
    if wrong := {s.name for s in node.inputs} ^ set(inputs):
        raise ValueError(f"{SOURCE.name}: inputs not set or unknown: {sorted(wrong)}")
    for name, value in inputs.items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.tree.links.new(value, node.inputs[name])
        else:
            node.inputs[name].default_value = value
    return node
