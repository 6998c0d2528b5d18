"""Images for comparisons of similarities with other implementations."""

from __future__ import annotations

import numpy as np


def pattern(side, phase=0.0, gain=1.0):
    """Return a coloured pattern of slow and fast waves, uint8 [1, side, side, 3]."""
    y, x = np.mgrid[:side, :side] * (2 * np.pi / side)
    channels = [
        120 + gain * (60 * np.sin(3 * x + k + phase) * np.cos(2 * y) + 50 * np.sin(11 * y + 7 * x))
        for k in range(3)
    ]
    return np.clip(np.stack(channels, axis=-1), 0, 255).round().astype(np.uint8)[None]


def disc(level=80, column=64, radius=30):
    """Return a disc on white, uint8 [1, 128, 128, 3]."""
    rows, columns = np.mgrid[:128, :128]
    image = np.full((1, 128, 128, 3), 255, np.uint8)
    image[0, (rows - 64) ** 2 + (columns - column) ** 2 <= radius**2] = level
    return image


PAIRS = {
    "phase": lambda side: (pattern(side), pattern(side, 0.3)),
    "contrast": lambda side: (pattern(side), pattern(side, 0.0, 0.6)),
    "both": lambda side: (pattern(side, 0.1, 0.8), pattern(side, 0.4, 1.1)),
}
