"""The search for extremes: its inputs, the oracles, the reduction of failures, and the tables."""

from __future__ import annotations

import csv
import itertools
import sys
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pytest

from bench.catalogue.suites import STABILITY
from bench.checking.golden import check
from bench.running.options import Options
from bench.suites.stability import generated
from bench.suites.stability.generated import (
    CloudInput,
    ImagePattern,
    ImagesInput,
    NumberRows,
    RowChange,
)
from bench.suites.stability.metrics import METRICS
from bench.suites.stability.oracles import (
    BEST,
    SLOW_POINTS,
    MethodSubject,
    MetricSubject,
    examine,
    method_subject,
    metric_subject,
)
from bench.suites.stability.run import run
from bench.suites.stability.search import ROUND, Rounds, generate, kind_of, require_hypothesis
from bench.suites.stability.search_run import run_search
from data_prep.failures import BadInput, MissingDependency
from data_prep.scene import View
from tests.robustness.seeded_faults import SUBJECTS, FaultyMethod, first_failure

NAMES = {**vars(generated), "nan": np.nan, "inf": np.inf}
FRONT = (View(0.0, 0.0),)


class _Enough(Exception):
    pass


def inputs_of(subject, seed=0, count=60):
    inputs = []

    def take(given):
        if len(inputs) == count:
            raise _Enough
        inputs.append(given)

    with suppress(_Enough):
        generate(subject, seed, take)
    return inputs


def ticking():
    """A clock that is 0.01 s later each time that it is read."""
    ticks = itertools.count()
    return lambda: next(ticks) / 100


# --- inputs ---------------------------------------------------------------------------------------


def test_generated_clouds_cover_what_the_page_promises():
    inputs = inputs_of(MethodSubject("splat"), count=ROUND)
    points = [given.cloud().points for given in inputs]
    assert len(inputs) == ROUND
    counts = {len(rows) for rows in points}
    assert {0, 1, 2, 3} <= counts
    assert 2048 < max(counts) <= 100_000
    assert any(np.isnan(rows).any() for rows in points)
    assert any(np.isinf(rows).any() for rows in points)
    finite = [rows for rows in points if len(rows) and np.isfinite(rows).all()]
    assert len(finite) > ROUND / 4
    assert max(np.abs(rows).max() for rows in finite) > 1e30
    assert any(((rows != 0) & (np.abs(rows) < 1e-38)).any() for rows in finite)  # denormal
    several = [rows for rows in finite if len(rows) > 3]
    assert any(len(np.unique(rows, axis=0)) < len(rows) for rows in several)
    # In float64: the extent of a cloud from -3e38 to 3e38 is no float32.
    extents = [np.ptp(rows.astype(np.float64), axis=0) for rows in several]
    constant = {int((extent == 0).sum()) for extent in extents}
    assert {0, 1} <= constant  # planes
    elevations = {view.elevation_deg for given in inputs for view in given.views}
    assert {-90.0, 90.0} <= elevations
    assert any(abs(v.azimuth_deg) > 1e6 for given in inputs for v in given.views)


@pytest.mark.parametrize("metric", ["ssim", "frechet-distance", "azimuth-error-deg"])
def test_an_input_is_made_again_from_its_text(metric):
    for given in inputs_of(MetricSubject(metric), seed=1):
        again = eval(repr(given), NAMES)
        for array, other in zip(given.arrays(), again.arrays(), strict=True):
            assert array.dtype == other.dtype
            assert array.tobytes() == other.tobytes()


def test_the_same_seed_gives_the_same_inputs():
    subject = MethodSubject("splat", most_points=100)
    first = list(map(repr, inputs_of(subject)))
    assert first == list(map(repr, inputs_of(subject)))
    assert first != list(map(repr, inputs_of(subject, seed=1)))
    assert max(len(given.cloud()) for given in inputs_of(subject)) <= 100


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (RowChange("times", 2.0), [[2, 4, 6], [8, 10, 12], [14, 16, 18]]),
        (RowChange("times", 0.0, 2), [[1, 2, 0], [4, 5, 0], [7, 8, 0]]),
        (RowChange("plus", 1.0, 0, 2), [[2, 2, 3], [4, 5, 6], [8, 8, 9]]),
        (RowChange("put", 0.5, step=100), [[0.5, 0.5, 0.5], [4, 5, 6], [7, 8, 9]]),
        (RowChange("round", 4.0), [[0, 0, 4], [4, 4, 8], [8, 8, 8]]),
        (RowChange("repeat", step=2), [[1, 2, 3], [1, 2, 3], [7, 8, 9]]),
        (RowChange("sort", column=0), [[1, 2, 3], [4, 5, 6], [7, 8, 9]]),
    ],
)
def test_changes_of_rows(change, expected):
    rows = np.arange(1, 10, dtype=np.float32).reshape(3, 3)
    assert change.apply(rows).tolist() == expected
    assert change.apply(rows[:0]).shape == (0, 3)
    assert rows.ravel().tolist() == list(range(1, 10))


