"""The checklist of the paper's claims, `claims.md`: it tests each claim on finished runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from threadpoolctl import threadpool_limits

from bench.analysis.compare import compared
from bench.analysis.paper import NETWORK, SURFACE
from bench.analysis.run import read_run
from bench.analysis.sets import ImageSet, true_gallery
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import FLOORS, known_method
from bench.catalogue.metrics import JUDGE
from bench.catalogue.suites import TRUTHS
from bench.check.claims import CHAIRS, CLASSES, LATENT, SPEED, Claim, claims
from bench.check.rules import (
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
from bench.judges.answers import found, why_no_retrieval
from bench.records.folder import read_finished
from bench.records.frames import Features
from bench.tables import markdown
from bench.tables.grid import BOLD, Cell, Grid, grid
from bench.tables.paper import seed_spreads
from bench.tables.table import TABLES
from data_prep.failures import BadInput, unknown
from data_prep.files.atomic_write import write_whole
from learning.weights import card_of

_CHECKLIST = "claims.md"  # the name of the file in a run's folder
# The widths of networks whose weights are made when they are loaded, so that no file of weights
# tells their width; the unit is the width of the paper's network.
_PAPER_WIDTHS = {"pc2pix@paper": 1.0}
SUITES = (CHAIRS, CLASSES, SPEED, LATENT)  # the suites whose runs can test a claim


class _RunEvidence(NamedTuple):
    """The evidence of a run about claims."""

    name: str  # the name that people see: the suite and the dataset
    suite: str
    evidence: Evidence


@dataclass(frozen=True)
class ClaimResult:
    """The finding about a claim on one run, with the corrected verdict."""

    claim: Claim
    run: str  # the name of the run; empty where no run of the claim's suite was given
    finding: ClaimFinding
    # The verdict after Holm's correction for the number of claims of the claim's family that were
    # tested for the same method on the same run.
    verdict: Verdict = "not testable here"


def check_claims(directories: Sequence[Path], subjects: Sequence[str] = ()) -> list[ClaimResult]:
    """Test every claim on the finished runs in these folders, in the order of the claims.

    subjects  the methods for which claims about pc2pix are tested; by default its variants

    Raises BadInput for a folder without a finished run, for a run of a suite that no claim is
    about, for runs that do not fit together, and where the runs can test no claim.
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
    """Raise BadInput for a subject that is a method of none of the runs."""
    methods: dict[str, None] = {}
    for manifest in manifests.values():
        methods |= dict.fromkeys(manifest.get("methods", ()))
    for subject in subjects:
        if subject not in methods:
            raise unknown(subject, [*methods], "method", see="bench table DIR")


def _refuse_misfits(manifests: Mapping[Path, Mapping[str, Any]]) -> None:
    """Raise BadInput for runs whose values cannot stand in one table.

    All runs have to have the same dataset, seed and features; those of a suite the same objects.
    """
    # The first run that has a property, by the property and the suite within which it has to agree.
    first: dict[tuple[str, str], tuple[Path, object]] = {}
    for directory, manifest in manifests.items():
        properties = {
            ("dataset", ""): manifest.get("dataset"),
            ("seed", ""): manifest.get("seed"),
            ("objects", str(manifest["suite"])): manifest.get("objects"),
        }
        for name, identity in manifest.get("feature_identity", {}).items():
            properties[f"features of {name}", ""] = identity
        for (what, suite), value in properties.items():
            other, known = first.setdefault((what, suite), (directory, value))
            if known != value:
                shown = f": {known} and {value}" if what != "objects" else ""
                raise BadInput(
                    f"{other} and {directory} do not fit together, they have different "
                    f"{what}{shown}; give runs that were made alike"
                )


