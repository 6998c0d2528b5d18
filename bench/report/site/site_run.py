"""A run on a site, and the parts of a page that several pages show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from bench.analysis.comparison import Comparison
from bench.analysis.paired import PairedDifference
from bench.analysis.ranks import Ranking
from bench.analysis.scored import ScoredRun
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.suite_types import TRUTHS
from bench.report.site.methods import SiteMethod, method_slug
from bench.tables.differences import too_few
from bench.tables.frontier import cost_grid
from bench.tables.grid import (
    NOTHING,
    Annotation,
    Cell,
    ColumnHeader,
    Grid,
    measured,
    scored_as_blank,
)
from bench.tables.ranks import RankedValue
from bench.tables.table import Table

HEADLINE = ("ssim-object", "lpips")  # before others of a suite; the first judges costs
LETTERS = (
    "Methods that share a letter are not shown to differ (paired object by object, p below 0.05 "
    "after Holm's correction for all pairs of a column). Reference methods (ceiling, floor) are "
    "shown for comparison and have no letters."
)
FAILURES = (
    "Values are means over objects. A failed image counts as a blank one, as in the column "
    "“failures_as_blank” of the CSV files; their column “value” leaves it out."
)
FIRST = Annotation("first")  # nothing is shown to be better
COST_REMARK = "One thread. Times of different machines are not compared, accuracy is."


@dataclass(frozen=True, eq=False)
class SiteRun:
    """A run of the site.

    Attributes
    ----------
    name : str
        Name that no other run of the site has.
    slug : str
        Beginning of the names of its files.
    methods : mapping
        Methods by their names on the site.
    by_class : tuple of Comparison
        The comparisons of single classes; empty where there is one class.
    rankings : tuple of Ranking
        Rankings by metric and condition, with methods by their names on the site.
    overall : Comparison
        The methods by each object's mean over conditions.
    overall_rankings : mapping
        Rankings of `overall` by metric, with methods by their names on the site.
    ranks : Table
        The same rankings for scripts, with methods by their ids.
    copies : tuple of Path
        Folders with the same records, which are not counted.
    """

    name: str
    slug: str
    run: ScoredRun
    methods: Mapping[str, SiteMethod]
    compared: tuple[Comparison, ...]
    by_class: tuple[Comparison, ...]
    rankings: tuple[Ranking, ...]
    overall: Comparison
    overall_rankings: Mapping[str, Ranking]
    ranks: Table[RankedValue]
    copies: tuple[Path, ...] = ()

    @cached_property
    def metrics(self) -> list[str]:
        """Return the metrics of the rankings, in order."""
        return list(self.overall_rankings)

    @property
    def objects(self) -> str:
        """Return how many objects of what it shows, from how many views."""
        manifest = self.run.manifest
        classes = {name.partition("/")[0] for name in map(str, manifest["objects"])}
        kinds = f"{len(classes)} classes" if len(classes) > 1 else f"class {min(classes)}"
        return f"{len(manifest['objects'])} objects of {kinds} × {manifest['views']} views"

    @cached_property
    def differences(self) -> dict[tuple[str, str], list[PairedDifference]]:
        """Return the differences of two methods, in either order, by metric and condition."""
        differences: dict[tuple[str, str], list[PairedDifference]] = {}
        for ranking in self.rankings:
            for difference in ranking.pairs:
                a, b = difference.pair.a.method, difference.pair.b.method
                differences.setdefault((a, b), []).append(difference)
                differences.setdefault((b, a), []).append(difference.turned())
        return differences

    @cached_property
    def images(self) -> dict[tuple[str, str], tuple[int, int]]:
        """Return the number of images drawn and requested, by condition and method."""
        return {
            (comparison.condition, name): comparison.images[method.id]
            for comparison in self.compared
            for name, method in self.methods.items()
            if method.id in comparison.images
        }

    @property
    def failed(self) -> tuple[int, int]:
        """Return the number of failed images and of all images."""
        counts = map(self.run.sums.images, self.run.sums.cells)
        drawn, planned = map(sum, zip(*counts, strict=True))
        return planned - drawn, planned

    @cached_property
    def reasons(self) -> list[tuple[tuple[str, str], int]]:
        """Return the number of failed images by method and reason, the most frequent first."""
        names = {method.id: name for name, method in self.methods.items()}
        counts = Counter[tuple[str, str]]()
        for (method, _, _), reasons in sorted(self.run.sums.reasons.items()):
            counts.update({(names[method], why): n for why, n in sorted(reasons.items())})
        return counts.most_common()

    def failed_images(self, method: str, condition: str) -> tuple[int, int]:
        """Return the number of failed images of a method at a condition, and of all of them."""
        sums, id_ = self.run.sums, self.methods[method].id
        counts = [sums.images(cell) for cell in sums.cells if cell[:2] == (id_, condition)]
        planned = sum(count for _, count in counts)
        return planned - sum(count for count, _ in counts), planned

    @cached_property
    def costs(self) -> Grid | None:
        """Return the costs of all methods; None without costs."""
        costs = cost_grid(self.compared, self.metrics[0], int(self.run.manifest["views"]))
        names = {method.id: name for name, method in self.methods.items()}
        return costs and replace(
            costs, lines=tuple(replace(line, name=names[line.name]) for line in costs.lines)
        )

    @property
    def truth(self) -> str:
        """Return the truth that images are scored against, in words."""
        return TRUTHS[self.run.suite.truth]

    @property
    def page(self) -> str:
        """Return the file name of the run's page."""
        return f"run-{self.slug}.html"

    @property
    def machine(self) -> str:
        """Return the name of the processor that the run was measured on."""
        return str(self.run.manifest.get("machine", {}).get("cpu", "an unknown processor"))


