"""Sheets of images of a run, after the paper's Figures 1 and 3, and of thin parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bench.metrics.silhouette import object_boxes
from bench.metrics.thin_parts import evaluated
from bench.records.artifacts import JobName, read_array
from bench.records.record import GROUND_TRUTH
from bench.report.styles import rivals
from bench.tables.figure import DPI, Image, image_grid, save
from bench.tables.grid import ordered

OBJECTS_SHOWN = 4
THIN_OF = 8  # the first objects of a run, of which those with most thin parts are shown
THIN_CONDITIONS = ("2048", "noise-0.05")
THIN_TINT = (225, 0, 75)
LONGEST = 18  # letters of a name


def write_images(
    path: Path,
    artifacts: Mapping[JobName, Path],
    conditions: Sequence[str],
    objects_shown: int = OBJECTS_SHOWN,
    cell_in: float = 1.3,
    titles_in: float = 0.0,
    dpi: float = DPI,
) -> None:
    """Write a sheet of the first view of the first objects, which nobody has chosen.

    It has a row for each object and method that competes, and the truth and then each condition as
    columns.
    """
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    cells = [(GROUND_TRUTH, ""), *(("", condition) for condition in conditions)]

    def first(cell: tuple[str, str], method: str, obj: tuple[str, str]) -> Image | None:
        drawn = artifacts.get(JobName(cell[0] or method, cell[1], *obj))
        return None if drawn is None else read_array(drawn)[0]

    rows = [
        (f"{obj[1][:LONGEST]}\n{method}", [first(cell, method, obj) for cell in cells])
        for obj in ordered(name.object for name in artifacts)[:objects_shown]
        for method in methods
    ]
    if rows:
        size_in = (cell_in * len(cells) + 1, cell_in * len(rows) + titles_in)
        save(image_grid([GROUND_TRUTH, *conditions], rows, size_in), path, dpi=dpi)


def write_thin_parts(path: Path, artifacts: Mapping[JobName, Path]) -> None:
    """Write a sheet of the objects with the most thin parts, cut out of the view with most.

    Columns: the truth, the truth with the evaluated pixels tinted, then method by method the
    images at a clean and at a noisy condition.
    """
    truths = [name for name in artifacts if name.method == GROUND_TRUTH][:THIN_OF]
    parts = {truth.object: evaluated(read_array(artifacts[truth])) for truth in truths}
    counts = {obj: part.sum(axis=(1, 2)) for obj, part in parts.items()}
    by_count = sorted(truths, key=lambda truth: -int(counts[truth.object].sum()))
    chosen = [truth for truth in by_count if counts[truth.object].any()][:OBJECTS_SHOWN]
    conditions = {name.condition for name in artifacts}
    columns = [
        (method, condition)
        for method in rivals(ordered(name.method for name in artifacts if name.condition))
        for condition in THIN_CONDITIONS
        if condition in conditions
    ]
    if not chosen or not columns:
        return
    rows = []
    for truth in chosen:
        obj = truth.object
        view = int(counts[obj].argmax())
        true = read_array(artifacts[truth])[view]
        top, bottom, left, right = object_boxes(true[None])[0].tolist()
        cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
        tinted = np.where(parts[obj][view][..., None], np.array(THIN_TINT, np.uint8), true)
        images: list[Image | None] = [true[cut], tinted[cut]]
        for cell in columns:
            drawn = artifacts.get(JobName(*cell, *obj))
            images.append(None if drawn is None else read_array(drawn)[view][cut])
        rows.append((f"{obj[1][:LONGEST]}\nview {view}", images))
    titles = [GROUND_TRUTH, "its thin parts", *(f"{m}\n{c}" for m, c in columns)]
    size_in = (2.2 * len(titles), 2.3 * len(rows))
    save(image_grid(titles, rows, size_in, "nearest"), path)
