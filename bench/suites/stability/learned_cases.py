"""Cases on the judges that were trained on photographs: LPIPS, DISTS, sets of their features."""

from __future__ import annotations

import functools

import numpy as np

from bench.metrics.frechet import TooFewSamples
from bench.suites.stability.feature_cases import SAME, rounding_of
from bench.suites.stability.metric_cases import (
    Near,
    Refused,
    boxes,
    cases_of,
    flat,
    noise,
    twice,
)

_WHITE_BLACK = 0.78644050453  # float64, computed apart by the original's rule (version 0.1)
_LPIPS_SINGLE = 1e-5  # its error in float32
_ON_ALEXNET = functools.partial(rounding_of, "fd-alexnet")

ALEXNET_CASES = (
    *cases_of("lpips", "distances by AlexNet",
        ("lpips-identical", lambda: twice(noise(5)), Near("0", 0.0)),
        ("lpips-white-against-black", lambda: (flat(255), flat(0)),
         Near("that of the original", _WHITE_BLACK, _LPIPS_SINGLE)),
        ("lpips-swapped", lambda: (flat(0), flat(255)),
         Near("symmetric", _WHITE_BLACK, _LPIPS_SINGLE)),
        ("lpips-no-images", lambda: twice(flat(0, 0)), Near("no values", lambda a, b: np.empty(0))),
        ("lpips-in-0-to-1", lambda: (flat(255) / 255, flat(0) / 255),
         Refused(ValueError, "images must be uint8 [N, H, W, 3], got float64")),
        ("lpips-another-size", lambda: (flat(0, side=64), flat(0)),
         Refused(ValueError, "must have the same shape")),
        ("lpips-too-small", lambda: twice(flat(0, side=30)),
         Refused(ValueError, "of 31 x 31 pixels or more")),
    ),
    *cases_of("fd-alexnet", "distances by AlexNet",
        ("alexnet-identical", lambda: twice(boxes()), Near(SAME, 0.0, _ON_ALEXNET)),
        ("alexnet-one-image", lambda: (flat(0), flat(255)),
         Refused(TooFewSamples, "[1, 256]")),
        ("alexnet-in-0-to-1", lambda: twice(boxes() / 255),
         Refused(ValueError, "images must be uint8")),
    ),
)  # fmt: skip


_DISTS_WHITE_BLACK = 0.373687821513  # float64, by the code of DISTS_pytorch 0.1
_DISTS_SINGLE = 1e-5  # its error in float32

LEARNED_CASES = (
    *cases_of("dists", "learned judges on request",
        ("dists-identical", lambda: twice(noise(5)), Near("0", 0.0)),
        ("dists-white", lambda: twice(flat(255)), Near("0, though nothing varies", 0.0)),
        ("dists-white-against-black", lambda: (flat(255), flat(0)),
         Near("that of the original", _DISTS_WHITE_BLACK, _DISTS_SINGLE)),
        ("dists-swapped", lambda: (flat(0), flat(255)),
         Near("symmetric", _DISTS_WHITE_BLACK, _DISTS_SINGLE)),
        ("dists-no-images", lambda: twice(flat(0, 0)), Near("no values", lambda a, b: np.empty(0))),
        ("dists-in-0-to-1", lambda: (flat(255) / 255, flat(0) / 255),
         Refused(ValueError, "images must be uint8 [N, H, W, 3], got float64")),
        ("dists-another-size", lambda: (flat(0, side=64), flat(0)),
         Refused(ValueError, "must have the same shape")),
        ("dists-too-small", lambda: twice(flat(0, side=15)),
         Refused(ValueError, "of 16 x 16 pixels or more")),
    ),
)  # fmt: skip
