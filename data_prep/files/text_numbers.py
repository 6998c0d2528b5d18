"""Long texts of numbers, read at once."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray


def numbers_in(text: str, dtype: type = np.float64) -> NDArray[Any] | None:
    """Return all numbers of a text of numbers between white space; None where anything else stands.

    A reader then goes through its lines to name the one that is wrong.
    """
    if not text.strip():  # which NumPy takes for one number, -1
        return np.empty(0, dtype)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy warns and stops where it finds no number
        try:
            return np.fromstring(text, dtype, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
