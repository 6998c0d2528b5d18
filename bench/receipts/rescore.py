"""The check that stored scores and features are those of the stored images.

In another environment a method may draw other pixels, but of the same pixels the metrics are the
same but for rounding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import (
    LEARNED_METRICS,
    find_extractor,
    lpips_network,
    metrics_device,
)
from bench.metrics.image_scores import scores
from bench.receipts.compare import StoredJob
from bench.receipts.digests import job_title
from bench.records.artifacts import IMAGES
from bench.records.job import Job
from data_prep.arrays import Floats
from data_prep.scene import UInt8Images

# Networks compute in float32, whose sums over thousands of terms differ by 1e-5 of the largest.
ROUNDING = 1e-4
# A turn of 12 chairs x 3 views by 0.1 degree, which stands for another driver as in
# `bench.checking.tolerances`, left at least 0.9963 of the SSIM of a chair: three times that loss.
TRUE_IMAGES = 0.012


def misscored(job: Job, stored: StoredJob, truth: UInt8Images | None) -> list[str]:
    """Return a line for each score or feature of a job that is not that of its stored images.

    `truth` are the stored true images of its object; None for the ground truth itself.
    """
    if IMAGES not in stored.arrays:
        return []
    images: UInt8Images = stored.arrays[IMAGES]
    title, device = job_title(job.name), metrics_device(job.device)
    lines = []
    for name, weights in job.features:
        values = find_extractor(name).load(weights, device)(images)
        if not _close(stored.arrays.get(name), values):
            lines.append(f"{title}: features of {name} are not those of its images in the run")
    if truth is None:
        return lines
    scored: dict[str, Floats] = dict(scores(truth, images))
    if weights := dict(job.features).get(LEARNED_METRICS["lpips"]):
        network = lpips_network(weights, device)
        scored["lpips"] = network.distance(network.encode(truth), network.encode(images))
    for name, values in scored.items():
        stored_values = [getattr(record, name) for record in stored.records]
        was = np.array([np.nan if value is None else value for value in stored_values])
        if not _close(was, np.where(np.isfinite(values), values, np.nan)):
            most = float(np.nanmax(np.abs(was - values), initial=0.0))
            lines.append(f"{title}: {name} is not that of its images in the run, by {most:.3g}")
    return lines


def other_truth(job: Job, stored: StoredJob, here: StoredJob) -> list[str]:
    """Return a line where true images differ by more than other drivers make them differ."""
    was, now = stored.arrays[IMAGES], here.arrays[IMAGES]
    if was.shape != now.shape:
        return [f"{job_title(job.name)}: images {list(was.shape)}, here {list(now.shape)}"]
    similarity = float(np.mean(scores(now, was)["ssim"]))
    if similarity >= 1 - TRUE_IMAGES:
        return []
    return [
        f"{job_title(job.name)}: ssim {similarity:.4f} to the true images here, at least "
        f"{1 - TRUE_IMAGES:.3f} expected"
    ]


def _close(first: object, second: NDArray[np.floating]) -> bool:
    """Return whether two arrays are the same but for rounding."""
    if not isinstance(first, np.ndarray) or first.shape != second.shape:
        return False
    largest = float(np.nanmax(np.abs(second), initial=0.0))
    return np.allclose(first, second, rtol=0, atol=ROUNDING * max(largest, 1e-3), equal_nan=True)
