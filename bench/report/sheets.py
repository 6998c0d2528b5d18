"""Sheets of images: any grid of images, and those of a run, which fit a page."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.paper import SURFACE, network_of
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import role
from bench.catalogue.metrics import higher_is_better
from bench.metrics.silhouette import object_boxes
from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.thin_parts import evaluated
from bench.records.frames import Artifact
from bench.records.job import JobName
from bench.records.record import GROUND_TRUTH
from bench.report.figure import MOST_HIGH_IN, TEXT, WIDTH_IN, Image, drawing, panels, save
from bench.report.styles import rivals
from bench.tables.grid import ordered
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAILED = "failed"  # in place of an image
OBJECTS_SHOWN = 4
THIN_OF = 8  # the first objects of a run, of which those with most thin parts are shown
_THIN_CONDITIONS = ("2048", "noise-0.05")
THIN_TINT = (225, 0, 75)
LONGEST = 18  # letters of a name
_LETTERS_IN_LINE = 12  # of a title: more are wider than an image
LABELS_IN, TITLES_IN, CAPTION_IN = 0.5, 0.4, 0.15
_LEAST_CELL_IN = 0.75  # of an image: fewer objects are shown rather than smaller images


@drawing()
def image_sheet(
    titles: Sequence[str],
    rows: Sequence[tuple[str, Iterable[Image | str]]],
    *,
    captions: Sequence[Sequence[str]] = (),
    note: str = "",
    cell_in: float = math.inf,
    width_in: float = WIDTH_IN,
    fontsize: float = TEXT,
    interpolation: str | None = None,
) -> Figure:
    """Return images in rows, as large as a page has room for.

    titles         above the columns; long ones are wrapped
    rows           the name of a row and an image [H, W, 3] for each title, or words in its place
    captions       words beneath each image, row by row
    note           below all images
    cell_in        the most that an image is high, and `width_in`, width of the sheet, inches
    fontsize       of all text, points
    interpolation  as of `matplotlib.axes.Axes.imshow`
    """
    room_in = CAPTION_IN * bool(captions)
    widest, high = (width_in - LABELS_IN) / len(titles), (MOST_HIGH_IN - TITLES_IN) / len(rows)
    cell_in = min(widest + room_in, high, cell_in)
    size_in = (width_in, cell_in * len(rows) + TITLES_IN * (1 + bool(note)))
    figure, axes = panels(len(rows), len(titles), size_in, layout=None)
    for number, (label, images) in enumerate(rows):
        axes[number, 0].set_ylabel(_wrapped(label), fontsize=fontsize)
        for axis, image in zip(axes[number], images, strict=True):
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
            if isinstance(image, str):
                axis.text(0.5, 0.5, image, ha="center", va="center", transform=axis.transAxes)
            else:
                axis.imshow(image, interpolation=interpolation)
        for axis, caption in zip(axes[number], captions[number] if captions else (), strict=False):
            axis.set_xlabel(caption, fontsize=fontsize, labelpad=2)
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(_wrapped(title), fontsize=fontsize)
    figure.supxlabel(visible(note), fontsize=fontsize)
    figure.tight_layout(pad=0.3)
    return figure


def _wrapped(name: str) -> str:
    """Return a name on lines that are as wide as an image."""
    lines = map(visible, name.split("\n"))
    return "\n".join(
        textwrap.fill(line, _LETTERS_IN_LINE, break_long_words=False) for line in lines
    )


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
    least = min(_LEAST_CELL_IN, (WIDTH_IN - LABELS_IN) / (1 + len(across)))
    fitting = int((MOST_HIGH_IN - TITLES_IN) / (least * len(down)) + 1e-9)
    rows = []
    for obj in objects[: max(fitting, 1)]:
        for name in down:
            cells = [(other, name) if turned else (name, other) for other in across]
            jobs = [JobName(GROUND_TRUTH, "", *obj), *(JobName(*cell, *obj) for cell in cells)]
            rows.append((f"{obj[1][:LONGEST]}\n{name}", [_first(artifacts, job) for job in jobs]))
    save(image_sheet([GROUND_TRUTH, *across], rows), path)


def _first(artifacts: Mapping[JobName, Artifact], job: JobName) -> Image | str:
    """Return the first view of a job."""
    drawn = artifacts.get(job)
    return FAILED if drawn is None else drawn.read()[0]


def write_classes(
    path: Path, headline: pd.DataFrame, artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write the paper's Figure 4: the first object of each class, which nobody has chosen.

    The truth is followed by one method of each approach, and the best by each metric of the
    headline, each image above its SSIM with the truth.
    """
    cells = [name for name in artifacts if name.condition]
    methods, condition = ordered(name.method for name in cells), cells[0].condition
    best = best_methods(headline, condition)
    splat_net = next((m for m in methods if family_of(m) == "splat-net"), None)
    wanted = ordered([SURFACE, network_of(methods), *best.values(), splat_net, "splat"])
    shown = [method for method in wanted if method in methods]
    first: dict[str, JobName] = {}
    for name in artifacts:
        if name.method == GROUND_TRUTH:
            first.setdefault(name.class_name, name)
    rows, captions = [], []
    for class_name, truth in first.items():
        true = artifacts[truth].read()[:1]
        images = [_first(artifacts, JobName(method, condition, *truth.object)) for method in shown]
        rows.append((class_name, [true[0], *images]))
        scores = (
            "" if isinstance(image, str) else f"{ssim_per_image(true, image[None]).ssim[0]:.2f}"
            for image in images
        )
        captions.append(["", *scores])
    lines = [f"{condition}: the first object of each class in its first view; SSIM below"]
    if best:
        winners = (
            f"{winner} by {' and '.join(m for m, method in best.items() if method == winner)}"
            for winner in ordered(best.values())
        )
        lines.append(f"best of all methods: {', '.join(winners)}")
    figure = image_sheet(["truth", *shown], rows, captions=captions, note="; ".join(lines))
    save(figure, path)


