"""Confidence sequences: intervals of a mean that hold at every moment, for bounded differences.

An interval for a fixed number of objects is wrong far more often than in 5 % of the runs where it
is looked at after each object and the run ends when one likes it. A confidence sequence is one
interval after each object, and with probability 1 - alpha all of them have the mean: a run may be
looked at, and ended, whenever one likes.

These are by betting (Waudby-Smith and Ramdas, "Estimating means of bounded random variables by
betting", Journal of the Royal Statistical Society B 86, 2024, https://arxiv.org/abs/2010.09686;
section 4.3 and appendix B on mixtures of bets). Whoever bets the share f of a wealth of 1 that
values x >= l have a mean above m has after them, at fair odds,

    product of (1 - f) + f (x - l) / (m - l)

which has mean 1 or less where m is the mean or above it, whatever came before: by Ville's
inequality it ever reaches 2 / alpha with probability alpha / 2 at most. So does a mean over several
f, here SHARES with WEIGHTS: no f has to be chosen before the spread of the values is known. The
wealth falls with m. All m at which it has reached 2 / alpha are left out, which gives the lower end
of the interval; the same from above gives the upper end. An end never moves back.

Wealth is kept for the m of a grid within the interval alone, so that an object costs no more after
a thousand others, and ends are on the grid, outwards: wider by less than a step, never narrower.

Of the packages for this `confseq` 0.0.11 has C++ to compile, `savvi` 0.3.1 brings cvxpy, and
`ville` is at its first release; what a protocol rests on is few lines here.
"""

from __future__ import annotations

import numpy as np

from data_prep.arrays import Floats

# Large bets decide where differences are large against their spread, the common case of two
# renderers on the same objects; small ones give narrow intervals in the long run.
SHARES = np.array([0.9, 0.6, 0.35, 0.2, 0.1, 0.05, 0.025, 0.012])
WEIGHTS = np.array([0.25, 0.2, 0.15, 0.1, 0.1, 0.08, 0.06, 0.06])


class ConfidenceSequence:
    """The intervals of the mean of values between -bound and bound, one after each value.

    Attributes
    ----------
    low, high : float
        Ends of the interval now; at first -bound and bound.
    count : int
        Values so far.
    """

    def __init__(self, alpha: float, bound: float, step: float) -> None:
        """Take the probability that any interval errs, the bound, and the step of the grid.

        Raises ValueError unless 0 < alpha < 1, and unless `bound` is a multiple of `step`.
        """
        steps = round(bound / step)
        if not 0 < alpha < 1:
            raise ValueError(f"alpha {alpha:g}: must be between 0 and 1")
        if steps < 1 or abs(steps * step - bound) > 1e-9 * bound:
            raise ValueError(f"bound {bound:g}: must be a multiple of the step {step:g}")
        self.low, self.high, self.count = -bound, bound, 0
        self._bound = bound
        self._limit = np.log(2.0 / alpha)
        self._means = step * np.arange(1 - steps, steps)
        # Logarithms of the wealth that bets on more than each mean and on less, [2, shares, means].
        self._wealth = np.zeros((2, len(SHARES), len(self._means)))

    def add(self, value: float) -> None:
        """Take another value. Raises ValueError for one that is not within the bounds."""
        bound = self._bound
        if not abs(value) <= bound:
            raise ValueError(f"value {value:g}: must be within {-bound:g} and {bound:g}")
        self.count += 1
        if not len(self._means):
            return
        more = (bound + value) / (bound + self._means)
        less = (bound - value) / (bound - self._means)
        self._wealth += np.log1p(SHARES[:, None] * (np.stack([more, less])[:, None] - 1.0))
        highest = self._wealth.max(axis=1)
        of_mixture = np.einsum("j,sjm->sm", WEIGHTS, np.exp(self._wealth - highest[:, None]))
        below, above = highest + np.log(of_mixture) >= self._limit
        if below.any():
            self.low = float(self._means[below][-1])
        if above.any():
            self.high = float(self._means[above][0])
        inside = ~below & ~above
        self._means, self._wealth = self._means[inside], self._wealth[..., inside]


def intervals(values: Floats, alpha: float, bound: float, step: float) -> Floats:
    """Return the interval after each value, [n, 2]. Raises as `ConfidenceSequence`."""
    sequence = ConfidenceSequence(alpha, bound, step)
    ends = []
    for value in values:
        sequence.add(float(value))
        ends.append((sequence.low, sequence.high))
    return np.array(ends).reshape(-1, 2)
