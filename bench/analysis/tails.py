"""The tails of methods: how bad their worst images are, which means over objects hide.

Images count here, not objects, and those of all classes together: who looks at a method's images
sees the worst of them, whichever object it is of. A failed image is scored as the blank one.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import pandas as pd

from bench.analysis.comparison import ALL
from bench.analysis.scored_run import Run
from bench.catalogue.methods import FLOOR
from bench.records.frames import read_scores, scored_metrics
from bench.records.record import JOB
from data_prep.failures import BadInput

INVENTED = ("invented-holes", "invented-parts")
WORST, SHARE = "worst-1-percent", "images-percent"
# value         by `statistic`: the mean of the metric over the worst 1 % of the images, or the
#               share of the images with a value above 0, in per cent
# n_ok, n       images that exist, images there should be
# worst         value of the worst image, which `worst_object`, as class/object, and `worst_view`
#               name; both are empty where all values are 0
TAIL_COLUMNS = (
    "suite",
    "method",
    "condition",
    "class",
    "metric",
    "statistic",
    "value",
    "n_ok",
    "n",
    "worst",
    "worst_object",
    "worst_view",
)
_HUNDREDTH = 100  # one image in so many counts as among the worst


def tail_images(run: Run) -> pd.DataFrame:
    """Return the images of a run with a column for each metric of tails that it has.

    A failed image has the values of the blank one of its object and view, or NaN without one. A run
    that was not scored by the metrics in INVENTED, or has changed since, has no column of them.
    """
    images = run.read_images((*JOB, "view", "outcome", "lpips"))
    if "lpips" in run.skipped:
        images = images.drop(columns="lpips")
    kept = [*JOB, "view"]
    for metric in sorted({*INVENTED} & {*scored_metrics(run.directory)}):
        with suppress(BadInput):  # the table of the metric itself says so
            values = read_scores(run.directory, metric)[1].rename(columns={"value": metric})
            images = images.merge(values, how="left", on=kept)
    metrics = [name for name in ("lpips", *INVENTED) if name in images]
    place = kept[1:]
    blank = images.loc[images["method"] == FLOOR, [*place, *metrics]]
    of_blank = images[place].merge(blank, how="left", on=place)[metrics]
    images[metrics] = images[metrics].where(images["outcome"] == "ok", of_blank)
    return images


def tail_rows(images: pd.DataFrame, suite: str) -> pd.DataFrame:
    """Return a row for each metric, condition and method that has values: TAIL_COLUMNS.

    `images` are as `tail_images` returns them, methods and conditions in the order of the rows.
    """
    classes = images["class"].unique()
    class_name = str(classes[0]) if len(classes) == 1 else ALL
    rows = []
    for metric in (name for name in ("lpips", *INVENTED) if name in images):
        for (condition, method), of_cell in images.groupby(["condition", "method"], sort=False):
            known = of_cell[of_cell[metric].notna()]
            if len(known):
                cell = suite, method, condition, class_name, metric
                numbers = int((of_cell["outcome"] == "ok").sum()), len(of_cell)
                rows.append((*cell, *_statistic(known[metric]), *numbers, *_worst(known, metric)))
    return pd.DataFrame(rows, columns=list(TAIL_COLUMNS))


def _statistic(values: pd.Series[float]) -> tuple[str, float]:
    """Return the name of the statistic that suits the metric, and its value for these images."""
    if values.name in INVENTED:
        return SHARE, 100.0 * float((values > 0).mean())
    count = math.ceil(len(values) / _HUNDREDTH)
    return WORST, float(values.nlargest(count).mean())


def _worst(images: pd.DataFrame, metric: str) -> tuple[float, str, str]:
    """Return the value of the worst image, the first of several, its object and its view."""
    image: Any = images[images[metric] == images[metric].max()].iloc[0]
    if image[metric] == 0:
        return 0.0, "", ""
    return float(image[metric]), f"{image['class']}/{image['object']}", str(image["view"])