def best_methods(headline: pd.DataFrame, condition: str) -> dict[str, str]:
    """Return the best of the methods that compete by each metric, in the mean over classes.

    Failed images are scored as blank ones, so that no method is best by failing.
    """
    rows = headline[(headline["condition"] == condition) & headline["failures_as_blank"].notna()]
    rows = rows[~rows["method"].map(role).astype(bool)]
    best = {}
    for metric, of_metric in rows.groupby("metric", sort=False):
        values = of_metric["failures_as_blank"].to_numpy()
        place = values.argmax() if higher_is_better(str(metric)) else values.argmin()
        best[str(metric)] = str(of_metric["method"].iloc[place])
    return best


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
    conditions = [condition for condition in _THIN_CONDITIONS if condition in measured]
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    if not chosen or not conditions or not methods:
        return
    # Truth and tinted truth stand side by side above two conditions, one above the other above one.
    labels = ["truth,\nits thin parts"] if len(conditions) > 1 else ["truth", "its thin parts"]
    columns: list[list[Image | str]] = []
    for truth in chosen:
        view = int(counts[truth.object].argmax())
        true = artifacts[truth].read()[view]
        cut, tinted = thin_cut(true, parts[truth.object][view])
        heads = [true[cut], tinted[cut]]
        for condition, head in zip(conditions, heads, strict=False):
            drawn = [artifacts.get(JobName(method, condition, *truth.object)) for method in methods]
            images = [FAILED if some is None else some.read()[view][cut] for some in drawn]
            columns.append([*([head] if len(conditions) > 1 else heads), *images])
    rows = [(name, [c[i] for c in columns]) for i, name in enumerate([*labels, *methods])]
    objects = [truth.object_id[:LONGEST] for truth in chosen]
    titles = [f"{name}\n{condition}" for name in objects for condition in conditions]
    save(image_sheet(titles, rows, interpolation="nearest"), path)


def thin_cut(true: Image, parts: NDArray[np.bool_]) -> tuple[tuple[slice, slice], Image]:
    """Return the box around an object in its true image, and the image with thin parts tinted."""
    top, bottom, left, right = object_boxes(true[None])[0].tolist()
    cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
    return cut, np.where(parts[..., None], np.array(THIN_TINT, np.uint8), true)
