"""What a metric of another package has to keep to."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.plugins import ImageMetric, find_metric
from bench.checking.contract.findings import VIEWS, Broken, Finding, tried
from data_prep.datasets import ProceduralObject
from data_prep.scene import UInt8Images


def metric_findings(metric_id: str) -> Iterator[Finding]:
    """All findings about a metric of another package. Raises BadInput for an unknown one."""
    metric = find_metric(metric_id)
    truth = ProceduralObject("chair", "validation", 0).truth(VIEWS)
    drawn = ProceduralObject("chair", "validation", 1).truth(VIEWS)
    white = np.full_like(truth, 255)
    if isinstance(metric, ImageMetric):
        value: Callable[[UInt8Images, UInt8Images], NDArray[np.floating]] = metric.score
        size: tuple[int, ...] = (len(VIEWS),)
        pairs = {"images": (truth, drawn), "white images": (truth, white), "no images": None}
    else:
        features = metric.features
        value, size = lambda _, images: features(images), ()
        pairs = {"images": (drawn, drawn), "white images": (white, white), "no images": None}

    def taken(name: str, pair: tuple[UInt8Images, UInt8Images] | None) -> str:
        a, b = pair or (truth[:0], drawn[:0])
        found = np.asarray(value(a, b), np.float64)
        if found.ndim != (1 if size else 2) or len(found) != len(b):
            raise Broken(f"gives the shape {found.shape} for {len(b)} {name}")
        if not np.isfinite(found).all():
            raise Broken(f"{int((~np.isfinite(found)).sum())} of {found.size} are not finite")
        again = np.asarray(value(a.copy(), b.copy()), np.float64)
        if not np.array_equal(found, again):
            raise Broken("another value the second time")
        return str(list(found.shape))

    def apart() -> str:
        whole = np.asarray(value(truth, drawn), np.float64)
        alone = [value(truth[i : i + 1], drawn[i : i + 1]) for i in range(len(VIEWS))]
        if not np.allclose(whole, np.concatenate(alone), rtol=1e-5, atol=1e-8):
            raise Broken("an image has another value alone than among others")
        return "the same alone and among others"

    def ordered() -> str:
        assert isinstance(metric, ImageMetric)
        same, other = (float(np.mean(value(truth, images))) for images in (truth, drawn))
        if same != other and (same > other) != metric.higher_is_better:
            better = "higher" if metric.higher_is_better else "lower"
            raise Broken(
                f"identical images have {same:.4g}, others {other:.4g}: {better} is better?"
            )
        return f"identical images {same:.4g}, another object {other:.4g}"

    for name, pair in pairs.items():
        yield tried(name, lambda name=name, pair=pair: taken(name, pair))
    yield tried("one by one", apart)
    if isinstance(metric, ImageMetric):
        yield tried("direction", ordered)
