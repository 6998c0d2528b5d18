"""The site over several runs: one folder that can be published as it is.

index.html           the leaderboards, and a link to each report (`bench.report.index`)
RUN/report.html      the report of a run, named after its folder
RUN/METHOD.html      a method: where it comes from, its images and values, and how to repeat them

No link leads out of the folder. A file that would stay the same is not written again.
"""

from __future__ import annotations

import os
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bench.analysis.run import Run, read_run
from bench.entered.claims import address_of
from bench.records.folder import FIXED, TRUTH, locked_run, open_store
from bench.report.build import REPORT, read_page
from bench.report.images import CLOUD
from bench.report.index import WRITTEN_BY, NamedRun, index_html
from bench.report.page import rendered
from bench.report.styles import rivals
from bench.running.options import file_name
from bench.tables.build import make_outputs
from bench.tables.grid import Grid, TableRow
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import is_hidden
from data_prep.progress import progress

INDEX = "index.html"
_OURS = 'name="generator" content="pc2pix-bench'  # in the head of each page of a site
_HEAD_BYTES = 2_000  # bytes at the beginning of a page that have its head
_LONGEST = 60  # characters of a method in a file's name: 240 bytes in UTF-8, of 255 that may be


def write_site(directories: Sequence[Path], site: Path) -> Path:
    """Write the pages of finished runs into the folder `site`, and return the index over them.

    Nothing is written before all pages are made. Raises BadInput as `read_run` and
    `bench.report.build.read_page`; where a folder is given twice, holds a copy of another run or
    has its name; and where `site` holds something else in the place of a page. Raises CannotWrite
    for a run that is written at the same time, and where a page cannot be written.
    """
    _refuse_names(directories)
    runs = [read_run(directory) for directory in directories]
    _refuse_copies(runs)
    names = [directory.resolve().name for directory in directories]
    _refuse_others(site, names)
    pages: dict[Path, str] = {}
    named = []
    with progress("reports", len(runs)) as advance:
        for name, run in zip(names, runs, strict=True):
            with locked_run(run.directory, "make it writable, or leave this run out"):
                page = read_page(make_outputs(run))
            pages[site / name / REPORT] = rendered("report.html.jinja", **page)
            address = quote(os.fsencode(name))
            of_methods = {}
            for method, file in page_files(rivals(run.manifest["methods"])).items():
                values = method_page(method, name, run.manifest, page)
                pages[site / name / file] = rendered("method.html.jinja", **values)
                of_methods[method] = f"{address}/{quote(file)}", values["picture"]
            named.append(NamedRun(name, run, f"{address}/{REPORT}", of_methods))
            advance(0)
    pages[site / INDEX] = index_html(named)
    for path, text in pages.items():
        if not path.is_file() or path.read_bytes() != text.encode():
            write_whole(path, text.encode(), remedy="give another --out")
    return site / INDEX


def _refuse_names(directories: Sequence[Path]) -> None:
    """Raise BadInput where a folder is given twice, and where two folders have one name."""
    before: dict[str, Path] = {}
    for directory in directories:
        folder = directory.resolve()
        # Many file systems, and many servers of pages, know no capital letters.
        other = before.setdefault(folder.name.casefold(), folder)
        if other is folder:
            continue
        if other == folder:
            raise BadInput(f"{directory}: given twice; give each folder once")
        raise BadInput(
            f"{directory}: has the name of {other}, and each run has a folder of its name on the "
            "site; rename one of them"
        )


def _refuse_copies(runs: Sequence[Run]) -> None:
    """Raise BadInput where two folders have the same records, times included, of one request."""
    first: dict[tuple[Any, ...], Path] = {}
    for run in runs:
        request = (run.manifest.get(name) for name in (*FIXED, TRUTH))
        with open_store(run.directory) as store:
            key = (*request, store.digest())
        other = first.setdefault(key, run.directory)
        if other != run.directory:
            raise BadInput(f"{run.directory}: a copy of the run in {other}; give one of the two")


