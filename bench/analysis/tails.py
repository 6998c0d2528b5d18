"""The tails of methods: how bad their worst images are, which means over objects hide.

Images count here, not objects, and those of all classes together: who looks at a method's images
sees the worst of them, whichever object it is of. A failed image is scored as the blank one.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any

import pandas as pd

from bench.analysis.compare import ALL
from bench.analysis.run import Run
from bench.catalogue.methods import FLOOR
from bench.records.frames import read_scores, scored_metrics
from bench.records.job import JOB
from data_prep.failures import BadInput

INVENTED = ("invented-holes", "invented-parts")  # of `bench score`: the table needs one
WORST = "worst-1-percent"  # statistic: the mean of the metric over the worst 1 % of the images
SHARE = "images-percent"  # statistic: the share of the images with a value above 0, in per cent
# statistic     WORST or SHARE, which suits the metric, and `value`, its value
# n_ok, n       images that exist, images there should be
# worst         the metric of the worst image
# worst_object  the object of the worst image, as class/object; empty where all values are 0
# worst_view    number of its view; empty where all values are 0
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
_ONE_OF = 100  # images, of which one counts as among the worst


def tail_images(run: Run) -> pd.DataFrame:
    """Return the images of a run with a column for each metric of tails that it has.

    A failed image has the values of the blank one of its object and view, or NaN without one. A run
    that was not scored by the metrics in INVENTED, or has changed since, has no column of them.
    """
    images = run.read_images((*JOB, "view", "outcome", "lpips"))
    if "lpips" in run.skipped:
        images = images.drop(columns="lpips")
    for metric in sorted({*INVENTED} & {*scored_metrics(run.directory)}):
        with suppress(BadInput):  # scores of images that have changed: the metric's table says so
            _, scores = read_scores(run.directory, metric)
            values = scores.rename(columns={"value": metric})
            images = images.merge(values, how="left", on=[*JOB, "view"])
    metrics = [name for name in ("lpips", *INVENTED) if name in images]
    same_image = [*JOB[1:], "view"]  # columns that a method's image shares with the blank one
    blank = images.loc[images["method"] == FLOOR, [*same_image, *metrics]]
    of_blank = images[same_image].merge(blank, how="left", on=same_image)[metrics]
    images[metrics] = images[metrics].where(images["outcome"] == "ok", of_blank)
    return images


def tail_rows(images: pd.DataFrame, suite: str) -> pd.DataFrame:
    """Return a row with TAIL_COLUMNS for each metric, condition and method that has values.

    images  as `tail_images` returns them; the rows are in their order of conditions and methods
    """
    classes = images["class"].unique()
    class_name = str(classes[0]) if len(classes) == 1 else ALL
    rows = []
    metrics = [name for name in ("lpips", *INVENTED) if name in images]
    for metric in metrics:
        for (condition, method), of_method in images.groupby(["condition", "method"], sort=False):
            known = of_method[of_method[metric].notna()]
            if known.empty:
                continue
            statistic, value = _statistic(known[metric])
            worst, worst_object, worst_view = _worst(known, metric)
            rows.append(
                {
                    "suite": suite,
                    "method": method,
                    "condition": condition,
                    "class": class_name,
                    "metric": metric,
                    "statistic": statistic,
                    "value": value,
                    "n_ok": int((of_method["outcome"] == "ok").sum()),
                    "n": len(of_method),
                    "worst": worst,
                    "worst_object": worst_object,
                    "worst_view": worst_view,
                }
            )
    return pd.DataFrame(rows, columns=list(TAIL_COLUMNS))


def _statistic(values: pd.Series[float]) -> tuple[str, float]:
    """Return the name of the statistic that suits the metric, and its value for these images."""
    if values.name in INVENTED:
        return SHARE, 100.0 * float((values > 0).mean())
    count = math.ceil(len(values) / _ONE_OF)
    return WORST, float(values.nlargest(count).mean())


def _worst(images: pd.DataFrame, metric: str) -> tuple[float, str, str]:
    """Return the value of the worst image, its object and its view; of equal ones the first."""
    image: Any = images[images[metric] == images[metric].max()].iloc[0]
    if image[metric] == 0:
        return 0.0, "", ""
    return float(image[metric]), f"{image['class']}/{image['object']}", str(image["view"])
