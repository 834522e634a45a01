"""Chooses the channel of an EXR file, or the array of an npz file, that contains a map of disparity or depth.

A file may have many channels: colours, normals, the depths of several layers. A channel is chosen only if the names
exclude all other channels. If several remain, the user must state one.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...support.files import shorten
from ...support.foreign_bytes import RefusedError

#: Names of layers, passes or channels that contain a map.
_MAP_NAMES = {"depth": ("depth", "disparity"), "disparity": ("disparity", "depth")}
#: Components that may contain a map, the likeliest first.
_MAP_COMPONENTS = ("Z", "Y", "V", "R")
#: Passes that contain no map: directions, places, colours and labels.
_PASSES_WITHOUT_MAP = (
    "normal",
    "position",
    "vector",
    "uv",
    "image",
    "combined",
    "rgb",
    "colour",
    "color",
    "diff",
    "gloss",
    "emit",
    "index",
    "crypto",
    "shadow",
    "ao",
    "mist",
)
#: Most names that a sentence quotes.
_MAX_QUOTED_NAMES = 6
#: Components of a vector, colours of a picture, and its opacity. Two or more components of a vector are no map.
_VECTOR, _COLOURS, _OPACITY = {"x", "y", "z"}, ("R", "G", "B"), "A"


def choose_channel(names: Sequence[str], kind: str, predicted: bool = False) -> str:
    """Choose the channel among ``names`` that holds a map of ``kind`` "depth" or "disparity".

    Names of layers and passes count first, then the usual names of channels. A component such as Z is a depth in a pass
    called Depth, but a direction in a pass called Normal or beside an X and a Y. Raises RefusedError if several layers
    may hold the map, or none. The remedy for truth is to state the channel in ``pairs.toml``; ``predicted`` maps have
    no such file.
    """
    if len(names) == 1:
        return names[0]
    scalars = [name for name in names if name.rpartition(".")[2] != _OPACITY and not _is_vector_component(name, names)]
    for group in _group_candidates(scalars, kind):
        if len(group) > 1:
            raise RefusedError(
                f"has several channels that may hold the {_pluralise_kind(kind)}, {_list_names(group)}; "
                + (
                    f"keep one of them, as {kind}.Y."
                    if predicted
                    else "state one of them as truth.channel in pairs.toml."
                )
            )
        if group:
            return group[0]
    raise RefusedError(
        f"has the channels {_list_names(names)}, and none has a name for {_pluralise_kind(kind)}; "
        f"{_ask_for_channel(kind, predicted)}"
    )


def find_sibling_colours(name: str, names: Sequence[str]) -> list[str]:
    """Find the other colours of the picture that contains a channel; empty if the channel is not a colour."""
    layer, dot, own = name.rpartition(".")
    others = [layer + dot + colour for colour in _COLOURS if own in _COLOURS and colour != own]
    return [each for each in others if each in names]


def refuse_picture(name: str, names: Sequence[str], kind: str, predicted: bool = False) -> None:
    """Raise RefusedError, because a channel belongs to a picture of different colours.

    The caller accepts three equal channels, which may be a map.
    """
    raise RefusedError(
        f"has the channels {_list_names(names)}, of which {shorten(name)} is a colour of a picture and none "
        f"is called as one with {_pluralise_kind(kind)}; {_ask_for_channel(kind, predicted)}"
    )


def _ask_for_channel(kind: str, predicted: bool) -> str:
    return (
        f"write them as the channel {kind}.Y."
        if predicted
        else f"write the {_pluralise_kind(kind)} as the channel {kind}.Y, or state theirs as truth.channel in "
        "pairs.toml."
    )


def find_stated_channel(names: Sequence[str], stated: str) -> str:
    """Return the stated ``truth.channel`` if ``names`` has it. Raises RefusedError if it is missing."""
    if stated not in names:
        raise RefusedError(
            f"has no {shorten(stated)}, which truth.channel in pairs.toml states, but "
            f"{_list_names(names)}; state one of these."
        )
    return stated


def choose_array(names: Sequence[str], kind: str, predicted: bool = False) -> str:
    """Choose the array of an npz with the name ``kind``, else its only array.

    Raises RefusedError if there is neither.
    """
    if kind in names:
        return kind
    if len(names) == 1:
        return names[0]
    raise RefusedError(
        f"contains the arrays {_list_names(names)}; call the one with the {_pluralise_kind(kind)} {kind}"
        + ("." if predicted else ", or state it as truth.channel in pairs.toml.")
    )


def _list_names(names: Sequence[str]) -> str:
    """Join the first names, in the form that a user has to type."""
    shown = [shorten(name) for name in names[:_MAX_QUOTED_NAMES]]
    return ", ".join([*shown, *([f"{len(names) - _MAX_QUOTED_NAMES} more"] if len(names) > _MAX_QUOTED_NAMES else [])])


def _pluralise_kind(kind: str) -> str:
    return "depths" if kind == "depth" else "disparities"


def _group_candidates(names: Sequence[str], kind: str) -> list[list[str]]:
    """Group channels of different layers that may hold the map, the likeliest group first."""
    other_words = [
        name for name in names if not any(layer.startswith(_PASSES_WITHOUT_MAP) for layer in _split_words(name)[:-1])
    ]
    return [
        *(
            _drop_repeated_colours([name for name in names if fits(word, name)])
            for word in _MAP_NAMES[kind]
            for fits in (_has_word, _has_word_beginning)
        ),
        *(
            _drop_repeated_colours([name for name in other_words if name.split(".")[-1] == component])
            for component in _MAP_COMPONENTS
        ),
    ]


def _has_word(word: str, name: str) -> bool:
    return word in _split_words(name)


def _has_word_beginning(word: str, name: str) -> bool:
    return any(part.startswith(word) for part in _split_words(name))


def _split_words(name: str) -> list[str]:
    return name.lower().split(".")


def _drop_repeated_colours(names: Sequence[str]) -> list[str]:
    """Keep only the first colour of each layer, because a depth may be stored as three equal colours."""
    found: dict[str, str] = {}
    for name in sorted(names, key=lambda name: "RGB".find(name.rpartition(".")[2])):
        layer, _, own = name.rpartition(".")
        found.setdefault(f"{layer}." if own in _COLOURS else name, name)
    return sorted(found.values())


def _is_vector_component(name: str, names: Sequence[str]) -> bool:
    """Return whether a channel is a component of a vector, judged by the channels beside it."""
    layer, _, own = name.rpartition(".")
    beside = {each.rpartition(".")[2].lower() for each in names if each.rpartition(".")[0] == layer} & _VECTOR
    return own.lower() in beside and len(beside) > 1
