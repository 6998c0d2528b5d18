"""Datasets: objects by class, with clouds, views and true images."""

from __future__ import annotations

from importlib import import_module
from typing import Any
from warnings import warn


def __getattr__(name: str) -> Any:
    """Return a name of the former module `data_prep.datasets`, with a DeprecationWarning."""
    registry = import_module("data_prep.datasets.registry")
    if name.startswith("__") or not hasattr(registry, name):
        raise AttributeError(f"module 'data_prep.datasets' has no attribute '{name}'")
    warn(
        f"data_prep.datasets.{name} is now data_prep.datasets.registry.{name}; the old name goes "
        "with the next version",
        DeprecationWarning,
        stacklevel=2,
    )
    return getattr(registry, name)
