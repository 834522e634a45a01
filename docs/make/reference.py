"""The reference pages of the manual, generated from the code that they document.

``pages`` returns Markdown by path below ``docs/``: settings and their ranges from ``settings/topics/``,
presets and their sources from the TOML files, both command lines from their parsers, matchers from
their options, operators from their source. Needs no Blender.
"""

from __future__ import annotations

import argparse
import ast
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from icymoon.commands import cli
from icymoon.render.plans.vary_scene import SPACINGS
from icymoon.settings import preset_files, toml_text
from icymoon.settings.table import TOPICS, list_ground_settings
from icymoon.settings.topics.declaration import Setting
from icymoon.settings.topics.scene import OUR_TOPICS
from icymoon.stereo import cli as stereo_cli
from icymoon.stereo.export import OPTIONS
from icymoon.stereo.matchers import find_plugins, load_matcher
from icymoon.support.version import ROOT
from mistakes import MISTAKES
from notebooks import pages as _notebooks
from python_api import page as _python

#: The first step that must be repeated after a change of a setting, by its effect.
EFFECTS = {
    "geometry": "build",
    "material": "render",
    "light": "render",
    "lander": "render",
    "camera": "render",
    "sampling": "render",
    "response": "evaluate",
    "run": "",
}


#: The first line of a generated page, which a browser does not show.
HEADER = "<!-- This page is generated. Change what it is made from, then run: make docs-pages -->\n\n"


def pages() -> dict[str, str]:
    """Every generated page."""
    return {path: HEADER + text for path, text in _bodies().items()}


def _bodies() -> dict[str, str]:
    return {
        "reference/settings.md": _settings(),
        "reference/presets.md": _presets(),
        "reference/cli.md": _cli(),
        "reference/matchers.md": _matchers(),
        "reference/operators.md": _operators(),
        "reference/errors.md": _errors(),
        "reference/python.md": _python(),
        "reference/requires.md": _requires(),
        **_notebooks(),
    }


def _cell(text: str) -> str:
    """Text in the form of a table's cell."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def _table(heads: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


# ---- settings -------------------------------------------------------------------------------------------------------


def _settings() -> str:
    parts = [
        "# Settings\n",
        "This page lists every setting. It is generated from `settings/topics/`, which also determine the "
        "sidebar, the TOML files, `--set` and `pair.json`. A value outside the range is refused. Sliders end at "
        "the range in brackets; type a number to go beyond. Unit 1 is a plain number. *Repeat from* is the first "
        "step that must be repeated after a change: build the scene, render or evaluate. It is empty if none "
        "must.\n",
        "Topics: " + ", ".join(f"[{key}](#{key})" for key in OUR_TOPICS) + ".\n",
    ]
    for topic in OUR_TOPICS.values():
        parts.append(f"## {topic.key}\n\n**{topic.label}.** {topic.description}.\n")
        owner = _owner(topic.key)
        if owner != topic.key:
            parts.append(f"This topic has the same settings as [{owner}](#{owner}).\n")
            continue
        parts.append(_setting_table(topic.key, topic.settings))
        for setting in topic.settings:
            if setting.entries:
                parts.append(f"Each table of `{topic.key}.{setting.key}` has these entries:\n")
                parts.append(_setting_table(f"{topic.key}.{setting.key}", setting.entries))
    return "\n".join(parts)


def _owner(topic: str) -> str:
    """The first topic with the settings of this one: rocks share those of the ground's surface."""
    return next(t.key for t in OUR_TOPICS.values() if t.settings is TOPICS[topic].settings)


def _setting_table(prefix: str, listed: tuple[Setting, ...]) -> str:
    return _table(
        ("Setting", "Default", "Unit", "Range", "Meaning", "Repeat from"),
        [
            (
                f'<span id="{prefix}.{s.key}"></span>`{s.key}`',
                _default(s),
                s.unit,
                _range(s),
                _meaning(s),
                EFFECTS[s.effect],
            )
            for s in listed
        ],
    )


