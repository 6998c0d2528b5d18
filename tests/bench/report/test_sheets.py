"""The figures of a run as files: sheets of images, and the plots beside them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from harness_objects import Tetrahedron

from bench.analysis.paper import AVERAGE
from bench.catalogue.suites import TableSpec
from bench.metrics.structural_similarity import ssim_per_image
from bench.records.frames import Artifact
from bench.records.job import GROUND_TRUTH
from bench.report.run_figures import write_class_figures, write_figures
from bench.report.sheets import THIN_TINT
from bench.tables.paper import published

from ..builders import make_job, make_truth, store_images, value_row, value_table

NAN = float("nan")
PAPER = published("thirteen-classes")
SPEC = TableSpec("classes", "t", "T")
METHODS = ("surface-apss", "pc2pix@all", "splat")


def row(metric, method, class_name, value, low=NAN, high=NAN):
    changes = {"ci_low": low, "ci_high": high, "class": class_name}
    return value_row(method, value, metric=metric, **changes)


CURVES = [value_table(row("ssim", m, "chair", 0.8)) for m in ("splat", "blank")]


def sheet_of(figure, rows):
    return np.array(figure.axes).reshape(rows, -1)


def images_of(cells):
    return [np.asarray(axis.images[0].get_array()) for axis in cells]


def test_the_grid_shows_first_images_and_failures(drawn, tmp_path):
    a, b = Tetrahedron("a"), Tetrahedron("b")  # splat has failed for b
    jobs = [make_truth(a), make_job(a), make_job(a, "blank"), make_truth(b), make_job(b, "blank")]
    figures = drawn(write_figures, CURVES, jobs=jobs)
    assert set(figures) == {"robustness.png", "robustness.svg", "pictures.png"}
    cells = sheet_of(figures["pictures.png"], 2)  # objects x (truth, condition); no floor
    assert [axis.get_title() for axis in cells[0]] == ["ground-truth", "2048"]
    assert [axis.get_ylabel() for axis in cells[:, 0]] == ["a\nsplat", "b\nsplat"]
    assert [text.get_text() for text in cells[1, 1].texts] == ["failed"]
    expected = [Artifact(tmp_path, jobs[i].key).read()[0] for i in (0, 1, 3)]
    for image, of_job in zip(images_of([*cells[0], cells[1, 0]]), expected, strict=True):
        assert np.array_equal(image, of_job)


def test_the_sheet_of_thin_parts(drawn, tmp_path):
    """c has two legs, a has one, b none; of a's views the second shows it."""
    jobs = []
    for name, legs in (("a", (0, 1)), ("b", (0, 0)), ("c", (2, 1))):
        truth = np.full((2, 128, 128, 3), 255, np.uint8)
        truth[:, 30:50, 30:90] = 120  # a seat
        for view, count in enumerate(legs):
            for leg in range(count):
                truth[view, 50:90, 40 + 20 * leg : 43 + 20 * leg] = 120
        obj = Tetrahedron(name)
        jobs += [make_truth(obj), make_job(obj)]
        jobs += [make_job(obj, "splat", "512"), make_job(obj, "constant")]
        for number, job in enumerate(jobs[-4:]):
            store_images(tmp_path, job, images=truth // (1 + number))
    noisy = make_job(Tetrahedron("a"), "splat", "noise-0.05")
    store_images(tmp_path, noisy, images=truth)
    cells = sheet_of(drawn(write_figures, CURVES, jobs=[*jobs, noisy])["thin-parts.png"], 2)
    titles = ["c\n2048", "c\nnoise-0.05", "a\n2048", "a\nnoise-0.05"]
    assert [axis.get_title() for axis in cells[0]] == titles
    assert [axis.get_ylabel() for axis in cells[:, 0]] == ["truth,\nits thin\nparts", "splat"]
    assert [text.get_text() for text in cells[1, 1].texts] == ["failed"]
    true, tinted, drawn_by_splat = images_of((cells[0, 2], cells[0, 3], cells[1, 2]))
    assert true.shape == (66, 66, 3)  # the seat's box and the leg, 3 px around
    part = (tinted == THIN_TINT).all(axis=2)
    assert np.array_equal(tinted[~part], true[~part])
    assert part[23:63, 13:16].all()
    assert part.sum() == 40 * 3 + part[:23].sum()
    assert part[:23].sum() < 12
    assert np.array_equal(drawn_by_splat, true // 2)


def figures_of_classes(drawn, rows, jobs, headline=()):
    tables = (value_table(*of, spec=SPEC) for of in (rows, headline))
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
    cells = sheet_of(figures_of_classes(drawn, ROWS, jobs)["classes.png"], 3)
    assert [axis.get_ylabel() for axis in cells[:, 0]] == ["car", "lamp", "sofa"]
    assert [axis.get_title() for axis in cells[0]] == ["truth", *METHODS]
    first = {(job.object.object_id, job.method): job for job in jobs}
    true, shown = (
        Artifact(tmp_path, first["car-a", method].key).read()[:1]
        for method in (GROUND_TRUTH, "splat")
    )
    assert np.array_equal(images_of(cells[0])[0], true[0])
    assert np.array_equal(images_of(cells[0])[3], shown[0])
    assert cells[0, 3].get_xlabel() == f"{ssim_per_image(true, shown).ssim[0]:.2f}"
    assert [text.get_text() for text in cells[1, 1].texts] == ["failed"]


def test_the_best_by_the_headline_has_a_column(drawn):
    methods = ("surface-apss", "splat-net@chair", "splat-net", "points2pix", "splat", "blank")
    headline = [
        row("ssim-object", "splat-net@chair", AVERAGE, 0.7),
        row("ssim-object", "splat-net", AVERAGE, 0.8),
        row("ssim-object", "blank", AVERAGE, 0.9),  # does not compete
        row("ssim-object", "splat", AVERAGE, 0.95) | {"failures_as_blank": 0.2},
        row("ssim-object", "best-classical", AVERAGE, 0.99),  # another by that name
        row("lpips", "splat-net", AVERAGE, 0.2),
        row("lpips", "points2pix", AVERAGE, 0.1),
        row("lpips", "surface-apss", AVERAGE, NAN),
        row("lpips", "splat-net@chair", AVERAGE, 0.05) | {"condition": "512"},
    ]
    sheet = figures_of_classes(drawn, ROWS, make_jobs(methods=methods), headline)["classes.png"]
    titles = [axis.get_title().replace("\n", "") for axis in sheet.axes if axis.get_title()]
    shown = ("surface-apss", "splat-net", "points2pix", "splat-net@chair", "splat")
    assert titles == ["truth", *shown]
    assert sheet.get_supxlabel().endswith("splat-net by ssim-object, points2pix by lpips")


@pytest.mark.parametrize(
    ("tables", "methods", "names"),
    [([], (), []), (CURVES, ("true-mesh", "blank"), ["robustness.png", "robustness.svg"])],
)
def test_without_a_rival_there_is_no_grid(drawn, tmp_path, tables, methods, names):
    jobs = [make_truth(), *(make_job(method=method) for method in methods)]
    drawn(write_figures, tables, jobs=jobs)
    assert sorted(path.name for path in tmp_path.glob("figures/*")) == names


def test_what_a_run_lacks_has_no_figure(drawn, tmp_path):
    jobs = make_jobs(methods=("surface-apss", "splat"))
    assert figures_of_classes(drawn, ROWS, [job for job in jobs if not job.condition]) == {}
    assert not (tmp_path / "figures").exists()
    assert list(figures_of_classes(drawn, ROWS, jobs)) == ["classes.png"]
