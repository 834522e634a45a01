"""Contents of files for tests, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping


class Files(Mapping[str, bytes]):
    """Contents by name. One that is given as a function is made when it is first asked for, once.

    Every worker imports every module of tests, also those whose tests another one runs.
    """

    def __init__(self, contents: Mapping[str, bytes | Callable[[], bytes]]) -> None:
        self._contents = dict(contents)

    def __getitem__(self, name: str) -> bytes:
        content = self._contents[name]
        if callable(content):
            content = self._contents[name] = content()
        return content

    def __iter__(self) -> Iterator[str]:
        return iter(self._contents)

    def __len__(self) -> int:
        return len(self._contents)
