"""Intersection over union of silhouettes: boxes and legs whose pixels can be counted."""

from __future__ import annotations

import numpy as np

from bench.suites.stability.metric_cases import Case, Near, Refused, Stated, twice
from bench.suites.stability.metric_pictures import flat, leg, noise
from bench.suites.stability.metric_tolerances import U

SILHOUETTE = "silhouette-iou"


def _stated(words: str, value: float, within: float = 0.0) -> dict[str, Stated]:
    return {SILHOUETTE: Near(words, value, within)}


def _refused(says: str) -> dict[str, Stated]:
    return {SILHOUETTE: Refused(ValueError, says)}


SILHOUETTE_CASES = (
    Case("same-leg", "silhouettes", lambda: twice(leg()), _stated("the same pixels", 1.0)),
    Case("same-noise", "silhouettes", lambda: twice(noise(3)), _stated("the same pixels", 1.0)),
    Case(
        "nothing-on-nothing",
        "silhouettes",
        lambda: twice(flat(255)),
        _stated("neither shows anything: they agree", 1.0),
    ),
    Case(
        "nothing-of-a-leg",
        "silhouettes",
        lambda: (leg(), flat(255)),
        _stated("nothing of 120 px", 0.0),
    ),
    Case(
        "a-leg-on-nothing",
        "silhouettes",
        lambda: (flat(255), leg()),
        _stated("120 px where nothing is", 0.0),
    ),
    Case(
        "half-a-leg",
        "silhouettes",
        lambda: (leg(), leg(rows=slice(40, 60))),
        _stated("20 of 40 rows", 0.5),
    ),
    Case(
        "shifted-leg",
        "silhouettes",
        lambda: (leg(), leg(columns=slice(61, 64))),
        _stated("2 of 3 columns drawn, 1 beside them: 2 / 4", 0.5),
    ),
    Case(
        "a-leg-painted-over",
        "silhouettes",
        lambda: (leg(), flat(0)),
        _stated("120 px of 128 x 128", 120 / 128**2, U),
    ),
    Case(
        "a-leg-in-another-colour",
        "silhouettes",
        lambda: (leg(0), leg(217)),
        _stated("contrast 38 of the 37.5 asked for: what is in it does not count", 1.0),
    ),
    Case(
        "a-leg-too-faint",
        "silhouettes",
        lambda: (leg(0), leg(218)),
        _stated("contrast 37 of the 37.5 asked for", 0.0),
    ),
    Case(
        "haze-around-a-leg",
        "silhouettes",
        lambda: (leg(), np.minimum(leg(), flat(218))),
        _stated("contrast 37 all over the background is no object", 1.0),
    ),
    Case(
        "a-light-leg-in-haze",
        "silhouettes",
        lambda: (leg(235), np.minimum(leg(235), flat(245))),
        _stated("contrast 10, half of the leg's, all over: 120 px of 128 x 128", 120 / 128**2, U),
    ),
    Case(
        "faintest-haze-on-nothing",
        "silhouettes",
        lambda: (flat(255), flat(218)),
        _stated("contrast 37 of the 37.5 asked for where nothing is", 1.0),
    ),
    Case(
        "silhouettes-of-no-images",
        "silhouettes",
        lambda: twice(flat(0, 0)),
        {SILHOUETTE: Near("of no images none", lambda a, b: np.empty(0))},
    ),
    Case(
        "silhouettes-of-two-images",
        "silhouettes",
        lambda: (np.concatenate([leg(), leg()]), np.concatenate([leg(), flat(255)])),
        {SILHOUETTE: Near("each by itself", lambda a, b: [1.0, 0.0])},
    ),
    Case(
        "silhouettes-in-0-to-1",
        "silhouettes",
        lambda: (flat(255) / 255, leg() / 255),
        _refused("images must be uint8"),
    ),
    Case(
        "silhouettes-without-a-stack",
        "silhouettes",
        lambda: twice(leg()[0]),
        _refused("[128, 128, 3]"),
    ),
    Case(
        "silhouettes-of-another-size",
        "silhouettes",
        lambda: (flat(0, side=64), flat(0)),
        _refused("of truths [1, 64, 64, 3]"),
    ),
)
