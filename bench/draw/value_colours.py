"""Colours of points by a number that each has: its height, or a column of its file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.files.safe_read import shown
from data_prep.scene import NEUTRAL_GREY

WORDS = ("auto", "file", "grey", "invented")  # colours that are no names of columns
HEIGHT = "height"  # along the axis that points up, in the units of the file
_MAP = "viridis"  # Matplotlib's map: lightness grows evenly from dark blue to yellow
# The range is cut at these shares of the points, as single echoes of a scanner are far brighter
# than all others.
_CUT = (0.01, 0.99)
_MOST_LABELS = 32  # with so many different values or fewer they are labels, and nothing is cut


def column_of(colour: str) -> str:
    """Return the column that the value of --colour names; "" for another colour and the height."""
    return "" if colour in (*WORDS, HEIGHT) else colour


def no_column(colour: str, names: Sequence[str]) -> str:
    """Return what is wrong with the name of a column that is not among `names`."""
    return f"no column {shown(colour)}; give {_choices(names)}"


def _choices(names: Sequence[str]) -> str:
    columns = shown(", ".join(dict.fromkeys((HEIGHT, *filter(None, names)))))
    return f"one of {columns}, or {', '.join(WORDS[:-1])} or {WORDS[-1]}"


@dataclass(frozen=True)
class ValueScale:
    """The range of values that is drawn from the dark end of the map to the bright one."""

    low: float
    high: float

    def colors(self, values: Floats) -> NDArray[np.uint8]:
        """Return colours uint8 [N, 3]; neutral grey for a value that is not finite."""
        from matplotlib import colormaps

        finite = np.isfinite(values)
        colors = np.empty((len(values), 3), np.uint8)
        colors[~finite] = NEUTRAL_GREY
        shares = (values[finite] - self.low) / (self.high - self.low)
        colors[finite] = colormaps[_MAP](np.clip(shares, 0, 1), bytes=True)[:, :3]
        return colors


def scale_of(name: str, values: Floats, names: Sequence[str]) -> tuple[ValueScale, tuple[str, ...]]:
    """Return the range of values [N] in which colours tell them apart, and notes on it.

    The height has its whole range, and so have labels; of others the lowest and highest per cent
    are cut.

    names  the columns that there are

    Raises BadInput where no value is finite, or all of them are equal.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        raise BadInput(f"no value of {shown(name)} is a number; give {_choices(names)}")
    low, high = float(finite.min()), float(finite.max())
    if low == high:
        raise BadInput(f"all values of {shown(name)} are {low:g}; give {_choices(names)}")
    beyond = 0
    if name != HEIGHT and len(np.unique(finite)) > _MOST_LABELS:
        first, last = np.quantile(finite, _CUT).tolist()
        if first < last:
            low, high = first, last
            beyond = int(np.count_nonzero((finite < low) | (finite > high)))
    note = f"{name}: {low:.6g} to {high:.6g}, from dark to bright ({_MAP})"
    if beyond:
        note += f"; {beyond} of {len(finite)} values beyond have the colours of the ends"
    missing = len(values) - len(finite)
    if missing:
        return ValueScale(low, high), (note, f"{missing} points without {name} are grey")
    return ValueScale(low, high), (note,)
