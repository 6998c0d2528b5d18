"""How far metrics may be from what the cases of `bench.metric_cases_*` state.

With u = 2^-53:

* `SUMS`. The mean over the 118 x 118 windows of three channels is taken tile by tile: sums of at
  most 576 x 3 values of at most 1, and of 25 tiles. Off by 1,753 u at most: 2e-13.
* `ONE_WINDOW`. A moment of one window of noise is a sum of 11 sums of 11 products of at most 255^2,
  off by 22 u of that. Four moments, over the least of the divisors, C3: 2e-11.
* `ROUNDING`. A singular value errs by a few u of the largest one, the sum of d of them by d u of
  the traces: 5e-13 of the traces for d = 2,048. The distance is the difference of traces.
* Features that are off by at most e move the root of the distance by at most
  D = e sqrt(d n / (n - 1)) a set: it is a metric, and pairing each row with itself is one way to
  carry one Gaussian to the other (Gelbrich 1990). The distance itself moves by 2 D times its root
  and D^2.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Floats = NDArray[np.float64]

# By the protocol of the head of `bench.metrics.structural_similarity`, and not its own constants:
# they are under test.
WINDOW, SIGMA = 11, 1.5
C1, C2, C3 = 2.55**2, 7.65**2, 7.65**2 / 2
U = 2.0**-53
SUMS = (576 * 3 + 25) * U
ONE_WINDOW = 4 * 22 * U * 255**2 / C3
ROUNDING = 1e-12
FLOAT32_FEATURES = 1e-4  # sums of up to 864 float32 products a layer, of features up to some 10
CODE_LENGTH = 18 * 2.0**-24  # float32: half of the 32 roundings of a sum of squares, root, quotient
ANGLE_DEG = math.degrees(2.0**-23)  # sine and cosine in float32


def trace(x: Floats) -> Any:
    """Of the covariance; two passes."""
    return ((x - x.mean(axis=0)) ** 2).sum() / (len(x) - 1)


def rounding(x: Array, y: Array) -> float:
    """ROUNDING of the traces and of the squared shift of two sets of features."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    shift = x.mean(axis=0) - y.mean(axis=0)
    return ROUNDING * float(trace(x) + trace(y) + shift @ shift)


def largest_move(root: Any, features: int, rows: int, by: float) -> float:
    """How far a distance may move where both sets of features are off by `by`; see the head."""
    move = 2 * by * math.sqrt(features * rows / (rows - 1))
    return float(2 * root * move + move**2)
