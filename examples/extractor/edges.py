"""Distances for pc2pix-bench on the edges of an image, in place of features of a network."""

import numpy as np

from bench.catalogue.plugins import SetMetric

CELLS = 8  # a side


def edges(images):
    """Return mean steps of grey levels, float64 [V, 64], in 8 x 8 parts of uint8 [V, H, W, 3]."""
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
