from __future__ import annotations

import numpy as np

from bench.analysis.comparison import NAN, Estimate
from bench.report.pareto import frontier_figure, write_frontier
from bench.report.styles import method_styles

from ..tables.test_frontier import place

SHOWN = (  # method, cost, value, verdict
    ("surface-apss@resolution=25", 20, 0.60, "dominated"),
    ("surface-apss@resolution=50", 100, 0.70, "dominated"),
    ("surface-apss", 400, 0.80, "frontier"),
    ("surface-apss@resolution=300", 800, 0.78, "dominated"),
    ("pc2pix@acgan", 40, 0.75, "frontier"),
    ("pc2pix", 80, 0.75, "tied"),
    ("pc2pix@paper", 90, 0.75, "tied"),
    ("pc2pix@all", 95, 0.75, "tied"),
    ("splat", 10, 0.50, "frontier"),
    ("true-mesh", 30, 1.00, "reference"),
    ("constant", 1, 0.70, "reference"),
    ("blank", 1, 0.65, "reference"),
)


def places(metric="ssim", views=20):
    made = []
    for method, cost, value, verdict in SHOWN:
        shown = value if metric == "ssim" else 100 * (1.1 - value)
        estimates = {
            "cost_ms": Estimate(cost, 0.9 * cost, 1.1 * cost),
            "quality": Estimate(shown, 0.95 * shown, 1.05 * shown),
        }
        made.append(place(method, metric, verdict, views=views, **estimates))
    return made


def figure(shown, metric, views):
    return frontier_figure(shown, metric, views, method_styles(p.method for p in shown)).figure


def lines(axis, label):
    return [line for line in axis.lines if line.get_label() == label]


def test_a_parameter_is_a_line_and_the_frontier_a_step_to_the_edge():
    (axis,) = figure(places(), "ssim", 20).axes
    (sweep,) = lines(axis, "surface-apss (resolution)")
    assert sweep.get_xydata().tolist() == [[20, 0.6], [100, 0.7], [400, 0.8], [800, 0.78]]
    assert sweep.get_linestyle() == "-"
    (steps,) = lines(axis, "frontier")
    right = axis.get_xlim()[1]
    assert steps.get_xydata().tolist() == [[10, 0.5], [40, 0.75], [400, 0.8], [right, 0.8]]
    assert steps.get_drawstyle() == "steps-post"
    for label, value in (("constant", 0.7), ("blank", 0.65)):
        assert lines(axis, label)[0].get_ydata() == [value, value]
    drawn = np.concatenate([np.atleast_1d(line.get_ydata()) for line in axis.lines])
    assert drawn.max() < 0.9  # the ceiling is not drawn


def test_what_is_below_a_white_image_is_hollow():
    below = place("splat", verdict="below a white image", quality=Estimate(0.5, 0.4, 0.6))
    (axis,) = figure([*places()[:8], below], "ssim", 20).axes
    faces = {
        line.get_xydata()[0, 1]: line.get_markerfacecolor()
        for line in axis.lines
        if line.get_linestyle() == "None"
        and len(line.get_xydata()) == 1
        and line.get_label().startswith("_")
    }
    assert [value for value, face in faces.items() if face == "#ffffff"] == [0.5]
    (steps,) = lines(axis, "frontier")
    assert steps.get_xydata()[0].tolist() == [40, 0.75]


def test_distances_are_logarithmic_and_zero_has_no_place(tmp_path):
    (axis,) = figure(places("fd-views"), "fd-views", 20).axes
    assert axis.get_yscale() == "log"
    assert axis.get_ylabel() == "fd-views (lower is better)"
    none = [place("splat", "fd-views", quality=Estimate(0.0, 0.0, 0.0))]
    write_frontier(tmp_path, [*places(), *none])
    assert {path.name for path in tmp_path.iterdir()} == {"frontier.png", "frontier.svg"}


def test_files(tmp_path):
    failed = Estimate(NAN, NAN, NAN)
    lost = [place(m, "structure", "no value", quality=failed) for m in ("splat", "pc2pix")]
    one_view = places(views=1)
    write_frontier(tmp_path / "figures", [*places(), *places("fd-views"), *lost, *one_view])
    heads = {path.name: path.read_bytes()[:4] for path in (tmp_path / "figures").iterdir()}
    assert heads == {
        f"{name}.{kind}": head
        for name in ("frontier", "frontier-fd-views")
        for kind, head in (("png", b"\x89PNG"), ("svg", b"<?xm"))
    }
