"""The harness: suites, methods, metrics, runs, tables, checks and the command line.

`draw_cloud` and `turntable` make images of points, `show` a page that turns them. `pyproject.toml`
has the order of the sub-packages. Other packages may import `bench.methods`, `bench.image_metric`
and `bench.render_cloud`, the former names of three modules.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.draw.points import draw_cloud, turntable
    from bench.draw.show import show

__all__ = ["draw_cloud", "show", "turntable"]

_PUBLIC = {
    "methods": "bench.catalogue.methods",  # Method
    "image_metric": "bench.catalogue.plugins",  # ImageMetric
    "render_cloud": "bench.draw.cloud",  # draw_file
}


class _Renamed(ModuleType):
    """A module under its former name, imported when a name in it is used."""

    def __getattr__(self, name: str) -> object:
        return getattr(import_module(_PUBLIC[self.__name__.removeprefix("bench.")]), name)


for _name in _PUBLIC:
    globals()[_name] = sys.modules[f"bench.{_name}"] = _Renamed(f"bench.{_name}")


def __dir__() -> list[str]:
    return sorted([*__all__, *_PUBLIC])


def __getattr__(name: str) -> Any:
    """Return a public function, whose module is imported now."""
    if name not in __all__:
        raise AttributeError(f"module 'bench' has no attribute '{name}'")
    module = "bench.draw.show" if name == "show" else "bench.draw.points"
    return getattr(import_module(module), name)
