from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import torch
from harness_objects import Calling, Refusing, Tetrahedron

import bench.running.work
from bench.catalogue.methods import METHODS, Method
from bench.catalogue.metrics import find_extractor
from bench.judges import VIEWS_WEIGHTS
from bench.metrics import ssim
from bench.metrics.image_scores import scores
from bench.records.job import pack, unpack
from bench.running.work import cloud_of, run_job
from data_prep.clouds.sampling import sample_surface
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.randomness import generator
from data_prep.rendering.images import to_float, to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import View

from ..builders import SCORES, VIEWS, make_job, make_truth, true_images, views_of

SSIM = ("ssim", "luminance", "contrast", "structure")
ONE_BLANK = "draw: 1 of 2 images are blank"


def black_on_white():
    """Two images of a black square."""
    images = np.ones((2, 128, 128, 3), np.float32)
    images[:, 32:96, 32:96] = 0.0
    return images


class Fake:
    """A method that draws `images` and remembers what it was given."""

    def __init__(self, images=None, notes=()):
        self.images = black_on_white() if images is None else images
        self.notes = notes
        self.clouds, self.draws = [], []

    def prepare(self, cloud, rng):
        self.clouds.append(cloud)
        self.draws.append(rng.random())
        return self

    def draw(self, state, views, rng):
        assert state is self
        self.draws.append(rng.random())
        return self.images


class Failing(Fake):
    def __init__(self, error):
        super().__init__()
        self.error = error

    def prepare(self, cloud, rng):
        raise self.error


class Mute(Exception):
    def __str__(self):
        raise RuntimeError("no text")


@pytest.fixture
def measure(tmp_path, monkeypatch):
    """Does one job with a renderer of the test's own, on a random ground truth."""

    def run(renderer, load=None, **changes):
        bench.running.work.load_renderer.cache_clear()
        sees_mesh = changes.pop("sees_mesh", False)
        method = Method("fake", load or (lambda device: renderer), str, 1, "", sees_mesh=sees_mesh)
        monkeypatch.setattr(bench.running.work, "find_run_method", lambda method_id: method)
        truth = changes.pop("truth", None)
        reference = true_images(seed=1) if truth is None else pack(truth)
        named: dict[str, Any] = {"reference": reference} | changes
        job = make_job(method="fake", **named)
        return job, run_job(job)

    yield run
    bench.running.work.load_renderer.cache_clear()


def scores_of(result, *names):
    """Scores of a result, view by view."""
    return list(zip(*(result.of_views[name].tolist() for name in names), strict=True))


def test_scores_images_and_checksum(measure, tmp_path):
    rng = np.random.default_rng(2)
    images = rng.integers(0, 256, (2, 128, 128, 3), np.uint8)
    job, result = measure(Fake(to_float(images), notes=("3 faces dropped", "1 hole")))
    assert result.key == job.key
    assert result.unusable is None
    assert np.array_equal(unpack(result.arrays["images"]), images)
    truth = unpack(job.reference)
    of_views = result.of_views
    for i in range(2):
        expected = ssim(truth[i : i + 1], images[i : i + 1])
        assert [of_views[name][i] for name in SSIM] == list(expected)
    assert np.array_equal(of_views["ssim_object"], scores(truth, images)["ssim_object"])
    assert np.isnan([of_views["thin_recall"], of_views["thin_precision"]]).all()  # a frame of noise
    assert [View(*angles) for angles in views_of(result)] == [*VIEWS]
    assert (result.suite, result.reason) == (job.suite, "")
    assert result.notes == "3 faces dropped; 1 hole"
    assert of_views["ssim"][0] != of_views["ssim"][1]


def test_thin_parts_and_images_without_an_object(measure):
    truth = np.full((2, 128, 128, 3), 255, np.uint8)
    truth[0, 40:80, 60:63] = 0
    drawn = truth.copy()
    drawn[0, 60:] = 255
    _, result = measure(Fake(to_float(drawn)), truth=truth)
    names = ("ssim", "structure", "ssim_object", "thin_recall", "thin_precision")
    leg, empty = scores_of(result, *names)
    assert leg[3:] == (0.5, 1.0)
    assert 0 < leg[2] < leg[0] < 1
    assert empty[:2] == (1.0, 1.0)
    assert np.isnan(empty[2:]).all()


