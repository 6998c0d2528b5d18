from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from bench.catalogue.lookup import find
from bench.records.job import Job
from bench.rendering.cloud import Failed
from bench.rendering.sheet import LABEL_HEIGHT, MARGIN
from bench.running.work import cloud_of, rng_of
from data_prep.clouds.conditions import CONDITIONS
from data_prep.datasets.registry import ProceduralObject
from data_prep.rendering.images import blank
from data_prep.scene import View
from studies.silhouette_motion import (
    STATISTICS,
    Tally,
    boundary,
    distances,
    estimates,
    flicker,
    offsets,
    open_sides,
    statistics,
)
from studies.view_consistency import (
    SHOWN_CONDITIONS,
    STRIP,
    TOO_LITTLE,
    TOO_MUCH,
    ChairTask,
    Turn,
    drawing_of,
    failures,
    main,
    rows_of,
    slatted_chair,
    study,
    tint,
)

SIZE = 128


def box(top, bottom, left, right):
    """One silhouette: a rectangle, bottom and right exclusive."""
    mask = np.zeros((SIZE, SIZE), bool)
    mask[top:bottom, left:right] = True
    return mask


def blobs(seed, count=3, size=24):
    """Random ragged silhouettes [count, size, size], none empty."""
    return np.random.default_rng(seed).random((count, size, size)) < 0.3


def test_open_sides_and_boundaries():
    sides = open_sides(box(40, 60, 30, 40)[None])
    edges = ((40, 41, 30, 40), (59, 60, 30, 40), (40, 60, 30, 31), (40, 60, 39, 40))
    for side, edge in zip(sides[:, 0], edges, strict=True):  # top, bottom, left, right
        assert np.array_equal(side, box(*edge))
    assert boundary(box(40, 60, 30, 40)[None]).sum() == 2 * (20 + 10) - 4
    everything = np.ones((1, SIZE, SIZE), bool)  # beyond the frame is outside
    assert (open_sides(everything).sum(axis=(1, 2, 3)) == SIZE).all()
    assert boundary(everything).sum() == 4 * SIZE - 4


def test_offsets_by_definition():
    for mask, actual in zip(blobs(0), offsets(blobs(0)), strict=True):
        around = np.argwhere(boundary(mask[None])[0])
        for y, x in np.ndindex(mask.shape):
            nearest = np.sqrt(((around - (y, x)) ** 2).sum(axis=1).min())
            # one square root of the same whole number by two libraries: a rounding error
            assert abs(actual[y, x] - (nearest if mask[y, x] else -nearest)) < 1e-12
    assert (offsets(np.zeros((1, 4, 4), bool)) == -np.inf).all()


def test_distance_and_flicker_by_definition():
    """Flicker may compare with any of several places that are as near."""
    true, seen = blobs(1), blobs(2)
    apart, changes = [], []
    for mine, other in ((true, seen), (seen, true)):
        offset = offsets(other)
        for ours, theirs in zip(boundary(mine), boundary(other), strict=True):
            around = np.argwhere(theirs)
            apart += [np.sqrt(((around - at) ** 2).sum(axis=1).min()) for at in np.argwhere(ours)]
        for side in open_sides(mine):
            for view, here in enumerate(side):
                after = (view + 1) % len(mine)  # the turn closes
                next_places = np.argwhere(side[after])
                for at in np.argwhere(here):
                    squared = ((next_places - at) ** 2).sum(axis=1)
                    nearest = tuple(next_places[squared == squared.min()].T)
                    changes.append(np.abs(offset[view][tuple(at)] - offset[after][nearest]))
    # square roots of the same whole numbers by two libraries: a rounding error
    np.testing.assert_allclose(distances(true, seen), apart, rtol=0, atol=1e-12)
    actual = flicker(true, seen)
    for value, among in zip(actual, changes, strict=True):
        assert np.abs(among - value).min() < 1e-12
    assert max(len(among) for among in changes) > 1
    assert (distances(true, true) == 0).all()
    assert (flicker(true, true) == 0).all()


SLAT = box(40, 60, 70, 72)


def test_where_nothing_is_drawn():
    true = np.stack([SLAT] * 5)
    seen = np.zeros_like(true)
    for pair in ((true, seen), (seen, true)):
        assert (distances(*pair) == np.inf).all()
        assert len(distances(*pair)) == boundary(true).sum()
        assert (flicker(*pair) == np.inf).all()
        assert len(flicker(*pair)) == open_sides(true).sum()
    assert len(distances(seen, seen)) == len(flicker(seen, seen)) == 0
    seen = true.copy()
    seen[1] = False
    assert (distances(true, seen) == np.inf).sum() == boundary(true[:1]).sum()
    # true boundaries 0 to 1 and 1 to 2, drawn ones 0 to 1
    assert (flicker(true, seen) == np.inf).sum() == 3 * open_sides(true[:1]).sum()


def test_statistics_of_a_tally_are_those_of_its_values():
    values = np.sqrt(np.random.default_rng(2).integers(0, 12, 997))
    tally = Tally.of(values)
    rounded = np.round(values, 3)
    expected = [*np.percentile(rounded, [50, 95, 99], method="inverted_cdf"), (rounded <= 2).mean()]
    # the percentiles are values, the share is one division of the same whole numbers
    assert statistics(tally.values, tally.counts).tolist() == expected
    assert tally.counts.sum() == 997


