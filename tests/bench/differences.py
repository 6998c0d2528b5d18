"""Differences of two sides, as `bench compare` has them."""

from __future__ import annotations

from math import isfinite, nan

import pandas as pd

from bench.analysis.pairs import IMAGES_OF, Differences
from bench.catalogue.suites import TRUTHS


def make_difference(metric, condition, value, ahead="b", **changes):
    """Return a row of splat-net against poisson on 24 chairs, in one sentence with nine others."""
    reach = nan if ahead == "unknown" else 0.01
    row = {
        **{"metric": metric, "condition": condition, "class": "chair"},
        **{"run_a": "run", "method_a": "poisson", "run_b": "run", "method_b": "splat-net"},
        **{"value_a": 0.5, "value_b": 0.5 + value, "difference": value},
        **{"ci_low": value - reach, "ci_high": value + reach},
        **{"level": 0.995, "p": 0.001, "p_corrected": 0.01, "cells": 10, "ahead": ahead},
        **{"failed_a": 0, "failed_b": 0},
        **{"objects": 24, "objects_needed": 8 if ahead == "unknown" and isfinite(value) else None},
    } | changes
    measured = zip(IMAGES_OF, (row["method_a"], row["method_b"]), strict=True)
    return dict(measured) | row


def make_differences(rows, remarks=(), a="poisson", b="splat-net"):
    needed = pd.Series([row["objects_needed"] for row in rows], dtype=object)
    frame = pd.DataFrame(rows).assign(objects_needed=needed)
    return Differences(a, b, frame, tuple(remarks), TRUTHS["coloured"])