def test_values_outside_0_1_are_clipped(measure):
    images = black_on_white()
    images[0, :, :64], images[1, :, :64] = -0.5, 1.5
    _, result = measure(Fake(images))
    drawn = unpack(result.arrays["images"])[:, :, :64]
    assert (drawn[0] == 0).all()
    assert (drawn[1] == 255).all()


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_an_image_of_one_colour_is_none_and_one_with_another_pixel_is(measure, level):
    images = black_on_white()
    images[1] = level
    _, result = measure(Fake(images))
    assert result.reason == ONE_BLANK
    assert result.arrays == {}
    images[1, 127, 127, 2] = abs(level - 0.01)
    assert measure(Fake(images))[1].reason == ""


@pytest.mark.parametrize("floor", ["blank", "constant"])
def test_a_floor_may_be_blank(floor):
    reference = true_images()
    assert run_job(make_job(method=floor, reference=reference)).reason == ""


def test_blank_where_the_truth_is_blank_is_an_image(measure):
    truth = to_uint8(black_on_white())
    truth[1] = 255
    images = black_on_white()
    images[1] = 1.0
    assert measure(Fake(images), truth=truth)[1].reason == ""
    images[0] = 1.0
    assert measure(Fake(images), truth=truth)[1].reason == ONE_BLANK


@pytest.mark.parametrize(
    ("images", "problem"),
    [
        (np.zeros((2, 128, 128, 3), np.uint8), "are uint8, expected float32 in [0, 1]"),
        (np.zeros((2, 128, 128, 3), complex), "are complex128, expected float32 in [0, 1]"),
        ([[1.0]], "are list, expected float32 in [0, 1]"),
        (None, "are NoneType, expected float32 in [0, 1]"),
        *(
            (np.zeros(shape, np.float32), f"of shape {shape}, expected (2, 128, 128, 3)")
            for shape in ((1, 128, 128, 3), (2, 128, 128), (2, 128, 128, 4), (2, 3, 128, 128))
        ),
    ],
)
def test_what_is_no_images_is_refused(measure, images, problem):
    method = Fake()
    method.images = images
    _, result = measure(method)
    assert result.reason in (f"draw: {problem}", f"draw: images {problem}")
    assert result.arrays == {}


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_pixels_that_are_not_finite_are_counted(measure, value):
    images = black_on_white()
    images[1, 5, 7] = value
    _, result = measure(Fake(images))
    assert result.reason == "draw: 3 pixel values are not finite"


def test_views_are_drawn_in_batches_where_asked(measure):
    sizes = []

    class Counting(Fake):
        def draw(self, state, views, rng):
            sizes.append(len(views))
            return np.stack([black_on_white()[0] * np.float32(view.azimuth_deg) for view in views])

    views = tuple(View(float(i + 1) / 8, 0.0) for i in range(5))
    drawn = []
    for batch in (None, 1, 2, 5, 9):
        _, result = measure(Counting(), views=views, batch=batch, reference=None)
        assert views_of(result) == [(v.azimuth_deg, v.elevation_deg) for v in views]
        drawn.append(unpack(result.arrays["images"]))
    assert all((images == drawn[0]).all() for images in drawn)
    assert sizes == [5, 1, 1, 1, 1, 1, 2, 2, 1, 5, 5]
    assert np.isnan(result.of_views["ssim"]).all()  # no truth, no scores


class Clock:
    """Stands still unless something is said to take time."""

    def __init__(self):
        self.now = 10.0

    def __call__(self):
        return self.now

    def taking(self, seconds, function):
        """The function, which takes so long."""

        def slow(*given):
            self.now += seconds
            return function(*given)

        return slow


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(time, "perf_counter", clock)
    return clock