def _default(setting: Setting) -> str:
    if setting.kind == "bool":
        return str(setting.default).lower()
    if setting.kind in ("text", "choice"):
        return f"`{setting.default}`" if setting.default else "empty"
    if setting.kind == "list":
        return "none"
    return _number(setting.default)


def _range(setting: Setting) -> str:
    if setting.kind not in ("int", "float"):
        return {"bool": "true, false", "text": "text", "list": "tables", "choice": "names"}[setting.kind]
    low, high = setting.soft or (setting.minimum, setting.maximum)
    slider = "" if (low, high) == (setting.minimum, setting.maximum) else f"<br>({_number(low)} to {_number(high)})"
    return f"{_number(setting.minimum)} to {_number(setting.maximum)}{slider}".replace(" ", "&nbsp;")


def _number(value: Any) -> str:
    """A number in its shortest form: 1e6, 2.521e5, 0.001."""
    plain = f"{value:.10g}"
    if "e" not in plain and len(plain) < 7:
        return plain
    mantissa, exponent = f"{value:.9e}".split("e")
    short = f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    return short if len(short) < len(plain) else plain


def _meaning(setting: Setting) -> str:
    text = f"**{setting.label}.** {_cell(setting.description)}."
    return text + "".join(f"<br>`{name}` {label}: {_cell(meaning)}." for name, label, meaning in setting.choices)


# ---- presets --------------------------------------------------------------------------------------------------------


def _presets() -> str:
    parts = [
        "# Presets\n",
        "These presets are shipped in `presets/`. Each is a TOML file, and every number in it has a source. A "
        "preset of a scene includes others. `--preset` may be given several times; the later preset wins. "
        "*Chosen* means that no measurement is known and that the value is a decision.\n",
    ]
    kinds = sorted({name.split("/")[0] for name in preset_files.preset_names()}, key=[*preset_files.PRESET_KINDS].index)
    for kind in kinds:
        parts.append(f"## {preset_files.PRESET_KINDS[kind]}\n")
        parts += [_preset(name) for name in preset_files.preset_names(kind)]
    return "\n".join(parts)


def _preset(name: str) -> str:
    raw = toml_text.read_toml(preset_files.find_preset(name))
    header, sources, measured = raw.pop("preset"), raw.pop("sources"), raw.pop("measured", None)
    text = f"### {name}\n\n**{header['title']}.** {header['description']}.\n"
    if included := header.get("include"):
        text += "\nIncludes " + ", ".join(f"[{one}](#{one.replace('/', '')})" for one in included) + ".\n"
    rows = [
        (f"[{topic}.{key}](settings.md#{_owner(topic)}.{key})", _cell(_value(value)), _cell(sources[f"{topic}.{key}"]))
        for topic, values in raw.items()
        for key, value in values.items()
    ]
    text += "\n" + _table(("Setting", "Value", "Source"), rows)
    if not measured:
        return text
    return text + (_describe_slope(measured) if "rms_slope_deg" in measured else _describe_quality(measured))


def _describe_slope(measured: dict[str, Any]) -> str:
    """The measured slope of a terrain with its landforms."""
    return f"\n{measured['what']}: {measured['rms_slope_deg']}° (`{measured['command']}`).\n"


def _describe_quality(measured: dict[str, Any]) -> str:
    """The cost of a quality, and its distance from a converged render."""
    bake = f", and baking its light {measured['bake_cpu_s']:.1f} s" if measured["bake_cpu_s"] else ""
    text = (
        f"\nMeasured on {measured['scene']} (`{measured['command']}`). A further pair takes "
        f"{measured['cpu_s']:.1f} processor seconds{bake}. The mean radiance is off by "
        f"{100 * measured['radiance_bias']:+.2f} %, a pixel by {100 * measured['radiance_rms']:.1f} % (root mean "
        "square). Differences from the converged render:\n\n"
    )
    suns = {key.split("_")[1]: found for key, found in measured.items() if key.startswith("sun_")}
    rows = [
        (
            f"{matcher}",
            *(f"{100 * found[f'{label}_{key}']:+.1f} %" for found in suns.values() for key in ("bad_1", "coverage")),
        )
        for label, matcher in (("bm", "StereoBM"), ("sgbm", "SGBM"), ("jplv", "JPLV"))
    ]
    return text + _table(("Matcher", *(f"Sun {sun}°: {what}" for sun in suns for what in ("bad-1", "coverage"))), rows)


