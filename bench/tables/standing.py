"""What `bench add` prints about a method: its values, its places, and whether it is ahead."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from bench.analysis.run_pairs import Standing, method_standing
from bench.analysis.scored_run import Run
from bench.catalogue.conditions import condition_name
from bench.tables.differences import comparison_lines
from bench.tables.grid import scored_as_blank
from bench.tables.markdown import visible
from bench.tables.table import Table
from bench.tables.terminal import in_parts, laid_out, value_text


def standing_lines(
    run: Run, headline: Table, method: str, added: Sequence[str], width: int
) -> Iterator[str]:
    """Yield how a method stands among those of its run, in lines of at most `width` columns.

    added  methods that were added together with it: it is not compared with them

    First come its values in the headline table, its place among the methods that compete, and the
    images that it lacks; then how it compares with the best of the other methods.
    """
    stands, name = method_standing(run, method, added), visible(method)
    yield ""
    if not stands.conditions:
        yield f"{name} has no image: there is nothing to compare."
        return
    lines = list(_values(headline, stands, method))
    heads = [name, *(condition_name(c).brief for c in stands.images), "place"]
    yield from laid_out([*in_parts(heads, lines, width), *_lacks(stands, name)], width)
    for metrics, differences in stands.against:
        yield ""
        if metrics:
            yield f"the best there by {' and '.join(metrics)}: {visible(differences.a)}"
        yield from comparison_lines(differences, width, hint="")
        pair = f"{differences.a},{method}"
        yield visible(f"intervals: bench compare {run.directory} --methods {pair} --format md")


def _values(headline: Table, stands: Standing, method: str) -> Iterator[list[str]]:
    """Yield a line for each metric: the values of a method at the conditions, and its place."""
    for grid in headline.grids():
        for line in grid.lines:
            if line.name != method:
                continue
            place, among = stands.places.get(grid.metric, (0, 0))
            yield [
                grid.metric,
                *(value_text(cell, True) for cell in line.cells),
                f"{_ordinal(place)} of {among}" if place else "-",
            ]


def _ordinal(place: int) -> str:
    """Return 1st, 2nd, 3rd, 4th; 11th, 12th and 13th."""
    if place % 100 in (11, 12, 13):
        return f"{place}th"
    ends = {1: "st", 2: "nd", 3: "rd"}
    return f"{place}{ends.get(place % 10, 'th')}"


def _lacks(stands: Standing, name: str) -> Iterator[str]:
    """Yield a line on the conditions without an image, and one for each that lacks some images."""
    has, every = stands.conditions, stands.images
    if len(has) < len(every):
        yield (
            f"{name} has {len(has)} of {len(every)} conditions: {', '.join(has)}. Places and "
            "comparisons here are of these; the tables score blank images at the others."
        )
    yield "place: by the mean over these conditions, among the methods that compete"
    for condition in has:
        if lacking := scored_as_blank(*every[condition]):
            yield f"{name} at {condition}: {lacking}."