def _refuse_others(site: Path, names: Iterable[str]) -> None:
    """Raise BadInput where something else than a page of a site would be replaced or joined."""
    if site.suffix in (".html", ".htm") or (site.exists() and not site.is_dir()):
        raise BadInput(f"--out {site}: of several runs a folder is needed; give one for {INDEX}")
    index = site / INDEX
    if os.path.lexists(index) and not _is_page(index, WRITTEN_BY):
        raise BadInput(f"{index}: is there, and no index of runs; give another --out")
    for name in names:
        folder = site / name
        paths = [folder] if os.path.lexists(folder) else []
        if folder.is_dir() and not folder.is_symlink():
            paths = sorted(path for path in folder.iterdir() if not is_hidden(path.name))
        for path in paths:
            if not _is_page(path, _OURS):
                raise BadInput(f"{path}: is there, and no page of a site; give another --out")


def _is_page(path: Path, mark: str) -> bool:
    """Return whether a path is a page that has a mark in its head."""
    if path.is_symlink() or not path.is_file() or path.suffix != ".html":
        return False
    with path.open("rb") as file:
        return mark.encode() in file.read(_HEAD_BYTES)


def page_files(methods: Iterable[str]) -> dict[str, str]:
    """Return a file name of its own for the page of each method, whatever characters it has."""
    files: dict[str, str] = {}
    for method in methods:
        stem = file_name(method)[:_LONGEST].strip(".-") or "method"
        file, number = f"{stem}.html", 2
        while file.casefold() in {REPORT, *map(str.casefold, files.values())}:
            file, number = f"{stem}-{number}.html", number + 1
        files[method] = file
    return files


def method_page(
    method: str, run: str, manifest: Mapping[str, Any], report: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the values that the template of a method's page shows.

    run     name of the run
    report  the values of its report (`bench.report.build.read_page`)

    `picture` is the data URI of the method's first image.
    """
    images = [_images_of(grid, method) for grid in report["grids"]]
    tables = [(title, grids) for title, _, grids, _ in report["tables"]]
    if report["cost_table"]:
        tables.append(("Cost", [report["cost_table"]]))
    picture = ""
    if images:
        _, cells = images[0]["rows"][0]
        picture, _ = cells[-1][0]  # of the method, which has the last column
    return {
        "scripts": ("report.js", "pictures.js"),
        "method": method,
        "run": run,
        "report": REPORT,
        "source": dict(dict(report["meanings"])["Methods"])[method],
        "quality": report["quality"],
        "grids": images,
        "tables": [grid for title, grids in tables for grid in _lines_of(method, title, grids)],
        "command": command_of(method, manifest),
        "picture": picture,
    }


def _images_of(grid: Mapping[str, Any], method: str) -> dict[str, Any]:
    """Return a grid of the report (`bench.report.images.grids`) with one method alone.

    Its rows are the conditions, its columns cloud, truth and method.
    """
    columns = [CLOUD, "truth", method]
    if grid["corner"] == "method":
        of_name = dict(grid["rows"])
        cells = zip(*(of_name[name] for name in columns), strict=True)
        rows = list(zip(grid["columns"], cells, strict=True))
    else:
        places = [grid["columns"].index(name) for name in columns]
        rows = [(name, [cells[place] for place in places]) for name, cells in grid["rows"]]
    return {**grid, "corner": "condition", "columns": columns, "rows": rows}


def _lines_of(method: str, title: str, grids: Iterable[Grid]) -> list[Grid]:
    """Return the lines of a method in the grids of a table, those with equal columns together."""
    lines: dict[tuple[str, ...], list[TableRow]] = {}
    for grid in grids:
        name, _, about = grid.caption.partition(" (")
        for line in grid.lines:
            if line.name == method and any(cell.value is not None for cell in line.cells):
                row = TableRow(name, line.cells, about.removesuffix(")"))
                lines.setdefault(grid.columns, []).append(row)
    return [Grid("metric", columns, tuple(rows), caption=title) for columns, rows in lines.items()]


def command_of(method: str, manifest: Mapping[str, Any]) -> str:
    """Return the command that repeats the images and values of a method of a run."""
    of_class = Counter(name.partition("/")[0] for name in manifest["objects"])
    options = {
        **manifest["request"],
        "methods": [address_of(manifest, method)],
        "conditions": manifest["conditions"],
        "limit": max(of_class.values()),
    }
    arguments = ["bench", "run"]
    for name, value in options.items():
        text = ",".join(value) if isinstance(value, list) else str(value)
        arguments += [f"--{name.replace('_', '-')}", text]
    return shlex.join(arguments)
