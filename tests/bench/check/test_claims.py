from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import pandas as pd
import pytest

from bench.analysis.compare import Estimate
from bench.analysis.intervals import StandardError
from bench.catalogue.suites import LATENT, SPEED, SUITES
from bench.check.checklist import ClaimResult, check_claims, judge, read_evidence, to_markdown
from bench.check.claims import RULES, claims
from bench.check.rules import ClaimFinding, Requirement
from bench.tables.paper import published
from data_prep.failures import BadInput

from ..builders import make_manifest, write_manifest, write_run, write_run_with_tables

pytestmark = pytest.mark.usefixtures("few_objects")

CLAIMS = claims()
SURE = Requirement("", Estimate(0.1, 0.05, 0.15), StandardError(0.02, 20.0), 24)
FOUND = ClaimFinding("pc2pix", "ssim 0.7", (SURE,))


def test_the_table_of_claims():
    assert len({claim.id for claim in CLAIMS}) == len(CLAIMS) == 64
    assert {claim.id for claim in CLAIMS} >= {*RULES}
    suites = {suite.id for suite in SUITES} | {LATENT.id, SPEED.id}
    for claim in CLAIMS:
        assert re.fullmatch(r"[a-z0-9-]+", claim.id)
        assert (claim.rule is None) == bool(claim.why_not)
        assert (claim.rule is None) == (claim.suite == "")
        assert claim.rule is None or claim.suite in suites
    for suite, count in (("chair-robustness", 25), ("thirteen-classes", 14)):
        printed = [c for c in CLAIMS if c.suite == suite and c.id.startswith("table-")]
        assert len(printed) == count == len(published(suite)) / 2


@pytest.mark.parametrize(
    ("claim_id", "where", "quoted", "ahead", "on"),
    [
        ("3-ssim-noise-005", "Table 3, noise-0.05", "ssim: 0.46, 0.63", "network", " on chairs"),
        ("3-contrast-512", "Table 3, 512", "contrast: 0.82, 0.79", "surface", " on chairs"),
        ("4-noise-010", "Table 4, noise-0.10", "FID: 294.2, 39.0", "network", " on chairs"),
        ("5-rifle", "Table 5, rifle", "FID: 26.3, 29.0", "surface", ""),
        ("5-average", "Table 5, average", "FID: 114.4, 57.2", "network", ""),
        (
            *("3-luminance-512", "Table 3, 512", "luminance: 0.94, 0.94", "equal"),
            " on chairs, within 0.01",
        ),
    ],
)
def test_claims_made_of_published_values(claim_id, where, quoted, ahead, on):
    (claim,) = (claim for claim in CLAIMS if claim.id == f"table-{claim_id}")
    assert claim.quoted == quoted.replace(":", " of SR and PC2PIX:")
    who = {"network": "pc2pix is ahead", "surface": "SR is ahead", "equal": "they are equal"}[ahead]
    assert (claim.where, claim.criterion) == (where, f"{who} by {quoted.split(':')[0]}{on}")
    assert claim.rule.keywords["ahead"] == ahead


def test_claims_without_a_run_or_of_one_that_lacks_something(tmp_path):
    """The run has splat, true-mesh and blank: no side of any claim was measured."""
    results = judge(CLAIMS, [])
    assert [entry.claim.id for entry in results] == [claim.id for claim in CLAIMS]
    assert {entry.finding.verdict for entry in results} == {"not testable here"}
    reasons = {entry.claim.id: entry.finding.reason for entry in results}
    assert reasons["table-5-car"] == "give a run of thirteen-classes"
    assert reasons["nine-times-faster"] == "give a run of speed"
    assert reasons["better-than-points2pix"].startswith("our points2pix has other inputs")
    run = read_evidence(write_run(tmp_path / "run"))
    results = [entry for entry in judge(CLAIMS, [run]) if entry.run]
    assert len(results) == sum(claim.suite == "chair-robustness" for claim in CLAIMS)
    assert {entry.run for entry in results} == {"chair-robustness on procedural"}
    assert {entry.finding.verdict for entry in results} == {"not testable here"}
    reasons = {entry.claim.id: entry.finding.reason for entry in results}
    assert reasons["table-3-ssim-2048"] == "the run has no pc2pix"


def test_claims_of_a_run(tmp_path):
    """Random scores: nothing is ahead of anything, and the numbers are those of the tables."""
    run = write_run_with_tables(
        tmp_path / "run",
        methods=["surface-apss", "pc2pix", "blank"],
        conditions=["1024", "512"],
        objects=[f"chair/{name}" for name in "abcdef"],
    )
    findings = {
        entry.claim.id: entry.finding for entry in judge(CLAIMS, [read_evidence(run)]) if entry.run
    }
    rows = pd.read_csv(run / "tables" / "table3_ssim.csv").query("metric == 'ssim'")
    values = rows.set_index(["method", "condition"])["value"]
    finding = findings["table-3-ssim-1024"]
    network, sr = (values[method, 1024] for method in ("pc2pix", "surface-apss"))
    assert finding.numbers.startswith(
        f"ssim {network:.3f}, SR {sr:.3f}; ahead by {network - sr:+.3f} ["
    )
    assert finding.verdict == "undecided"
    assert finding.objects == 6
    assert findings["table-4-512"].reason.endswith("fd-views stands in for fid")


