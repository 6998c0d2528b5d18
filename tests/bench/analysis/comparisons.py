"""Comparisons of methods by a metric, as a run would have measured them."""

from __future__ import annotations

import numpy as np

from bench.analysis.comparison import Comparison, Estimate, Quality
from bench.analysis.intervals import mean_interval


def quality(metric, scores):
    """From the score of each object, with the interval of an image metric."""
    scores = np.array(scores, float)
    return Quality(metric, Estimate(float(scores.mean()), *mean_interval(scores)), scores)


def comparison(methods, metric="ssim", condition="2048", class_name="chair"):
    """Methods by (milliseconds to prepare, milliseconds to draw a view, score of each object).

    Times may be one number, or one for each object. Two images an object are there.
    """
    count = len(next(iter(methods.values()))[2])
    nothing = np.zeros(count)
    return Comparison(
        condition,
        class_name,
        tuple("abcdefgh"[:count]),
        {name: nothing + np.array(ms) / 1000 for name, (ms, _, _) in methods.items()},
        {name: nothing + np.array(ms) / 1000 for name, (_, ms, _) in methods.items()},
        dict.fromkeys(methods, (2 * count, 2 * count)),
        {metric: {name: quality(metric, scores) for name, (_, _, scores) in methods.items()}},
    )
