"""What V pictures of one cloud cost, and from how many on one road is cheaper than another.

A cloud is prepared once and drawn as often as one likes. Drawing was timed in calls of one view and
of a batch of views; in between the cost of a call is taken to grow evenly, and more views than a
batch are drawn in batches. Thus what is said of one view and of whole batches is as measured:

    total(V) = prepare + one + (V - 1) (all - one) / (batch - 1)    1 <= V <= batch
    total(V) = prepare + V all / batch                              V >= batch

Two straight lines, so that the break-even of two methods is a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["always", "never", "up to", "from", "between", "outside"]


@dataclass(frozen=True)
class Cost:
    """What a method costs, in any one unit.

    prepare     of a cloud
    draw_one    of a call with one view
    draw_batch  of a call with `batch` views, all of them
    batch       at least 1; of 1, `draw_batch` is the same as `draw_one`
    """

    prepare: float
    draw_one: float
    draw_batch: float
    batch: int

    def total(self, views: float) -> float:
        """Of preparing a cloud and drawing `views` >= 1 pictures of it."""
        if views >= self.batch:
            return self.prepare + views * self.draw_batch / self.batch
        more = (self.draw_batch - self.draw_one) / (self.batch - 1)
        return self.prepare + self.draw_one + (views - 1) * more

    def per_picture(self, views: float) -> float:
        """The same, shared by the pictures."""
        return self.total(views) / views


@dataclass(frozen=True)
class BreakEven:
    """For how many views of a cloud a method is cheaper than its rival.

    cheaper    "always" and "never" for any number; "up to" or "from" the one in `views`;
               "between" or "outside" the two there
    views      where the totals are equal, ascending; no whole numbers as a rule
    """

    cheaper: Verdict
    views: tuple[float, ...]


def break_even(cost: Cost, rival: Cost) -> BreakEven:
    """Where the totals of two costs with the same batch cross, for 1 view and more.

    Where they are equal throughout, neither is cheaper: "never". Raises ValueError where the
    batches differ.
    """
    if cost.batch != rival.batch:
        raise ValueError(f"break_even: batches of {cost.batch} and of {rival.batch} views")
    batch = cost.batch
    at_one = cost.total(1) - rival.total(1)
    at_batch = cost.total(batch) - rival.total(batch)
    growth = (cost.draw_batch - rival.draw_batch) / batch  # a view, beyond the batch
    found = []
    if at_one * at_batch < 0:
        found.append(1 + (batch - 1) * at_one / (at_one - at_batch))
    if at_batch * growth < 0:
        found.append((rival.prepare - cost.prepare) / growth)
    # The first difference that is none decides: a tie at the start says nothing of what follows.
    cheaper_first = next((d < 0 for d in (at_one, at_batch, growth) if d), False)
    kinds: tuple[Verdict, ...] = (
        ("always", "up to", "outside") if cheaper_first else ("never", "from", "between")
    )
    return BreakEven(kinds[len(found)], tuple(found))
