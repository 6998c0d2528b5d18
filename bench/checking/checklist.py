"""The checklist of the paper's claims: from runs to verdicts, as `claims.md`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import compare
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import column, is_mean
from bench.checking.claim_rules import (
    DISTANCES,
    Evidence,
    Finding,
    Lacking,
    Scored,
    Verdict,
)
from bench.checking.claims import CHAIRS, CLASSES, LATENT, SPEED, Claim, claims
from bench.records.features import Features
from bench.records.journal import read_finished
from bench.records.record import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.build import class_orderings
from bench.tables.classes import NETWORK, SURFACE
from bench.tables.scored import read_scored
from bench.tables.table import BOLD, TABLES, Cell, Grid, grid
from data_prep.failures import BadInput
from data_prep.whole_files import write_whole

CHECKLIST = "claims.md"
SUITES = (CHAIRS, CLASSES, SPEED, LATENT)
VERDICTS: tuple[Verdict, ...] = ("supported", "not supported", "not testable here")


@dataclass(frozen=True, eq=False)
class Run:
    """A run that is asked: its name for people, its suite, and what it has to say."""

    name: str
    suite: str
    evidence: Evidence


@dataclass(frozen=True)
class Checked:
    """A claim and what a run says about it; `run` is empty where none was asked."""

    claim: Claim
    run: str
    finding: Finding


def check_claims(directories: Sequence[Path]) -> list[Checked]:
    """What finished runs say about the claims, in the order of the table.

    Raises BadInput where one is no finished run, and where no claim is about its suite.
    """
    with threadpool_limits(1):
        runs = [read_run(directory) for directory in directories]
        return checked(runs)


def checked(runs: Sequence[Run]) -> list[Checked]:
    """Every claim against every run of its suite; a line of its own where there is none."""
    made = []
    for claim in claims():
        asked = [run for run in runs if claim.rule is not None and run.suite == claim.suite]
        if not asked:
            reason = claim.why_not or f"give a run of {claim.suite}"
            made.append(Checked(claim, "", Finding("-", "not testable here", "", reason)))
        for run in asked:
            made += [Checked(claim, run.name, finding) for finding in _findings(claim, run)]
    return made


def to_markdown(made: Sequence[Checked]) -> str:
    """The checklist: counts, then a row for each claim, run and method."""
    return markdown.document(
        [
            "# The paper's claims",
            "*Supported* is what a 95 % interval over objects puts wholly on the claimed side; a "
            "claim that so few objects cannot decide is *not supported*, and the reason says so. "
            "Values are ours, on our data; the paper's stand in the quotations. "
            "`fd-views` is not FID: where it stands in, no Inception weights were given.",
            _counts(made),
            _claims(made),
        ]
    )


def _claims(made: Sequence[Checked]) -> Grid:
    """The claim itself stands in its first row."""
    several = len({entry.run for entry in made if entry.run}) > 1
    lines = []
    last = None
    for entry in made:
        claim, found = entry.claim, entry.finding
        first = claim is not last
        last = claim
        supported = found.verdict == "supported"
        lines.append(
            [
                claim.id,
                Cell(
                    found.verdict,
                    rest=f": {found.reason}" if found.reason else "",
                    special=BOLD if supported else None,
                ),
                f"{found.subject} ({entry.run})" if several and entry.run else found.subject,
                found.numbers,
                f"“{claim.quoted}” ({claim.where})" if first else "",
                claim.measured if first else "",
            ]
        )
    return grid(["claim", "verdict", "method", "ours", "the paper", "measured"], lines)


def write_checklist(made: Sequence[Checked], directory: Path) -> Path:
    """Write `claims.md` into the folder of a run, and return its path."""
    path = directory / CHECKLIST
    write_whole(path, to_markdown(made).encode())
    return path


def read_run(directory: Path) -> Run:
    """A finished run, as evidence. Raises BadInput: not finished, damaged, or of another suite."""
    manifest = read_finished(directory)
    suite = manifest["suite"]
    if suite not in SUITES:
        raise BadInput(
            f"{directory}: no claim of the paper is about {suite}; give runs of {', '.join(SUITES)}"
        )
    name = f"{suite} on {manifest['dataset']}"
    if suite == SPEED:
        return Run(name, suite, _read_table(directory, "speed_samples"))
    if suite == LATENT:
        of_both = [_read_table(directory, f"latent_{of}") for of in ("interpolation", "arithmetic")]
        return Run(name, suite, pd.concat(of_both, ignore_index=True))
    return Run(name, suite, _scored(directory, manifest))


def _scored(directory: Path, manifest: dict[str, Any]) -> Scored:
    scored = read_scored(directory)
    there = [
        metric
        for metric in (*scored.suite.image_metrics, *scored.suite.class_metrics, *DISTANCES)
        if metric in scored.features or (is_mean(metric) and column(metric) in scored.records)
    ]
    known = [m for m in manifest["methods"] if m.partition("@")[0] == NETWORK]
    chosen = scored.records["method"].isin([SURFACE, "true-mesh", FLOOR, *known])
    compared = compare(scored.records[chosen], scored.features, list(dict.fromkeys(there)))
    if not compared:
        raise BadInput(f"{directory}: no object of this run could be drawn; fix the dataset")
    features = scored.features.get("fd-views")
    classes = scored.records["class"].unique().tolist()
    return Scored(
        {(c.condition, c.class_name): c for c in compared},
        class_orderings(scored),
        {} if features is None else spreads(features, classes),
    )


def spreads(features: Features, classes: Iterable[str]) -> dict[str, tuple[float, Any]]:
    """How much true objects of a class differ: the variance of their mean features, added up.

    By class, with the same without each object; classes of fewer than 3 objects are left out.
    """
    made = {}
    for name in classes:
        truth = (GROUND_TRUTH, "", name)
        images = features.images(*truth)
        values = pd.DataFrame(features.of(*truth, images).astype(np.float64))
        means = values.groupby([obj for obj, _ in images]).mean().to_numpy()
        if len(means) >= 3:
            left_out = [_variance(np.delete(means, i, axis=0)) for i in range(len(means))]
            made[name] = _variance(means), np.array(left_out)
    return made


def _variance(means: Any) -> float:
    return float(means.var(axis=0, ddof=1).sum())


def _findings(claim: Claim, run: Run) -> list[Finding]:
    assert claim.rule is not None
    try:
        return claim.rule(run.evidence)
    except Lacking as error:
        return [Finding("-", "not testable here", "", str(error))]


def _counts(made: Sequence[Checked]) -> Grid:
    """How many claims of each verdict, by method: one line for each that any claim is about."""
    subjects: dict[tuple[str, str], list[Verdict]] = {}
    for entry in made:
        subjects.setdefault((entry.finding.subject, entry.run), []).append(entry.finding.verdict)
    lines = (
        [subject, run, *(str(verdicts.count(verdict)) for verdict in VERDICTS)]
        for (subject, run), verdicts in subjects.items()
    )
    return grid(["method", "run", *VERDICTS], lines)


def _read_table(directory: Path, name: str) -> pd.DataFrame:
    path = directory / TABLES / f"{name}.csv"
    try:
        return pd.read_csv(path, dtype={"condition": str})
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: cannot be read ({error}); start the run again") from error
