"""Cases on metrics that no suite has: multi-scale and wavelet similarity, FLIP.

Tolerances: a mean of SSIM's windows errs by `SUMS`, and a power below 1 of it by less; the bands of
a flat image err by 1e-12 of 255, beside K = 1. FLIP computes in float32.
"""

from __future__ import annotations

import numpy as np

from bench.suites.stability.image_cases import one_window
from bench.suites.stability.metric_cases import (
    ONE_WINDOW,
    SUMS,
    WINDOW,
    cases,
    flat,
    leg,
    luminance_of_flat,
    near,
    noise,
    refused,
    twice,
)
from data_prep.scene import IMAGE_SIZE, UInt8Images

MS_SSIM, CW_SSIM, FLIP = "ms-ssim", "cw-ssim", "flip"
OF_PIXELS = (MS_SSIM, CW_SSIM, FLIP)
COARSEST = 0.2363 / (0.0448 + 0.2856 + 0.3001 + 0.2363)  # weight of the fourth scale
BANDS = 1e-9
FLOAT32 = 1e-6
WHITE_BLACK = 0.967388  # of every pixel, printed by the tool `flip` of the package, version 1.7


def _waves(shift: int) -> UInt8Images:
    """Return vertical stripes with a period of 32 px, moved by some pixels."""
    columns = np.arange(IMAGE_SIZE) + shift
    row = np.round(127.5 + 100 * np.sin(2 * np.pi * columns / 32)).astype(np.uint8)
    return np.repeat(np.tile(row, (1, IMAGE_SIZE, 1))[..., None], 3, axis=-1)


_SAME = (
    near("identical", 1.0, MS_SSIM)
    | near("identical", 1.0, CW_SSIM, within=BANDS)
    | near("identical", 0.0, FLIP)
)

SIMILARITY_CASES = (
    *cases(
        "similarities and distances",
        ("similarity-of-the-same-noise", lambda: twice(noise(1)), _SAME),
        ("similarity-of-the-same-leg", lambda: twice(leg()), _SAME),
        ("similarity-of-white", lambda: twice(flat(255)), _SAME),
        ("similarity-of-black", lambda: twice(flat(0)), _SAME),
        ("similarity-of-white-and-black", lambda: (flat(255), flat(0)),
         near("luminance to the power of the fourth scale's weight",
              luminance_of_flat(0, 255) ** COARSEST, MS_SSIM, within=SUMS)
         | near("no structure in either", 1.0, CW_SSIM, within=BANDS)
         | near("that of the package's tool", WHITE_BLACK, FLIP, within=FLOAT32)),
        ("similarity-of-black-and-white", lambda: (flat(0), flat(255)),
         near("symmetric", WHITE_BLACK, FLIP, within=FLOAT32)),
        ("similarity-of-noise-and-its-negative",
         lambda: (noise(2, WINDOW), 255 - noise(2, WINDOW)),
         near("one scale, whose structure is negative", 0.0, MS_SSIM)),
        ("similarity-of-7x7", lambda: (noise(7, 7), noise(107, 7)),
         near("one scale of one window: ssim, at least 0",
              lambda a, b: max(one_window("ssim", a, b), 0.0), MS_SSIM, within=ONE_WINDOW)
         | refused("sides must be multiples of 8, at least 64", CW_SSIM)),
        # A coefficient of a stripe turns by 360 degrees / 32, all of them alike.
        ("stripes-moved-by-one-pixel", lambda: (_waves(0), _waves(1)),
         near("a shift of phases alone", 1.0, CW_SSIM, within=1e-3)),
        ("stripes-against-their-negative", lambda: (_waves(0), _waves(16)),
         near("a shift of phases alone", 1.0, CW_SSIM, within=1e-3)
         | near("structure is negative", 0.0, MS_SSIM)),
        ("similarity-of-no-images", lambda: twice(flat(0, 0)),
         refused("nothing to compare", *OF_PIXELS)),
        ("similarity-of-nan-pixels",
         lambda: (flat(255) / 255, np.full((1, IMAGE_SIZE, IMAGE_SIZE, 3), np.nan)),
         refused("images must be uint8", *OF_PIXELS)),
        ("similarity-of-another-size", lambda: (flat(0, side=64), flat(0)),
         refused("the same shape", *OF_PIXELS)),
        ("similarity-of-four-channels", lambda: twice(np.zeros((2, 128, 128, 4), np.uint8)),
         refused("images must be [N, H, W, 3]", FLIP)),
    ),
)  # fmt: skip
