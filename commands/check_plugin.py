"""The verb ``check-plugin``: try a plug-in and print its faults."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator

from ..physics.terrain.landforms.check_landform import check_landform
from ..plugins.common_checks import Check, check_package
from ..plugins.installed import GROUPS, Found, Plugin, find_installed
from ..stereo.environment import packages
from ..support.errors import IcyMoonError
from ..support.printer import say
from ..support.suggestions import suggest_nearest


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``check-plugin``."""
    parser.add_argument("name", nargs="?", metavar="NAME", help="name of the plug-in or of its package (list all)")
    parser.set_defaults(run=_run_check_plugin)


def find_all_plugins() -> dict[str, Found]:
    """Find the plug-ins of this Python, by kind."""
    from ..stereo import export, matchers
    from ..stereo.measure import plug_in as metrics

    return {
        "matcher": matchers.find_plugins(),
        "landform": find_installed("landform"),
        "metric": metrics.find_plugins(),
        "export": export.find_plugins(),
    }


def run_checks(plugin: Plugin) -> Iterator[Check]:
    """Run all checks of a plug-in, up to the first failure that makes the other checks meaningless."""
    yield from check_package(plugin)
    if plugin.kind == "landform":
        yield from check_landform(plugin)
        return
    from ..stereo.check_plugin import check_export, check_matcher, check_metric

    special: dict[str, Callable[[Plugin], Iterator[Check]]] = {
        "matcher": check_matcher,
        "metric": check_metric,
        "export": check_export,
    }
    yield from special[plugin.kind](plugin)


def _run_check_plugin(options: argparse.Namespace) -> int:
    packages.require_modules("numpy", "cv2", "OpenEXR")
    found = find_all_plugins()
    if options.name is None:
        return _list_plugins(found)
    if refused := [each.refused[options.name] for each in found.values() if options.name in each.refused]:
        raise IcyMoonError(refused[0])
    chosen = [
        plugin
        for each in found.values()
        for plugin in each.added.values()
        if options.name in (plugin.name, plugin.package)
    ]
    if not chosen:
        raise IcyMoonError(_not_found_text(options.name, found))
    faults = 0
    for plugin in chosen:
        say(f"{plugin.kind} {plugin.name}, {plugin.release}")
        for check in run_checks(plugin):
            say(f"  {'FAULT' if check.fault else 'ok   '}  {check.what}", at_once=True)
            if check.fault:
                say(f"         {check.fault}", at_once=True)
            faults += bool(check.fault)
    say("It can be used." if not faults else f"{faults} to correct.")
    return 1 if faults else 0


def _not_found_text(name: str, found: dict[str, Found]) -> str:
    known: Collection[str] = [plugin.name for each in found.values() for plugin in each.added.values()]
    if not known:
        return (
            f"No plug-in {name!r} is installed in this Python, nor any other; install its package with pip, and "
            f"give it an entry point in one of {', '.join(GROUPS.values())}."
        )
    return f"No plug-in {name!r} is installed in this Python; {suggest_nearest(name, known)}"


def _list_plugins(found: dict[str, Found]) -> int:
    for kind, each in found.items():
        for plugin in each.added.values():
            say(f"{kind} {plugin.name}, {plugin.release}")
        for sentence in each.refused.values():
            say(sentence)
    return 1 if any(each.refused for each in found.values()) else 0
