"""Errors of azimuth and elevation: wrapping, undecided answers, magnitudes, number formats."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bench.suites.stability.metric_cases import Array, Case, Near
from bench.suites.stability.metric_tolerances import ANGLE_DEG


def _answers(azimuth_deg: list[float], elevation_deg: float = 0.0) -> NDArray[np.float32]:
    """What a judge that is never wrong would say, float32 [n, 3]."""
    radians = np.radians(np.array(azimuth_deg, np.float64))
    elevation = np.full(len(radians), elevation_deg / 40)
    return np.stack([np.sin(radians), np.cos(radians), elevation], axis=1).astype(np.float32)


def _angles(case_id: str, answers: Callable[[], Array], asked: list[float], **stated: Near) -> Case:
    metrics = {f"{name}-error-deg": near for name, near in stated.items()}
    return Case(case_id, "angles", lambda: (answers(), np.array(asked, np.float64)), metrics)


ANGLE_CASES = (
    _angles("right", lambda: _answers([-170.0, 0.0, 90.0]), [-170.0, 0.0, 90.0],
            azimuth=Near("0", 0.0, ANGLE_DEG)),
    _angles("opposite", lambda: _answers([-90.0, 0.0]), [90.0, 180.0],
            azimuth=Near("the largest", 180.0, ANGLE_DEG)),
    _angles("both-sides-of-180", lambda: _answers([179.5, -180.0]), [-179.5, 180.0],
            azimuth=Near("wrapped", lambda a, b: [1.0, 0.0], ANGLE_DEG)),
    _angles("turned-ten-million-times", lambda: _answers([90.0]), [90.0 + 3.6e9],
            azimuth=Near("wrapped", 0.0, ANGLE_DEG)),
    _angles("undecided", lambda: np.zeros((2, 3), np.float32), [30.0, -120.0],
            azimuth=Near("0 / 0 is the azimuth 0", lambda a, b: np.abs(b), ANGLE_DEG),
            elevation=Near("0 is level", lambda a, b: np.abs(b))),
    _angles("answers-of-1e-40", lambda: np.float32(1e-40) * _answers([90.0]), [90.0],
            azimuth=Near("the length does not count", 0.0, ANGLE_DEG)),
    _angles("answers-of-1e38", lambda: np.float32(1e38) * _answers([45.0]), [45.0],
            azimuth=Near("the length does not count", 0.0, ANGLE_DEG)),
    _angles("answers-in-float16", lambda: _answers([30.0], 20.0).astype(np.float16), [20.0],
            # Sine and cosine are off by 2^-11 of themselves.
            azimuth=Near("30 - 20", 10.0, math.degrees(2.0**-11)),
            elevation=Near("20 - 20", 0.0)),
    _angles("ends-of-elevation", lambda: _answers([0.0, 0.0], 40.0), [40.0, -40.0],
            elevation=Near("0 and 80", lambda a, b: [0.0, 80.0])),
    _angles("answers-of-nan", lambda: np.full((2, 3), np.nan, np.float32), [0.0, 30.0],
            azimuth=Near("NaN stays NaN", math.nan), elevation=Near("NaN stays NaN", math.nan)),
    _angles("no-answers", lambda: np.empty((0, 3), np.float32), [],
            azimuth=Near("of no pictures none", lambda a, b: np.empty(0)),
            elevation=Near("of no pictures none", lambda a, b: np.empty(0))),
)  # fmt: skip
