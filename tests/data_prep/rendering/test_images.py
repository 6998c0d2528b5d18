from __future__ import annotations

from fractions import Fraction

import numpy as np

from data_prep.rendering.images import blank, to_float, to_uint8

LEVELS = np.arange(256, dtype=np.uint8)


def test_all_levels_there_and_back() -> None:
    there = to_float(LEVELS)
    assert there.dtype == np.float32
    np.testing.assert_array_equal(there, (np.arange(256) / 255).astype(np.float32))  # the nearest
    back = to_uint8(there)
    assert back.dtype == np.uint8
    np.testing.assert_array_equal(back, LEVELS)


def test_halves_are_rounded_up() -> None:
    half = np.arange(255, dtype=np.float32) + np.float32(0.5)
    values = half / np.float32(255)
    exact = values * np.float32(255) == half  # others are no ties in float32
    even = np.arange(255) % 2 == 0  # half to even would send these down
    assert (exact & even).sum() > 50
    np.testing.assert_array_equal(to_uint8(values)[exact], LEVELS[1:][exact])


def test_agrees_with_exact_arithmetic_and_clips_what_is_outside() -> None:
    values = np.random.default_rng(0).random(5000, dtype=np.float32)
    exact = [255 * Fraction(float(v)) + Fraction(1, 2) for v in values]
    # Two roundings of values below 256: an ulp is 2**-16 at most. Nearer to a tie either is right.
    clear = np.array([min(e % 1, 1 - e % 1) > Fraction(1, 2**15) for e in exact])
    assert clear.mean() > 0.99
    np.testing.assert_array_equal(to_uint8(values)[clear], np.array([int(e) for e in exact])[clear])
    values = np.array([-np.inf, -7, -1e-9, 1 + 1e-6, 2, np.inf], np.float32)
    assert to_uint8(values).tolist() == [0, 0, 0, 255, 255, 255]


def test_blank_is_white() -> None:
    images = blank(3)
    assert images.shape == (3, 128, 128, 3)
    assert images.dtype == np.uint8
    assert (images == 255).all()
    assert blank(0).shape == (0, 128, 128, 3)
    images[0] = 0
    assert (blank(1) == 255).all()  # each caller has its own
