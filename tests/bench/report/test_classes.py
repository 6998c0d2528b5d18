from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from harness_objects import Tetrahedron

from bench.analysis.paper import AVERAGE
from bench.analysis.scores import QualityRow
from bench.catalogue.suites import TableSpec
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.record import GROUND_TRUTH
from bench.records.stored_artifacts import Artifact
from bench.report.classes import write_class_figures
from bench.tables.classes import table_of_classes
from bench.tables.published import published

from ..builders import make_job, make_truth

NAN = float("nan")
PAPER = published("thirteen-classes")
METHODS = ("surface-apss", "pc2pix@all", "splat")


def row(metric, method, class_name, value, low=NAN, high=NAN):
    return QualityRow(
        "s", method, "2048", class_name, metric, value, low, high, 2, 2, NAN, value, ""
    )


def figures(drawn, rows, jobs, headline=()):
    tables = (table_of_classes(TableSpec("classes", "t", "T"), of, "") for of in (rows, headline))
    return drawn(write_class_figures, *tables, PAPER, jobs=jobs)


ROWS = [
    row("fid", "surface-apss", "car", NAN),
    row("fd-views", "surface-apss", "car", 20.0, 15.0, 30.0),
    row("fd-views", "pc2pix@all", "car", 5.0),
    row("fd-views", "splat", "car", 77.0),
    row("fd-views", "surface-apss", "average", 12.0),
    row("fd-views", "pc2pix@all", "average", 6.0),
    row("ssim", "surface-apss", "car", 0.5),
]


def make_jobs(methods=METHODS, lost=()):
    jobs = []
    for class_name, object_id in product(("car", "lamp", "sofa"), "ab"):
        obj = Tetrahedron(f"{class_name}-{object_id}", class_name)
        jobs.append(make_truth(obj))
        drawn = [method for method in methods if (class_name, method) not in lost]
        jobs += [make_job(obj, method) for method in drawn]
    return jobs


def test_figure_4(drawn, tmp_path):
    jobs = make_jobs(lost=[("lamp", "surface-apss")])
    images, *_ = figures(drawn, ROWS, jobs)
    names = [axis.get_ylabel() for axis in images.axes if axis.get_ylabel()]
    assert names == ["car", "sofa", "lamp"]  # two blocks
    by_row = np.array(images.axes).reshape(2, 8)
    assert [axis.get_title() for axis in by_row[0]] == ["truth", *METHODS] * 2
    first = {(job.object.object_id, job.method): job for job in jobs}
    true, shown = (
        Artifact(tmp_path, first["car-a", method].key).read()[:1]
        for method in (GROUND_TRUTH, "splat")
    )
    assert np.array_equal(by_row[0, 0].images[0].get_array(), true[0])
    assert np.array_equal(by_row[0, 3].images[0].get_array(), shown[0])
    assert by_row[0, 3].get_xlabel() == f"{ssim_per_image(true, shown).ssim[0]:.2f}"
    assert [text.get_text() for text in by_row[1, 1].texts] == ["failed"]
    assert (tmp_path / "figures" / "classes.png").is_file()


def test_the_best_by_the_headline_has_a_column(drawn, tmp_path):
    methods = ("surface-apss", "splat-net@chair", "splat-net", "points2pix", "splat", "blank")
    headline = [
        row("ssim-object", "splat-net@chair", AVERAGE, 0.7),
        row("ssim-object", "splat-net", AVERAGE, 0.8),
        row("ssim-object", "blank", AVERAGE, 0.9),  # does not compete
        replace(row("ssim-object", "splat", AVERAGE, 0.95), failures_as_blank=0.2),
        row("ssim-object", "best-reconstruction", AVERAGE, 0.99),  # another by that name
        row("lpips", "splat-net", AVERAGE, 0.2),
        row("lpips", "points2pix", AVERAGE, 0.1),
        row("lpips", "surface-apss", AVERAGE, NAN),
        replace(row("lpips", "splat-net@chair", AVERAGE, 0.05), condition="512"),
    ]
    (images,) = figures(drawn, ROWS, make_jobs(methods=methods), headline)
    titles = [axis.get_title() for axis in images.axes if axis.get_title()]
    # six in a row leave no room for a second block
    assert titles == [
        "truth",
        "surface-apss",
        "splat-net",
        "points2pix",
        "splat-\nnet@chair",
        "splat",
    ]
    assert images.get_supxlabel().endswith("splat-net by ssim-object, points2pix by lpips")


def dots_of(axis):
    return {bars.get_label(): bars.lines[0].get_xdata().tolist() for bars in axis.containers}


def test_dots(drawn, tmp_path):
    jobs = make_jobs()
    *_, dots = figures(drawn, ROWS, jobs)
    ours, paper = dots.axes
    assert ours.get_title() == "ours: fd-views (lower is better)"
    assert [text.get_text() for text in ours.get_yticklabels()] == ["car", "average"]
    assert dots_of(ours) == {"SR": [20.0, 12.0], "pc2pix@all": [5.0, 6.0]}
    segments = ours.containers[0].lines[2][0].get_segments()
    assert segments[0][:, 0].tolist() == [15.0, 30.0]
    assert segments[1][:, 0].tolist() == [12.0, 12.0]  # no interval
    assert dots_of(paper) == {"SR": [203.1, 114.4], "pc2pix@all": [40.0, 57.2]}
    *_, dots = figures(drawn, [*ROWS, row("fid", "pc2pix@all", "car", 40.0)], jobs)
    assert dots.axes[0].get_title() == "ours: fid (lower is better)"


def test_what_a_run_lacks_has_no_figure(drawn, tmp_path):
    jobs = make_jobs(methods=("surface-apss", "splat"))
    assert figures(drawn, ROWS, [job for job in jobs if not job.condition]) == []
    assert not (tmp_path / "figures").exists()
    assert len(figures(drawn, ROWS, jobs)) == 1
    assert not (tmp_path / "figures" / "table5.png").exists()
