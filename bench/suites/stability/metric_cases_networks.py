"""Features that networks find in pictures: Fréchet distances of them, and the judge's answers."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from bench.catalogue.metrics import JUDGE, Extractor, find_extractor
from bench.suites.stability.metric_cases import FD_VIEWS, UNIT_CODES, Case, Near, Stated, twice
from bench.suites.stability.metric_pictures import Pictures, boxes, flat, grey, noise, speck
from bench.suites.stability.metric_tolerances import FLOAT32_FEATURES, largest_move, rounding


@functools.cache
def extractor(name: str) -> Extractor:
    """A network of ours by its id, loaded once."""
    source = find_extractor(name)
    return source.load(str(source.weights(None)))


def _of_constants(name: str, a: Pictures, b: Pictures) -> float:
    """Squared distance of the features of two pictures."""
    features = extractor(name)
    return float(((features(a[:1])[0].astype(float) - features(b[:1])[0].astype(float)) ** 2).sum())


def _rounding_of(name: str, a: Pictures, b: Pictures) -> float:
    features = extractor(name)
    return rounding(features(a), features(b))


def _on_networks(stated: Callable[[str], Near]) -> dict[str, Stated]:
    return {name: stated(name) for name in FD_VIEWS}


_SAME = "0, not less, of 6 pictures and 64 features"

NETWORK_CASES = (
    Case(
        "identical-pictures",
        "features of pictures",
        lambda: twice(boxes()),
        _on_networks(lambda name: Near(_SAME, 0.0, functools.partial(_rounding_of, name)))
        | {JUDGE: UNIT_CODES},
    ),
    Case(
        "pictures-in-reverse",
        "features of pictures",
        lambda: (boxes(), boxes()[::-1]),
        _on_networks(lambda name: Near(_SAME, 0.0, largest_move(0.0, 64, 6, FLOAT32_FEATURES)))
        | {JUDGE: UNIT_CODES},
    ),
    Case(
        "white-pictures",
        "features of pictures",
        lambda: twice(flat(255, 3)),
        _on_networks(lambda name: Near(_SAME, 0.0, largest_move(0.0, 64, 3, FLOAT32_FEATURES)))
        | {JUDGE: UNIT_CODES},
    ),
    Case(
        "white-pictures-against-black",
        "features of pictures",
        lambda: (flat(255, 3), flat(0, 3)),
        _on_networks(
            lambda name: Near(
                "nothing varies: the squared distance of two feature vectors",
                functools.partial(_of_constants, name),
                lambda a, b: largest_move(
                    math.sqrt(_of_constants(name, a, b)), 64, 3, FLOAT32_FEATURES
                ),
            )
        )
        | {JUDGE: UNIT_CODES},
    ),
    Case(
        "colour-against-its-grey",
        "features of pictures",
        lambda: (boxes(), grey(boxes())),
        {
            "fd-views-grey": Near(
                "0: colour does not count", 0.0, functools.partial(_rounding_of, "fd-views-grey")
            )
        },
    ),
    Case(
        "noise-and-one-pixel",
        "features of pictures",
        lambda: (flat(255, 2), np.concatenate([noise(5), speck(255, 0, 0)])),
        {JUDGE: UNIT_CODES},
    ),
)
