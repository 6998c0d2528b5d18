"""The checklist of the paper's claims: from runs to verdicts, as `claims.md`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.comparison import compare
from bench.analysis.recognition import true_gallery
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS, known_method
from bench.catalogue.metrics import JUDGE, column, is_mean
from bench.checking.claim_rules import (
    CHAIR,
    DISTANCES,
    RECOGNISABLE,
    VERDICTS,
    Evidence,
    Finding,
    MissingEvidence,
    QualityEvidence,
    TimingEvidence,
    Training,
    Verdict,
    corrected,
)
from bench.checking.claims import CHAIRS, CLASSES, LATENT, SPEED, Claim, claims
from bench.judges.answers import found, why_no_retrieval
from bench.records.features import Features
from bench.records.journal import PROTOCOL, read_finished
from bench.records.record import GROUND_TRUTH
from bench.tables import markdown
from bench.tables.classes import NETWORK, SURFACE
from bench.tables.published import seed_spreads
from bench.tables.quality import cells, image_keys
from bench.tables.scored import read_scored
from bench.tables.table import BOLD, TABLES, Cell, Grid, grid
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from learning.weights import card_of

CHECKLIST = "claims.md"
# Networks of the paper's width that have no weights of their own.
PAPER_WIDTHS = {"pc2pix@paper": 1.0, "pc2pix@paper-bf16": 1.0}
SUITES = (CHAIRS, CLASSES, SPEED, LATENT)


@dataclass(frozen=True, eq=False)
class Run:
    """A run that is asked: its name for people, its suite, and what it has to say."""

    name: str
    suite: str
    evidence: Evidence


@dataclass(frozen=True)
class ClaimResult:
    """A claim and what a run says about it; `run` is empty where none was asked.

    verdict  after Holm's correction for the claims of its family about the same method and run
    """

    claim: Claim
    run: str
    finding: Finding
    verdict: Verdict = "not testable here"


def check_claims(directories: Sequence[Path], subjects: Sequence[str] = ()) -> list[ClaimResult]:
    """What finished runs say about the claims, in the order of the table.

    `subjects` are methods in place of the variants of pc2pix. Raises BadInput where one is no
    finished run, where no claim is about its suite, and where runs do not fit together.
    """
    with threadpool_limits(1):
        manifests = {directory: read_finished(directory) for directory in directories}
        _refuse_misfits(manifests)
        return checked([read_run(of, manifests[of], subjects) for of in directories])


def _refuse_misfits(manifests: Mapping[Path, Mapping[str, Any]]) -> None:
    """Raises BadInput for runs of which one table would compare what differs."""
    first: dict[tuple[str, str], tuple[Path, object]] = {}
    for directory, manifest in manifests.items():
        suite = str(manifest["suite"])
        features = manifest.get("feature_identity", {}).items()
        for what, of_suite, value in (
            ("schema", "", manifest.get("schema_version")),
            (PROTOCOL, "", manifest[PROTOCOL]),
            ("dataset", "", manifest.get("dataset")),
            ("seed", "", manifest.get("seed")),
            ("objects", suite, manifest.get("objects")),
            *((f"features of {name}", "", identity) for name, identity in features),
        ):
            known = first.setdefault((what, of_suite), (directory, value))
            if known[1] != value:
                shown = f": {known[1]} and {value}" if what != "objects" else ""
                raise BadInput(
                    f"{known[0]} and {directory} do not fit together, they have different "
                    f"{what}{shown}; give runs that were made alike"
                )


def checked(runs: Sequence[Run]) -> list[ClaimResult]:
    """Every claim against every run of its suite; a line of its own where there is none."""
    made = []
    for claim in claims():
        asked = [run for run in runs if claim.rule is not None and run.suite == claim.suite]
        if not asked:
            reason = claim.why_not or f"give a run of {claim.suite}"
            made.append(ClaimResult(claim, "", Finding("-", "", (), reason)))
        for run in asked:
            made += [ClaimResult(claim, run.name, finding) for finding in _findings(claim, run)]
    return _corrected(made)


def _corrected(made: Sequence[ClaimResult]) -> list[ClaimResult]:
    """With verdicts corrected for the claims of each family about one method of one run."""
    families: dict[tuple[str, str, str], list[int]] = {}
    for i, entry in enumerate(made):
        key = entry.claim.family, entry.run, entry.finding.subject
        families.setdefault(key, []).append(i)
    verdicts: dict[int, Verdict] = {}
    for places in families.values():
        found = corrected([made[i].finding for i in places])
        verdicts |= dict(zip(places, found, strict=True))
    return [replace(entry, verdict=verdicts[i]) for i, entry in enumerate(made)]


def to_markdown(made: Sequence[ClaimResult]) -> str:
    """The checklist: counts, then a row for each claim, run and method."""
    return markdown.document(
        [
            "# The paper's claims",
            "*Supported*: 95 % intervals over objects put all that the claim requires on its side. "
            "*Contradicted*: one of them is on the other side. *Undecided*: so many objects cannot "
            "tell. Verdicts are corrected for the number of claims of a family (a table, or the "
            "text) by Holm's procedure; where that changes one, the uncorrected one follows. "
            "What is smaller than the spread between trainings of a network is undecided; without "
            "a spread there is one training. "
            "Values are ours, on our data; the paper's stand in the quotations. "
            "`fd-views` is not FID: where it stands in, no Inception weights were given.",
            _counts(made),
            _claims(made),
        ]
    )


def _claims(made: Sequence[ClaimResult]) -> Grid:
    """The claim itself stands in its first row."""
    several = len({entry.run for entry in made if entry.run}) > 1
    lines = []
    last = None
    for entry in made:
        claim, found = entry.claim, entry.finding
        first = claim is not last
        last = claim
        raw = f"uncorrected: {found.verdict}" if found.verdict != entry.verdict else ""
        why = "; ".join(filter(None, [raw, found.why]))
        lines.append(
            [
                claim.id,
                Cell(
                    entry.verdict,
                    rest=f": {why}" if why else "",
                    special=BOLD if entry.verdict == "supported" else None,
                ),
                f"{found.subject} ({entry.run})" if several and entry.run else found.subject,
                str(found.objects or "-"),
                found.numbers,
                f"“{claim.quoted}” ({claim.where})" if first else "",
                claim.measured if first else "",
            ]
        )
    heads = ["claim", "verdict", "method", "objects", "ours", "the paper", "measured"]
    return grid(heads, lines)


def write_checklist(made: Sequence[ClaimResult], directory: Path) -> Path:
    """Write `claims.md` into the folder of a run, and return its path."""
    path = directory / CHECKLIST
    write_whole(path, to_markdown(made).encode())
    return path


def read_run(
    directory: Path, manifest: Mapping[str, Any] | None = None, subjects: Sequence[str] = ()
) -> Run:
    """A finished run, as evidence. Raises BadInput: not finished, damaged, or of another suite."""
    manifest = dict(manifest or read_finished(directory))
    suite = manifest["suite"]
    if suite not in SUITES:
        raise BadInput(
            f"{directory}: no claim of the paper is about {suite}; give runs of {', '.join(SUITES)}"
        )
    name = f"{suite} on {manifest['dataset']}"
    if suite == SPEED:
        samples = _read_table(directory, "speed_samples")
        machine = str(manifest.get("machine", {}).get("cpu") or "an unknown machine")
        return Run(
            name, suite, TimingEvidence(samples, machine, _trainings(samples["method"].unique()))
        )
    if suite == LATENT:
        of_both = [_read_table(directory, f"latent_{of}") for of in ("interpolation", "arithmetic")]
        return Run(name, suite, pd.concat(of_both, ignore_index=True))
    return Run(name, suite, _scored(directory, manifest, subjects))


def _scored(directory: Path, manifest: dict[str, Any], subjects: Sequence[str]) -> QualityEvidence:
    scored = read_scored(directory)
    asked = (*scored.suite.image_metrics, *scored.suite.class_metrics, *DISTANCES, *RECOGNISABLE)
    there = [
        metric
        for metric in asked
        if metric in scored.features or (is_mean(metric) and column(metric) in scored.records)
    ]
    known = [m for m in manifest["methods"] if family_of(m) == NETWORK or m in subjects]
    chosen = scored.records["method"].isin([SURFACE, "true-mesh", *FLOORS, *known])
    compared = compare(scored.records[chosen], scored.features, list(dict.fromkeys(there)))
    if not compared:
        raise BadInput(f"{directory}: no object of this run could be drawn; fix the dataset")
    features = scored.features.get("fd-views")
    classes = scored.records["class"].unique().tolist()
    judged = scored.features.get(JUDGE)
    return QualityEvidence(
        {(c.condition, c.class_name): c for c in compared},
        {} if features is None else spreads(features, classes),
        {} if judged is None else retrieval_of_chairs(scored.records[chosen], judged),
        _trainings(known),
        tuple(subjects),
        seed_spreads(),
    )


def _trainings(methods: Iterable[str]) -> dict[str, Training]:
    """What the weights of networks say; methods without, or whose file is gone, are left out."""
    found = {}
    for name in methods:
        method = known_method(str(name))
        if method is None or method.weights_file is None:
            continue
        try:
            card = card_of(method.weights_file())
        except BadInput:
            continue
        width = PAPER_WIDTHS.get(str(name), card.get("model", {}).get("width"))
        if width is not None:
            found[str(name)] = Training(float(width), bool(card.get("augment", False)))
    return found


def retrieval_of_chairs(records: pd.DataFrame, judged: Features) -> dict[tuple[str, str], Any]:
    """By method and condition, the share of each chair's images by which the judge finds it."""
    chairs = records[records["class"] == CHAIR]
    if chairs.empty:
        return {}
    among = true_gallery(judged, CHAIR)
    if why_no_retrieval(among):
        return {}
    made = {}
    for cell, group in cells(chairs[chairs["outcome"] == "ok"]):
        images = image_keys(group)
        hits = pd.Series(found(among, judged.of(*cell, images), images))
        shares = hits.groupby(group["object"].to_numpy()).mean()
        # an object without images is not found
        made[cell[0], cell[1]] = shares.reindex(sorted(among.objects), fill_value=0.0).to_numpy()
    return made


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
    except MissingEvidence as error:
        return [Finding("-", "", (), str(error))]


def _counts(made: Sequence[ClaimResult]) -> Grid:
    """How many claims of each verdict, by method: one line for each that any claim is about."""
    subjects: dict[tuple[str, str], list[Verdict]] = {}
    for entry in made:
        subjects.setdefault((entry.finding.subject, entry.run), []).append(entry.verdict)
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
