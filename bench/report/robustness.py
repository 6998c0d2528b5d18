"""Figures of a finished run, for people who would rather look than read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.methods import FLOORS, find_method
from bench.catalogue.metrics import IMAGE_METRICS
from bench.metrics.foreground import object_boxes
from bench.metrics.thin_parts import evaluated
from bench.records.artifacts import Artifact, Item
from bench.records.record import GROUND_TRUTH
from bench.tables.quality import Row, Table

FIGURES = "figures"
OBJECTS_SHOWN = 4
THIN_OF = 8  # the first objects of a run, of which those with most thin parts are shown
THIN_CONDITIONS = ("2048", "noise-0.05")
THIN_TINT = (225, 0, 75)
METRICS_SHOWN = ("ssim", "structure", "fd-views", "fid")


def write_figures(directory: Path, tables: Sequence[Table], artifacts: Sequence[Artifact]) -> None:
    """Robustness curves (after Tables 3 and 4), picture grids (the paper's Figures 1 and 3) and a
    sheet of thin parts.

    `artifacts` are all that there are, ground truths included. Where all methods have failed, there
    is nothing to draw.
    """
    if all(artifact.item.method == GROUND_TRUTH for artifact in artifacts):
        return
    import matplotlib as mpl

    mpl.use("Agg")
    folder = directory / FIGURES
    folder.mkdir(exist_ok=True)
    _robustness(folder / "robustness.png", tables)
    _grid(folder / "pictures.png", artifacts)
    _thin_parts(folder / "thin-parts.png", artifacts)


def _robustness(path: Path, tables: Sequence[Table]) -> None:
    from matplotlib import pyplot as plt

    shown: dict[str, list[Row]] = {}
    for row in (row for table in tables for row in table.rows):
        if row.metric in METRICS_SHOWN and math.isfinite(row.value):
            shown.setdefault(row.metric, []).append(row)
    figure, axes = plt.subplots(
        1, len(shown), figsize=(5 * len(shown), 4), squeeze=False, layout="constrained"
    )
    for axis, (metric, rows) in zip(axes[0], shown.items(), strict=True):
        for method in dict.fromkeys(row.method for row in rows):
            of_method = [row for row in rows if row.method == method]
            values = np.array([row.value for row in of_method])
            ends = np.array([(row.ci_low, row.ci_high) for row in of_method]).T
            reach = np.nan_to_num(np.abs(ends - values))
            axis.errorbar(
                [row.condition for row in of_method],
                values,
                yerr=reach,
                label=method,
                capsize=3,
                marker="o",
            )
        higher = metric in IMAGE_METRICS
        axis.set_title(f"{metric} ({'higher' if higher else 'lower'} is better)")
        axis.set_xlabel("condition")
        axis.grid(alpha=0.3)
        if not higher:
            axis.set_yscale("symlog", linthresh=10)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _grid(path: Path, artifacts: Sequence[Artifact]) -> None:
    """The first view of the first objects: a row per object and method, a column per condition.

    Ceiling and floors are left out: the first column shows the truth, and what looks at no cloud
    needs no picture.
    """
    from matplotlib import pyplot as plt

    by_item = {artifact.item: artifact for artifact in artifacts}
    objects = list(dict.fromkeys(item.object for item in by_item))[:OBJECTS_SHOWN]
    conditions = list(dict.fromkeys(item.condition for item in by_item if item.condition))
    methods = _rivals(by_item)
    rows = [(obj, method) for obj in objects for method in methods]
    columns = [GROUND_TRUTH, *conditions]
    if not rows:
        return
    figure, axes = plt.subplots(
        len(rows), len(columns), figsize=(1.3 * len(columns) + 1, 1.3 * len(rows)), squeeze=False
    )
    for axis_row, (obj, method) in zip(axes, rows, strict=True):
        for axis, column in zip(axis_row, columns, strict=True):
            of_method = (method, column) if column != GROUND_TRUTH else (GROUND_TRUTH, "")
            artifact = by_item.get(Item(*of_method, *obj))
            show(axis, None if artifact is None else artifact.pictures()[0])
        axis_row[0].set_ylabel(f"{obj[1][:18]}\n{method}", fontsize=7)
    for axis, column in zip(axes[0], columns, strict=True):
        axis.set_title(column, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _thin_parts(path: Path, artifacts: Sequence[Artifact]) -> None:
    """Objects with the most thin parts, each in the view that shows most of them, cut out.

    Columns: the truth, the truth with the evaluated pixels tinted, then method by method the
    pictures at a clean and at a noisy condition.
    """
    from matplotlib import pyplot as plt

    by_item = {artifact.item: artifact for artifact in artifacts}
    truths = [artifact for artifact in artifacts if artifact.item.method == GROUND_TRUTH][:THIN_OF]
    parts = {truth.item.object: evaluated(truth.pictures()) for truth in truths}
    counts = {obj: part.sum(axis=(1, 2)) for obj, part in parts.items()}
    by_count = sorted(truths, key=lambda truth: -int(counts[truth.item.object].sum()))
    chosen = [truth for truth in by_count if counts[truth.item.object].any()][:OBJECTS_SHOWN]
    there = {item.condition for item in by_item}
    columns = [
        (method, condition)
        for method in _rivals(by_item)
        for condition in THIN_CONDITIONS
        if condition in there
    ]
    if not chosen or not columns:
        return
    figure, axes = plt.subplots(
        len(chosen),
        2 + len(columns),
        figsize=(2.2 * (2 + len(columns)), 2.3 * len(chosen)),
        squeeze=False,
    )
    for axis_row, truth in zip(axes, chosen, strict=True):
        obj = truth.item.object
        view = int(counts[obj].argmax())
        true = truth.pictures()[view]
        top, bottom, left, right = object_boxes(true[None])[0].tolist()
        cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
        tinted = np.where(parts[obj][view][..., None], np.array(THIN_TINT, np.uint8), true)
        show(axis_row[0], true[cut], "nearest")
        show(axis_row[1], tinted[cut], "nearest")
        for axis, cell in zip(axis_row[2:], columns, strict=True):
            artifact = by_item.get(Item(*cell, *obj))
            show(axis, None if artifact is None else artifact.pictures()[view][cut], "nearest")
        axis_row[0].set_ylabel(f"{obj[1][:18]}\nview {view}", fontsize=7)
    titles = [GROUND_TRUTH, "its thin parts", *(f"{m}\n{c}" for m, c in columns)]
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=9)
    figure.tight_layout(pad=0.3)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def show(axis: Any, picture: NDArray[np.uint8] | None, interpolation: str | None = None) -> None:
    """A picture without a frame, or the word that there is none."""
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    if picture is None:
        axis.text(0.5, 0.5, "failed", ha="center", va="center", transform=axis.transAxes)
    else:
        axis.imshow(picture, interpolation=interpolation)


def _rivals(items: Iterable[Item]) -> list[str]:
    """The methods that are compared, in order: without ceiling and floors."""
    methods = dict.fromkeys(item.method for item in items if item.condition)
    return [m for m in methods if m not in FLOORS and not find_method(m).sees_mesh]