@dataclass(frozen=True)
class Slow(Tetrahedron):
    """An object whose cloud takes 4 s of a clock, and its true images 3 s."""

    clock: Clock = field(default_factory=Clock, compare=False)

    def cloud(self, rng, count=2048):
        return self.clock.taking(4.0, super().cloud)(rng, count)

    def truth(self, views):
        return self.clock.taking(3.0, super().truth)(views)


def test_times_are_taken_apart(measure, clock, monkeypatch):
    fake = Fake()
    fake.prepare = clock.taking(0.25, fake.prepare)
    fake.draw = clock.taking(1.0, fake.draw)
    work = bench.running.work
    monkeypatch.setattr(work, "scores", clock.taking(2.0, work.scores))
    load = clock.taking(16.0, lambda device: fake)
    _, result = measure(fake, load=load, obj=Slow(clock=clock))
    assert (result.prepare_s, result.draw_s) == (0.25, 0.5)
    assert result.timing == {"methods": 17.25, "metrics": 2.0}


@pytest.mark.parametrize("sees_mesh", [False, True])
def test_only_the_ceiling_sees_the_mesh(measure, sees_mesh):
    fake = Fake()
    measure(fake, sees_mesh=sees_mesh)
    (cloud,) = fake.clouds
    assert (cloud.source is not None) == sees_mesh
    assert cloud.points.shape == (2048, 3)
    assert [method.id for method in METHODS if method.sees_mesh] == ["true-mesh", "true-mesh@grey"]


def test_clouds_come_from_seed_object_and_condition_and_not_from_the_method(tmp_path):
    def points(condition="2048", **changes):
        return cloud_of(make_job(condition=condition, **changes)).points

    for condition in ("2048", "noise-0.05", "missing-0.25"):
        assert np.array_equal(points(condition), points(condition, method="blank"))
    plain, noisy = points(), points("noise-0.05")
    expected = sample_surface(Tetrahedron().load(), generator(0, "cloud", "chair", "a"))
    assert np.array_equal(plain, expected.points)
    assert np.array_equal(points("512"), plain[::4])
    # 6,144 normal deviates of 0.05: their standard deviation errs by 0.05 / sqrt(12288), 1 %
    assert 0.0475 < (noisy - plain).std() < 0.0525
    assert not np.array_equal(plain, points(seed=1))
    assert not np.array_equal(plain, points(obj=Tetrahedron("b")))
    assert not np.array_equal(plain, points(obj=Tetrahedron("a", "sofa")))
    other = points("noise-0.05", seed=1) - points(seed=1)
    assert not np.allclose(other, noisy - plain, atol=1e-3)
    assert not np.allclose(points("noise-0.10") - plain, 2 * (noisy - plain), atol=1e-3)


@pytest.mark.parametrize("obj", [Tetrahedron("b"), Tetrahedron("a", "sofa")])
def test_each_object_has_noise_of_its_own(obj):
    """Else the noise of a run would be one draw, and no mean over objects would be rid of it."""
    first, other = (
        cloud_of(make_job(condition="noise-0.05", obj=some)).points
        - cloud_of(make_job(obj=some)).points
        for some in (Tetrahedron("a"), obj)
    )
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.06  # 5 / sqrt(6144)


def test_randomness_comes_from_the_job_alone(measure):
    def draws(**changes):
        fake = Fake()
        measure(fake, **changes)
        return fake.draws

    assert draws() == draws()
    for change in ({"seed": 1}, {"condition": "512"}):
        assert not set(draws(**change)) & set(draws())


def test_the_ground_truth_is_the_mesh(tmp_path):
    result = run_job(make_truth())
    expected = render(Tetrahedron().load(), VIEWS)
    assert np.array_equal(unpack(result.arrays["images"]), expected)
    assert len(np.unique(expected.reshape(-1, 3), axis=0)) > 3
    assert result.reason == ""
    assert np.isnan(result.of_views["ssim"]).all()


