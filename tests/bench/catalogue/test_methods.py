from __future__ import annotations

import pytest

from bench.catalogue import methods
from bench.catalogue.methods import METHODS, find_method, plugin_ids
from data_prep.failures import BadInput

MODULE = """
from bench.catalogue.methods import Method
GOOD = Method("good", lambda device: None, str, 3, "a stranger's")
OTHER = Method("other-id", lambda device: None, str, 1, "")
NO_METHOD = "text"
"""
ENTRIES = """
[pc2pix_bench.methods]
good = strangers_methods:GOOD
other = strangers_methods:OTHER
no-method = strangers_methods:NO_METHOD
missing = strangers_methods:MISSING
broken = strangers_broken:GOOD
blank = strangers_methods:GOOD
"""


@pytest.fixture
def stranger(tmp_path, monkeypatch):
    """An installed package that announces methods, some of which it does not have."""
    (tmp_path / "strangers_methods.py").write_text(MODULE)
    (tmp_path / "strangers_broken.py").write_text("raise OSError('no licence')")
    info = tmp_path / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    caches = methods.plugin_ids, methods._plugin
    for cache in caches:
        cache.cache_clear()
    monkeypatch.syspath_prepend(tmp_path)
    yield
    for cache in caches:
        cache.cache_clear()


def test_methods_of_other_packages_are_found(stranger):
    assert find_method("good").version == 3
    assert plugin_ids() == ("blank", "broken", "good", "missing", "no-method", "other")


def test_our_own_methods_cannot_be_replaced(stranger):
    (ours,) = (method for method in METHODS if method.id == "blank")
    assert find_method("blank") is ours


@pytest.mark.parametrize(
    ("method", "problem"),
    [
        ("other", "strangers_methods:OTHER is not a bench.methods.Method with that id"),
        (
            "no-method",
            "strangers_methods:NO_METHOD is not a bench.methods.Method with that id",
        ),
        ("missing", "strangers_methods:MISSING cannot be loaded (AttributeError: "),
        ("broken", "strangers_broken:GOOD cannot be loaded (OSError: no licence)"),
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
