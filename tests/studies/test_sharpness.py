from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from studies.sharpness import lightness, sharpness, summary


def halves(dark: int, ramp: int = 0) -> np.ndarray:
    """Return an image [1, 64, 64, 3], white on the left and grey on the right of a ramp."""
    row = np.full(64, 255.0)
    row[32 + ramp :] = dark
    row[32 : 32 + ramp] = np.linspace(255, dark, ramp + 2)[1:-1]
    return np.broadcast_to(row.round().astype(np.uint8)[None, None, :, None], (1, 64, 64, 3))


def test_a_step_has_half_its_height_as_gradient() -> None:
    # 2 % of 64 x 64 pixels are 82, and central differences see a step in two columns of 64
    assert sharpness(halves(55)) == pytest.approx([200 / 255 / 2])
    assert sharpness(np.full((2, 64, 64, 3), 128, np.uint8)).tolist() == [0, 0]


def test_a_ramp_is_less_sharp_by_its_width() -> None:
    # over 9 steps the height falls in equal parts of 20 grey levels: a tenth of 180
    ratio = sharpness(halves(75, 8)) / sharpness(halves(75))
    assert ratio == pytest.approx([2 * 20 / 180], rel=1e-6)


def test_lightness_is_of_the_pixels_that_both_show() -> None:
    true, drawn = halves(55), np.array(halves(75))
    drawn[:, :, 48:] = 255
    assert lightness(true, drawn) == (pytest.approx(55 / 255), pytest.approx(20 / 255))
    assert np.isnan(lightness(true, np.full_like(true, 255))).all()


def test_the_summary_tells_dark_from_light_objects() -> None:
    values = pd.DataFrame(
        {
            "method": ["a"] * 3,
            "condition": ["2048"] * 3,
            "luma": ["dark", "light", "dark"],
            "sharpness": [0.5, 1.0, 0.9],
            "lightness": [0.2, -0.1, 0.4],
        }
    )
    (line,) = summary(values).to_dict("records")
    assert line == {
        "method": "a",
        "condition": "2048",
        "sharpness": pytest.approx(0.8),
        "lightness, dark": pytest.approx(0.3),
        "lightness, light": pytest.approx(-0.1),
    }
