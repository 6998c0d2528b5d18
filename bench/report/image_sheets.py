"""Sheets of images of a run, after the paper's Figures 1 and 3, and of thin parts."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import object_boxes
from bench.metrics.thin_parts import evaluated
from bench.records.artifacts import JobName
from bench.records.record import GROUND_TRUTH
from bench.records.stored_artifacts import Artifact
from bench.report.figure import MOST_HIGH_IN, WIDTH_IN, Image, image_grid, save
from bench.report.styles import rivals
from bench.tables.grid import ordered
from bench.tables.markdown import visible

OBJECTS_SHOWN = 4
THIN_OF = 8  # the first objects of a run, of which those with most thin parts are shown
THIN_CONDITIONS = ("2048", "noise-0.05")
THIN_TINT = (225, 0, 75)
LONGEST = 18  # letters of a name
LETTERS_IN_LINE = 12  # of a title: more are wider than an image
LABELS_IN, TITLES_IN = 0.5, 0.4
LEAST_CELL_IN = 0.75  # of an image: fewer objects are shown rather than smaller images


def write_images(
    path: Path,
    artifacts: Mapping[JobName, Artifact],
    conditions: Sequence[str],
    objects_shown: int = OBJECTS_SHOWN,
) -> None:
    """Write a sheet of the first view of the first objects, which nobody has chosen.

    Its columns are the truth and then the conditions, its rows objects and the methods that
    compete; where there are more conditions than methods, these two change places. The sheet fits
    a page, with at most `objects_shown` objects.
    """
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    turned = len(conditions) > len(methods)
    down, across = (conditions, methods) if turned else (methods, conditions)
    objects = ordered(name.object for name in artifacts)[:objects_shown]
    if not (down and across and objects):
        return
    cell_in = _cell_in(len(down), 1 + len(across), len(objects))
    fitting = int((MOST_HIGH_IN - TITLES_IN) / (cell_in * len(down)) + 1e-9)
    rows = [
        (
            f"{obj[1][:LONGEST]}\n{name}",
            [
                _first(artifacts, JobName(GROUND_TRUTH, "", *obj)),
                *(
                    _first(artifacts, JobName(*((other, name) if turned else (name, other)), *obj))
                    for other in across
                ),
            ],
        )
        for obj in objects[: max(fitting, 1)]
        for name in down
    ]
    titles = [GROUND_TRUTH, *map(visible, across)]
    size_in = (WIDTH_IN, cell_in * len(rows) + TITLES_IN)
    save(image_grid(list(map(wrapped, titles)), rows, size_in), path)


def _cell_in(rows: int, columns: int, objects: int) -> float:
    """Return the height of an image: of most objects that leave it LEAST_CELL_IN, or of one."""
    widest = (WIDTH_IN - LABELS_IN) / columns
    high = (MOST_HIGH_IN - TITLES_IN) / rows
    while objects > 1 and high / objects < min(LEAST_CELL_IN, widest):
        objects -= 1
    return min(widest, high / objects)


def wrapped(title: str) -> str:
    """Return a title on lines that are as wide as an image."""
    return textwrap.fill(title, LETTERS_IN_LINE, break_long_words=False)


def _first(artifacts: Mapping[JobName, Artifact], job: JobName) -> Image | None:
    """Return the first view of a job; None where it failed."""
    drawn = artifacts.get(job)
    return None if drawn is None else drawn.read()[0]


def write_thin_parts(path: Path, artifacts: Mapping[JobName, Artifact]) -> None:
    """Write a sheet of the objects with the most thin parts, cut out of the view with most.

    Side by side the objects; from above the truth, the truth with the evaluated pixels tinted, and
    method by method the images at a clean and at a noisy condition.
    """
    truths = [name for name in artifacts if name.method == GROUND_TRUTH][:THIN_OF]
    parts = {truth.object: evaluated(artifacts[truth].read()) for truth in truths}
    counts = {obj: part.sum(axis=(1, 2)) for obj, part in parts.items()}
    by_count = sorted(truths, key=lambda truth: -int(counts[truth.object].sum()))
    chosen = [truth for truth in by_count if counts[truth.object].any()][:OBJECTS_SHOWN]
    measured = {name.condition for name in artifacts}
    conditions = [condition for condition in THIN_CONDITIONS if condition in measured]
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    if not chosen or not conditions or not methods:
        return
    # Truth and tinted truth stand side by side above two conditions, one above the other above one.
    labels = ["truth,\nits thin parts"] if len(conditions) > 1 else ["truth", "its thin parts"]
    labels += list(map(visible, methods))
    columns = [
        column
        for truth in chosen
        for column in _thin_columns(truth, parts[truth.object], conditions, methods, artifacts)
    ]
    rows = [(_label(name), [c[i] for c in columns]) for i, name in enumerate(labels)]
    titles = [
        f"{wrapped(obj[1][:LONGEST])}\n{condition}"
        for obj in (truth.object for truth in chosen)
        for condition in conditions
    ]
    cell_in = min((WIDTH_IN - LABELS_IN) / len(titles), (MOST_HIGH_IN - TITLES_IN) / len(rows))
    size_in = (WIDTH_IN, cell_in * len(rows) + TITLES_IN)
    save(image_grid(titles, rows, size_in, "nearest"), path)


def _thin_columns(
    truth: JobName,
    parts: NDArray[np.bool_],
    conditions: Sequence[str],
    methods: Sequence[str],
    artifacts: Mapping[JobName, Artifact],
) -> list[list[Image | None]]:
    """Return the images of an object, column by column: a column for each condition."""
    view = int(parts.sum(axis=(1, 2)).argmax())
    true = artifacts[truth].read()[view]
    top, bottom, left, right = object_boxes(true[None])[0].tolist()
    cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
    tinted = np.where(parts[view][..., None], np.array(THIN_TINT, np.uint8), true)
    heads = [true[cut], tinted[cut]]
    columns: list[list[Image | None]] = []
    for condition, head in zip(conditions, heads, strict=False):
        drawn = [artifacts.get(JobName(method, condition, *truth.object)) for method in methods]
        images = [None if some is None else some.read()[view][cut] for some in drawn]
        columns.append([*([head] if len(conditions) > 1 else heads), *images])
    return columns


def _label(name: str) -> str:
    return "\n".join(map(wrapped, name.split("\n")))
