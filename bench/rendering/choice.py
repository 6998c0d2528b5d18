"""The method that draws: the one that is named, one within a budget, or the recommended one."""

from __future__ import annotations

from collections.abc import Sequence

from bench.catalogue.chosen import best_within
from bench.catalogue.methods import RECOMMENDED, RECOMMENDED_IN_COLOUR, find_method
from data_prep.failures import BadInput


def methods_to_draw(
    methods: Sequence[str], in_colour: bool = False, budget_ms: float | None = None
) -> tuple[str, ...]:
    """Return the methods, each once, or the one that is meant where none is named.

    Parameters
    ----------
    methods : sequence of str
        Ids; none: a method within the budget, or the recommended one for an unknown object.
    in_colour : bool
        Whether colours are wanted that a network makes up.
    budget_ms : float or None
        Most milliseconds for one image of a new cloud.

    Raises
    ------
    BadInput
        For wishes that exclude each other, and for a budget that no method meets.
    """
    if methods and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: it chooses the method, and {', '.join(methods)} is named; "
            "leave out one of the two"
        )
    if in_colour and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: the methods that it chooses from draw in grey; leave out "
            "the colour or the budget"
        )
    for method_id in methods if in_colour else ():
        if find_method(method_id).color == "none":
            raise BadInput(
                f"method '{method_id}' draws in grey; leave out the colour, or the method: then "
                f"{RECOMMENDED_IN_COLOUR} draws"
            )
    if methods:
        return tuple(dict.fromkeys(methods))
    if budget_ms is not None:
        return (best_within(budget_ms).method,)
    return (RECOMMENDED_IN_COLOUR if in_colour else RECOMMENDED,)


def note_on_budget(budget_ms: float | None) -> str | None:
    """Return a line on the method that a budget chose; None without one."""
    if budget_ms is None:
        return None
    chosen = best_within(budget_ms)
    return (
        f"budget {budget_ms:g}ms: {chosen.method}, of the measured methods within it the best on "
        f"real meshes (score {chosen.score:.3f}); {chosen.one_view_ms:.3g} ms for one image of "
        "2,048 points, where it was measured"
    )


def note_on_chairs(methods: Sequence[str]) -> str | None:
    """Return a line on the methods that were trained on chairs alone; None where all know more."""
    chairs = [name for name in methods if find_method(name).trained_on == "chairs"]
    if not chairs:
        return None
    were = "was" if len(chairs) == 1 else "were"
    return (
        f"{', '.join(chairs)} {were} trained on chairs and may draw a chair whatever the cloud is; "
        "for other objects leave out the method"
    )
