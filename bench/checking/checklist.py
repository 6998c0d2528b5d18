"""The checklist of the paper's claims: from runs to verdicts, as `claims.md`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.distances import ImageSet
from bench.analysis.paper import NETWORK, SURFACE
from bench.analysis.recognition import true_gallery
from bench.analysis.scored_run import read_run
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS, known_method
from bench.catalogue.metrics import JUDGE
from bench.catalogue.suites import TRUTHS
from bench.checking.claim_rules import (
    CHAIR,
    DISTANCES,
    RECOGNISABLE,
    VERDICTS,
    ClaimFinding,
    Evidence,
    MissingEvidence,
    QualityEvidence,
    TimingEvidence,
    Training,
    Verdict,
    corrected,
)
from bench.checking.claims import CHAIRS, CLASSES, LATENT, SPEED, Claim, claims
from bench.judges.answers import found, why_no_retrieval
from bench.records.frames import Features
from bench.records.run_folder import read_finished
from bench.tables import markdown
from bench.tables.grid import BOLD, Cell, Grid, grid
from bench.tables.published import seed_spreads
from bench.tables.table import TABLES
from data_prep.failures import BadInput, unknown
from data_prep.files.atomic_write import write_whole
from learning.weights import card_of

_CHECKLIST = "claims.md"
# Networks of the paper's width that have no weights of their own.
_PAPER_WIDTHS = {"pc2pix@paper": 1.0}
SUITES = (CHAIRS, CLASSES, SPEED, LATENT)


class _RunEvidence(NamedTuple):
    """A run as evidence, with its suite and its name for people."""

    name: str
    suite: str
    evidence: Evidence


@dataclass(frozen=True)
class ClaimResult:
    """The finding of a run about a claim."""

    claim: Claim
    run: str  # its name; empty where no run of the claim's suite was given
    finding: ClaimFinding
    # After Holm's correction for the claims of its family about the same method and run.
    verdict: Verdict = "not testable here"


def check_claims(directories: Sequence[Path], subjects: Sequence[str] = ()) -> list[ClaimResult]:
    """Return the results of finished runs about the claims, in the order of the table.

    `subjects` are methods in place of the variants of pc2pix. Raises BadInput for a folder without
    a finished run, for a suite that no claim is about, for runs that do not fit together, and where
    they can test no claim.
    """
    with threadpool_limits(1):
        manifests = {directory: read_finished(directory) for directory in directories}
        _refuse_misfits(manifests)
        _refuse_absent(subjects, manifests)
        runs = [read_evidence(folder, manifests[folder], subjects) for folder in directories]
        results = judge(claims(), runs)
    if not any(result.finding.requirements for result in results):
        reasons = dict.fromkeys(result.finding.reason for result in results if result.run)
        raise BadInput(
            f"{', '.join(map(str, directories))}: no claim of the paper can be tested: "
            f"{'; '.join(reasons)}; give runs with the default methods"
        )
    return results


def _refuse_absent(subjects: Sequence[str], manifests: Mapping[Path, Mapping[str, Any]]) -> None:
    """Raise BadInput for a method that no run has."""
    of_runs = dict.fromkeys(m for run in manifests.values() for m in run.get("methods", ()))
    for method in subjects:
        if method not in of_runs:
            raise unknown(method, [*of_runs], "method", see="bench table DIR")


def _refuse_misfits(manifests: Mapping[Path, Mapping[str, Any]]) -> None:
    """Raise BadInput for runs whose values cannot stand in one table."""
    first: dict[tuple[str, str], tuple[Path, object]] = {}
    for directory, manifest in manifests.items():
        suite = str(manifest["suite"])
        features = manifest.get("feature_identity", {}).items()
        for what, of_suite, value in (
            ("dataset", "", manifest.get("dataset")),
            ("seed", "", manifest.get("seed")),
            ("objects", suite, manifest.get("objects")),
            *((f"features of {name}", "", identity) for name, identity in features),
        ):
            other, known = first.setdefault((what, of_suite), (directory, value))
            if known != value:
                shown = f": {known} and {value}" if what != "objects" else ""
                raise BadInput(
                    f"{other} and {directory} do not fit together, they have different "
                    f"{what}{shown}; give runs that were made alike"
                )


def judge(table: Sequence[Claim], runs: Sequence[_RunEvidence]) -> list[ClaimResult]:
    """Return the results of every claim and run of its suite, with corrected verdicts.

    A claim without such a run has one result, which names the remedy.
    """
    results = []
    for claim in table:
        own_runs = [run for run in runs if claim.rule is not None and run.suite == claim.suite]
        if not own_runs:
            reason = claim.why_not or f"give a run of {claim.suite}"
            results.append(ClaimResult(claim, "", ClaimFinding("-", "", (), reason)))
        for run in own_runs:
            assert claim.rule is not None
            try:
                findings = claim.rule(run.evidence)
            except MissingEvidence as error:
                findings = [ClaimFinding("-", "", (), str(error))]
            results += [ClaimResult(claim, run.name, finding) for finding in findings]
    return _corrected(results)


def _corrected(results: Sequence[ClaimResult]) -> list[ClaimResult]:
    """Return results corrected for the claims of each family about one method of one run."""
    families: dict[tuple[str, str, str], list[int]] = {}
    for i, result in enumerate(results):
        key = result.claim.family, result.run, result.finding.subject
        families.setdefault(key, []).append(i)
    verdicts: dict[int, Verdict] = {}
    for places in families.values():
        family = corrected([results[i].finding for i in places])
        verdicts |= dict(zip(places, family, strict=True))
    return [replace(result, verdict=verdicts[i]) for i, result in enumerate(results)]


def to_markdown(results: Sequence[ClaimResult]) -> str:
    """Return the checklist: counts, then a row for each claim, run and method."""
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
            _counts(results),
            _claims(results),
        ]
    )


def _claims(results: Sequence[ClaimResult]) -> Grid:
    """Return a row for each result, with the words of the claim in its first row only."""
    several = len({result.run for result in results if result.run}) > 1
    lines = []
    for before, result in zip([None, *results], results, strict=False):
        claim, finding = result.claim, result.finding
        first = before is None or claim is not before.claim
        raw = f"uncorrected: {finding.verdict}" if finding.verdict != result.verdict else ""
        why = "; ".join(filter(None, [raw, finding.why]))
        lines.append(
            [
                claim.id,
                Cell(
                    result.verdict,
                    rest=f": {why}" if why else "",
                    special=BOLD if result.verdict == "supported" else None,
                ),
                f"{finding.subject} ({result.run})" if several and result.run else finding.subject,
                str(finding.objects or "-"),
                finding.numbers,
                f"“{claim.quoted}” ({claim.where})" if first else "",
                claim.measured if first else "",
            ]
        )
    heads = ["claim", "verdict", "method", "objects", "ours", "the paper", "measured"]
    return grid(heads, lines)


def write_checklist(results: Sequence[ClaimResult], directory: Path) -> Path:
    """Write `claims.md` into the folder of a run, and return its path."""
    path = directory / _CHECKLIST
    write_whole(path, to_markdown(results).encode())
    return path


def read_evidence(
    directory: Path, manifest: Mapping[str, Any] | None = None, subjects: Sequence[str] = ()
) -> _RunEvidence:
    """Return a finished run as evidence.

    Raises BadInput for a run that is not finished, is damaged, or is of another suite.
    """
    manifest = dict(manifest or read_finished(directory))
    suite = manifest["suite"]
    if suite not in SUITES:
        raise BadInput(
            f"{directory}: no claim of the paper is about {suite}; give runs of {', '.join(SUITES)}"
        )
    evidence: Evidence
    if suite == SPEED:
        samples = _read_table(directory, "speed_samples")
        machine = str(manifest.get("machine", {}).get("cpu") or "an unknown machine")
        evidence = TimingEvidence(samples, machine, _trainings(samples["method"].unique()))
    elif suite == LATENT:
        names = ("latent_interpolation", "latent_arithmetic")
        evidence = pd.concat([_read_table(directory, table) for table in names], ignore_index=True)
    else:
        evidence = _quality_evidence(directory, manifest, subjects)
    return _RunEvidence(f"{suite} on {manifest['dataset']}", suite, evidence)


def _quality_evidence(
    directory: Path, manifest: dict[str, Any], subjects: Sequence[str]
) -> QualityEvidence:
    scored = read_run(directory)
    if scored.suite.truth != "coloured":
        raise BadInput(
            f"{directory}: is scored against {TRUTHS[scored.suite.truth]}, and the paper's claims "
            "are about images in colours; give a run without --truth"
        )
    wanted = (*scored.suite.image_metrics, *scored.suite.class_metrics, *DISTANCES, *RECOGNISABLE)
    metrics = [m for m in dict.fromkeys(wanted) if m in scored.features or scored.has(m)]
    known = [m for m in manifest["methods"] if family_of(m) == NETWORK or m in subjects]
    compared = scored.compared(metrics, [SURFACE, "true-mesh", *FLOORS, *known])
    if compared.empty:
        raise BadInput(f"{directory}: no object of this run could be drawn; fix the dataset")
    judged = scored.features.get(JUDGE)
    return QualityEvidence(
        compared,
        {} if judged is None else _retrieval_of_chairs(scored.image_sets, judged),
        _trainings(known),
        tuple(subjects),
        seed_spreads(),
    )


def _trainings(methods: Iterable[str]) -> dict[str, Training]:
    """Return the trainings of networks; a method without a file of weights has none."""
    trainings = {}
    for name in methods:
        method = known_method(str(name))
        if method is None or method.weights_file is None:
            continue
        try:
            card = card_of(method.weights_file())
        except BadInput:
            continue
        width = _PAPER_WIDTHS.get(str(name), card.get("model", {}).get("width"))
        if width is not None:
            trainings[str(name)] = Training(float(width), bool(card.get("augment", False)))
    return trainings


def _retrieval_of_chairs(cells: Iterable[ImageSet], judged: Features) -> dict[tuple[str, str], Any]:
    """Return the share of each chair's images by which the judge finds it, [G].

    It is by method and condition; empty without chairs, and where the gallery is too small.
    """
    of_chairs = [cell for cell in cells if cell[2] == CHAIR]
    if not of_chairs:
        return {}
    gallery = true_gallery(judged, CHAIR)
    if why_no_retrieval(gallery):
        return {}
    by_cell = {}
    for cell in of_chairs:
        images = judged.images(*cell)
        hits = pd.Series(found(gallery, judged.of(*cell, images), images))
        shares = hits.groupby([obj for obj, _ in images]).mean()
        # An object without images is not found.
        per_object = shares.reindex(sorted(gallery.objects), fill_value=0.0).to_numpy()
        by_cell[cell[0], cell[1]] = per_object
    return by_cell


def _counts(results: Sequence[ClaimResult]) -> Grid:
    """Return the number of claims of each verdict, a line for each method of each run."""
    subjects: dict[tuple[str, str], list[Verdict]] = {}
    for result in results:
        subjects.setdefault((result.finding.subject, result.run), []).append(result.verdict)
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
