"""Axes of the report's plots: from values to pixels, round ticks, labels side by side. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

WIDE = 20.0  # positive values whose greatest is so many times the least have a logarithmic axis
PAD = 0.06  # of the values' reach, at both ends


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high` on pixels from `start` to `end`."""

    low: float
    high: float
    start: float
    end: float
    logarithmic: bool

    def at(self, value: float) -> float:
        """The pixel of a value; of what lies beyond the axis (0 on a logarithmic one), its end."""
        low, high = self._scale(self.low), self._scale(self.high)
        inside = min(max(value, self.low), self.high)
        return self.start + (self._scale(inside) - low) / (high - low) * (self.end - self.start)

    def ticks(self, most: int = 6) -> list[tuple[float, str]]:
        """Round values in the axis' reach as (pixel, label)."""
        values = self._powers(most) if self.logarithmic else self._steps(most)
        return [(self.at(value), f"{value:g}") for value in values]

    def _scale(self, value: float) -> float:
        return math.log10(value) if self.logarithmic else value

    def _powers(self, most: int) -> list[float]:
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        for digits in ((1, 2, 5), (1, 3), (1,)):
            values = [digit * 10.0**power for power in range(first, last + 1) for digit in digits]
            values = [value for value in values if self.low <= value <= self.high]
            if len(values) <= most:
                break
        return values

    def _steps(self, most: int) -> list[float]:
        rough = (self.high - self.low) / most
        power = 10.0 ** math.floor(math.log10(rough))
        step = next(s for s in (power, 2 * power, 5 * power, 10 * power) if s >= rough * (1 - 1e-9))
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        digits = max(0, 2 - math.floor(math.log10(step)))
        return [round(number * step, digits) for number in range(first, last + 1)]


def axis_of(
    values: Sequence[float], start: float, end: float, logarithmic: bool | None = None
) -> Axis:
    """An axis on which all finite values have room.

    logarithmic  None: where all are positive and far apart. Otherwise what is asked for; the axis
                 of a logarithm leaves out what is not positive.

    Without any value it goes from 0 to 1, with equal ones a little to both sides.
    """
    finite = [value for value in values if math.isfinite(value)]
    if logarithmic is None:
        logarithmic = bool(finite) and min(finite) > 0 and max(finite) / min(finite) > WIDE
    if logarithmic:
        finite = [math.log10(value) for value in finite if value > 0]
    low, high = (min(finite), max(finite)) if finite else (0.0, 1.0)
    pad = PAD * (high - low) or 0.1 * max(abs(low), 1.0)
    low, high = low - pad, high + pad
    if logarithmic:
        low, high = 10.0**low, 10.0**high
    return Axis(low, high, start, end, logarithmic)


def axis_with_room(
    values: Sequence[float], ends: Sequence[float], start: float, end: float
) -> Axis:
    """The axis of `values` on which `ends`, of their intervals say, have room too.

    The values alone decide about a logarithm: an interval that reaches down to 0 ends at the axis.
    """
    return axis_of(ends, start, end, axis_of(values, start, end).logarithmic)


def spread(wanted: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """Places near the wanted ones, in their order, `gap` apart and from `low` to `high`.

    Where there is no room for all they go on beyond `low`.
    """
    order = sorted(range(len(wanted)), key=lambda i: wanted[i])
    places = [max(wanted[i], low) for i in order]
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + gap)
    ceiling = high
    for i in reversed(range(len(places))):
        places[i] = min(places[i], ceiling)
        ceiling = places[i] - gap
    back = dict(zip(order, places, strict=True))
    return [back[i] for i in range(len(wanted))]