def test_features_are_those_of_the_images(tmp_path):
    result = run_job(make_truth(features=(("fd-views", str(VIEWS_WEIGHTS)),)))
    arrays = {name: unpack(data) for name, data in result.arrays.items()}
    assert set(arrays) == {"images", "fd-views"}
    expected = find_extractor("fd-views").load(str(VIEWS_WEIGHTS), "cpu")(arrays["images"])
    assert np.array_equal(arrays["fd-views"], expected)


def learned_jobs(device):
    """The jobs of a ground truth and of splats, with the networks that need no download."""
    names = ("fd-views", "fd-alexnet", "judge")
    features = tuple((name, str(find_extractor(name).weights(None))) for name in names)
    options = {"features": features, "device": device}
    reference = run_job(make_truth()).arrays["images"]
    return make_truth(**options), make_job(reference=reference, **options)


def test_metrics_of_a_run_without_a_gpu_are_those_of_the_cpu():
    results = {device: [*map(run_job, learned_jobs(device))] for device in ("auto", "cpu")}
    for auto, cpu in zip(results["auto"], results["cpu"], strict=True):
        assert (auto.reason, auto.arrays) == ("", cpu.arrays)
        assert auto.views == cpu.views
    assert all(0 < lpips < 1 for (lpips,) in scores_of(results["cpu"][1], "lpips"))


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without a GPU")
def test_a_gpu_that_a_node_does_not_have_ends_the_run():
    """A failed record would count against the method."""
    for job in learned_jobs("cuda"):
        assert (run_job(job).unusable or "").startswith("--device cuda: PyTorch ")


def test_the_same_job_gives_the_same_bytes(tmp_path):
    truths = [run_job(make_truth()).arrays for _ in range(2)]
    assert truths[0] == truths[1]
    one, two = (run_job(make_job(reference=truth["images"])) for truth in truths)
    assert (one.arrays, one.views) == (two.arrays, two.views)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (StageFailure("ball-pivoting", "no faces"), "ball-pivoting: no faces"),
        (BadInput("an empty cloud; give points"), "input: an empty cloud; give points"),
        (RuntimeError("first line\nsecond line"), "RuntimeError: first line"),
        (IndexError(), "IndexError: no message"),
        (MemoryError("500 GiB"), "memory: 500 GiB"),
        (SystemExit("enough"), "SystemExit: enough"),
        (KeyboardInterrupt(), "KeyboardInterrupt: no message"),
        (TimeoutError("slow"), "TimeoutError: slow"),
        (Mute(), "Mute: its message cannot be shown"),
        (ValueError("\ud800"), "ValueError: \\ud800"),
        (ValueError("long " * 10_000), ("ValueError: " + "long " * 10_000)[:10_000] + " [...]"),
    ],
)
def test_what_a_method_raises_is_a_record(measure, error, reason):
    _, result = measure(Failing(error))
    assert (result.reason, result.unusable, result.arrays) == (reason, None, {})
    assert np.isnan([result.of_views[name] for name in SCORES]).all()
    assert len(views_of(result)) == 2
    assert result.prepare_s > 0  # until it failed
    assert result.draw_s == 0


@pytest.mark.parametrize("make", [make_job, make_truth])
@pytest.mark.parametrize(
    ("obj", "reason"),
    [(Refusing(), "input: no such shape; draw one"), (Calling(), "SystemExit: enough")],
)
def test_objects_that_cannot_be_loaded(tmp_path, make, obj, reason):
    reference = true_images()
    assert run_job(replace(make(obj), reference=reference)).reason == reason


def raising(error):
    def function(*arguments):
        raise error

    return function


def test_a_missing_library_or_unusable_weights_end_the_run(measure):
    _, result = measure(Failing(MissingDependency("no libGL: install libgl1")))
    assert result.unusable == "no libGL: install libgl1"
    assert result.reason == "no libGL: install libgl1"
    _, result = measure(None, raising(BadInput("w.safetensors: cut short; fetch it again")))
    assert result.unusable == "w.safetensors: cut short; fetch it again"