def rank_cell(run: SiteRun, ranking: Ranking, method: str) -> Cell:
    """Return a method's value with the letters of its rank."""
    rank = ranking.of(method)
    caveat = scored_as_blank(*run.images.get((ranking.condition, method), (0, 0)))
    if rank is None:
        return replace(NOTHING, caveat=caveat)
    cell = measured(rank.estimate, rank.precision, special=FIRST if rank.first else None)
    return replace(cell, text=f"{cell.text} {rank.letters}".rstrip(), caveat=caveat)


def letters_remark(rankings: Iterable[Ranking]) -> str:
    """Return what letters mean, and how many objects there have to be where they are missing."""
    needed = [ranking.objects_needed for ranking in rankings if ranking.objects_needed]
    return LETTERS + (f" Without letters: {too_few(max(needed))}." if needed else "")


def caption_of(metric: str) -> str:
    """Return the caption of a metric's grid."""
    return f"{metric}, {'higher' if higher_is_better(metric) else 'lower'} is better"


def lead_record(runs: Iterable[SiteRun], a: str, b: str) -> tuple[int, int, int]:
    """Count how often a is ahead of b, neither, and b, over runs, metrics and conditions."""
    outcomes = [cell.ahead for run in runs for cell in run.differences.get((a, b), ())]
    return outcomes.count("a"), outcomes.count("tie"), outcomes.count("b")


def objects_needed(runs: Iterable[SiteRun], a: str, b: str) -> int:
    """Return how many objects decide all that is undecided between a and b; 0 where nothing is."""
    cells = [cell for run in runs for cell in run.differences.get((a, b), ())]
    return max((cell.objects_needed or 0 for cell in cells), default=0)


def share_ranking(runs: Sequence[SiteRun], a: str, b: str) -> bool:
    """Return whether two methods are in the same ranking of some run."""
    return any(ranks.of(a) and ranks.of(b) for run in runs for ranks in run.rankings)


def headers(names: Iterable[str]) -> tuple[ColumnHeader, ...]:
    """Return column headers without tags."""
    return tuple(map(ColumnHeader, names))


def method_file(method: str) -> str:
    """Return the file name of a method's page."""
    return f"method-{method_slug(method)}.html"


def pair_file(a: str, b: str) -> str:
    """Return the file name of the page that compares two methods."""
    return f"compare-{method_slug(a)}--{method_slug(b)}.html"


def truths_of(runs: Iterable[SiteRun]) -> str:
    """Return the truths of runs, each once: "the true mesh in its colours and ... in grey"."""
    return " and ".join(dict.fromkeys(run.truth for run in runs))


def methods_of(runs: Iterable[SiteRun]) -> list[str]:
    """Return the methods that have a value in some run, reference methods last."""
    rankings = [ranking for run in runs for ranking in run.rankings]
    return list(dict.fromkeys(rank.method for ranking in rankings for rank in ranking.ranks))


def method_id_of(runs: Iterable[SiteRun], name: str) -> str:
    """Return the id of a method of the site."""
    return next(run.methods[name].id for run in runs if name in run.methods)


def manifest_of(runs: Iterable[SiteRun], name: str) -> Mapping[str, Any]:
    """Return the manifest of the first run that has a method of the site."""
    return next(run.run.manifest for run in runs if name in run.methods)


def cost_grid_of(run: SiteRun, ranked: Sequence[str], only: str | None = None) -> Grid | None:
    """Return the costs of a run, of all methods or of one, with links to pages of methods."""
    if (costs := run.costs) is None:
        return None
    lines = (
        replace(line, link=method_file(line.name) if line.name in ranked else "")
        for line in costs.lines
        if only in (None, line.name)
    )
    return replace(costs, lines=tuple(lines), caption=f"{run.name}, {run.machine}: {costs.caption}")