def test_pictures_are_filled_and_patched():
    (image,) = ImagePattern(b"\x01\x02\x03", None, ((0, 1, 1, 1, 9),)).images(1, 2, 2)
    assert image.tolist() == [[[1, 2, 3], [9, 9, 9]], [[1, 2, 3], [1, 2, 3]]]
    assert not ImagePattern(b"").images(1, 1, 1).any()
    assert ImagePattern(seed=0).images(2, 5, 5).std() > 50


# --- seeded faults and sound subjects -------------------------------------------------------------


def test_a_fault_is_found_and_reduced_to_no_point():
    found = first_failure(SUBJECTS["no first point"], 1.0, clock=ticking())
    assert found is not None
    assert found.problem.startswith("IndexError: index 0 is out of bounds")
    assert found.input == CloudInput(NumberRows(), found.input.views[:1])


@pytest.mark.slow
def test_a_metric_fault_is_found_and_reduced():
    found = first_failure(SUBJECTS["offset of identical images"], 1.0, clock=ticking())
    assert found is not None
    assert kind_of(found.problem) == "# to # of identical inputs, expected #"
    assert found.input.counts[0] == 1


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["end without depth", "order"])
def test_faults_behind_the_first_line_are_found(fault):
    found = first_failure(SUBJECTS[fault], 60.0)
    assert found is not None
    problems = {
        "end without depth": "crash: the worker died (exit code 3)",
        "order": "images change in reverse by",
    }
    assert found.problem.startswith(problems[fault])


class _Here:
    """A pool that examines in this process."""

    capacity = 1

    def __init__(self):
        self._tasks = []

    def submit(self, task):
        self._tasks.append(task)

    def wait_any(self):
        for subject, given in self._tasks:
            yield (subject, given), subject.examine(given)
        self._tasks.clear()


@pytest.mark.parametrize(
    "subject",
    [
        replace(method_subject("splat", "cpu"), most_points=200),
        metric_subject("silhouette-iou"),
        metric_subject("elevation-error-deg"),
    ],
    ids=lambda subject: subject.id,
)
def test_a_sound_subject_has_no_failure(subject):
    rounds = Rounds(subject, 1.0, _Here(), ticking())
    rounds.carry_out(0)
    assert 50 < rounds.result.inputs <= 100
    assert rounds.result.failing == {}
    assert rounds.result.seconds >= 1.0


@pytest.mark.parametrize(
    ("fault", "given", "problem"),
    [
        (
            "NaN above 1e19",
            NumberRows(((1e20, 0.0, 0.0),)),
            "ValueError: 49152 pixel values",
        ),
        ("overflow at 1e30", NumberRows(((2e30, 0.0, 0.0),)), "ValueError: pixels "),
        (
            "shape of one view",
            NumberRows(((0.0, 0.0, 0.0),)),
            "ValueError: images of shape (1",
        ),
        ("two points", NumberRows(((0.0, 0.0, 0.0),) * 2), "ValueError: images are uint8"),
        ("count of calls", NumberRows(count=9), "other the second time: images"),
        ("denormal numbers", NumberRows(((1e-40, 0.0, 0.0),)), "FloatingPointError: underflow"),
        ("order", NumberRows(((0.1, 0.0, 0.0), (0.0, 0.1, 0.0))), "images change in reverse by "),
    ],
)
def test_what_is_unexpected_of_a_method(fault, given, problem):
    finding = FaultyMethod(fault).examine(CloudInput(given, FRONT))
    assert finding.problem.startswith(problem)
    sound = FaultyMethod(fault).examine(CloudInput(NumberRows(), FRONT))
    assert (sound.problem, sound.refused) == ("", "input: no points")


