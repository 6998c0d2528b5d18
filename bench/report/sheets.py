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
from bench.records.job import GROUND_TRUTH, JobName
from bench.report.plots import MOST_HIGH_IN, TEXT, WIDTH_IN, Image, drawing, panels, save
from bench.report.styles import rivals
from bench.tables.grid import ordered
from bench.tables.markdown import visible

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FAILED = "failed"  # stands in place of an image
OBJECTS_SHOWN = 4  # objects on a sheet, at most
THIN_OF = 8  # of so many first objects of a run those with the most thin parts are shown
_THIN_CONDITIONS = ("2048", "noise-0.05")  # a clean and a noisy one
THIN_TINT = (225, 0, 75)  # colour of thin parts: red, green, blue, 0..255
LONGEST = 18  # letters of an object's name
_LETTERS_IN_LINE = 12  # letters in a line of a title: more are wider than an image
LABELS_IN = 0.5  # inches: width of the names of rows
TITLES_IN = 0.4  # inches: height of the titles of columns, and of a note
CAPTION_IN = 0.15  # inches: height of the words beneath an image
_LEAST_CELL_IN = 0.75  # inches: least height of an image; fewer objects are shown instead


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
    note           words below all images
    cell_in        greatest height of an image, inches
    width_in       width of the sheet, inches
    fontsize       of all text, points
    interpolation  as of `matplotlib.axes.Axes.imshow`
    """
    caption_in = CAPTION_IN if captions else 0.0
    widest = (width_in - LABELS_IN) / len(titles)
    highest = (MOST_HIGH_IN - TITLES_IN) / len(rows)
    cell_in = min(widest + caption_in, highest, cell_in)
    texts_in = 2 * TITLES_IN if note else TITLES_IN
    size_in = (width_in, cell_in * len(rows) + texts_in)
    figure, axes = panels(len(rows), len(titles), size_in, layout=None)
    for number, (label, images) in enumerate(rows):
        axes[number, 0].set_ylabel(_wrapped(label), fontsize=fontsize)
        for axis, image in zip(axes[number], images, strict=True):
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
            if isinstance(image, str):
                middle = {"ha": "center", "va": "center", "transform": axis.transAxes}
                axis.text(0.5, 0.5, image, fontsize=fontsize, **middle)
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
    """Return a name broken into lines that are no wider than an image."""
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

    The first column is the truth. Of the methods that compete and the conditions the more numerous
    stand below each other, for each object, and the others side by side. The sheet fits a page,
    with at most `objects_shown` objects.
    """
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    conditions_down = len(conditions) > len(methods)
    down, across = (conditions, methods) if conditions_down else (methods, conditions)
    objects = ordered(name.object for name in artifacts)[:objects_shown]
    if not (down and across and objects):
        return
    least = min(_LEAST_CELL_IN, (WIDTH_IN - LABELS_IN) / (1 + len(across)))
    # Objects that have room; 1e-9 is for a quotient that rounding leaves below a whole number.
    fitting = int((MOST_HIGH_IN - TITLES_IN) / (least * len(down)) + 1e-9)
    rows = []
    for obj in objects[: max(fitting, 1)]:
        for name in down:
            jobs = [JobName(GROUND_TRUTH, "", *obj)]
            for other in across:
                method, condition = (other, name) if conditions_down else (name, other)
                jobs.append(JobName(method, condition, *obj))
            rows.append((f"{obj[1][:LONGEST]}\n{name}", [_first(artifacts, job) for job in jobs]))
    save(image_sheet([GROUND_TRUTH, *across], rows), path)


def _first(artifacts: Mapping[JobName, Artifact], job: JobName) -> Image | str:
    """Return the first image of a job, or FAILED where it has none."""
    drawn = artifacts.get(job)
    return FAILED if drawn is None else drawn.read()[0]


def write_classes(
    path: Path, headline: pd.DataFrame, artifacts: Mapping[JobName, Artifact]
) -> None:
    """Write the paper's Figure 4: the first object of each class, which nobody has chosen.

    The truth is followed by one method of each approach, and the best by each metric of the
    headline, each image above its SSIM with the truth.
    """
    drawn = [name for name in artifacts if name.condition]  # ground truths have no condition
    methods, condition = ordered(name.method for name in drawn), drawn[0].condition
    best = best_methods(headline, condition)
    splat_net = next((name for name in methods if family_of(name) == "splat-net"), None)
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
        captions.append(["", *(_ssim_text(true, image) for image in images)])
    lines = [f"{condition}: the first object of each class in its first view; SSIM below"]
    if best:
        winners = []
        for winner in ordered(best.values()):
            metrics = [metric for metric, method in best.items() if method == winner]
            winners.append(f"{winner} by {' and '.join(metrics)}")
        lines.append(f"best of all methods: {', '.join(winners)}")
    figure = image_sheet(["truth", *shown], rows, captions=captions, note="; ".join(lines))
    save(figure, path)


