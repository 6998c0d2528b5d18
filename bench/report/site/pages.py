"""The pages of a site: overview, runs, comparisons and costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

from bench.analysis.paired import PairedDifference
from bench.catalogue.condition_names import condition_words
from bench.catalogue.methods import role
from bench.records.run_folder import PROTOCOL
from bench.report.site.about_page import ABOUT, about_page
from bench.report.site.classes import class_grids
from bench.report.site.index_page import INDEX, IndexPage, index_page
from bench.report.site.method_page import method_page
from bench.report.site.page import Link, Section, SitePage
from bench.report.site.site_run import (
    COST_REMARK,
    FAILURES,
    SiteRun,
    caption_of,
    cost_grid_of,
    headers,
    lead_record,
    letters_remark,
    method_file,
    method_id_of,
    objects_needed,
    pair_file,
    rank_cell,
    share_ranking,
    truths_of,
)
from bench.report.site.words import p_words
from bench.tables.differences import difference_cell, too_few
from bench.tables.grid import (
    NOTHING,
    Annotation,
    Cell,
    Grid,
    PivotLayout,
    TableRow,
    grid,
    pivot,
    scored_as_blank,
)

MOST_REASONS = 20  # listed on the page of a run
COMPARE, COSTS = "compare.html", "cost.html"
MENU = (
    *(("Leaderboard", INDEX), ("Comparisons", COMPARE), ("Cost", COSTS)),
    ("Licence and citation", ABOUT),
)


def pages(
    runs: Sequence[SiteRun], downloads: Mapping[str, Sequence[Link]], left_out: Sequence[str]
) -> list[SitePage | IndexPage]:
    """Return all pages of a site, the index first.

    downloads  links by the names of runs
    left_out   names of runs without a scored object
    """
    index = index_page(runs, left_out)
    ranked = index.methods
    pairs = [(a, b) for a, b in combinations(ranked, 2) if share_ranking(runs, a, b)]
    return [
        index,
        *(_run_page(run, downloads[run.name], ranked) for run in runs),
        *(method_page(method, ranked, runs) for method in ranked),
        _matrix(runs, ranked),
        *(_pair_page(a, b, runs) for a, b in pairs),
        _costs(runs, ranked),
        about_page(runs),
    ]


def _rank_grids(run: SiteRun) -> tuple[Grid, ...]:
    """Return a grid for each metric: methods by condition, the best of the first column first."""
    grids = []
    for metric in run.metrics:
        rankings = [ranking for ranking in run.rankings if ranking.metric == metric]
        methods = [rank.method for rank in rankings[0].ranks]
        lines = tuple(
            TableRow(
                *(m, tuple(rank_cell(run, ranking, m) for ranking in rankings)),
                role(run.methods[m].id),
                link=method_file(m),
            )
            for m in methods
        )
        heads = headers(condition_words(ranking.condition) for ranking in rankings)
        remark = letters_remark(rankings)
        grids.append(Grid("method", heads, lines, caption=caption_of(metric), remark=remark))
    return tuple(grids)


def _difference_cell(run: SiteRun, row: PairedDifference) -> Cell:
    cell = difference_cell(row)
    if row.objects_needed:
        outcome = Annotation("too few objects", against=True)
    else:
        p = "" if math.isnan(row.p_holm) else f", p {p_words(row.p_holm)}"
        ahead = {"a": row.pair.a.method, "b": row.pair.b.method}.get(row.ahead)
        words = f"{ahead} ahead" if ahead else "not decided"
        outcome = Annotation(f"{words}{p}", against=not ahead)
    failures = []
    for method in (row.pair.a.method, row.pair.b.method):
        if text := scored_as_blank(*run.images[row.pair.condition, method]):
            failures.append(f"{method}: {text}")
    return replace(cell, special=outcome, caveat="; ".join(failures))


def _run_page(run: SiteRun, downloads: Sequence[Link], ranked: Sequence[str]) -> SitePage:
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
            ("truth", run.truth),
            ("objects", run.objects),
            ("seed", str(manifest["seed"])),
            ("failed", "{} of {} images".format(*run.failed)),
            ("machine", run.machine),
            ("finished", str(manifest["finished"])[:10]),
            ("protocol", str(manifest[PROTOCOL])),
        ),
        (
            Section("Ranks", FAILURES, _rank_grids(run)),
            *([Section("Classes", grids=class_grids(run, ranked))] if run.by_class else []),
            *_failures(run),
            Section("Downloads", links=tuple(link for link in downloads if link not in images)),
            *([Section("Figures", images=images)] if images else []),
        ),
    )


def _failures(run: SiteRun) -> list[Section]:
    """Return how many images of each method failed, and why; nothing where none did."""
    reasons = run.reasons
    if not reasons:
        return []
    conditions = [str(name) for name in run.run.manifest["conditions"]]
    failing = {name for (name, _), _ in reasons}
    counted = {
        name: [run.failed_images(name, at) for at in conditions]
        for name in run.methods
        if name in failing
    }
    lines = [
        [
            name,
            *(
                Cell(f"{failed} of {all_}", float(failed)) if failed else NOTHING
                for failed, all_ in counts
            ),
        ]
        for name, counts in counted.items()
    ]
    notes = [f"{name}: {count} × {why}" for (name, why), count in reasons[:MOST_REASONS]]
    if len(reasons) > MOST_REASONS:
        notes.append(f"{len(reasons) - MOST_REASONS} more reasons are in the full report.")
    heads = ["method", *map(condition_words, conditions)]
    counts = grid(heads, lines, caption="Failed images", notes=tuple(notes))
    return [Section("Failures", grids=(counts,))]


def _matrix(runs: Sequence[SiteRun], ranked: Sequence[str]) -> SitePage:
    lines = []
    needed = max((objects_needed(runs, a, b) for a, b in combinations(ranked, 2)), default=0)
    for a in ranked:
        cells = []
        for b in ranked:
            if a == b or not share_ranking(runs, a, b):
                cells.append(NOTHING)
                continue
            record = lead_record(runs, a, b)
            text = "–".join(map(str, record)) if any(record) else "untested"
            link = pair_file(*sorted((a, b), key=ranked.index))
            cells.append(Cell(text, float(record[0] - record[2]), link=link))
        lines.append(TableRow(a, tuple(cells), role(method_id_of(runs, a)), link=method_file(a)))
    matrix = Grid(
        "method",
        headers(ranked),
        tuple(lines),
        caption="Ahead, tie, behind: the method of the line against that of the column",
        remark="Counted over all metrics and conditions of all runs that have both, against "
        f"{truths_of(runs)}. A tie: no "
        f"difference is shown.{f' Untested: {too_few(needed)}.' if needed else ''}",
    )
    return SitePage(
        COMPARE,
        "Comparisons",
        "pc2pix-bench",
        "Any two methods on the same objects; each count leads to the differences behind it.",
        (("methods", str(len(ranked))), ("runs", str(len(runs)))),
        (Section("All pairs", grids=(matrix,)),),
    )


def _pair_page(a: str, b: str, runs: Sequence[SiteRun]) -> SitePage:
    sections = []
    for run in runs:
        if rows := run.differences.get((a, b)):
            differences = pivot(
                *(rows, "pair.metric", "pair.condition", partial(_difference_cell, run)),
                PivotLayout(column_name=condition_words),
                corner="metric",
                caption=f"{run.name}: {b} minus {a}, with 95 % intervals",
                remark="Marked: who is ahead, p below 0.05. p is corrected by Holm's procedure for "
                "all pairs of methods under that condition.",
            )
            about = f"{run.run.manifest['dataset']}, against {run.truth}"
            sections.append(Section(run.name, about, (differences,)))
    ahead, ties, behind = lead_record(runs, a, b)
    outcome = []
    if ahead + ties + behind:
        outcome.append(
            f"Over all runs, metrics and conditions {a} is ahead {ahead} times, {b} {behind} "
            f"times, and {ties} times no difference is shown."
        )
    if needed := objects_needed(runs, a, b):
        outcome.append(f"{'For the rest there' if outcome else 'There'} are {too_few(needed)}.")
    return SitePage(
        pair_file(a, b),
        f"{a} and {b}",
        "pc2pix-bench, two methods",
        " ".join(outcome),
        (("runs with both", str(len(sections))),),
        (
            *sections,
            Section("Pages", links=((a, method_file(a)), (b, method_file(b)))),
        ),
    )


def _costs(runs: Sequence[SiteRun], ranked: Sequence[str]) -> SitePage:
    grids = [(run.name, cost_grid_of(run, ranked)) for run in runs]
    return SitePage(
        COSTS,
        "Cost",
        "pc2pix-bench",
        "What a cloud with all its views costs, and who is on the frontier, run by run. "
        f"{COST_REMARK}",
        (("runs", str(len(runs))),),
        tuple(Section(name, grids=(costs,)) for name, costs in grids if costs is not None),
    )