def judge(table: Sequence[Claim], runs: Sequence[_RunEvidence]) -> list[ClaimResult]:
    """Test each claim on every run of its suite, and return the results with corrected verdicts.

    A claim without a run of its suite has one result, whose reason says which run to give.
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
    """Return results with verdicts corrected for the number of claims that are tested together.

    These are the claims of a family, for one method of one run.
    """
    families: dict[tuple[str, str, str], list[int]] = {}
    for number, result in enumerate(results):
        key = result.claim.family, result.run, result.finding.subject
        families.setdefault(key, []).append(number)
    verdicts: dict[int, Verdict] = {}
    for numbers in families.values():
        family = corrected([results[number].finding for number in numbers])
        verdicts |= dict(zip(numbers, family, strict=True))
    return [replace(result, verdict=verdicts[number]) for number, result in enumerate(results)]


def to_markdown(results: Sequence[ClaimResult]) -> str:
    """Return the checklist as Markdown: counts of verdicts, then a row for each result."""
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
    """Return a grid with a row for each result; a claim is quoted in its first row only."""
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
                claim.criterion if first else "",
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
    """Return what a finished run can prove about claims.

    Raises BadInput for a run that is not finished or is damaged, and for a run of a suite that no
    claim is about.
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
    metrics = [
        metric
        for metric in dict.fromkeys(wanted)
        if metric in scored.features or scored.has(metric)
    ]
    networks = [
        method
        for method in manifest["methods"]
        if family_of(method) == NETWORK or method in subjects
    ]
    evidence = compared(scored, metrics, [SURFACE, "true-mesh", *FLOORS, *networks])
    if evidence.empty:
        raise BadInput(f"{directory}: no object of this run could be drawn; fix the dataset")
    judged = scored.features.get(JUDGE)
    return QualityEvidence(
        compared=evidence,
        retrieval={} if judged is None else _retrieval_of_chairs(scored.image_sets, judged),
        trainings=_trainings(networks),
        subjects=tuple(subjects),
        seeds=seed_spreads(),
    )


def _trainings(methods: Iterable[str]) -> dict[str, Training]:
    """Return what is known about the trainings of methods, by method.

    A method without a file of weights is left out, and so is one whose file does not tell.
    """
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


def _retrieval_of_chairs(
    groups: Iterable[ImageSet], judged: Features
) -> dict[tuple[str, str], Any]:
    """Return in which share of each chair's images the judge finds that chair, float64 [G].

    The result is by method and condition, with the G chairs sorted by name. It is empty without
    chairs, and where there are too few true images to find a chair by.

    groups  triples of method, condition and class
    judged  the judge's answers to the images of the run
    """
    of_chairs = [group for group in groups if group[2] == CHAIR]
    if not of_chairs:
        return {}
    gallery = true_gallery(judged, CHAIR)
    if why_no_retrieval(gallery):
        return {}
    retrieval = {}
    for method, condition, class_name in of_chairs:
        images = judged.images(method, condition, class_name)
        answers = judged.of(method, condition, class_name, images)
        hits = pd.Series(found(gallery, answers, images))
        shares = hits.groupby([obj for obj, _ in images]).mean()
        # An object without images counts as never found.
        shares = shares.reindex(sorted(gallery.objects), fill_value=0.0)
        retrieval[method, condition] = shares.to_numpy()
    return retrieval


def _counts(results: Sequence[ClaimResult]) -> Grid:
    """Return a grid that counts the claims of each verdict, with a row for each method of a run."""
    verdicts_of: dict[tuple[str, str], list[Verdict]] = {}
    for result in results:
        verdicts_of.setdefault((result.finding.subject, result.run), []).append(result.verdict)
    lines = []
    for (subject, run), verdicts in verdicts_of.items():
        counts = [str(verdicts.count(verdict)) for verdict in VERDICTS]
        lines.append([subject, run, *counts])
    return grid(["method", "run", *VERDICTS], lines)


def _read_table(directory: Path, name: str) -> pd.DataFrame:
    path = directory / TABLES / f"{name}.csv"
    try:
        return pd.read_csv(path, dtype={"condition": str})
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: cannot be read ({error}); start the run again") from error
