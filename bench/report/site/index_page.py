"""The index of a site: the answer, plots, the leaderboard, classes, runs, and what it all means."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

from bench.analysis.comparison import worse_than_blank
from bench.analysis.frontier import places
from bench.analysis.leaderboard import MeanRanks
from bench.analysis.paired import SIGNIFICANCE
from bench.catalogue.condition_names import condition_words
from bench.catalogue.methods import RECOMMENDED
from bench.records.artifacts import JobName
from bench.records.run_folder import PROTOCOL
from bench.records.stored_artifacts import StoredArtifacts
from bench.report.images import data_uri
from bench.report.page import PageImage, Plot
from bench.report.site.board import Board, row_kinds
from bench.report.site.classes import class_grids
from bench.report.site.leaderboard import leaderboard, site_ranks
from bench.report.site.plots import run_plots
from bench.report.site.site_run import SiteRun, methods_of, truths_of
from bench.report.site.words import joined_names, metric_words
from bench.report.stored import Sources
from bench.tables.differences import too_few
from bench.tables.grid import Grid
from data_prep.failures import BadInput
from data_prep.progress import log

INDEX = "index.html"
MOST_REASONS = 3  # listed for a run; its page has all


@dataclass(frozen=True)
class RunPlots:
    """The plots of a run under its name; `about` says of what they are."""

    name: str
    about: str
    plots: tuple[Plot, ...]


@dataclass(frozen=True)
class RunCard:
    """A run with what it takes to repeat it, and what failed."""

    name: str
    page: str
    about: str
    facts: tuple[tuple[str, str], ...]
    failures: tuple[str, ...]
    command: str
    versions: str


@dataclass(frozen=True)
class IndexPage:
    """The content of the index.

    Attributes
    ----------
    answers : tuple of (term, sentence)
        Who is first, and what one has to know before the table.
    classes : tuple of (run, grids)
        Values by class of the runs that have several.
    boards : tuple of Board
        A leaderboard for each truth: ranks against one say nothing about the other.
    meanings : tuple of (title, ((anchor, term, description), ...))
        Glossary.
    """

    file: str
    title: str
    kicker: str
    about: str
    facts: tuple[tuple[str, str], ...]
    answers: tuple[tuple[str, str], ...]
    plots: tuple[RunPlots, ...]
    boards: tuple[Board, ...]
    classes: tuple[tuple[str, tuple[Grid, ...]], ...]
    runs: tuple[RunCard, ...]
    left_out: tuple[str, ...]
    meanings: tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...]

    @property
    def methods(self) -> list[str]:
        """Return all methods, each once, in the order of the leaderboards."""
        return list(dict.fromkeys(row.name for board in self.boards for row in board.rows))


def index_page(runs: Sequence[SiteRun], left_out: Sequence[str] = ()) -> IndexPage:
    """Return the index of a site; `left_out` are names of runs."""
    by_truth: dict[str, list[SiteRun]] = {}
    for run in runs:
        by_truth.setdefault(run.truth, []).append(run)
    boards, answers, images_of = [], [], thumbnails(runs)
    for truth, of_truth in by_truth.items():
        ranks = site_ranks(of_truth)
        boards.append(leaderboard(of_truth, methods_of(of_truth), ranks, images_of))
        shown = [row.name for row in boards[-1].rows if not row.kind]
        against = f", against {truth}" if len(by_truth) > 1 else ""
        answers += [(f"{term}{against}", a) for term, a in _answers(of_truth, ranks, shown)]
    failed, images = (sum(counts) for counts in zip(*(run.failed for run in runs), strict=True))
    names = list(dict.fromkeys(row.name for board in boards for row in board.rows))
    plotted = (
        RunPlots(
            run.name,
            f"{run.run.suite.about}; {run.objects}",
            run_plots(run, [run.methods[name].id for name in _main_methods(run, names)]),
        )
        for run in runs
    )
    return IndexPage(
        INDEX,
        "Leaderboard",
        "pc2pix-bench",
        "Which renderer should draw a point cloud? Networks and surface reconstruction against "
        "true images.",
        (
            ("protocol", str(runs[0].run.manifest[PROTOCOL])),
            ("truth", truths_of(runs)),
            ("runs", str(len(runs))),
            ("methods", str(len(names))),
            ("failed", f"{failed:,} of {images:,} images"),
        ),
        tuple(answers),
        tuple(of_run for of_run in plotted if of_run.plots),
        tuple(boards),
        tuple(
            (run.name, class_grids(run, _main_methods(run, names))) for run in runs if run.by_class
        ),
        tuple(map(_card, runs)),
        tuple(f"{name} is left out: no object has scored images." for name in left_out),
        _meanings(runs),
    )


def _main_methods(run: SiteRun, names: Sequence[str]) -> list[str]:
    """Return the methods of a run that are neither reference methods nor variants of others."""
    of_run = [name for name in names if name in run.methods]
    kinds = row_kinds(of_run, {name: run.methods[name].id for name in of_run}, {RECOMMENDED})
    return [name for name in of_run if not kinds[name]]


def thumbnails(runs: Sequence[SiteRun]) -> dict[str, PageImage]:
    """Return an image of each method: the first view of the first object, where a run has it."""
    images: dict[str, PageImage] = {}
    first = str(runs[0].run.manifest["objects"][0])
    for run in runs:
        sources = Sources(StoredArtifacts(run.run.directory), {}, "")
        condition, objects = run.run.manifest["conditions"][0], run.run.manifest["objects"]
        class_name, _, object_id = str(first if first in objects else objects[0]).partition("/")
        try:
            for name, method in run.methods.items():
                drawn = sources.images(JobName(method.id, condition, class_name, object_id))
                if name not in images and drawn is not None:
                    words = f"{class_name} {object_id} by {name}, {condition_words(condition)}"
                    images[name] = PageImage(data_uri(drawn[0]), words)
        except BadInput as error:
            log(f"{run.name}: no thumbnails, {error}")
    return images


def _answers(
    runs: Sequence[SiteRun], ranks: MeanRanks, shown: Sequence[str]
) -> tuple[tuple[str, str], ...]:
    """Return who is first, what is cheap, and what is worse than a white image."""
    answers = []
    if ranks.ranks:
        few = ranks.first != ranks.ranks[0].method
        enough = " of those with enough objects" if few else ""
        answers.append((f"First by mean rank{enough}", ranks.first))
        tied = [rank.method for rank in ranks.ranks if rank.p_first >= SIGNIFICANCE]
        if ranks.objects_needed:
            answers.append(("Whether it differs from others", too_few(ranks.objects_needed)))
        elif tied:
            answers.append(("Not shown to differ from it", joined_names(tied)))
    cheap = []
    for run in runs[:1]:
        names = {method.id: name for name, method in run.methods.items()}
        points = [p for p in places(run.overall, run.metrics[:1], 1) if p.verdict == "frontier"]
        cheap += [names[p.method] for p in sorted(points, key=lambda p: p.cost_ms.value)]
        if cheap:
            answers.append((f"On the frontier of {run.name}, cheapest first", joined_names(cheap)))
    below = [name for name in shown if _below(runs, name)]
    if below:
        answers.append(("Worse than a white image in some run", joined_names(below)))
    return tuple(answers)


def _below(runs: Sequence[SiteRun], method: str) -> bool:
    return any(
        run.methods[method].id in worse_than_blank(run.overall.qualities[metric])
        for run in runs
        if method in run.methods
        for metric in run.metrics
    )


def _card(run: SiteRun) -> RunCard:
    manifest = run.run.manifest
    failed, images = run.failed
    arguments = [str(argument) for argument in manifest.get("command", [])[1:]]
    reasons = run.reasons
    failures = [f"{name}: {count} × {why}" for (name, why), count in reasons[:MOST_REASONS]]
    if len(reasons) > MOST_REASONS:
        failures.append(f"{len(reasons) - MOST_REASONS} more reasons on the page of the run")
    copies = [
        f"{path.resolve().name} has the same records; it is not counted again"
        for path in run.copies
    ]
    commit = str(manifest.get("git", {}).get("commit", ""))[:7]
    return RunCard(
        run.name,
        run.page,
        run.run.suite.about,
        (
            ("suite", str(manifest["suite"])),
            ("dataset", str(manifest["dataset"])),
            ("truth", run.truth),
            ("objects", run.objects),
            ("conditions", ", ".join(map(condition_words, manifest["conditions"]))),
            ("seed", str(manifest["seed"])),
            ("failed", f"{failed:,} of {images:,} images"),
            ("machine", run.machine),
            ("finished", str(manifest["finished"])[:10]),
            *([("commit", commit)] if commit else []),
        ),
        (*failures, *copies),
        shlex.join(["bench", *arguments])
        if arguments
        else f"bench run --suite {manifest['suite']}",
        ", ".join(f"{name} {version}" for name, version in manifest.get("versions", {}).items()),
    )


def _meanings(
    runs: Sequence[SiteRun],
) -> tuple[tuple[str, tuple[tuple[str, str, str], ...]], ...]:
    metrics = dict.fromkeys(metric for run in runs for metric in run.metrics)
    conditions = dict.fromkeys(c.condition for run in runs for c in run.compared)
    general = (
        ("rank", "mean rank", "One, and the share of the comparisons that a method loses to each "
         "other, summed over these: object by object, by each metric under each condition of each "
         "run. To methods that it has not met it is taken to lose as often as to the others."),
        ("letters", "letters", "Methods that share a letter are not shown to differ; “a” is the "
         "first. p values are corrected for all pairs of methods."),
        ("cost", "ms a view", "Milliseconds for a cloud of the first condition and its first view, "
         "on one thread of the machine that is named; median over objects."),
        ("below", "worse than blank", "Worse than a white image, which costs nothing."),
    )  # fmt: skip
    return (
        ("Metrics", tuple((m, m, metric_words(m)) for m in metrics)),
        ("Conditions", tuple((f"condition-{c}", c, condition_words(c)) for c in conditions)),
        ("Columns", general),
    )
