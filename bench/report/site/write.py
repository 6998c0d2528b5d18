"""A static site over many runs: `bench site DIR... --out FOLDER`.

All pages lie in one folder, beside their downloads, so that each link is a file name: it works
from `file://`, and nothing is loaded from elsewhere. An overview, a page a run, one a method, and
one for each two methods. Ranks have letters (`bench.analysis.ranks`). Costs are only ever shown
with the machine that they were taken on; accuracy is what is compared across machines.
"""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import Comparison, pooled
from bench.analysis.leaderboard import over_conditions
from bench.analysis.ranks import ranking
from bench.analysis.scored import ScoredRun, scored_run
from bench.catalogue.metrics import is_mean
from bench.records.parquet import RECORDS
from bench.records.run_folder import (
    CONDITION_IDENTITIES,
    FIXED,
    MANIFEST,
    PROTOCOL,
    SHARD,
    TRUTH,
    read_finished,
)
from bench.report.build import REPORT, write_report
from bench.report.site.index_page import INDEX
from bench.report.site.methods import SiteMethod, shortened_name, site_methods, under_site_names
from bench.report.site.page import Link, site_html
from bench.report.site.pages import MENU, pages
from bench.report.site.site_run import HEADLINE, SiteRun
from bench.running.options import file_name
from bench.running.plan import digest
from bench.tables.build import make_outputs
from bench.tables.figure import FIGURES
from bench.tables.ranks import RANKS, ranks_table
from bench.tables.table import TABLES, of_protocol
from data_prep.failures import BadInput
from data_prep.files.atomic_write import whole_folder
from data_prep.files.checksums import file_sha256
from data_prep.progress import log, progress

# What a run was to measure, in its manifest.
REQUEST = (
    *(PROTOCOL, *FIXED, SHARD, TRUTH, CONDITION_IDENTITIES),
    *("methods", "identities", "conditions", "objects"),
)


def write_site(directories: Sequence[Path], out: Path) -> int:
    """Write the site of finished runs into a new folder, whole or not at all; return its pages.

    A folder with the same records as another is a copy of that run: it is named, and not counted
    again. Raises BadInput where the folder is there already, a folder is given twice, a run is of
    another version of the protocol, or is no run whose images were scored.
    """
    if out.exists():
        raise BadInput(f"{out}: is there already; give a new folder with --out")
    for i, directory in enumerate(directories):
        if directory.resolve() in (other.resolve() for other in directories[:i]):
            raise BadInput(f"{directory}: given twice; give each folder once")
    scored = [scored_run(directory, read_finished(directory)) for directory in directories]
    with_copies = _with_copies(scored)
    for run, copies in with_copies:
        for copy in copies:
            log(f"{copy}: the same records as {run.directory}; the run is counted once")
    runs, left_out = _ranked(with_copies)
    with whole_folder(out) as new:
        downloads = {run.name: _copy(run, new) for run in runs}
        site = pages(runs, downloads, left_out)
        for page in site:
            (new / page.file).write_text(site_html(page, MENU, page.file == INDEX), "utf-8")
    return len(site)


def _with_copies(scored: Sequence[ScoredRun]) -> list[tuple[ScoredRun, tuple[Path, ...]]]:
    """Return each run once, with the folders that hold copies of it.

    A copy has the same records to the byte, times included, of the same request.
    """
    same: dict[str, list[ScoredRun]] = {}
    for run in scored:
        request = [run.manifest.get(key) for key in REQUEST]
        same.setdefault(digest([request, file_sha256(run.directory / RECORDS)]), []).append(run)
    return [(run, tuple(copy.directory for copy in copies)) for run, *copies in same.values()]


def _numbered(texts: Sequence[str]) -> list[str]:
    """Return the texts, with a number where one came before that is the same but for its case."""
    numbered: list[str] = []
    taken: set[str] = set()
    for text in texts:
        candidates = (text if count == 1 else f"{text}-{count}" for count in itertools.count(1))
        numbered.append(next(name for name in candidates if name.casefold() not in taken))
        taken.add(numbered[-1].casefold())
    return numbered


def _ranked(
    with_copies: Sequence[tuple[ScoredRun, tuple[Path, ...]]],
) -> tuple[list[SiteRun], list[str]]:
    """Return the runs with their rankings, and the names of those without a scored object.

    Raises BadInput where no run has one.
    """
    scored = [run for run, _ in with_copies]
    names = _numbered([run.directory.resolve().name for run in scored])
    slugs = _numbered([shortened_name(file_name(name)).strip("-.") or "run" for name in names])
    methods = site_methods([run.manifest for run in scored])
    runs, left_out = [], []
    with threadpool_limits(1), progress("rankings", len(scored)) as advance:
        for i, run in enumerate(scored):
            metrics = run.measured([*dict.fromkeys((*HEADLINE, *run.suite.headline))])
            metrics = [metric for metric in metrics if is_mean(metric)]
            by_class = run.compared(metrics)
            if by_class and metrics and run.manifest["objects"]:
                compared = pooled(by_class) or by_class  # of several classes all objects together
                named = methods[i], with_copies[i][1]
                runs.append(_site_run(run, (names[i], slugs[i]), compared, metrics, named))
            else:
                log(f"{run.directory}: no object has scored images; the run is left out")
                left_out.append(names[i])
            advance(0)
    if not runs:
        names_given = ", ".join(names)
        raise BadInput(f"{names_given}: no run has an object with scored images; give one that has")
    return runs, left_out


def _site_run(
    run: ScoredRun,
    name: tuple[str, str],
    compared: Sequence[Comparison],
    metrics: Sequence[str],
    named: tuple[Mapping[str, SiteMethod], tuple[Path, ...]],
) -> SiteRun:
    """Return a run with its rankings; `name` is followed by its slug, `named` by its copies."""
    methods, copies = named
    by_class = run.compared(metrics)
    rankings = [ranking(comparison, metric) for metric in metrics for comparison in compared]
    overall = over_conditions(compared)
    return SiteRun(
        *(*name, run),
        methods={method.name: method for method in methods.values()},
        compared=tuple(compared),
        by_class=tuple(by_class) if len(by_class) > len(compared) else (),
        rankings=tuple(under_site_names(each, methods) for each in rankings),
        overall=overall,
        overall_rankings={
            metric: under_site_names(ranking(overall, metric), methods) for metric in metrics
        },
        ranks=of_protocol(ranks_table(compared, rankings), run.suite, run.manifest[PROTOCOL]),
        copies=copies,
    )


def _copy(run: SiteRun, folder: Path) -> list[Link]:
    """Put the downloads and the report of a run beside the pages, and return their links."""
    directory = run.run.directory
    files = [
        *sorted((directory / TABLES).glob("*.csv")),
        *(path for path in (directory / RECORDS, directory / MANIFEST) if path.is_file()),
        *sorted((directory / FIGURES).glob("*.png")),
    ]
    ranks = f"{run.slug}-{RANKS}.csv"
    (folder / ranks).write_text(run.ranks.to_csv(), "utf-8")
    links = [(f"{RANKS}.csv: the values of this page", ranks)]
    for path in files:
        name = f"{run.slug}-{path.name}"
        shutil.copyfile(path, folder / name)
        links.append((path.name, name))
    report = f"report-{run.slug}.html"  # the page of a run is run-SLUG.html
    if (directory / REPORT).is_file():  # a minute for a hundred objects
        shutil.copyfile(directory / REPORT, folder / report)
    else:
        write_report(make_outputs(run.run), folder / report)
    return [("the full report: curves, images, worst cases, failures", report), *links]