def test_speed_and_latent_runs(tmp_path):
    for name in ("speed", "latent"):
        (tmp_path / name / "tables").mkdir(parents=True)
        write_manifest(tmp_path / name, make_manifest(suite=name))
    header = "method,condition,threads,cloud,round,stage,views,wall_s,core_s\n"
    (tmp_path / "speed/tables/speed_samples.csv").write_text(
        header + "splat,2048,1,x,1,draw,1,2,2\n"
    )
    for name in ("interpolation", "arithmetic"):
        text = f"what,metric,kind,method,value,ci_low,ci_high\n{name},m,all,pc2pix,1,1,1\n"
        (tmp_path / f"latent/tables/latent_{name}.csv").write_text(text)
    speed, latent = (read_evidence(tmp_path / name) for name in ("speed", "latent"))
    assert speed.evidence.samples["condition"].tolist() == ["2048"]
    assert latent.evidence["what"].tolist() == ["interpolation", "arithmetic"]
    (tmp_path / "speed/tables/speed_samples.csv").unlink()
    with pytest.raises(BadInput, match=r"speed_samples.csv: cannot be read"):
        read_evidence(tmp_path / "speed")
    write_manifest(tmp_path / "speed", make_manifest(suite="stability"))
    with pytest.raises(BadInput, match="no claim of the paper is about stability"):
        read_evidence(tmp_path / "speed")


def test_the_checklist_in_markdown():
    claim, other = CLAIMS[0], CLAIMS[1]
    open_ = SURE._replace(name="a | b", estimate=Estimate(0.1, -0.1, 0.3))
    results = [
        ClaimResult(claim, "run 1", FOUND, "supported"),
        ClaimResult(claim, "run 2", replace(FOUND, requirements=(open_,)), "undecided"),
        ClaimResult(claim, "run 3", FOUND, "undecided"),
        ClaimResult(other, "", ClaimFinding("-", "", (), "give a run of x")),
    ]
    lines = to_markdown(results).splitlines()
    assert "| pc2pix | run 1 | 1 | 0 | 0 | 0 |" in lines
    assert "| pc2pix | run 3 | 0 | 0 | 1 | 0 |" in lines
    first = next(line for line in lines if line.startswith(f"| {claim.id} |"))
    start = f"| {claim.id} | **supported** | pc2pix (run 1) | 24 | ssim 0.7 "
    assert first == f"{start}| “{claim.quoted}” ({claim.where}) | {claim.criterion} |"
    second, third, fourth = lines[lines.index(first) + 1 :][:3]
    message = "undecided: not shown: a \\| b | pc2pix (run 2) | 24 | ssim 0.7"
    assert second == f"| {claim.id} | {message} |  |  |"  # the quotation stands above
    assert third.startswith(f"| {claim.id} | undecided: uncorrected: supported | pc2pix (run 3) |")
    assert fourth.startswith(f"| {other.id} | not testable here: give a run of x | - | - |  | “")


def test_floors_are_not_robust(tmp_path):
    """A white image loses nothing. It shows nothing, either."""
    names = ["surface-apss", "blank", "constant"]
    run = write_run(tmp_path / "run", methods=names, objects=[f"chair/{i}" for i in "abcdefgh"],
                    conditions=["2048", "1024", "512", "noise-0.05", "noise-0.10"])  # fmt: skip
    results = judge(CLAIMS, [read_evidence(run, subjects=("blank", "constant"))])
    robust = {"operates-on-fewer-points", "robust-to-noise", "structure-is-kept", "fid-is-kept"}
    chosen = [entry for entry in results if entry.claim.id in robust]
    assert {entry.finding.subject for entry in chosen} == {"blank", "constant"}
    assert len(chosen) == 8
    assert "supported" not in {entry.finding.verdict for entry in chosen}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dataset": "folder:x"}, "different dataset: procedural and folder:x"),
        ({"seed": 3}, "different seed: 0 and 3"),
        ({"objects": ["chair/z"]}, "different objects; give runs"),
    ],
)
def test_runs_that_do_not_fit_together_are_refused(tmp_path, changes, message):
    first, second = (write_run(tmp_path / name) for name in ("first", "second"))
    manifest = json.loads((second / "manifest.json").read_text())
    (second / "manifest.json").write_text(json.dumps(manifest | changes))
    with pytest.raises(BadInput, match=f"first and .*second do not fit together.*{message}"):
        check_claims([first, second])


def test_the_command(command, refused, tmp_path):
    run = write_run(tmp_path / "run")
    again = shutil.copytree(run, tmp_path / "again")
    said = refused("check", "--claims", run)
    assert said == (
        f"{run}: no claim of the paper can be tested: the run has no pc2pix; the run has no ssim "
        "of surface-apss; give runs with the default methods"
    )
    status, out, err = command("check", "--claims", run, again, "--methods", "splat")
    assert status == 0
    assert out.startswith("# The paper's claims\n")
    assert (run / "claims.md").read_text() == out.removesuffix("\n")
    assert not (again / "claims.md").exists()
    assert err == f"written to {run / 'claims.md'}\n"
    absent = refused("check", "--claims", run, "--methods", "nonsense")
    assert "unknown method 'nonsense': there are splat, true-mesh, blank" in absent
    assert (run / "claims.md").read_text() == out.removesuffix("\n")
    said = refused("check", run, again)
    assert "2 folders: golden values are compared with one run; give one folder" in said