def _value(value: object) -> str:
    if isinstance(value, list):
        return "; ".join(", ".join(f"{k} {v}" for k, v in entry.items()) for entry in value)
    if isinstance(value, bool):
        return str(value).lower()
    return _number(value) if isinstance(value, float) else str(value)


# ---- errors ---------------------------------------------------------------------------------------------------------


def _errors() -> str:
    parts = [
        "# When something goes wrong\n",
        "Every error is one sentence that reports what is wrong, where, and how to fix it. The window shows it "
        "in the status bar and in the Info editor. A command prints it on standard error and ends with exit "
        "status 1. Nothing half-written is left; run the same command again to go on. A traceback is a defect, "
        "so please report it. This page lists the common errors. **Preferences ▸ Add-ons ▸ Icy Moon ▸ Check** "
        "and `python -m icymoon doctor` show what is missing on your machine.\n",
    ]
    for title, mistakes in MISTAKES.items():
        parts.append(f"## {title}\n")
        parts.append(
            _table(
                ("Cause", "Error", "Fix"),
                [(f"{_cell(m.wrong)}.", f"… {_cell(m.message)} …", f"… {_cell(m.fix)}") for m in mistakes],
            )
        )
    return "\n".join(parts)


# ---- command lines --------------------------------------------------------------------------------------------------


def _cli() -> str:
    text = (
        "# Command lines\n\nResults are printed on standard output, messages on standard error. The exit status is "
        "0 for success, 1 after an error, which reports its fix, 2 for a wrong command line, and 130 when "
        "stopped.\n"
    )
    # The parsers are what the programs themselves use.
    for title, parser in (
        ("python -m icymoon", cli.make_parser()),
        ("python -m icymoon.stereo", stereo_cli.make_parser()),
    ):
        text += f"\n## {title}\n\n{parser.description}\n"
        for name, (meaning, verb) in _verbs(parser).items():
            text += f"\n### {title} {name}\n\n{_sentence(meaning)}\n\n{_options(verb)}"
    return text


def _verbs(parser: argparse.ArgumentParser) -> dict[str, tuple[str, argparse.ArgumentParser]]:
    """(meaning, parser) of each verb of a command line, by its name."""
    (verbs,) = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    meanings = {choice.dest: choice.help or "" for choice in verbs._choices_actions}
    return {name: (meanings.get(name, ""), verb) for name, verb in verbs.choices.items()}


def _options(parser: argparse.ArgumentParser) -> str:
    rows = []
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        word = action.metavar or (action.dest.upper() if action.option_strings else action.dest)
        shape = word if isinstance(word, str) else " ".join(word)
        if action.choices:
            shape = "{" + ",".join(map(str, action.choices)) + "}"
        if action.nargs == 0:
            shape = ""
        elif action.nargs == "+":
            shape += " …"
        elif action.nargs in ("?", "*"):
            shape = f"[{shape}]"
        words = " ".join(part for part in ("/".join(action.option_strings), shape) if part)
        # A default that is a path of the machine that builds the manual is not shown; the help describes it.
        told = (action.help or "") % {"default": action.default}
        rows.append(
            (f"`{words}`", _cell(_sentence(told)) + (" Required." if action.required and action.option_strings else ""))
        )
    return _table(("Argument", "Meaning"), rows) if rows else "This command takes no arguments.\n"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")


# ---- matchers -------------------------------------------------------------------------------------------------------


