"""Metrics, datasets and conditions that break one point of the contract each are named by it."""

from __future__ import annotations

import pytest

from bench.catalogue.suites import Limits
from bench.checking.contract import conditions, datasets, metrics
from bench.checking.contract.plugin import plugin_findings
from tests.bench.checking import broken_conditions, broken_datasets, broken_metrics

LIMITS = Limits(time_s=5.0, memory_gib=4.0)
METRICS, DATASETS = broken_metrics.__name__, broken_datasets.__name__
CONDITIONS = broken_conditions.__name__
FAULTS = {
    METRICS: broken_metrics.FAULTS,
    DATASETS: broken_datasets.FAULTS,
    CONDITIONS: broken_conditions.FAULTS,
}
CHECKS = {  # in the process of the test, by the subject of their finding
    METRICS: {
        "images": metrics.check_images,
        "batches": metrics.check_batches,
        "identical images": metrics.check_scores,
        "features": metrics.check_features,
    },
    DATASETS: {
        "objects": datasets.check_objects,
        "clouds": datasets.check_clouds,
        "views": datasets.check_views,
        "pickling": datasets.check_pickling,
    },
    CONDITIONS: {
        "identity": conditions.check_identity,
        "clouds": conditions.check_clouds,
        "repeatable": conditions.check_repeatable,
        "place": conditions.check_place,
        "other clouds": conditions.check_others,
        "calls": conditions.check_calls,
    },
}
ENDING = ("EXITS", "LEAVES", "INTERRUPTS", "EXITS_LATE")
HERE = [
    (module, name)
    for module, faults in FAULTS.items()
    for name, (point, *_) in faults.items()
    if point in CHECKS[module] and name not in ENDING
]


def target(module, name, folder):
    return f"{module}:{name}" + (f":{folder}" if module == DATASETS else "")


def verdicts(name):
    """Return the verdict and the text of each finding, by its subject."""
    findings = plugin_findings(name, LIMITS)
    return {finding.subject: (finding.verdict, finding.text) for finding in findings}


@pytest.mark.opengl
@pytest.mark.parametrize(("module", "name"), HERE)
def test_a_point_names_its_fault(module, name, tmp_path):
    point, said, *_ = FAULTS[module][name]
    with pytest.raises(Exception) as raised:
        CHECKS[module][point](target(module, name, tmp_path))
    assert said in str(raised.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", broken_metrics.FAULTS)
def test_every_fault_of_a_metric_is_named(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    point, said = broken_metrics.FAULTS[name]
    verdict, text = verdicts(target(METRICS, name, tmp_path))[point]
    assert said in text
    assert verdict == "FAIL"


@pytest.mark.slow
@pytest.mark.parametrize("name", broken_datasets.FAULTS)
def test_every_fault_of_a_dataset_is_named(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    point, said, blocks = broken_datasets.FAULTS[name]
    verdict, text = verdicts(target(DATASETS, name, tmp_path))[point]
    assert said in text
    assert verdict == ("FAIL" if blocks else "warn")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["HASH_ORDER", "UNNAMED", "PRINTS", "LEAVES", "HANGS"])
def test_a_fault_of_a_condition_that_its_process_shows_is_named(name, tmp_path, monkeypatch):
    """The other faults are named by their points, above, in the process of the test."""
    monkeypatch.chdir(tmp_path)
    point, said, blocks = broken_conditions.FAULTS[name]
    verdict, text = verdicts(target(CONDITIONS, name, tmp_path))[point]
    assert said in text
    assert verdict == ("FAIL" if blocks else "warn")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "name"),
    [(METRICS, "GOOD"), (METRICS, "GOOD_SET"), (DATASETS, "GOOD"), (CONDITIONS, "GOOD")],
)
def test_good_ones_pass(module, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    findings = verdicts(target(module, name, tmp_path))
    assert [line for line in findings.items() if line[1][0] != "ok"] == []


@pytest.mark.slow
def test_the_embedded_dataset_passes():
    findings = verdicts("procedural:validation")
    assert [line for line in findings.items() if line[1][0] != "ok"] == []
