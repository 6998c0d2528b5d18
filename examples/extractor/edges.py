"""Distances for pc2pix-bench by where an image has edges: no network, but any would do."""

import numpy as np

from bench.catalogue.plugins import SetMetric

CELLS = 8  # a side


def edges(images):
    """Mean step of grey levels in 8 x 8 parts of images uint8 [V, H, W, 3]: float64 [V, 64]."""
    grey = images.mean(axis=3) / 255
    steps = np.abs(np.diff(grey, axis=1, append=1.0)) + np.abs(np.diff(grey, axis=2, append=1.0))
    count, height, width = steps.shape
    parts = steps.reshape(count, CELLS, height // CELLS, CELLS, width // CELLS)
    return parts.mean(axis=(2, 4)).reshape(count, -1)


METRIC = SetMetric(
    "fd-edges",
    features=edges,
    version=1,  # raised when a change here alters its values
    about="distances on where images have edges",
)
