"""CW-SSIM by published values, and what it is for: small shifts; closed forms and refusals are in
`test_extreme_inputs`."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.wavelet_similarity import cw_ssim

from .similarity_images import PAIRS, disc

FILTERS_IN_FLOAT32 = 2e-6  # there, and read from tables of 1,024 steps
# Of 128 px, the mean over channels of CW_SSIM(channels=1, test_y_channel=False, K=4**6) of PyTorch
# Toolbox for Image Quality Assessment 0.1.16 in float64, 2026-11-25.
PUBLISHED = {"phase": 0.99804225, "contrast": 0.89398827, "both": 0.95390588}


@pytest.mark.parametrize("name", PAIRS)
def test_published_values(name):
    a, b = PAIRS[name](128)
    assert cw_ssim(a, b)[0] == pytest.approx(PUBLISHED[name], abs=FILTERS_IN_FLOAT32)


def test_a_small_shift_costs_a_tenth_of_what_it_costs_ssim():
    """Stripes 4 px wide lose their structure, and their outline in the wavelets next to nothing."""
    image = disc()
    image[:, 40:88, 40:88:8] = 255
    moved = np.roll(image, 1, axis=2)
    lost = 1 - cw_ssim(image, moved)[0], 1 - ssim_per_image(image, moved).ssim[0]
    assert 0 < 10 * lost[0] < lost[1]


def test_the_more_it_moves_the_less_it_is_like_itself():
    values = [cw_ssim(disc(), disc(column=64 + by))[0] for by in (0, 1, 4, 12, 32)]
    assert values == sorted(values, reverse=True)
    assert values[0] == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("faint", [0.3, 0.5])
def test_a_fainter_wave_has_a_closed_form(faint):
    """Amplitudes A and f A of one wave: (2 f g + K) / ((1 + f^2) g + K) with g in each orientation,
    which is 2 f / (1 + f^2) where K is small beside g, and 1 where an orientation has nothing."""
    columns = np.arange(128)
    a, b = (
        np.broadcast_to(
            np.round(127 + gain * 100 * np.cos(2 * np.pi * columns / 32))[None, None, :, None],
            (1, 128, 128, 3),
        ).astype(np.uint8)
        for gain in (1.0, faint)
    )
    # Of 8 orientations b the response is cos(pi b / 8)^7 of the largest, on one side.
    largest = 2 * 2**7 * 5040 / np.sqrt(8 * 87178291200)  # 7! and 14!
    gains = [(largest * max(np.cos(np.pi * b / 8), 0) ** 7 * 50) ** 2 for b in range(8)]
    # The wave's other frequency is at 180 degrees, seen by the orientations beyond 90.
    gains = [
        g + (largest * max(-np.cos(np.pi * b / 8), 0) ** 7 * 50) ** 2 for b, g in enumerate(gains)
    ]
    expected = np.mean([(2 * faint * g + 1) / ((1 + faint**2) * g + 1) for g in gains])
    assert cw_ssim(a, b)[0] == pytest.approx(expected, abs=2e-3)  # levels are rounded by half a one
