"""Image metrics and networks on no picture, one, two, and on arrays that are not pictures."""

from __future__ import annotations

import math

import numpy as np

from bench.catalogue.metrics import JUDGE
from bench.metrics.frechet import TooFewSamples
from bench.suites.stability.metric_cases import (
    FD_VIEWS,
    SSIM,
    THIN,
    UNIT_CODES,
    Case,
    Near,
    Refused,
    Stated,
    luminance_of_flat,
    twice,
)
from bench.suites.stability.metric_pictures import flat, leg
from bench.suites.stability.metric_tolerances import SUMS
from data_prep.scene import IMAGE_SIZE


def _refused_images(says: str, thin_says: str) -> dict[str, Stated]:
    stated: dict[str, Stated] = {
        metric: Refused(ValueError, says) for metric in (*SSIM, "ssim-object")
    }
    return stated | {metric: Refused(ValueError, thin_says) for metric in THIN}


def _refused_by_networks(of_grey: str = "pictures must be uint8 [..., 3]") -> dict[str, Stated]:
    whole: Stated = Refused(ValueError, "pictures must be uint8 [N, 128, 128, 3]")
    return {"fd-views": whole, "fd-views-grey": Refused(ValueError, of_grey), JUDGE: whole}


_NOT_UINT8 = (
    _refused_images("images must be uint8", "images must be uint8") | _refused_by_networks()
)

INPUT_CASES = (
    Case(
        "no-images",
        "number of images",
        lambda: twice(flat(0, 0)),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")}
        | {metric: Near("of no images none", lambda a, b: np.empty(0)) for metric in (*THIN, JUDGE)}
        | {metric: Refused(TooFewSamples, "[0, 64]") for metric in FD_VIEWS},
    ),
    Case(
        "one-image",
        "number of images",
        lambda: (flat(0), flat(255)),
        {
            "ssim": Near("one value", lambda a, b: [luminance_of_flat(0, 255)], SUMS),
            "fd-views": Refused(TooFewSamples, "[1, 64]"),
            "fd-views-grey": Refused(TooFewSamples, "[1, 64]"),
            JUDGE: UNIT_CODES,
        },
    ),
    Case(
        "two-images",
        "number of images",
        lambda: (
            np.concatenate([flat(0), leg()]),
            np.concatenate([flat(255), leg()]),
        ),
        {
            "ssim": Near("each by itself", lambda a, b: [luminance_of_flat(0, 255), 1.0], SUMS),
            "ssim-object": Near(
                "each by itself", lambda a, b: [luminance_of_flat(0, 255), 1.0], SUMS
            ),
            "thin-recall": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            "thin-precision": Near("each by itself", lambda a, b: [math.nan, 1.0]),
            JUDGE: UNIT_CODES,
        },
    ),
    Case(
        "nan-pixels",
        "not pictures",
        lambda: (flat(255) / 255, np.full((1, IMAGE_SIZE, IMAGE_SIZE, 3), np.nan)),
        _NOT_UINT8,
    ),
    Case(
        "floats-in-0-to-1",
        "not pictures",
        lambda: (flat(255).astype(np.float32) / 255, leg().astype(np.float32) / 255),
        _NOT_UINT8,
    ),
    Case(
        "whole-numbers-of-64-bits",
        "not pictures",
        lambda: (flat(255).astype(np.int64), leg().astype(np.int64)),
        _NOT_UINT8,
    ),
    Case(
        "only-one-is-uint8",
        "not pictures",
        lambda: (flat(255), leg() / 255),
        _NOT_UINT8,
    ),
    Case(
        "image-without-a-stack",
        "not pictures",
        lambda: twice(flat(0)[0]),
        _refused_images("[128, 128, 3]", "[128, 128, 3]")
        | _refused_by_networks("pictures must be uint8 [N, 128, 128, 3]"),
    ),
    Case(
        "two-dimensions",
        "not pictures",
        lambda: twice(flat(0)[0, :, :, 0]),
        _refused_images("[128, 128]", "[128, 128]") | _refused_by_networks(),
    ),
    Case(
        "another-size",
        "not pictures",
        lambda: (flat(0, side=64), flat(0)),
        _refused_images("must have the same shape", "of truths [1, 64, 64, 3]")
        | {metric: Refused(ValueError, "[1, 64, 64, 3]") for metric in FD_VIEWS},
    ),
    Case(
        "another-number-of-images",
        "not pictures",
        lambda: (flat(0), flat(0, 2)),
        _refused_images("must have the same shape", "of truths [1, 128, 128, 3]"),
    ),
    Case(
        "four-channels",
        "not pictures",
        lambda: twice(np.zeros((2, 128, 128, 4), np.uint8)),
        _refused_by_networks(),
    ),
    Case(
        "no-channels",
        "not pictures",
        lambda: twice(flat(0)[..., :0]),
        {metric: Refused(ValueError, "nothing to compare") for metric in (*SSIM, "ssim-object")},
    ),
)
