"""Methods and metrics that other packages announce: found, or refused by name."""

from __future__ import annotations

import sys

import pytest

from bench.catalogue import methods
from bench.catalogue.methods import METHODS, find_method
from bench.catalogue.plugins import find_metric, metric_ids
from data_prep.failures import BadInput

MODULE = """
from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric
METHOD = Method("good", lambda device: None, str, 3, "a stranger's")
DOTTED = Method("pc2pix@v1.2", lambda device: None, str, 4, "no file, though it has a dot")
OTHER_METHOD = Method("other-id", lambda device: None, str, 1, "")
METRIC = ImageMetric("good", lambda truth, drawn: drawn[:, 0, 0, 0] * 1.0, 3, True, "a stranger's")
OTHER_METRIC = ImageMetric("other-id", None, 1, True, "")
SPACED = ImageMetric("a/b", None, 1, True, "")
TEXT = "text"
"""
ANNOUNCED = """
[pc2pix_bench.methods]
good = stranger:METHOD
pc2pix@v1.2 = stranger:DOTTED
other = stranger:OTHER_METHOD
text = stranger:TEXT
missing = stranger:MISSING
broken = stranger_broken:METHOD
exiting = stranger_exiting:METHOD
blank = stranger:METHOD
[pc2pix_bench.metrics]
good = stranger:METRIC
other = stranger:OTHER_METRIC
text = stranger:TEXT
missing = stranger:MISSING
a/b = stranger:SPACED
"""
FIND = {"method": find_method, "metric": find_metric}


@pytest.fixture
def no_stranger():
    """What has been looked up before is forgotten, and what is looked up here too."""
    caches = methods.plugin_ids, methods._plugin, metric_ids
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


@pytest.fixture
def stranger(no_stranger, tmp_path, monkeypatch):
    """An installed package that announces more than it has."""
    (tmp_path / "stranger.py").write_text(MODULE)
    (tmp_path / "stranger_broken.py").write_text("raise OSError('no licence')")
    (tmp_path / "stranger_exiting.py").write_text("raise SystemExit(0)")
    info = tmp_path / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ANNOUNCED)
    monkeypatch.delitem(sys.modules, "stranger", raising=False)
    monkeypatch.syspath_prepend(tmp_path)


def test_those_of_other_packages_are_found_listed_and_replace_none_of_ours(stranger, command):
    assert find_method("good").version == find_metric("good").version == 3
    assert find_method("pc2pix@v1.2").version == 4
    ids = ("blank", "broken", "exiting", "good", "missing", "other", "pc2pix@v1.2", "text")
    assert methods.plugin_ids() == ids
    assert metric_ids() == ("a/b", "good", "missing", "other", "text")
    (ours,) = (method for method in METHODS if method.id == "blank")
    assert find_method("blank") is ours
    status, out, _ = command("list")  # which loads none
    assert status == 0
    assert "  missing                   of another installed package; see 'bench score'" in out


@pytest.mark.parametrize(
    ("kind", "id_", "problem"),
    [
        ("method", "other", "stranger:OTHER_METHOD is not a bench.methods.Method with that id; "),
        ("method", "text", "stranger:TEXT is not a bench.methods.Method with that id; "),
        ("method", "missing", "stranger:MISSING cannot be loaded (AttributeError: "),
        ("method", "broken", "stranger_broken:METHOD cannot be loaded (OSError: no licence); "),
        ("method", "exiting", "stranger_exiting:METHOD cannot be loaded (SystemExit: 0); "),
        ("metric", "other", "stranger:OTHER_METRIC is not a bench.image_metric.ImageMetric with "),
        ("metric", "text", "stranger:TEXT is not a bench.image_metric.ImageMetric with that id; "),
        ("metric", "missing", "stranger:MISSING cannot be loaded (AttributeError: "),
        ("metric", "a/b", "an id is kebab-case, it names files; rename it"),
    ],
)
def test_what_a_package_announces_and_has_not_is_refused_by_name(stranger, kind, id_, problem):
    with pytest.raises(BadInput) as error:
        FIND[kind](id_)
    message = str(error.value)
    assert message.startswith(f"{kind} '{id_}' of stranger: {problem}")
    assert message.endswith(("; fix or remove that package", "; rename it"))
    with pytest.raises(BadInput, match=f"unknown {kind} 'goods': "):
        FIND[kind]("goods")


def test_without_other_packages_there_are_ours_only(no_stranger, command, tmp_path):
    with pytest.raises(BadInput, match="unknown method 'good'"):
        find_method("good")
    with pytest.raises(BadInput, match="unknown metric 'ssim': no installed package adds one"):
        find_metric("ssim")
    status, out, err = command("score", tmp_path)
    assert (status, out) == (2, "")
    assert err == "bench: no installed package adds a metric; see docs/adding-a-metric.md\n"
