"""Quality against cost in the report: a plot for each condition and class, and a table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from bench.analysis.comparison import Comparison, Estimate, decimals, milliseconds
from bench.analysis.frontier import Place, places
from bench.catalogue.parameters import find_setting
from bench.report.label_places import place_labels
from bench.report.page import Cell, Line, Mark, NumberTable, Plot, Series, Style, Tags, Word
from bench.report.report_axes import Axis, axis_of, axis_with_room, spread
from bench.report.styles import family, higher_is_better, role

AREA = (54.0, 14.0, 466.0, 312.0)
WIDE_AREA = (54.0, 14.0, 866.0, 432.0)
FEW = 12  # points that labels have room for in the smaller one
MARGINS = (94.0, 48.0)  # right of the area, where floors are named, and below it
LETTER = (7.8, 14.0)  # pixels of a letter of a label: width, height
NEAR = 14.0  # pixels from a point within which its label needs no line


def cost_plots(
    comparisons: Sequence[Comparison],
    metrics: Sequence[str],
    views: int,
    styles: Mapping[str, Style],
) -> tuple[Plot, ...]:
    """A plot for each metric, condition and class; the ceiling is left out, floors are lines.

    All plots of a metric have the same axes, so that they can be compared. Methods without a time
    or a value have no point.
    """
    plots = []
    for metric in metrics:
        cells = {
            (c.condition, c.class_name): [p for p in places(c, (metric,), views) if _drawn(p)]
            for c in comparisons
        }
        every = [p for of_cell in cells.values() for p in of_cell]
        points = [p for p in every if not role(p.method)]
        if not points:
            continue
        crowded = max(sum(not role(p.method) for p in of) for of in cells.values()) > FEW
        left, top, right, bottom = WIDE_AREA if crowded else AREA
        times = [v for p in points for v in (p.cost_ms.value, p.cost_ms.low, p.cost_ms.high)]
        across = axis_of(times, left, right, True)
        ends = [v for p in points for v in (p.quality.value, p.quality.low, p.quality.high)]
        levels = [p.quality.value for p in every if role(p.method) == "floor"]
        values = [p.quality.value for p in points]
        upright = axis_with_room(values, [*ends, *levels], bottom, top)
        plots += [
            _plot(metric, cell, of_cell, (across, upright), views, styles)
            for cell, of_cell in cells.items()
        ]
    return tuple(plots)


def cost_table(comparisons: Sequence[Comparison], metric: str, views: int) -> NumberTable | None:
    """Milliseconds for a cloud with its views, by method and condition; None without any times.

    With several classes each line is of one class. The remark of a cell says what the cost is made
    of; its mark, whether the method is on the frontier by `metric`.
    """
    classes = list(dict.fromkeys(c.class_name for c in comparisons))
    conditions = list(dict.fromkeys(c.condition for c in comparisons))
    at = {(c.condition, c.class_name): c for c in comparisons}
    verdicts = {
        (c.condition, c.class_name, p.method): p.verdict
        for c in comparisons
        for p in places(c, (metric,), views)
    }
    lines = []
    for class_name in classes:
        methods = dict.fromkeys(m for c in comparisons for m in c.pictures)
        for method in methods:
            cells = []
            for condition in conditions:
                comparison = at.get((condition, class_name))
                if comparison is None or method not in comparison.pictures:
                    cells.append(Cell("-"))
                    continue
                cost = comparison.cost_ms(method, views)
                ahead = verdicts[condition, class_name, method] == "frontier"
                cells.append(
                    Cell(
                        milliseconds(cost.value),
                        cost.value if math.isfinite(cost.value) else None,
                        _made_of(comparison, method, views),
                        mark="frontier" if ahead else "",
                    )
                )
            about = class_name if len(classes) > 1 else role(method)
            tags = Tags(method=method, class_name=class_name)
            lines.append(Line(method, about, tags, tuple(cells)))
    if not any(cell.value is not None for line in lines for cell in line.cells):
        return None
    return NumberTable(
        caption=f"Milliseconds for a cloud with {_of_views(views)}, median over objects; beneath, "
        "what they are made of: prepare the cloud + draw a view",
        corner="method",
        columns=tuple((condition, Tags(condition=condition)) for condition in conditions),
        lines=tuple(lines),
        higher=False,
        notes=(f"“frontier”: no other method has at least its {metric} for at most its cost.",),
    )


def _made_of(comparison: Comparison, method: str, views: int) -> str:
    prepare, draw = (
        np.nanmedian(1000 * seconds[method]) if np.isfinite(seconds[method]).any() else math.nan
        for seconds in (comparison.prepare_s, comparison.draw_s)
    )
    if not math.isfinite(prepare):
        return "no times"
    times = f" × {views}" if views > 1 else ""
    return f"{milliseconds(float(prepare))} + {milliseconds(float(draw))}{times}"


def _of_views(views: int) -> str:
    return "1 view" if views == 1 else f"its {views} views"


def _drawn(place: Place) -> bool:
    """Whether it has a place on the axes, of which that of cost is logarithmic."""
    if role(place.method) == "ceiling" or not math.isfinite(place.quality.value):
        return False
    return role(place.method) == "floor" or place.cost_ms.value > 0


def _plot(
    metric: str,
    cell: tuple[str, str],
    of_cell: Sequence[Place],
    axes: tuple[Axis, Axis],
    views: int,
    styles: Mapping[str, Style],
) -> Plot:
    across, upright = axes
    left, top, right, bottom = area = _area(axes)
    condition, class_name = cell
    points = [p for p in of_cell if not role(p.method)]
    families: dict[str, list[Place]] = {}
    for place in points:
        families.setdefault(family(place.method), []).append(place)
    steps = sorted((p.cost_ms.value, p.quality.value) for p in points if p.verdict == "frontier")
    pixels = [(across.at(cost), upright.at(quality)) for cost, quality in steps]
    words = _words(points, axes, pixels)
    series = [
        _series(name, members, axes, styles[members[0].method], words)
        for name, members in families.items()
    ]
    floors = [p for p in of_cell if role(p.method) == "floor"]
    levels = [upright.at(p.quality.value) for p in floors]
    heights = spread(levels, LETTER[1], top, bottom)
    for floor, y, height in zip(floors, levels, heights, strict=True):
        told = f"{floor.method}: {floor.quality.value:.{decimals(metric)}f}, looks at no cloud"
        path = f"M{left:.1f} {y:.1f}H{right:.1f}"
        leader = f"M{right:.1f} {y:.1f}L{right + 10:.1f} {height:.1f}"
        word = Word(right + 14, height, floor.method, leader=leader)
        marks = (Mark(left, y, told),)
        tags = Tags(method=floor.method)
        series.append(Series(floor.method, styles[floor.method], path, marks, (word,), tags))
    better = f"{'higher' if higher_is_better(metric) else 'lower'} is better"
    by_cost = sorted(points, key=lambda p: p.cost_ms.value)
    return Plot(
        title=f"{condition}, {class_name}",
        told=f"{metric}, {better}, by rising cost: " + "; ".join(map(_told, by_cost)) + ".",
        width=int(right + MARGINS[0]),
        height=int(bottom + MARGINS[1]),
        area=area,
        x_title=f"milliseconds for a cloud with {_of_views(views)} (logarithmic)",
        y_title=f"{metric} ({better})",
        x_ticks=tuple(across.ticks()),
        y_ticks=tuple(upright.ticks()),
        series=tuple(series),
        wide=area == WIDE_AREA,
        frontier=_staircase(pixels, right),
        tags=Tags(condition=condition, class_name=class_name),
    )


def _area(axes: tuple[Axis, Axis]) -> tuple[float, float, float, float]:
    """Left, top, right, bottom."""
    across, upright = axes
    return across.start, upright.end, across.end, upright.start


def _series(
    name: str,
    members: Sequence[Place],
    axes: tuple[Axis, Axis],
    style: Style,
    words: Mapping[str, Word],
) -> Series:
    across, upright = axes
    marks = tuple(
        Mark(
            across.at(p.cost_ms.value),
            upright.at(p.quality.value),
            _told(p),
            Tags(method=p.method),
            _ends(across, p.cost_ms),
            _ends(upright, p.quality),
        )
        for p in members
    )
    joined = "M" + "L".join(f"{m.x:.1f} {m.y:.1f}" for m in marks) if len(marks) > 1 else ""
    of_members = tuple(words[p.method] for p in members if p.method in words)
    tags = Tags(method=name) if len(members) == 1 else Tags()
    return Series(name, style, joined, marks, of_members, tags)


def _told(place: Place) -> str:
    value = f"{place.quality.value:.{decimals(place.metric)}f}"
    ahead = ", on the frontier" if place.verdict == "frontier" else ""
    return f"{place.method}: {milliseconds(place.cost_ms.value)} ms, {value}{ahead}"


def _ends(axis: Axis, estimate: Estimate) -> tuple[float, float] | None:
    if not math.isfinite(estimate.low):
        return None
    low = estimate.low if estimate.low > 0 or not axis.logarithmic else axis.low
    return axis.at(low), axis.at(estimate.high)


def _staircase(pixels: Sequence[tuple[float, float]], right: float) -> str:
    """At each cost the best quality that it buys, up to the right end."""
    if not pixels:
        return ""
    start, *rest = pixels
    steps = "".join(f"H{x:.1f}V{y:.1f}" for x, y in rest)
    return f"M{start[0]:.1f} {start[1]:.1f}{steps}H{right:.1f}"


def _words(
    points: Sequence[Place], axes: tuple[Axis, Axis], steps: Sequence[tuple[float, float]]
) -> dict[str, Word]:
    """A label for each point, where it covers nothing; a setting of a knob is named by its value.

    Of a knob with many settings the first and the last are named, and the method itself.
    """
    across, upright = axes
    texts: dict[str, str] = {}
    for name in dict.fromkeys(family(p.method) for p in points):
        members = [p.method for p in points if family(p.method) == name]
        for method in members:
            setting = find_setting(method)
            if setting is None:
                texts[method] = method if len(method) <= 24 else f"…{method[-23:]}"
            elif method in (members[0], members[-1]):
                texts[method] = f"{setting.knob.name} {setting.value:g}"
            if name not in members and method == members[0]:
                texts[method] = method
    named = [p for p in points if p.method in texts]
    if not named:
        return {}
    xy = np.array([(across.at(p.cost_ms.value), upright.at(p.quality.value)) for p in points])
    anchors = xy[[p.method in texts for p in points]]
    sizes = np.array([(LETTER[0] * len(texts[p.method]) + 6, LETTER[1]) for p in named])
    marks = np.concatenate([xy - 6, xy + 6], axis=1)
    intervals = [
        box
        for p, (x, y) in zip(points, xy, strict=True)
        for ends, flat in ((_ends(across, p.cost_ms), True), (_ends(upright, p.quality), False))
        if ends is not None
        for box in [
            (min(ends), y - 1, max(ends), y + 1) if flat else (x - 1, min(ends), x + 1, max(ends))
        ]
    ]
    corners = [(x0, y0, x1, y1) for (x0, y0), (x1, y1) in pairwise(steps)]
    flat = [(min(x0, x1), y0 - 1, max(x0, x1), y0 + 1) for x0, y0, x1, _ in corners]
    flat += [(x, y - 1, across.end, y + 1) for x, y in steps[-1:]]
    steep = [(x1 - 1, min(y0, y1), x1 + 1, max(y0, y1)) for _, y0, x1, y1 in corners]
    obstacles = np.array([*marks.tolist(), *intervals, *flat, *steep], np.float64)
    centres = place_labels(anchors, sizes, obstacles, np.array(_area(axes)))
    words = {}
    for p, anchor, centre, size in zip(named, anchors, centres, sizes, strict=True):
        beyond = np.linalg.norm(np.clip(np.abs(centre - anchor) - size / 2, 0, None))
        nearest = np.clip(anchor, centre - size / 2, centre + size / 2)
        far = f"M{anchor[0]:.1f} {anchor[1]:.1f}L{nearest[0]:.1f} {nearest[1]:.1f}"
        leader = far if beyond > NEAR else ""
        words[p.method] = Word(centre[0], centre[1], texts[p.method], "middle", leader)
    return words