def _matchers() -> str:
    parts = [
        "# Matchers\n",
        "These are the names for `--methods`. Give options after a colon, as in `bm:window=21`, or with "
        "`--option bm.window=21`.\n",
    ]
    for name, plugin in find_plugins().usable.items():
        if not plugin.built_in:
            continue
        module = load_matcher(name)
        parts.append(f"## {name}\n\n{(module.__doc__ or '').strip().splitlines()[0]}\n")
        parts.append(
            _table(
                ("Option", "Default", "Values", "Meaning"),
                [
                    (f"`{o.key}`", _cell(str(o.default)) or "empty", _cell(o.range), _cell(o.doc))
                    for o in module.OPTIONS
                ],
            )
        )
        for preset, chosen in module.PRESETS.items():
            parts.append(f"`preset={preset}`: " + ", ".join(f"{key} {value}" for key, value in chosen.items()) + ".\n")
    return "\n".join(parts)


# ---- operators ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Operator:
    """An operator as stated in its source: (name, description) of its ``properties`` by key, and the ``choices`` of
    those that are enumerations."""

    name: str
    label: str
    description: str
    properties: dict[str, tuple[str, str]]
    choices: dict[str, list[str]]


def operators() -> list[Operator]:
    """Every operator of ``operators/`` and ``panels/``, in the order of their files."""
    files = [path for room in ("operators", "panels") for path in sorted((ROOT / room).glob("*.py"))]
    return [operator for path in files for operator in _operators_of(path)]


def _operators_of(path: Path) -> Iterator[Operator]:
    module = ast.parse(path.read_text(encoding="utf-8"))
    classes = {node.name: node for node in module.body if isinstance(node, ast.ClassDef)}
    constants = _assigned(module.body)
    for node in classes.values():
        if "_OT_" not in node.name:
            continue
        body = _gather_statements(node, classes)
        stated = _assigned(body, constants)
        properties: dict[str, tuple[str, str]] = {}
        if "__annotations__" in stated:  # made of settings
            properties = {
                name: (TOPICS[topic][key].label, TOPICS[topic][key].description)
                for name, (topic, key) in list_ground_settings().items()
            }
        choices: dict[str, list[str]] = {name: [] for name in properties}
        if any(isinstance(base, ast.Name) and base.id == "_ValueFields" for base in node.bases):
            for name, words in _value_fields():
                properties[name] = (words["name"], words.get("description") or "")
                choices[name] = [choice for choice, *_ in words.get("items") or ()]
        if any(isinstance(base, ast.Name) and base.id == "_OptionFields" for base in node.bases):
            properties |= {option.key: (option.label, option.tooltip) for option in OPTIONS}
            choices |= {option.key: [] for option in OPTIONS}
        for statement in body:
            if (
                isinstance(statement, ast.AnnAssign)
                and isinstance(statement.target, ast.Name)
                and isinstance(statement.annotation, ast.Call)
            ):
                words = _file_words(statement.annotation) or _words(statement.annotation, constants)
                if words.get("name"):  # what has none is hidden
                    properties[statement.target.id] = (words["name"], words.get("description") or "")
                    choices[statement.target.id] = [name for name, *_ in words.get("items") or ()]
        yield Operator(stated["bl_idname"], stated["bl_label"], ast.get_docstring(node) or "", properties, choices)


def _gather_statements(node: ast.ClassDef, classes: Mapping[str, ast.ClassDef]) -> list[ast.stmt]:
    """The statements of a class, after those that it inherits from ``classes`` of its file."""
    bases = (classes[base.id] for base in node.bases if isinstance(base, ast.Name) and base.id in classes)
    return [statement for base in bases for statement in _gather_statements(base, classes)] + node.body


def _file_words(call: ast.Call) -> dict[str | None, Any]:
    """The name and the description of a property that ``dialogs.file_property`` makes; empty for others."""
    if not ast.unparse(call.func).endswith("file_property"):
        return {}
    return {"name": "File", "description": ast.literal_eval(call.args[0])}


