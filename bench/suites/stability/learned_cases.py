"""Cases on the judges that were trained on photographs: LPIPS, DISTS, sets of their features."""

from __future__ import annotations

import functools
import math

import numpy as np

from bench.metrics.frechet import TooFewSamples
from bench.suites.stability.feature_cases import SAME, of_constants, rounding_of
from bench.suites.stability.metric_cases import (
    FLOAT32_FEATURES,
    Near,
    Refused,
    U,
    boxes,
    cases,
    cases_of,
    flat,
    largest_move,
    near,
    noise,
    refused,
    twice,
)
from data_prep.scene import UInt8Images

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
_SHARES = ("alexnet-precision", "alexnet-recall")


def _one_of(images: UInt8Images) -> UInt8Images:
    """Return as many images, all of them the first: mode collapse."""
    return np.repeat(images[:1], len(images), axis=0)


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
    *cases_of("fd-effnet", "learned judges on request",
        ("effnet-identical", lambda: twice(boxes()),
         Near(SAME, 0.0, functools.partial(rounding_of, "fd-effnet"))),
        ("effnet-white-against-black", lambda: (flat(255, 3), flat(0, 3)),
         Near("nothing varies: the squared distance of two feature vectors",
              functools.partial(of_constants, "fd-effnet"),
              lambda a, b: largest_move(
                  math.sqrt(of_constants("fd-effnet", a, b)), 1280, 3, FLOAT32_FEATURES))),
        ("effnet-one-image", lambda: (flat(0), flat(255)), Refused(TooFewSamples, "[1, 1280]")),
        ("effnet-in-0-to-1", lambda: twice(boxes() / 255),
         Refused(ValueError, "images must be uint8")),
        ("effnet-too-small", lambda: twice(flat(0, 3, side=31)),
         Refused(ValueError, "of 32 x 32 pixels or more")),
    ),
    *cases("learned judges on request",
        ("shares-identical", lambda: twice(boxes(12)), near("1", 1.0, *_SHARES)),
        ("shares-white-against-black", lambda: (flat(255, 12), flat(0, 12)),
         near("0", 0.0, *_SHARES)),
        ("shares-of-one-image-again-and-again", lambda: (boxes(12), _one_of(boxes(12))),
         near("it is a true one", 1.0, "alexnet-precision")
         | near("one true image of 12", 1 / 12, "alexnet-recall", within=U)),
        ("shares-of-10-images", lambda: twice(boxes(10)),
         refused("features must be [n, d] with n > 10, got [10, 256]", *_SHARES)),
        ("shares-in-0-to-1", lambda: twice(boxes(12) / 255),
         refused("images must be uint8", *_SHARES)),
    ),
)  # fmt: skip
