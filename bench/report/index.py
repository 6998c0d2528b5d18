"""The index over several runs: a card and a report for each, and a leaderboard for each data set.

Values of runs are beside each other only where data set and truth are the same. The page links to
the reports where they are, beside their runs, and loads nothing.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bench.analysis.frame import Run, read_run
from bench.catalogue.conditions import condition_words
from bench.catalogue.suites import TRUTHS
from bench.records.parquet import RECORDS
from bench.records.run_folder import FIXED, PROTOCOL, TRUTH
from bench.report.board import Board
from bench.report.build import REPORT, write_report
from bench.report.page import bundled, rendered
from bench.report.run_board import NamedRun, run_board
from bench.tables.build import make_outputs
from data_prep.failures import BadInput, CannotWrite
from data_prep.files.atomic_write import write_whole
from data_prep.files.checksums import file_sha256
from data_prep.progress import progress

INDEX = "index.html"
WRITTEN_BY = "pc2pix-bench, index of runs"  # in the head of a page that may be replaced
HEAD_BYTES = 2_000


@dataclass(frozen=True)
class RunCard:
    """A run: its name, the address of its report, its suite in words, and facts (term, value)."""

    name: str
    report: str
    about: str
    facts: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class RunGroup:
    """Runs of one data set and truth, with a leaderboard of their own if any has a value."""

    title: str
    cards: tuple[RunCard, ...]
    board: Board | None


def write_index(directories: Sequence[Path], out: Path | None = None) -> Path:
    """Write the report of each run, and the index over them into `out`; return the index.

    Parameters
    ----------
    directories : sequence of Path
        Folders of finished runs, two or more.
    out : Path, optional
        Folder of the index. Default: the one that all folders are in.

    Raises
    ------
    BadInput
        As `read_run`; where a folder is given twice or holds a copy of another run; where the
        folders are not beside each other and `out` is missing; where `out` is a page; and where a
        page of another origin is in its place.
    CannotWrite
        Where a page cannot be written.
    """
    folders = [directory.resolve() for directory in directories]
    page = _place(folders, out)
    for i, folder in enumerate(folders):
        if folder in folders[:i]:
            raise BadInput(f"{directories[i]}: given twice; give each folder once")
    runs = [read_run(directory) for directory in directories]
    _refuse_copies(runs)
    with progress("reports", len(runs)) as advance:
        for run in runs:
            write_report(make_outputs(run), remedy="make it writable, or leave this run out")
            advance(0)
    names = [folder.name for folder in folders]
    if len(set(names)) < len(names):
        names = [os.path.relpath(folder, page.parent) for folder in folders]
    named = [
        NamedRun(name, run, quote(os.path.relpath(folder / REPORT, page.parent)))
        for name, run, folder in zip(names, runs, folders, strict=True)
    ]
    try:
        page.parent.mkdir(parents=True, exist_ok=True)
        write_whole(page, index_html(named).encode())
    except OSError as error:
        raise CannotWrite(
            f"{page}: cannot be written ({error.strerror}); give another --out"
        ) from error
    return page


def _place(folders: Sequence[Path], out: Path | None) -> Path:
    """Return the file of the index. Raises BadInput where it would replace another page."""
    if out is None:
        if len({folder.parent for folder in folders}) > 1:
            raise BadInput("the runs are in several folders; give --out, a folder for the index")
        out = folders[0].parent
    page = out.resolve() / INDEX
    if out.suffix in (".html", ".htm") or (out.exists() and not out.is_dir()):
        raise BadInput(f"--out {out}: of several runs a folder is needed; give one for {INDEX}")
    if page.exists():
        with page.open("rb") as file:
            if WRITTEN_BY.encode() not in file.read(HEAD_BYTES):
                raise BadInput(f"{page}: is there, and no index of runs; give another --out")
    return page


def _refuse_copies(runs: Sequence[Run]) -> None:
    """Raise BadInput where two folders have the same records, times included, of one request."""
    first: dict[tuple[Any, ...], Path] = {}
    for run in runs:
        request = (run.manifest.get(name) for name in (*FIXED, TRUTH))
        key = (*request, file_sha256(run.directory / RECORDS))
        other = first.setdefault(key, run.directory)
        if other != run.directory:
            raise BadInput(f"{run.directory}: a copy of the run in {other}; give one of the two")


def index_html(runs: Sequence[NamedRun]) -> str:
    """Return the index as one HTML document."""
    return rendered(
        "index.html.jinja",
        groups=run_groups(runs),
        facts=(("protocol", str(runs[0].run.manifest[PROTOCOL])), ("runs", str(len(runs)))),
        written_by=WRITTEN_BY,
        board_style=bundled("board.css"),
        script=bundled("board.js"),
    )


def run_groups(runs: Sequence[NamedRun]) -> tuple[RunGroup, ...]:
    """Return the runs by data set and truth; all are of one version of the protocol."""
    groups: dict[tuple[str, str], list[NamedRun]] = {}
    for run in runs:
        truth = TRUTHS[run.run.suite.truth]
        groups.setdefault((str(run.run.manifest["dataset"]), truth), []).append(run)
    return tuple(
        RunGroup(f"{dataset}, against {truth}", tuple(map(_card, of_group)), run_board(of_group))
        for (dataset, truth), of_group in groups.items()
    )


def _card(named: NamedRun) -> RunCard:
    run, manifest = named.run, named.run.manifest
    counts = map(run.images, run.cells)
    drawn, planned = map(sum, zip(*counts, strict=True))
    classes = {str(name).partition("/")[0] for name in manifest["objects"]}
    of_what = f"{len(classes)} classes" if len(classes) > 1 else f"class {min(classes)}"
    facts = (
        ("suite", str(manifest["suite"])),
        ("dataset", str(manifest["dataset"])),
        ("truth", TRUTHS[run.suite.truth]),
        ("objects", f"{len(manifest['objects'])} of {of_what}"),
        ("views", str(manifest["views"])),
        ("conditions", ", ".join(map(condition_words, manifest["conditions"]))),
        ("methods", str(len(manifest["methods"]))),
        ("failed", f"{planned - drawn:,} of {planned:,} images"),
        ("seed", str(manifest["seed"])),
        ("machine", str(manifest.get("machine", {}).get("cpu", "unknown"))),
        ("finished", str(manifest["finished"])[:10]),
        ("protocol", str(manifest[PROTOCOL])),
    )
    return RunCard(named.name, named.report, run.suite.about, facts)
