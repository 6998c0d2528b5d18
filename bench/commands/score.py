"""`bench score`: metrics of other packages, taken of the images that a finished run has kept.

The run itself stays as it is: its records, its tables and what they are compared with. A score is a
pure function of images, so there is nothing to keep but the tables.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray

from bench.analysis.cells import image_keys
from bench.analysis.distances import FRECHET, KERNEL, FeatureDistances
from bench.analysis.scored import ScoredRun, read_scored
from bench.analysis.scores import QualityRow, RowWithSamples, distance_rows, image_rows
from bench.catalogue.metrics import column
from bench.catalogue.plugins import ImageMetric, SetMetric, find_metric, metric_ids
from bench.catalogue.suite_types import TableSpec
from bench.commands.options import RunDirectory, names
from bench.records.artifacts import JobName
from bench.records.features import ImageKey
from bench.records.record import GROUND_TRUTH
from bench.report.stored import Sources, open_sources
from bench.running.work import reason_of
from bench.tables.quality import quality_table
from bench.tables.table import Table, write_tables
from data_prep.failures import BadInput
from data_prep.scene import UInt8Images


def score(directory: Path, metric_ids: Sequence[str]) -> list[Table[QualityRow]]:
    """A table for each metric, written into `directory`/tables as metric_ID.csv and .md.

    Raises BadInput for what is no finished run, an unknown metric, images that are not there any
    more, and where a metric fails or gives no scores.
    """
    metrics = [find_metric(metric_id) for metric_id in metric_ids]
    run = read_scored(directory)
    for metric in metrics:
        if column(metric.id) in run.records.columns:
            raise BadInput(
                f"metric '{metric.id}': the records have a column of that name; rename it"
            )
    sources = open_sources(directory, run.manifest, ())
    made = []
    for metric in metrics:
        if isinstance(metric, SetMetric):
            found, better = _set_rows(run, sources, metric), "lower"
        else:
            found = _image_rows(run, sources, metric)
            better = "higher" if metric.higher_is_better else "lower"
        title = f"{metric.id}, version {metric.version}: {metric.about} ({better} is better)"
        rows = (one.row for one in found)
        spec = TableSpec("images", f"metric_{metric.id}", title)
        made.append(quality_table(spec, rows))
    write_tables(directory, made)
    return made


def _image_rows(run: ScoredRun, sources: Sources, metric: ImageMetric) -> list[RowWithSamples]:
    records = scored(run.records, sources, metric)
    return image_rows(replace(run, records=records, skipped={}), [metric.id])


def _set_rows(run: ScoredRun, sources: Sources, metric: SetMetric) -> list[RowWithSamples]:
    """Fréchet and kernel distances."""
    seen = FeatureDistances(SeenFeatures(run.records, sources, metric))
    return [
        row
        for name, distance in ((metric.id, FRECHET), (f"{metric.id}-kernel", KERNEL))
        for row in distance_rows(run, name, distance, seen)
    ]


class SeenFeatures:
    """The features of the images that a run has kept, as `bench.records.features.Features`.

    They are taken when they are asked for, cell by cell; those of the truth are kept.
    """

    def __init__(self, records: pd.DataFrame, sources: Sources, metric: SetMetric) -> None:
        ok = records[records["outcome"] == "ok"]
        cells = ok.groupby(["method", "condition", "class"], sort=False)
        self._images = {cell: sorted(image_keys(group)) for cell, group in cells}
        self._sources, self._metric = sources, metric
        self._true: dict[JobName, NDArray[np.float64]] = {}
        for name in records["class"].unique():
            of_class = (images for cell, images in self._images.items() if cell[2] == name)
            self._images[GROUND_TRUTH, "", name] = sorted(set().union(*of_class))

    def images(self, method: str, condition: str, class_name: str) -> list[ImageKey]:
        """The images there are, sorted; none in a cell that is not there."""
        return self._images.get((method, condition, class_name), [])

    def of(
        self, method: str, condition: str, class_name: str, images: Sequence[ImageKey]
    ) -> NDArray[np.float64]:
        """Theirs [n, d], in the order of `images`. Raises BadInput as `score`."""
        of_objects = {}
        for obj in dict.fromkeys(obj for obj, _ in images):
            item = JobName(method, condition, class_name, obj)
            found = self._true.get(item)
            if found is None:
                found = checked_features(self._metric, kept_images(self._sources, item))
            if method == GROUND_TRUTH:
                self._true[item] = found
            of_objects[obj] = found
        return np.stack([of_objects[obj][view] for obj, view in images])


def scored(records: pd.DataFrame, sources: Sources, metric: ImageMetric) -> pd.DataFrame:
    """The records with a column for the metric, NaN where there is no image.

    Raises BadInput as `score`.
    """
    values = pd.Series(np.nan, index=records.index)
    ok = records[records["outcome"] == "ok"]
    for cell, group in ok.groupby(["method", "condition", "class", "object"], sort=False):
        item = JobName(*map(str, cell))  # type: ignore[arg-type]  # pandas: of several columns a tuple
        drawn, truth = kept_images(sources, item), kept_images(sources, item.truth)
        views = group["view"].to_numpy()
        values[group.index] = checked_scores(metric, truth, drawn)[views]
    return records.assign(**{column(metric.id): values})


def kept_images(sources: Sources, item: JobName) -> UInt8Images:
    """The images [V, H, W, 3] of an item. Raises BadInput where they are gone."""
    images = sources.images(item)
    if images is None:
        raise BadInput(
            f"{' '.join(item)}: its images are not there any more; start the run again with its "
            "command"
        )
    return images


def _given(
    metric: ImageMetric | SetMetric, function: Callable[..., object], *images: UInt8Images
) -> NDArray[np.float64]:
    """Return what a function of the metric gives. Raises BadInput for whatever it raises.

    What it prints goes to stderr: stdout is for the tables.
    """
    try:
        with redirect_stdout(sys.stderr):
            return np.asarray(function(*images), np.float64)
    except (Exception, SystemExit) as error:  # whatever a stranger's function raises
        raise BadInput(f"metric '{metric.id}': {reason_of(error)}; fix that package") from error


def checked_features(metric: SetMetric, images: UInt8Images) -> NDArray[np.float64]:
    """Return features [V, d] of images [V, H, W, 3]. Raises BadInput where there are none."""
    found = _given(metric, metric.features, images)
    is_expected = found.ndim == 2 and len(found) == len(images) and found.shape[1] > 0
    if not is_expected or not np.isfinite(found).all():
        raise BadInput(
            f"metric '{metric.id}': gives features {list(found.shape)}, {np.isfinite(found).sum()} "
            f"finite, for {len(images)} images; fix that package"
        )
    return found


def checked_scores(
    metric: ImageMetric, truth: UInt8Images, drawn: UInt8Images
) -> NDArray[np.float64]:
    """Return scores [V] of images [V, H, W, 3]. Raises BadInput where the metric has none."""
    found = _given(metric, metric.score, truth, drawn)
    if found.shape != (len(drawn),) or not np.isfinite(found).all():
        like_truth = "; they are identical to the true ones" * np.array_equal(truth, drawn)
        raise BadInput(
            f"metric '{metric.id}': gives {found.shape} values, {np.isfinite(found).sum()} finite, "
            f"for {len(drawn)} pictures{like_truth}; fix that package ('bench test {metric.id}')"
        )
    return found


def score_run(
    directory: RunDirectory,
    metrics: Annotated[
        str | None,
        typer.Option(help="Metrics, comma-separated. Default: all of installed packages."),
    ] = None,
) -> None:
    """Measure a finished run with metrics of other packages; print their tables."""
    chosen = names(metrics) or metric_ids()
    if not chosen:
        raise BadInput("no installed package adds a metric; see docs/adding-a-metric.md")
    for made in score(directory, chosen):
        print(made.to_markdown())
