"""The conditions of `broken_conditions`, as if their package had been installed."""

from __future__ import annotations

from contextlib import contextmanager

from bench.catalogue import conditions
from data_prep.plugins import CONDITIONS, announced
from tests.bench.check import broken_conditions
from tests.bench.plugin_methods import announce

CACHES = (announced, conditions.load_condition, conditions._planned_condition)


@contextmanager
def installed(folder, monkeypatch, entries=None):
    """Announce `entries`, id to "module:NAME"; by default all conditions of that module."""
    every = broken_conditions.PLUGINS.items()
    named = {condition.id: f"{broken_conditions.__name__}:{name}" for name, condition in every}
    announce(folder, named if entries is None else entries, CONDITIONS)
    monkeypatch.syspath_prepend(folder)
    for cache in CACHES:
        cache.cache_clear()
    yield
    for cache in CACHES:
        cache.cache_clear()
