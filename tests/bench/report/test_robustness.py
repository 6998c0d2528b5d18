from __future__ import annotations

import numpy as np
import pytest
from harness_objects import Tetrahedron

from bench.analysis.scores import QualityRow
from bench.catalogue.suites import TableSpec
from bench.records.stored_artifacts import Artifact
from bench.report.image_sheets import THIN_TINT
from bench.report.robustness import write_figures
from bench.tables.quality import quality_table

from ..builders import make_job, make_truth, store_images

NAN = float("nan")


def make_row(metric, method, condition, value, low=NAN, high=NAN):
    return QualityRow(
        "s", method, condition, "chair", metric, value, low, high, 2, 2, NAN, value, ""
    )


IMAGES = (
    make_row("ssim", "splat", "2048", 0.8, 0.7, 0.95),
    make_row("ssim", "splat", "512", 0.6, 0.5, 0.65),
    make_row("ssim", "blank", "2048", 0.4),
    make_row("luminance", "splat", "2048", 0.9),
)
SETS = (make_row("fid", "splat", "2048", NAN), make_row("fd-views", "splat", "2048", 12.5))
CURVES = [
    quality_table(TableSpec("images", "t", ""), IMAGES),
    quality_table(TableSpec("images", "t", ""), SETS),
]


@pytest.fixture
def jobs(tmp_path):
    a, b = Tetrahedron("a"), Tetrahedron("b")  # splat has failed for b
    made = [make_truth(a), make_job(a), make_job(a, "blank")]
    made += [make_truth(b), make_job(b, "blank")]
    return made


def test_curves_show_the_tables(drawn, jobs, tmp_path):
    curves, _, _ = drawn(write_figures, CURVES, jobs=jobs)
    for name in ("robustness.png", "pictures.png"):
        assert (tmp_path / "figures" / name).read_bytes().startswith(b"\x89PNG")
    views, ssim = curves.axes  # fid has no value, luminance no curve
    assert ssim.get_title() == "ssim (higher is better)"
    assert views.get_title() == "fd-views (lower is better)"
    assert [text.get_text() for text in ssim.texts] == ["worse than a white image", "points"]
    (names,) = curves.legends
    assert [text.get_text() for text in names.get_texts()] == ["splat", "blank"]
    values = [line.get_ydata().tolist() for line in ssim.lines]
    assert values == [[0.8, 0.6], [0.7, 0.95], [0.8], [0.5, 0.65], [0.6], [0.4]]


def test_the_grid_shows_first_images_and_failures(drawn, jobs, tmp_path):
    _, _, grid = drawn(write_figures, CURVES, jobs=jobs)
    cells = np.array(grid.axes).reshape(2, 2)  # objects x (truth, condition); the floor is left out
    assert [axis.get_title() for axis in cells[0]] == ["ground-truth", "2048"]
    assert [axis.get_ylabel() for axis in cells[:, 0]] == ["a\nsplat", "b\nsplat"]
    assert [text.get_text() for text in cells[1, 1].texts] == ["failed"]
    assert not cells[1, 1].images
    by_cell = {(job.object.object_id, job.method): job for job in jobs}
    for row, obj in zip(cells, "ab", strict=True):
        for axis, method in zip(row, ("ground-truth", "splat"), strict=True):
            if axis.images:
                shown = np.asarray(axis.images[0].get_array())
                expected = Artifact(tmp_path, by_cell[obj, method].key).read()[0]
                assert np.array_equal(shown, expected)
    assert sum(len(axis.images) for axis in cells.flat) == 3


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
    *_, sheet = drawn(write_figures, CURVES, jobs=[*jobs, noisy])
    cells = np.array(sheet.axes).reshape(2, 4)  # truth and method x objects and conditions
    titles = ["c\n2048", "c\nnoise-0.05", "a\n2048", "a\nnoise-0.05"]
    assert [axis.get_title() for axis in cells[0]] == titles
    assert [axis.get_ylabel() for axis in cells[:, 0]] == ["truth,\nits thin\nparts", "splat"]
    assert [text.get_text() for text in cells[1, 1].texts] == ["failed"]
    shown = (cells[0, 2], cells[0, 3], cells[1, 2])
    true, tinted, drawn_by_splat = (np.asarray(axis.images[0].get_array()) for axis in shown)
    assert true.shape == (66, 66, 3)  # the seat's box and the leg, 3 px around
    part = (tinted == THIN_TINT).all(axis=2)
    assert np.array_equal(tinted[~part], true[~part])
    assert part[23:63, 13:16].all()
    assert part.sum() == 40 * 3 + part[:23].sum()
    assert part[:23].sum() < 12
    assert np.array_equal(drawn_by_splat, true // 2)


@pytest.mark.parametrize(
    ("tables", "methods", "names"),
    [([], (), []), (CURVES, ("true-mesh", "blank"), ["robustness.png", "robustness.svg"])],
)
def test_without_a_rival_there_is_no_grid(drawn, tmp_path, tables, methods, names):
    jobs = [make_truth(), *(make_job(method=method) for method in methods)]
    drawn(write_figures, tables, jobs=jobs)
    assert sorted(path.name for path in tmp_path.glob("figures/*")) == names
