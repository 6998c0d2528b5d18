"""Plug-ins that break one point of the contract each are named by it; good ones pass."""

from __future__ import annotations

import pytest

from bench.catalogue.methods import Method
from bench.catalogue.suites import Limits
from bench.check.contract import conditions, datasets, methods, metrics, plugin
from bench.check.contract.plugin import plugin_findings, steps_of
from tests.bench.check import broken_conditions, broken_datasets, broken_methods, broken_metrics

LIMITS = Limits(time_s=5.0, memory_gib=2.0)
SLOW = {"HOGS": Limits(time_s=20.0, memory_gib=2.0)}  # a busy machine fills memory slowly
CHECKS = {  # in the process of the test, by the subject of their finding
    broken_methods: {
        "images": methods.check_images,
        "batches": methods.check_batches,
        "inputs": methods.check_inputs,
        "identity": methods.check_identity,
        "loading": methods.check_loading,
    },
    broken_metrics: {
        "images": metrics.check_images,
        "batches": metrics.check_batches,
        "identical images": metrics.check_scores,
        "features": metrics.check_features,
    },
    broken_datasets: {
        "objects": datasets.check_objects,
        "clouds": datasets.check_clouds,
        "views": datasets.check_views,
        "pickling": datasets.check_pickling,
    },
    broken_conditions: {
        "identity": conditions.check_identity,
        "clouds": conditions.check_clouds,
        "place": conditions.check_place,
        "other clouds": conditions.check_others,
    },
}
OF_ALL = {"repeatable": plugin.check_repeatable, "calls": plugin.check_calls}
ENDING = ("EXITS", "LEAVES", "HOGS")  # what ends the process that it is in
FAULTS = [(module, name) for module in CHECKS for name in module.FAULTS]
HERE = [
    (module, name)
    for module, name in FAULTS
    if module.FAULTS[name][0] in CHECKS[module] | OF_ALL and name not in ENDING
]
GOOD = [
    *((broken_methods, name) for name in broken_methods.GOOD),
    *((broken_metrics, name) for name in ("GOOD", "GOOD_SET")),
    *((module, "GOOD") for module in (broken_datasets, broken_conditions)),
]


def label(part):
    """Name a module or a plug-in in the id of a test."""
    return part if isinstance(part, str) else part.__name__.rpartition(".")[2]


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """The working folder, from which modules are found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def target(module, name, folder):
    return f"{module.__name__}:{name}" + (f":{folder}" if module is broken_datasets else "")


def verdicts(target, name=""):
    """Return the verdict and the text of each finding, by its subject."""
    findings = plugin_findings(target, SLOW.get(name, LIMITS))
    return {finding.subject: (finding.verdict, finding.text) for finding in findings}


def assert_named(findings, point, said, blocks):
    verdict, text = findings[point]
    assert said in text
    assert verdict == ("FAIL" if blocks else "warn")
    assert blocks or "FAIL" not in [verdict for verdict, _ in findings.values()]


@pytest.mark.opengl
@pytest.mark.parametrize(("module", "name"), HERE, ids=label)
def test_a_point_names_its_fault(module, name, tmp_path):
    point, said, _ = module.FAULTS[name]
    with pytest.raises(Exception) as raised:
        (CHECKS[module] | OF_ALL)[point](target(module, name, tmp_path))
    assert said in f"{raised.type.__name__}: {raised.value}"


@pytest.mark.parametrize("name", broken_methods.GOOD)
@pytest.mark.parametrize("point", [*CHECKS[broken_methods], *OF_ALL])
def test_good_methods_keep_each_point(name, point):
    (CHECKS[broken_methods] | OF_ALL)[point](f"{broken_methods.__name__}:{name}")


def test_a_condition_meets_clouds_of_files_and_of_other_datasets():
    passed = conditions.check_others(f"{broken_conditions.__name__}:GOOD")
    others = "one point, three points, equal points, points in a plane, 20,000 points"
    assert passed.text == others


@pytest.mark.slow
@pytest.mark.parametrize(("module", "name"), FAULTS, ids=label)
def test_every_fault_is_named(module, name, elsewhere):
    assert_named(verdicts(target(module, name, elsewhere), name), *module.FAULTS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", broken_methods.MODULES)
def test_every_fault_of_a_module_is_named(name, elsewhere):
    line, *expected = broken_methods.MODULES[name]
    text = broken_methods.MODULE.format(line=line)
    (elsewhere / f"faulty_{name}.py").write_text(text)
    assert_named(verdicts(f"faulty_{name}:Plain"), *expected)


@pytest.mark.slow
@pytest.mark.parametrize(("module", "name"), GOOD, ids=label)
def test_good_ones_pass(module, name, elsewhere):
    findings = verdicts(target(module, name, elsewhere))
    assert [line for line in findings.items() if line[1][0] != "ok"] == []
    if module is broken_methods:
        assert len(findings) == 1 + len(steps_of(Method))


@pytest.mark.slow
def test_a_file_that_is_read_and_not_known_is_named(elsewhere):
    (elsewhere / "w.bin").write_text("weights")
    text = broken_methods.MODULE.format(line="open(''.join(['w', '.bin'])).close()")
    (elsewhere / "reading.py").write_text(text)
    read = (
        f"reads {elsewhere / 'w.bin'}, and no run would notice a change there; name it in `files`"
    )
    assert_named(verdicts("reading:Plain"), "files", read, False)
    (elsewhere / "declaring.py").write_text(f"{text}\nclass Mine(Plain):\n    files = ('w.bin',)\n")
    found = verdicts("declaring:Mine")
    assert found["files"] == (
        "ok",
        "1 beside its code are a part of its identity, and no other is read",
    )
    assert "; known by its source and w.bin; other files" in found["identity"][1]
