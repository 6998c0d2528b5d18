"""The stages of methods by name: blocks of code whose arithmetic can be changed, and nothing else.

A method marks its stages by `stage`; a study of rounding changes the arithmetic of some of them by
`at_stages`. A run does neither, and a stage then costs a microsecond.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager

NETWORK = "network"  # a forward pass
METRICS = "metrics"  # scores and features of images
Change = Callable[[], AbstractContextManager[object]]

_changes: list[tuple[Collection[str], Change]] = []
_changed: list[int] = []  # changes that are in force, by their place in the list


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Mark the block as a stage of a method, such as "normals"; a stage may contain others."""
    with ExitStack() as entered:
        for place, (names, change) in enumerate(_changes):
            if name in names and place not in _changed:
                _changed.append(place)
                entered.callback(_changed.remove, place)
                entered.enter_context(change())
        yield


@contextmanager
def at_stages(names: Collection[str], change: Change) -> Iterator[None]:
    """Enter the context `change()` in each stage of these names within the block.

    Without names it is entered once, around the block. A stage within one whose context is entered
    belongs to that. Only this thread's stages are meant: methods have one.
    """
    if not names:
        with change():
            yield
        return
    _changes.append((names, change))
    try:
        yield
    finally:
        _changes.pop()