def test_what_is_unexpected_of_a_metric():
    flat = ImagesInput(ImagePattern(), ImagePattern())
    finding = examine((SUBJECTS["correlation of flat images"], flat))
    assert finding.problem.startswith("RuntimeWarning: invalid value")
    object_ = ImagesInput(ImagePattern(), ImagePattern(b"\0"))
    finding = SUBJECTS["overlap by the true object"].examine(object_)
    assert "of identical inputs, expected 1" in finding.problem
    other = ImagesInput(ImagePattern(), ImagePattern(), counts=(1, 2))
    finding = metric_subject("ssim").examine(other)
    assert (finding.problem, finding.refused[:10]) == ("", "ValueError")


def test_subjects_follow_what_is_expected():
    assert method_subject("surface-fit", "cpu").order_free
    assert not method_subject("surface-apss", "cpu").order_free
    assert method_subject("surface-apss", "cpu").most_points == SLOW_POINTS
    assert method_subject("splat", "cpu").most_points == 100_000
    assert set(BEST) < set(METRICS)
    with pytest.raises(BadInput, match="unknown metric 'ssi': did you mean 'ssim'"):
        metric_subject("ssi")


# --- the run --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Quick(FaultyMethod):
    """A faulty method on small clouds."""

    most_points: int = 16


def test_a_search_leaves_tables_and_clouds_that_bench_check_reads(tmp_path):
    out = tmp_path / "run"
    options = Options("stability", search=1.0, workers=1, seed=7, out=out)
    subjects = [Quick("no first point"), metric_subject("silhouette-iou")]
    finished = run_search(options, STABILITY, subjects, ticking())
    with (out / "tables" / "search.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["subject"], row["unexpected"]) for row in rows] == [
        ("no first point", "1"),
        ("silhouette-iou", "0"),
    ]
    assert all(int(row["inputs"]) > 0 for row in rows)
    assert rows[0]["problem"] == "IndexError: index 0 is out of bounds for axis 0 with size 0"
    assert rows[0]["seed"] == "7"
    given = eval(rows[0]["smallest"], NAMES)
    path = out / "smallest" / "no-first-point-1.ply"
    assert f"{path} --as-is --method 'no first point' --azimuth" in rows[0]["command"]
    assert path.read_bytes().startswith(b"ply")
    assert len(given.cloud()) == 0
    text = (out / "tables" / "search.md").read_text()
    assert f"| no first point | {int(rows[0]['inputs']):,} |" in text
    assert "**no first point**: IndexError: index 0" in text
    assert finished.printed
    verdict = check(out)
    assert verdict.compared == 2
    assert len(verdict.regressions) == 1
    assert verdict.regressions[0].startswith("no first point, search-7: IndexError: index 0")
    with pytest.raises(BadInput, match="holds a run; give another --out, or --fresh"):
        run_search(options, STABILITY, subjects)


def test_unknown_names_are_refused_before_a_folder_is_made(tmp_path):
    options = Options("stability", search=1.0, out=tmp_path / "run")
    with pytest.raises(BadInput, match="unknown method 'splot'"):
        run(replace(options, methods=("splot",)))
    with pytest.raises(BadInput, match="unknown metric 'ssi'"):
        run(replace(options, metrics=("ssi",)))
    with pytest.raises(BadInput, match="--views: has no meaning"):
        run(replace(options, views=3))
    assert not (tmp_path / "run").exists()


def test_a_machine_without_hypothesis_is_told_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "hypothesis", None)
    with pytest.raises(MissingDependency, match=r"pip install 'pc2pix-bench\[search\]'"):
        require_hypothesis()


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("--search", "0s"), "--search 0s: give a time over 0 with its unit"),
        (("--search", "soon"), "--search soon: give a time over 0 with its unit"),
        (("--search",), "Option '--search' requires an argument"),
    ],
)
def test_a_search_needs_a_time(command, arguments, error):
    status, out, err = command("run", "--suite", "stability", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"bench: {error}")


def test_other_suites_have_no_search(command):
    status, out, err = command("run", "--suite", "chair-robustness", "--search", "1s")
    assert (status, out) == (2, "")
    assert err.startswith("bench: --search: has no meaning for the suite chair-robustness")
