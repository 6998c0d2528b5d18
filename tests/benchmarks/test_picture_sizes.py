from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.picture_sizes import SIZES, TESTED, resampled, sheet, to_markdown


def test_resampling_keeps_means_and_flat_pictures() -> None:
    pictures = np.random.default_rng(0).random((2, 128, 128, 3), np.float32)
    small = resampled(pictures, 64)
    assert np.allclose(small, pictures.reshape(2, 64, 2, 64, 2, 3).mean(axis=(2, 4)), atol=1e-6)
    assert resampled(pictures, 128) is pictures
    flat = np.full((1, 128, 128, 3), 0.25, np.float32)
    assert np.allclose(resampled(flat, 256), 0.25, atol=1e-6)
    edge = np.zeros((1, 128, 128, 3), np.float32)
    edge[:, :64] = 1
    large = resampled(edge, 256)  # bicubic overshoots at an edge: cut off
    assert large.shape == (1, 256, 256, 3)
    assert large.min() == 0
    assert large.max() == 1


def test_a_row_for_each_size_and_condition() -> None:
    found = pd.DataFrame(
        {"size": size, "way": way, "condition": c, "chair": i, "ssim": 0.9 - 0.1 * (way == "drawn"),
         "silhouette_iou": 0.5, "draw_ms": 3.0 if way == "drawn" else np.nan}
        for size in SIZES for c in TESTED for i in range(3) for way in ("drawn", "resampled")
    )  # fmt: skip
    lines = to_markdown(found).splitlines()
    assert len(lines) == 2 + len(SIZES) * len(TESTED)
    assert lines[2] == (
        "| 64 | 2048 | 0.800 [0.800, 0.800] | 0.900 [0.900, 0.900] | 0.500 [0.500, 0.500] "
        "| 0.500 [0.500, 0.500] | 3.0 |"
    )


def test_the_sheet_has_a_row_for_each_chair() -> None:
    shown = [np.full((size, size, 3), size % 256, np.uint8) for size in SIZES for _ in range(3)]
    made = np.asarray(sheet(shown * 2).convert("RGB"))
    assert made.shape == (2 * 256, 9 * 256, 3)
    assert made[0, ::256, 0].tolist() == [64] * 3 + [128] * 3 + [0] * 3  # 256 is 0 in uint8
