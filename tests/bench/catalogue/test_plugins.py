"""Methods and metrics that other packages announce: found, or refused by name."""

from __future__ import annotations

import sys

import pytest

from bench.catalogue import methods
from bench.catalogue.chosen import BEST_CLASSICAL
from bench.catalogue.conditions import CONDITIONS, find_condition, load_condition
from bench.catalogue.methods import METHODS, OUR_FAMILIES, find_method
from bench.catalogue.plugins import find_metric
from bench.records.job import GROUND_TRUTH
from data_prep.datasets import registry as datasets
from data_prep.failures import BadInput
from data_prep.plugins import OUR_KINDS, announced

from ..plugin_conditions import CACHES

MODULE = """
from bench.catalogue.methods import Method
from bench.catalogue.plugins import ImageMetric
from data_prep.clouds.conditions import Condition, Unchanged
CONDITION = Condition("good", Unchanged(), "a stranger's")
METHOD = Method("good", lambda device: None, str, 3, "a stranger's")
DOTTED = Method("good@v1.2", lambda device: None, str, 4, "no file, though it has a dot")
FILED = Method("filed", lambda device: None, lambda: "scipy 1", 1, "", files=("weights.npz",))
OTHER_METHOD = Method("other-id", lambda device: None, str, 1, "")
METRIC = ImageMetric("good", lambda truth, drawn: drawn[:, 0, 0, 0] * 1.0, 3, True, "a stranger's")
OTHER_METRIC = ImageMetric("other-id", None, 1, True, "")
SPACED = ImageMetric("a/b", None, 1, True, "")
TEXT = "text"
"""
ANNOUNCED = """
[pc2pix_bench.methods]
good = stranger:METHOD
good@v1.2 = stranger:DOTTED
filed = stranger:FILED
other = stranger:OTHER_METHOD
text = stranger:TEXT
missing = stranger:MISSING
broken = stranger_broken:METHOD
exiting = stranger_exiting:METHOD
blank = stranger:METHOD
../x = stranger:METHOD
-x = stranger:METHOD
UPPER = stranger:METHOD
ground-truth = stranger:METHOD
best-classical = stranger:METHOD
pc2pix@mine = stranger:METHOD
twice = stranger:METHOD
[pc2pix_bench.metrics]
ssim = stranger:METRIC
twice = stranger:METRIC
good = stranger:METRIC
other = stranger:OTHER_METRIC
text = stranger:TEXT
missing = stranger:MISSING
a/b = stranger:SPACED
[pc2pix_bench.conditions]
noise-0.05 = stranger:CONDITION
all = stranger:CONDITION
Upper = stranger:CONDITION
../x = stranger:CONDITION
x--y = stranger:CONDITION
x.y = stranger:CONDITION
x-.5 = stranger:CONDITION
other = stranger:CONDITION
gone = no_such_module:CONDITION
[pc2pix_bench.extractors]
twice = stranger:METRIC
[pc2pix_bench.datasets]
folder = stranger:METRIC
"""
SECOND = "[pc2pix_bench.methods]\ntwice = stranger:METHOD\n"
FIND = {"method": find_method, "metric": find_metric, "condition": load_condition}


@pytest.fixture
def no_stranger():
    """What has been looked up before is forgotten, and what is looked up here too."""
    caches = (*CACHES, methods._plugin)
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
    for name, entries in (("stranger", ANNOUNCED), ("second", SECOND)):
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(entries)
    monkeypatch.delitem(sys.modules, "stranger", raising=False)
    monkeypatch.syspath_prepend(tmp_path)