def _ssim_text(true: NDArray[np.uint8], image: Image | str) -> str:
    """Return the SSIM of an image with the true one [1, H, W, 3]; empty where there is no image."""
    if isinstance(image, str):
        return ""
    return f"{ssim_per_image(true, image[None]).ssim[0]:.2f}"


def best_methods(headline: pd.DataFrame, condition: str) -> dict[str, str]:
    """Return the best of the methods that compete, by metric, in the mean over classes.

    headline   the frame of the headline table
    condition  the condition at which values are compared

    Failed images are scored as blank ones, so that no method is best because it failed.
    """
    rows = headline[(headline["condition"] == condition) & headline["failures_as_blank"].notna()]
    rows = rows[~rows["method"].map(role).astype(bool)]
    best = {}
    for metric, of_metric in rows.groupby("metric", sort=False):
        values = of_metric["failures_as_blank"].to_numpy()
        number = values.argmax() if higher_is_better(str(metric)) else values.argmin()
        best[str(metric)] = str(of_metric["method"].iloc[number])
    return best


def write_thin_parts(path: Path, artifacts: Mapping[JobName, Artifact]) -> None:
    """Write a sheet of the objects with the most thin parts, in the view that shows most of them.

    Objects stand side by side, cut out of their images. From above there are the truth, the truth
    with the evaluated pixels tinted, and the images of each method, at a clean and at a noisy
    condition.
    """
    truths = [name for name in artifacts if name.method == GROUND_TRUTH][:THIN_OF]
    parts = {truth.object: evaluated(artifacts[truth].read()) for truth in truths}
    counts = {obj: part.sum(axis=(1, 2)) for obj, part in parts.items()}
    by_count = sorted(truths, key=lambda truth: -int(counts[truth.object].sum()))
    chosen = [truth for truth in by_count if counts[truth.object].any()][:OBJECTS_SHOWN]
    of_run = {name.condition for name in artifacts}
    conditions = [condition for condition in _THIN_CONDITIONS if condition in of_run]
    methods = rivals(ordered(name.method for name in artifacts if name.condition))
    if not chosen or not conditions or not methods:
        return
    # With two conditions an object has two columns: the truth heads the first, the tinted truth the
    # second. With one condition they stand one above the other.
    two_columns = len(conditions) > 1
    labels = ["truth,\nits thin parts"] if two_columns else ["truth", "its thin parts"]
    columns: list[list[Image | str]] = []
    for truth in chosen:
        view = int(counts[truth.object].argmax())
        true = artifacts[truth].read()[view]
        cut, tinted = thin_cut(true, parts[truth.object][view])
        heads = [true[cut], tinted[cut]]
        for condition, head in zip(conditions, heads, strict=False):
            column: list[Image | str] = [head] if two_columns else [*heads]
            for method in methods:
                drawn = artifacts.get(JobName(method, condition, *truth.object))
                column.append(FAILED if drawn is None else drawn.read()[view][cut])
            columns.append(column)
    in_rows = zip(*columns, strict=True)
    rows = [(name, list(row)) for name, row in zip([*labels, *methods], in_rows, strict=True)]
    objects = [truth.object_id[:LONGEST] for truth in chosen]
    titles = [f"{name}\n{condition}" for name in objects for condition in conditions]
    save(image_sheet(titles, rows, interpolation="nearest"), path)


def thin_cut(true: Image, parts: NDArray[np.bool_]) -> tuple[tuple[slice, slice], Image]:
    """Return the box around an object, with a margin of 3 px, and its image with tinted parts.

    true   true image, uint8 [H, W, 3]
    parts  the pixels [H, W] that are tinted
    """
    top, bottom, left, right = object_boxes(true[None])[0].tolist()
    cut = slice(max(top - 3, 0), bottom + 3), slice(max(left - 3, 0), right + 3)
    return cut, np.where(parts[..., None], np.array(THIN_TINT, np.uint8), true)