def _value_fields() -> Iterator[tuple[str, dict[str | None, Any]]]:
    """The properties of ``scene_properties.make_varied_fields``, which the list and a dialog share."""
    module = ast.parse((ROOT / "settings" / "blender" / "scene_properties.py").read_text(encoding="utf-8"))
    function = next(
        node for node in module.body if isinstance(node, ast.FunctionDef) and node.name == "make_varied_fields"
    )
    made = next(node.value for node in function.body if isinstance(node, ast.Return))
    assert isinstance(made, ast.Dict)
    spacings = [ast.Constant(name) for name in SPACINGS]

    class Named(ast.NodeTransformer):
        def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
            return spacings[ast.literal_eval(node.slice)]

    for key, call in zip(made.keys, made.values, strict=True):
        if key is None:  # the same ends with other decimals, which are hidden
            continue
        assert isinstance(key, ast.Constant)
        assert isinstance(call, ast.Call)
        yield str(key.value), _words(Named().visit(call), {})


def _words(call: ast.Call, constants: dict[str, Any]) -> dict[str | None, Any]:
    """The arguments of a property: of its call, or of the setting that it represents."""
    words = {word.arg: _literal(word.value, constants) for word in call.keywords}
    if isinstance(call.func, ast.Attribute) and call.func.attr == "make_property":
        entry = call.args[0]  # TOPICS["topic"]["key"]
        assert isinstance(entry, ast.Subscript)
        assert isinstance(entry.value, ast.Subscript)
        setting = TOPICS[ast.literal_eval(entry.value.slice)][ast.literal_eval(entry.slice)]
        return {"name": setting.label, "description": setting.description, **words}
    return words


def _assigned(body: Sequence[ast.stmt], constants: dict[str, Any] | None = None) -> dict[str, Any]:
    """The literal values that statements give to names, and those of constants."""
    return {
        statement.targets[0].id: _literal(statement.value, constants or {})
        for statement in body
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name)
    }


def _literal(value: ast.expr, constants: dict[str, Any]) -> object:
    """The value of a literal or of a constant's name; None if it is known only at run time."""
    if isinstance(value, ast.Name):
        return constants.get(value.id)
    try:
        return ast.literal_eval(value)
    except ValueError:
        return None


def _operators() -> str:
    rows = [
        (
            f"`bpy.ops.{o.name}`",
            f"**{o.label}.** {_cell(o.description)}."
            + "".join(
                f"<br>`{key}` {name}: {_cell(text)}" + (f" ({', '.join(o.choices[key])})." if o.choices[key] else ".")
                for key, (name, text) in o.properties.items()
            ),
        )
        for o in operators()
    ]
    return (
        "# Operators\n\nAll operators are in Render ▸ Icy Moon or Add ▸ Mesh, so F3 finds them. Called from a "
        "script, an operator returns when its work is done. In the window, long work runs in a separate process. "
        "Settings are properties of `bpy.context.scene.icymoon`, for example "
        "`bpy.context.scene.icymoon.rig.baseline_m = 0.3`.\n\n" + _table(("Operator", "What it does"), rows)
    )


# ---- what a scene requires ------------------------------------------------------------------------------------------


def _requires() -> str:
    found = json.loads((ROOT / "docs" / "make" / "requires.json").read_text(encoding="utf-8"))
    rows = [
        (
            f"**{row['title']}**",
            row["needed"],
            f"{row['on_s']:g} s",
            f"{row['off_s']:g} s",
            f"{row['ratio']:.2f}",
            f"{100 * row['radiance']:+.2f} %" if "radiance" in row else "",
            row["changes"],
        )
        for row in found["rows"].values()
    ]
    return (
        "# What a scene requires\n\n"
        "Icy Moon switches each of these parts on only where a scene needs it. If the settings describe a part "
        "that a pair leaves out, the sidebar shows the reason under Quality and Speed ▸ Not Rendered, and "
        "`pair.json` contains it under `left_out`.\n\n"
        + _table(("Part", "On with", "Cost on", "Cost off", "Ratio", "Mean radiance", "What it changes"), rows)
        + f"\nThe table is made by `{found['command']}` in Blender {found['blender']}. Costs are processor seconds "
        f"on one thread, for a scene and one pair of it ({found['pair']}), or for a Python that imports a "
        f"package. Each is the least of {found['repeats']} in one run. *Mean radiance* compares the radiance "
        "without the part to that with it, as a ratio less 1. It includes the noise of the samples.\n"
    )
