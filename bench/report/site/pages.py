"""The pages of a site, each with the parts of runs and rankings that it shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from pathlib import Path

from bench.analysis.comparison import Comparison, decimals
from bench.analysis.paired import PairedDifference
from bench.analysis.ranks import Ranking
from bench.analysis.scored import ScoredRun
from bench.catalogue.methods import known_method, role
from bench.catalogue.metrics import higher_is_better
from bench.catalogue.parameters import PARAMETERS
from bench.records.journal import PROTOCOL
from bench.report.site.methods import SiteMethod, method_slug
from bench.report.site.page import Link, Section, SitePage, card_html
from bench.tables.differences import difference_cell, too_few
from bench.tables.frontier import cost_grid
from bench.tables.grid import (
    NOTHING,
    Annotation,
    Cell,
    ColumnHeader,
    Grid,
    TableRow,
    grid,
    number,
    pivot,
    scored_as_blank,
)
from bench.tables.ranks import RankedValue
from bench.tables.table import Table
from data_prep.files.checksums import file_sha256

QUALITY = "ssim"  # before the metrics of a suite's headline; what costs are compared with
LETTERS = (
    "Methods that share a letter are not shown to differ (paired object by object, p below 0.05 "
    "after Holm's correction for all pairs of a column). Reference methods (ceiling, floor) are "
    "shown for comparison and have no letters."
)
FAILURES = (
    "Values are means over objects. A failed image counts as a blank one, as in the column "
    "“failures_as_blank” of the CSV files; their column “value” leaves it out."
)
MOST_REASONS = 20  # listed on the page of a run
FIRST = Annotation("first")  # nothing is shown to be better
INDEX, COMPARE, COSTS = "index.html", "compare.html", "cost.html"
MENU = (("Overview", INDEX), ("Comparisons", COMPARE), ("Cost", COSTS))


@dataclass(frozen=True, eq=False)
class SiteRun:
    """A run of the site.

    name      no other run has it
    slug      begins the names of its files
    methods   by their names on the site
    rankings  by metric and condition, of methods by these names
    ranks     the same for scripts, of methods by their ids
    copies    folders with the same records, which are not counted
    """

    name: str
    slug: str
    run: ScoredRun
    methods: Mapping[str, SiteMethod]
    compared: tuple[Comparison, ...]
    rankings: tuple[Ranking, ...]
    ranks: Table[RankedValue]
    copies: tuple[Path, ...] = ()

    @cached_property
    def metrics(self) -> list[str]:
        """Its metrics, in order."""
        return list(dict.fromkeys(ranking.metric for ranking in self.rankings))

    @cached_property
    def differences(self) -> dict[tuple[str, str], list[PairedDifference]]:
        """Differences of two methods, in either order, by metric and condition."""
        found: dict[tuple[str, str], list[PairedDifference]] = {}
        for one in (one for of in self.rankings for one in of.pairs):
            a, b = one.pair.a.method, one.pair.b.method
            found.setdefault((a, b), []).append(one)
            found.setdefault((b, a), []).append(one.turned())
        return found

    @cached_property
    def images(self) -> dict[tuple[str, str], tuple[int, int]]:
        """Images that exist and images that should, by condition and method."""
        return {
            (of.condition, name): of.images[method.id]
            for of in self.compared
            for name, method in self.methods.items()
            if method.id in of.images
        }

    @property
    def failed(self) -> tuple[int, int]:
        """Images that failed, of how many."""
        outcomes = self.run.records["outcome"]
        return int((outcomes != "ok").sum()), len(outcomes)

    @cached_property
    def costs(self) -> Grid | None:
        """The costs of all its methods."""
        made = cost_grid(self.compared, QUALITY, int(self.run.manifest["views"]))
        names = {method.id: name for name, method in self.methods.items()}
        return made and replace(
            made, lines=tuple(replace(line, name=names[line.name]) for line in made.lines)
        )

    @property
    def page(self) -> str:
        """The file of its page."""
        return f"run-{self.slug}.html"

    @property
    def machine(self) -> str:
        """Its processor."""
        return str(self.run.manifest.get("machine", {}).get("cpu", "an unknown processor"))


def pages(runs: Sequence[SiteRun], downloads: Mapping[str, Sequence[Link]]) -> list[SitePage]:
    """Return all pages of a site; `downloads` are links by the names of runs."""
    ranked = list(dict.fromkeys(r.method for run in runs for of in run.rankings for r in of.ranks))
    pairs = [(a, b) for a, b in combinations(ranked, 2) if _shared(runs, a, b)]
    return [
        _overview(runs, ranked),
        *(_run_page(run, downloads[run.name]) for run in runs),
        *(_method_page(method, ranked, runs) for method in ranked),
        _matrix(runs, ranked),
        *(_pair_page(a, b, runs) for a, b in pairs),
        _costs(runs, ranked),
    ]


# --- grids ----------------------------------------------------------------------------------------


def _rank_cell(run: SiteRun, of: Ranking, method: str) -> Cell:
    rank = of.of(method)
    caveat = scored_as_blank(*run.images.get((of.condition, method), (0, 0)))
    if rank is None:
        return replace(NOTHING, caveat=caveat)
    digits = decimals(of.metric)
    cell = number(rank.estimate, f"{{:.{digits}f}}".format, special=FIRST if rank.first else None)
    return replace(cell, text=f"{cell.text} {rank.letters}".rstrip(), caveat=caveat)


def _letters_remark(rankings: Iterable[Ranking]) -> str:
    """Return what letters mean, and how many objects there have to be where they are missing."""
    needed = [ranking.objects_needed for ranking in rankings if ranking.objects_needed]
    return LETTERS + (f" Without letters: {too_few(max(needed))}." if needed else "")


def _caption(metric: str) -> str:
    return f"{metric}, {'higher' if higher_is_better(metric) else 'lower'} is better"


def _rank_grids(run: SiteRun) -> tuple[Grid, ...]:
    """Return a grid for each metric: methods by condition, the best of the first column first."""
    grids = []
    for metric in run.metrics:
        of_metric = [of for of in run.rankings if of.metric == metric]
        methods = [rank.method for rank in of_metric[0].ranks]
        lines = tuple(
            TableRow(
                *(m, tuple(_rank_cell(run, of, m) for of in of_metric)),
                role(run.methods[m].id),
                link=_method_file(m),
            )
            for m in methods
        )
        heads = _heads(of.condition for of in of_metric)
        remark = _letters_remark(of_metric)
        grids.append(Grid("method", heads, lines, caption=_caption(metric), remark=remark))
    return tuple(grids)


def _record(runs: Iterable[SiteRun], a: str, b: str) -> tuple[int, int, int]:
    """Count how often a is ahead of b, neither, and b, over runs, metrics and conditions."""
    outcomes = [one.ahead for run in runs for one in run.differences.get((a, b), ())]
    return outcomes.count("a"), outcomes.count("tie"), outcomes.count("b")


def _objects_needed(runs: Iterable[SiteRun], a: str, b: str) -> int:
    """Return how many objects decide all that is undecided between a and b; 0 where nothing is."""
    cells = [cell for run in runs for cell in run.differences.get((a, b), ())]
    return max((cell.objects_needed or 0 for cell in cells), default=0)


def _shared(runs: Sequence[SiteRun], a: str, b: str) -> bool:
    return any(of.of(a) and of.of(b) for run in runs for of in run.rankings)


def _difference_cell(run: SiteRun, row: PairedDifference) -> Cell:
    cell = difference_cell(row)
    if not row.objects_needed:
        ahead = {"a": row.pair.a.method, "b": row.pair.b.method}.get(row.ahead)
        cell = replace(cell, special=Annotation(f"{ahead} ahead") if ahead else None)
    failures = []
    for method in (row.pair.a.method, row.pair.b.method):
        if text := scored_as_blank(*run.images[row.pair.condition, method]):
            failures.append(f"{method}: {text}")
    return replace(cell, caveat="; ".join(failures))


def _heads(names: Iterable[str]) -> tuple[ColumnHeader, ...]:
    return tuple(map(ColumnHeader, names))


# --- pages ----------------------------------------------------------------------------------------


def _method_file(method: str) -> str:
    return f"method-{method_slug(method)}.html"


def _pair_file(a: str, b: str) -> str:
    return f"compare-{method_slug(a)}--{method_slug(b)}.html"


def _method_id(runs: Iterable[SiteRun], name: str) -> str:
    """Return the id of a method of the site."""
    return next(run.methods[name].id for run in runs if name in run.methods)


def _overview(runs: Sequence[SiteRun], ranked: Sequence[str]) -> SitePage:
    heads = ("suite", "dataset", "objects × views", "machine", "finished", "commit")
    lines = []
    for run in runs:
        manifest = run.run.manifest
        size = f"{len(manifest['objects'])} × {manifest['views']}"
        finished = str(manifest["finished"])[:10]
        commit = str(manifest.get("git", {}).get("commit", ""))[:7] or "-"
        failed, images = run.failed
        cells = (
            Cell(str(manifest["suite"])),
            Cell(str(manifest["dataset"])),
            Cell(size, caveat=f"{failed} of {images} images failed" if failed else ""),
            *map(Cell, (run.machine, finished, commit)),
        )
        lines.append(TableRow(run.name, cells, link=run.page))
    copies = tuple(
        f"{path.resolve().name} has the same records as {run.name}, and is not counted again."
        for run in runs
        for path in run.copies
    )
    of_runs = Grid("run", _heads(heads), tuple(lines), caption="What was run", notes=copies)
    firsts = []
    for method in ranked:
        cells = []
        for run in runs:
            ranks = [rank for r in run.rankings if (rank := r.of(method)) and rank.letters]
            count = sum(rank.first for rank in ranks)
            cells.append(Cell(f"{count} of {len(ranks)}", float(count)) if ranks else NOTHING)
        firsts.append(
            TableRow(
                method, tuple(cells), role(_method_id(runs, method)), link=_method_file(method)
            )
        )
    of_methods = Grid(
        "method",
        _heads(run.name for run in runs),
        tuple(firsts),
        caption="How often a method is among the first",
        remark="Of all metrics and conditions of a run: none is shown to be better. "
        + _letters_remark(ranking for run in runs for ranking in run.rankings),
    )
    version = runs[0].run.manifest[PROTOCOL]
    return SitePage(
        INDEX,
        "Runs and methods",
        "pc2pix-bench",
        "Point clouds drawn by networks and by surface reconstruction, against true images.",
        (("protocol", str(version)), ("runs", str(len(runs))), ("methods", str(len(ranked)))),
        (
            Section("Runs", grids=(of_runs,)),
            Section("Methods", "Each run's accuracy stands for itself.", (of_methods,)),
        ),
    )


def _run_page(run: SiteRun, downloads: Sequence[Link]) -> SitePage:
    manifest = run.run.manifest
    images = tuple((name, link) for name, link in downloads if link.endswith(".png"))
    return SitePage(
        run.page,
        run.name,
        "pc2pix-bench, a run",
        run.run.suite.about,
        (
            ("suite", str(manifest["suite"])),
            ("dataset", str(manifest["dataset"])),
            ("objects", f"{len(manifest['objects'])} × {manifest['views']} views"),
            ("failed", "{} of {} images".format(*run.failed)),
            ("machine", run.machine),
            ("finished", str(manifest["finished"])[:10]),
            ("protocol", str(manifest[PROTOCOL])),
        ),
        (
            Section("Ranks", FAILURES, _rank_grids(run)),
            *_failures(run),
            Section("Downloads", links=tuple(link for link in downloads if link not in images)),
            *([Section("Figures", images=images)] if images else []),
        ),
    )


def _failures(run: SiteRun) -> list[Section]:
    """Return how many images of each method failed, and why; nothing where none did."""
    records = run.run.records
    failed = records[records["outcome"] != "ok"]
    if failed.empty:
        return []
    names = {method.id: name for name, method in run.methods.items()}
    by_cell = failed.groupby(["method", "condition"]).size()
    of_cell = records.groupby(["method", "condition"]).size()
    conditions = [str(name) for name in run.run.manifest["conditions"]]
    lines = [
        [names[method]]
        + [
            Cell(f"{by_cell[method, at]} of {of_cell[method, at]}", float(by_cell[method, at]))
            if (method, at) in by_cell.index
            else NOTHING
            for at in conditions
        ]
        for method in dict.fromkeys(failed["method"])
    ]
    reasons = failed.groupby(["method", "reason"]).size().sort_values(ascending=False)
    notes = [
        f"{names[str(method)]}: {count} × {reason}"
        for (method, reason), count in reasons.head(MOST_REASONS).items()  # type: ignore[misc]
    ]
    if len(reasons) > MOST_REASONS:
        notes.append(f"{len(reasons) - MOST_REASONS} more reasons are in the full report.")
    made = grid(["method", *conditions], lines, caption="Failed images", notes=tuple(notes))
    return [Section("Failures", grids=(made,))]


def _of_weights(method: SiteMethod, weights: Path) -> bool:
    """Return whether a method was drawn with these weights, as far as its runs say."""
    stated = [part for part in method.identity if part.startswith("weights ")]
    return not stated or (weights.is_file() and f"weights {file_sha256(weights)}" in stated)


def _card(weights: Path) -> str | None:
    """Return the model card of a weights file, None without one.

    It has the name of the file, or lies beside it with a heading that names it, because one card
    may be of several files.
    """
    own = weights.with_suffix(".md")
    for path in (own, *sorted(weights.parent.glob("*.md"))):
        if not path.is_file():
            continue
        card = path.read_text("utf-8", errors="replace")
        if path == own or f"`{weights.stem}`" in card.partition("\n")[0]:
            return card
    return None


def _method_page(method: str, ranked: Sequence[str], runs: Sequence[SiteRun]) -> SitePage:
    own = [run for run in runs if method in run.methods]
    of_site = own[0].methods[method]
    known = known_method(of_site.id)
    grids = []
    for metric in dict.fromkeys(metric for run in own for metric in run.metrics):
        cells = [(run, of) for run in own for of in run.rankings if of.metric == metric]
        conditions = list(dict.fromkeys(of.condition for _, of in cells))
        lines = []
        for run in own:
            at = {of.condition: of for owner, of in cells if owner is run}
            values = (_rank_cell(run, at[c], method) if c in at else NOTHING for c in conditions)
            about = "; ".join(filter(None, [run.machine, run.methods[method].libraries]))
            lines.append(TableRow(run.name, tuple(values), about, link=run.page))
        remark = _letters_remark(of for _, of in cells)
        made = Grid(
            "run", _heads(conditions), tuple(lines), caption=_caption(metric), remark=remark
        )
        grids.append(made)
    others = [other for other in ranked if other != method and _shared(runs, method, other)]
    against = []
    for other in others:
        ahead, ties, behind = _record(runs, method, other)
        cells = (Cell(str(ahead), float(ahead)), Cell(str(ties)), Cell(str(behind)))
        pair = sorted((method, other), key=ranked.index)
        against.append(TableRow(other, cells, link=_pair_file(*pair)))
    sections = [
        Section("Accuracy", FAILURES, tuple(grids)),
        Section(
            "Against the others",
            "Metrics and conditions of all runs, counted by what is shown.",
            (
                Grid(
                    "other method",
                    _heads(("ahead", "tie", "behind")),
                    tuple(against),
                    caption=f"{method} against each other method",
                ),
            ),
        ),
        Section("Cost", _COST, tuple(filter(None, (_cost_grid(run, (), method) for run in own)))),
    ]
    knobs = [parameter for parameter in PARAMETERS if parameter.method == of_site.id]
    if knobs:
        rows = [[f"{of_site.id}@{k.name}=", f"{k.low:g} to {k.high:g}", k.about] for k in knobs]
        made = grid(["variant", "values", "meaning"], rows, caption="What can be set")
        sections.append(Section("Parameters", grids=(made,)))
    about = known.source if known else "no longer installed: its package or its weights are gone"
    if known and known.weights_file:
        weights = known.weights_file()
        if not _of_weights(of_site, weights):
            about += "; the weights of these runs are not those installed"
        elif card := _card(weights):
            sections.append(Section("Model card", trusted=card_html(card)))
    counts = [run.images[of.condition, method] for run in own for of in run.compared]
    failed, images = sum(n - n_ok for n_ok, n in counts), sum(n for _, n in counts)
    return SitePage(
        _method_file(method),
        method,
        "pc2pix-bench, a method",
        about,
        (
            ("kind", role(of_site.id) or "competes"),
            ("runs", str(len(own))),
            ("failed", f"{failed} of {images} images"),
            *([("identity", ", ".join(of_site.identity))] if of_site.identity else []),
        ),
        tuple(sections),
    )


def _matrix(runs: Sequence[SiteRun], ranked: Sequence[str]) -> SitePage:
    lines = []
    needed = max((_objects_needed(runs, a, b) for a, b in combinations(ranked, 2)), default=0)
    for a in ranked:
        cells = []
        for b in ranked:
            if a == b or not _shared(runs, a, b):
                cells.append(NOTHING)
                continue
            record = _record(runs, a, b)
            text = "–".join(map(str, record)) if any(record) else "untested"
            link = _pair_file(*sorted((a, b), key=ranked.index))
            cells.append(Cell(text, float(record[0] - record[2]), link=link))
        lines.append(TableRow(a, tuple(cells), role(_method_id(runs, a)), link=_method_file(a)))
    made = Grid(
        "method",
        _heads(ranked),
        tuple(lines),
        caption="Ahead, tie, behind: the method of the line against that of the column",
        remark="Counted over all metrics and conditions of all runs that have both. A tie: no "
        f"difference is shown.{f' Untested: {too_few(needed)}.' if needed else ''}",
    )
    return SitePage(
        COMPARE,
        "Comparisons",
        "pc2pix-bench",
        "Any two methods on the same objects; each count leads to the differences behind it.",
        (("methods", str(len(ranked))), ("runs", str(len(runs)))),
        (Section("All pairs", grids=(made,)),),
    )


def _pair_page(a: str, b: str, runs: Sequence[SiteRun]) -> SitePage:
    sections = []
    for run in runs:
        if rows := run.differences.get((a, b)):
            made = pivot(
                *(rows, "pair.metric", "pair.condition", partial(_difference_cell, run)),
                corner="metric",
                caption=f"{run.name}: {b} minus {a}, with 95 % intervals",
                remark="Marked: who is ahead, p below 0.05 after Holm's correction for all pairs "
                "of methods under that condition.",
            )
            sections.append(Section(run.name, str(run.run.manifest["dataset"]), (made,)))
    ahead, ties, behind = _record(runs, a, b)
    outcome = []
    if ahead + ties + behind:
        outcome.append(
            f"Over all runs, metrics and conditions {a} is ahead {ahead} times, {b} {behind} "
            f"times, and {ties} times no difference is shown."
        )
    if needed := _objects_needed(runs, a, b):
        outcome.append(f"{'For the rest there' if outcome else 'There'} are {too_few(needed)}.")
    return SitePage(
        _pair_file(a, b),
        f"{a} and {b}",
        "pc2pix-bench, two methods",
        " ".join(outcome),
        (("runs with both", str(len(sections))),),
        (
            *sections,
            Section("Pages", links=((a, _method_file(a)), (b, _method_file(b)))),
        ),
    )


_COST = "One thread. Times of different machines are not compared, accuracy is."


def _cost_grid(run: SiteRun, ranked: Sequence[str], only: str | None = None) -> Grid | None:
    """Return the costs of a run, of all methods or of one, with links to pages of methods."""
    if (made := run.costs) is None:
        return None
    lines = (
        replace(line, link=_method_file(line.name) if line.name in ranked else "")
        for line in made.lines
        if only in (None, line.name)
    )
    return replace(made, lines=tuple(lines), caption=f"{run.name}, {run.machine}: {made.caption}")


def _costs(runs: Sequence[SiteRun], ranked: Sequence[str]) -> SitePage:
    grids = [(run.name, _cost_grid(run, ranked)) for run in runs]
    return SitePage(
        COSTS,
        "Cost",
        "pc2pix-bench",
        f"What a cloud with all its views costs, and who is on the frontier, run by run. {_COST}",
        (("runs", str(len(runs))),),
        tuple(Section(name, grids=(made,)) for name, made in grids if made is not None),
    )