def test_intervals_worked_by_hand():
    """A quarter of the resamples of two objects holds each twice, the others one of each."""
    actual = estimates([Tally.of(np.zeros(30)), Tally.of(np.full(10, 4.0))])
    assert STATISTICS == ("p50", "p95", "p99", "within-2px")
    assert actual.tolist() == [[0.0, 4.0, 4.0, 0.75], [0.0, 0.0, 0.0, 0.0], [4.0, 4.0, 4.0, 1.0]]
    actual = estimates([Tally.of(np.zeros(5)), Tally.of(np.full(5, np.inf))])
    assert actual[:, STATISTICS.index("p95")].tolist() == [np.inf, 0.0, np.inf]


def test_failed_objects_are_counted_and_named():
    first, last = (
        {"distance": Tally.of(np.full(8, value)), "flicker": Tally.of(np.zeros(8))}
        for value in (1.0, 3.0)
    )
    results = [first, Failed("timeout: no result"), last]
    rows = rows_of("splat", "512", results)
    assert {(r.n_ok, r.n) for r in rows} == {(2, 3)}
    assert [(r.measure, r.statistic) for r in rows] == [
        (m, s) for m in ("distance", "flicker") for s in STATISTICS
    ]
    assert [r.value for r in rows] == [1.0, 3.0, 3.0, 0.5, 0.0, 0.0, 0.0, 1.0]
    assert rows_of("splat", "512", [Failed("draw: none")]) == []
    message = failures({("splat", "512"): results})
    assert message == "- splat, 512, test-0001: timeout: no result\n"


def test_what_is_tinted():
    truth, image = blank(1), blank(1)
    truth[0, 40:60, 30:50] = 80
    image[0, 40:60, 35:55] = 90
    image[0, 0, 0] = 250  # haze draws nothing
    tinted = tint(truth, image)
    assert (tinted[0, 40:60, 30:35] == TOO_LITTLE).all()
    assert (tinted[0, 40:60, 50:55] == TOO_MUCH).all()
    tinted[0, 40:60, 30:35] = 255
    tinted[0, 40:60, 50:55] = 90
    assert np.array_equal(tinted, image)


FEW_VIEWS = tuple(View(30.0 * i, 20.0) for i in range(12))


@pytest.mark.parametrize("condition", SHOWN_CONDITIONS)
def test_clouds_and_random_numbers_are_those_of_a_run(condition):
    cloud, drawing = drawing_of(ChairTask("splat", condition, 3, FEW_VIEWS))
    chair = ProceduralObject("chair", "test", 3)
    perturbation = find(condition, CONDITIONS, "condition").perturbation
    job = Job(
        key="", suite="", method="splat", condition=condition, perturbation=perturbation,
        object=chair, views=FEW_VIEWS, seed=0, device="cpu", features=(),
        reference_key=None,
    )  # fmt: skip
    assert np.array_equal(cloud.points, cloud_of(job).points)
    assert drawing.rng.random() == rng_of(job).random()
    assert (drawing.method, drawing.views) == ("splat", FEW_VIEWS)


def in_this_process(tasks, work, *_):
    """Carry out the tasks of a study one by one, for the sake of time."""
    return ((task, work(task)) for task in tasks)


def test_everything_is_written(tmp_path):
    turn = Turn(FEW_VIEWS, ("512",))
    message = study(tmp_path / "out", ("true-mesh", "splat"), 1, 1, turn, in_this_process)
    ceiling = "| true-mesh | 512 | 0.00 | 0.00 | 0.00 | 100.0% | 1/1 |"
    assert [line for line in message.splitlines() if "true-mesh" in line] == [ceiling] * 2
    assert message.count("\n| splat | 512 |") == 2
    names = {path.name: path for path in (tmp_path / "out").iterdir()}
    assert names.keys() == {
        *("strip-512.png", "turntable-512.gif", "view-consistency.csv", "view-consistency.md")
    }
    assert names["view-consistency.md"].read_text() == message
    table = names["view-consistency.csv"].read_text().splitlines()
    assert len(table) == 1 + 2 * 2 * len(STATISTICS)
    wide, high = 2 * 128 + MARGIN, 2 * 128 + LABEL_HEIGHT + MARGIN
    with Image.open(names["turntable-512.gif"]) as film:
        assert film.size == (MARGIN + 3 * wide, MARGIN + high)
        assert film.n_frames == 12
    with Image.open(names["strip-512.png"]) as image:
        strip = np.asarray(image)
    assert strip.shape == (MARGIN + 3 * high, MARGIN + 6 * wide, 3)
    truth, ceiling_row, splat_row = (
        strip[MARGIN + i * high + LABEL_HEIGHT :, MARGIN:][:256:2, :256:2] for i in range(3)
    )
    chair = ProceduralObject("chair", "test", slatted_chair())
    assert np.array_equal(truth, chair.truth(FEW_VIEWS[STRIP])[0])
    assert np.array_equal(ceiling_row, truth)
    assert (splat_row == TOO_MUCH).all(axis=-1).any()


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--methods", "splta"], "view_consistency: unknown method 'splta': did you mean 'splat'"),
        (["--chairs", "0"], "2"),
        (["--threads", "-1"], "2"),
    ],
)
def test_what_cannot_be_used(arguments, problem, tmp_path):
    with pytest.raises(SystemExit, match=problem):
        main(["--out", str(tmp_path), *arguments])
    assert not list(tmp_path.iterdir())
