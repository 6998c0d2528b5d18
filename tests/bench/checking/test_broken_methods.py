"""Methods that break one point of the contract each are named by it; good ones pass."""

from __future__ import annotations

import pytest

from bench.catalogue.suites import Limits
from bench.checking.contract import methods
from bench.checking.contract.plugin import plugin_findings
from bench.checking.contract.session import TRACES
from tests.bench.checking.broken_methods import FAULTS, GOOD, MODULE, MODULES

PLUGINS = "tests.bench.checking.broken_methods"
LIMITS = Limits(time_s=5.0, memory_gib=2.0)
SLOW = {"HOGS": Limits(time_s=20.0, memory_gib=2.0)}  # a busy machine fills memory slowly
# Points that are checked here in the process of the test, by the subject of their finding.
CHECKS = {
    "images": methods.check_images,
    "repeatable": methods.check_repeatable,
    "batches": methods.check_batches,
    "inputs": methods.check_inputs,
    "identity": methods.check_identity,
    "loading": methods.check_loading,
}
ENDING = (
    "EXITS",
    "LEAVES",
    "LEAVES_WITH_3",
    "KILLS_ITSELF",
    "INTERRUPTS",
    "HOGS",
    "IDENTITY_EXITS",
)
HERE = [name for name, (point, _, _) in FAULTS.items() if point in CHECKS and name not in ENDING]


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """The working folder, from which modules are found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def verdicts(name):
    """Return the verdict and the text of each finding, by its subject."""
    limits = SLOW.get(name.rpartition(":")[2], LIMITS)
    findings = plugin_findings(name, limits)
    return {finding.subject: (finding.verdict, finding.text) for finding in findings}


def assert_named(findings, point, said, blocks):
    verdict, text = findings[point]
    assert said in text
    assert verdict == ("FAIL" if blocks else "warn")


@pytest.mark.parametrize("name", HERE)
def test_a_point_names_its_fault(name):
    point, said, _ = FAULTS[name]
    with pytest.raises(Exception) as raised:
        CHECKS[point](f"{PLUGINS}:{name}")
    assert said in str(raised.value) or said in f"{raised.type.__name__}: {raised.value}"


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("point", CHECKS)
def test_good_methods_keep_each_point(name, point):
    CHECKS[point](f"{PLUGINS}:{name}")


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_named(name, elsewhere):
    assert_named(verdicts(f"{PLUGINS}:{name}"), *FAULTS[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_every_fault_of_a_module_is_named(name, elsewhere):
    line, *expected = MODULES[name]
    (elsewhere / f"faulty_{name}.py").write_text(MODULE.format(line=line))
    assert_named(verdicts(f"faulty_{name}:Plain"), *expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", GOOD)
def test_good_methods_pass(name, elsewhere):
    findings = verdicts(f"{PLUGINS}:{name}")
    assert [line for line in findings.items() if line[1][0] != "ok"] == []
    assert len(findings) == 2 + len(methods.method_steps(None)) + len(TRACES)
