"""LDR-FLIP: how much a viewer notices who flips back and forth between two images.

It is computed by the package of its authors.

Source: Andersson, Nilsson, Akenine-Moeller, Oskarsson, Astroem and Fairchild, "FLIP: a difference
evaluator for alternating images", HPG 2020; package `flip-evaluator` 1.7, a native module of 1 MB
that needs NumPy alone. Images are sRGB, and the viewer sees the package's default of 67 pixels per
degree: a screen 0.7 m wide with 3,840 pixels across, from 0.7 m away.

The package is optional: without it, or with another version, the metric is skipped.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import Distribution, distribution
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from bench.metrics.image_arrays import require_pairs, require_rgb, require_some
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.packaged_weights import require_version
from data_prep.arrays import Floats

PACKAGE, VERSION = "flip-evaluator", "1.7"
REMEDY = f"run 'pip install --no-deps {PACKAGE}=={VERSION}'"


def flip_module(
    find_distribution: Callable[[str], Distribution] = distribution,
    load: Callable[[str], ModuleType] = import_module,
) -> ModuleType:
    """Import the package and return its module.

    Raises WeightsUnavailable, with the remedy, where the package is absent, has another version or
    cannot be imported.
    """
    require_version(PACKAGE, VERSION, REMEDY, find_distribution)
    try:
        return load("flip_evaluator")
    except ImportError as error:  # built for another Python or C library
        raise WeightsUnavailable(f"{PACKAGE}: {error}; {REMEDY}") from error


def flip(truth: NDArray[np.uint8], images: NDArray[np.uint8]) -> Floats:
    """Return the mean FLIP error [N], 0..1, of sRGB images against true ones, uint8 [N, H, W, 3].

    Lower is better; 0 for identical images, and symmetric. The errors of pixels are in float32. A
    value does not depend on the other images of the stack. Raises ValueError for other arrays, and
    WeightsUnavailable as `flip_module`.
    """
    require_pairs(truth, images)
    require_some(truth)
    require_rgb(truth)
    evaluate = flip_module().evaluate
    values = np.empty(len(truth))
    for number, pair in enumerate(zip(truth, images, strict=True)):
        reference, test = (image.astype(np.float32) / np.float32(255) for image in pair)
        errors, _, _ = evaluate(reference, test, "LDR", applyMagma=False, computeMeanError=False)
        # The package's own mean is off by 1e-4, as it adds up in float32.
        values[number] = errors.mean(dtype=np.float64)
    return values
