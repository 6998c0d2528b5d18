from __future__ import annotations

import sys

import pytest

from bench.catalogue import methods
from bench.catalogue.methods import METHODS, find_method, plugin_ids
from data_prep.failures import BadInput

from ..builders import install_stranger

MODULE = """
from bench.catalogue.methods import Method
GOOD = Method("good", lambda device: None, str, 3, "a stranger's")
OTHER = Method("other-id", lambda device: None, str, 1, "")
NO_METHOD = "text"
"""
ENTRIES = """
good = stranger:GOOD
other = stranger:OTHER
no-method = stranger:NO_METHOD
missing = stranger:MISSING
broken = stranger_broken:GOOD
blank = stranger:GOOD
"""


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    """An installed package that announces methods, some of which it does not have."""
    (tmp_path / "stranger_broken.py").write_text("raise OSError('no licence')")
    caches = methods.plugin_ids, methods._plugin
    for cache in caches:
        cache.cache_clear()
    monkeypatch.delitem(sys.modules, "stranger", raising=False)
    install_stranger(tmp_path, monkeypatch, "pc2pix_bench.methods", MODULE, ENTRIES)
    yield
    for cache in caches:
        cache.cache_clear()


def test_methods_of_other_packages_are_found_and_replace_none_of_ours(stranger):
    assert find_method("good").version == 3
    assert plugin_ids() == ("blank", "broken", "good", "missing", "no-method", "other")
    (ours,) = (method for method in METHODS if method.id == "blank")
    assert find_method("blank") is ours


@pytest.mark.parametrize(
    ("method", "problem"),
    [
        ("other", "stranger:OTHER is not a bench.methods.Method with that id"),
        ("no-method", "stranger:NO_METHOD is not a bench.methods.Method with that id"),
        ("missing", "stranger:MISSING cannot be loaded (AttributeError: "),
        ("broken", "stranger_broken:GOOD cannot be loaded (OSError: no licence)"),
    ],
)
def test_what_a_package_announces_and_has_not_is_refused_by_name(stranger, method, problem):
    with pytest.raises(BadInput) as error:
        find_method(method)
    assert str(error.value).startswith(f"method '{method}' of stranger: {problem}")
    assert str(error.value).endswith("; fix or remove that package")


def test_without_other_packages_there_are_ours_only():
    methods.plugin_ids.cache_clear()
    with pytest.raises(BadInput, match="unknown method 'good'"):
        find_method("good")
