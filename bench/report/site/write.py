"""A static site over many runs: `bench site DIR... --out FOLDER`.

All pages lie in one folder, beside their downloads, so that each link is a file name: it works
from `file://`, and nothing is loaded from elsewhere. An overview, a page a run, one a method, and
one for each two methods. Ranks have letters (`bench.analysis.ranks`). Costs are only ever shown
with the machine that they were taken on; accuracy is what is compared across machines.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from threadpoolctl import threadpool_limits

from bench.analysis.comparison import pooled
from bench.analysis.ranks import ranking
from bench.catalogue.metrics import is_mean
from bench.records.journal import MANIFEST
from bench.records.parquet import RECORDS
from bench.report.build import REPORT, write_report
from bench.report.site.page import Link, site_html
from bench.report.site.pages import MENU, QUALITY, SiteRun, pages
from bench.running.protocol import file_name
from bench.tables.build import make_outputs
from bench.tables.differences import refuse_other_protocol
from bench.tables.figure import FIGURES
from bench.tables.scored import ScoredRun, read_scored
from bench.tables.table import TABLES
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.whole_files import whole_folder


def write_site(directories: Sequence[Path], out: Path) -> int:
    """Write the site of finished runs into a new folder, whole or not at all; the number of pages.

    Raises BadInput where the folder is there already, a run is given twice, is of another protocol
    than the first, or is no run whose images were scored.
    """
    if out.exists():
        raise BadInput(f"{out}: is there already; give a new folder with --out")
    for i, directory in enumerate(directories):
        if directory.resolve() in (other.resolve() for other in directories[:i]):
            raise BadInput(f"{directory}: given twice; give each folder once")
    scored = [read_scored(directory) for directory in directories]
    for run in scored[1:]:
        refuse_other_protocol(scored[0], run)
    runs = _ranked(scored)
    with whole_folder(out) as new:
        downloads = {run.name: _copy(run, new) for run in runs}
        made = pages(runs, downloads)
        for page in made:
            (new / page.file).write_text(site_html(page, MENU), "utf-8")
    return len(made)


def _ranked(scored: Sequence[ScoredRun]) -> list[SiteRun]:
    names: list[str] = []
    for run in scored:
        name, count = file_name(run.directory.resolve().name), 1
        while (named := name if count == 1 else f"{name}-{count}") in names:
            count += 1
        names.append(named)
    todo = []
    with threadpool_limits(1):
        for run in scored:
            metrics = run.measured([*dict.fromkeys((QUALITY, *run.suite.headline))])
            metrics = [metric for metric in metrics if is_mean(metric)]
            compared = run.compared(metrics)
            compared = pooled(compared) or compared  # of several classes all objects together
            todo.append((compared, [(of, metric) for metric in metrics for of in compared]))
        made = []
        with progress("rankings", sum(len(cells) for _, cells in todo)) as advance:
            for name, run, (compared, cells) in zip(names, scored, todo, strict=True):
                rankings = []
                for of, metric in cells:
                    rankings.append(ranking(of, metric))
                    advance(0)
                made.append(SiteRun(name, run, tuple(compared), tuple(rankings)))
    return made


def _copy(run: SiteRun, folder: Path) -> list[Link]:
    """Put the downloads and the report of a run beside the pages; their links."""
    directory = run.run.directory
    files = [
        *sorted((directory / TABLES).glob("*.csv")),
        *(path for path in (directory / RECORDS, directory / MANIFEST) if path.is_file()),
        *sorted((directory / FIGURES).glob("*.png")),
    ]
    links = []
    for path in files:
        name = f"{run.name}-{path.name}"
        shutil.copyfile(path, folder / name)
        links.append((path.name, name))
    report = f"{run.name}-{REPORT}"
    if (directory / REPORT).is_file():  # a minute for a hundred objects
        shutil.copyfile(directory / REPORT, folder / report)
    else:
        write_report(make_outputs(run.run), folder / report)
    return [("the full report: curves, images, worst cases, failures", report), *links]