def test_those_of_other_packages_are_found_listed_and_replace_none_of_ours(stranger, command):
    assert find_method("good").version == find_metric("good").version == 3
    assert find_method("good@v1.2").version == 4
    ids = {"blank", "broken", "exiting", "good", "missing", "other", "good@v1.2", "text", "../x"}
    assert ids | {"twice"} <= set(announced("method"))
    assert announced("metric") == ("a/b", "good", "missing", "other", "ssim", "text", "twice")
    (ours,) = (method for method in METHODS if method.id == "blank")
    assert find_method("blank") is ours
    status, out, _ = command("list", "--all")  # which loads none
    assert status == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    assert "missing of another installed package; see 'bench score'" in lines
    ours = "pc2pix-bench uses that id itself; rename it in that package"
    assert f"blank refused: method 'blank' of stranger: {ours}" in lines
    assert f"folder:PATH refused: dataset 'folder' of stranger: {ours}" in lines
    assert f"noise-0.05 refused: condition 'noise-0.05' of stranger: {ours}" in lines
    assert find_condition("noise-0.05") in CONDITIONS  # ours is run
    status, out, _ = command("doctor")
    assert status == 1
    assert f"FAIL other packages: method 'best-classical' of stranger: {ours}\n" in out
    assert out.count("FAIL other packages: ") == 19
    status, _, err = command("test", "blank")
    assert (status, err) == (2, f"bench: method 'blank' of stranger: {ours}\n")


def test_the_files_that_a_method_declares_are_a_part_of_its_identity(stranger, tmp_path):
    weights, method = tmp_path / "weights.npz", find_method("filed")
    with pytest.raises(BadInput, match=f"filed: declares the file {weights}, which is not there"):
        method.identity()
    identities = set()
    for content in ("first", "second", "first"):
        weights.write_text(content)
        identities.add(method.identity())
    assert len(identities) == 2
    assert all(text.startswith("scipy 1 files ") for text in identities)
    assert find_method("good").identity() == ""


def test_ids_of_this_project_are_all_known():
    assert {GROUND_TRUTH, BEST_CLASSICAL, "splat", "splat-net"} <= OUR_FAMILIES
    assert ("procedural", *datasets._STORED) == OUR_KINDS


KEBAB = "an id is kebab-case (a-z, 0-9 and single hyphens), it names files; rename it in that"
OURS = "pc2pix-bench uses that id itself; rename it in that package"
NUMBERED = "an id is kebab-case (a-z, 0-9 and single hyphens, numbers like 0.05)"


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
        *(("method", id_, KEBAB) for id_ in ("../x", "-x", "UPPER")),
        *(("method", id_, OURS) for id_ in ("ground-truth", "best-classical", "pc2pix@mine")),
        *(("condition", id_, NUMBERED) for id_ in ("Upper", "../x", "x--y", "x.y", "x-.5")),
        *(("condition", id_, OURS) for id_ in ("noise-0.05", "all")),
        (
            "condition",
            "other",
            "stranger:CONDITION is not a data_prep.clouds.conditions.Condit",
        ),
        ("condition", "gone", "no_such_module:CONDITION cannot be loaded (ModuleNotFoundError: "),
        ("metric", "a/b", KEBAB),
        ("metric", "ssim", OURS),
        ("metric", "twice", "there can be one of that id; rename or remove the others"),
        ("method", "twice", "there can be one of that id; rename or remove the others"),
    ],
)
def test_what_a_package_announces_and_has_not_is_refused_by_name(stranger, kind, id_, problem):
    with pytest.raises(BadInput) as error:
        FIND[kind](id_)
    message = str(error.value)
    owners = "second and of stranger" if (kind, id_) == ("method", "twice") else "stranger"
    assert message.startswith(f"{kind} '{id_}' of {owners}: {problem}")
    remedies = "; fix or remove that package", "; rename it in that package", "the others"
    assert message.endswith(remedies)
    with pytest.raises(BadInput, match=f"unknown {kind} 'goods': "):
        (find_condition if kind == "condition" else FIND[kind])("goods")


def test_without_other_packages_there_are_ours_only(no_stranger):
    with pytest.raises(BadInput, match="unknown method 'good'"):
        find_method("good")
    with pytest.raises(BadInput, match="unknown metric 'fli': did you mean 'flip'"):
        find_metric("fli")
