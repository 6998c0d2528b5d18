"""The measurement loop with a clock of its own: what is called, in which order, and what counts."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.catalogue import suites
from bench.catalogue.methods import Method, find_method
from bench.running.environment import CODE, ROOT, code_sha256
from bench.running.plan import plan
from bench.running.work import cloud_of, rng_of
from bench.suites.speed.measure import (
    SPEED,
    Clock,
    CloudFailure,
    Subject,
    TimingSample,
    Unit,
    finish_gpu,
    lost,
    measure,
    measurement_path,
    read_measurement,
    subjects_of,
    take_samples,
    write_measurement,
)
from bench.suites.speed.run import speed_units
from data_prep.clouds.conditions import Stride, Unchanged
from data_prep.datasets.registry import ProceduralObject
from data_prep.failures import BadInput, MissingDependency, StageFailure
from data_prep.scene import IMAGE_SIZE, Mesh, PointCloud, View

from ...builders import make_protocol
from ...harness_objects import Refusing, Tetrahedron

SIZE = (IMAGE_SIZE, IMAGE_SIZE)
LOAD_S, PREPARE_S, CALL_S, VIEW_S, FINISH_S = 100.0, 10.0, 1.0, 0.25, 0.125  # exact in binary
SMALL = replace(
    SPEED, clouds=2, views=3, singles=2, warm_ups=1, least_rounds=2, most_rounds=2, seconds=0.0
)


@dataclass
class World:
    """A clock that only the renderer advances; two cores work all the time."""

    now: float = 0.0
    log: list[tuple] = field(default_factory=list)

    def finish(self):
        """Advance to the end of the device's work, which is done once."""
        if self.log and self.log[-1] != "finish":
            self.now += FINISH_S
        self.log.append("finish")

    @property
    def clock(self):
        return Clock(wall=lambda: self.now, core=lambda: 2 * self.now, finish=self.finish)

    @property
    def calls(self):
        return [entry for entry in self.log if entry != "finish"]


@dataclass
class Fake:
    """A renderer that takes a known time; on clouds of `bad` points it fails in `stage`."""

    world: World
    bad: int = -1
    stage: str = "prepare"

    def prepare(self, cloud, rng):
        self.world.now += PREPARE_S
        self.world.log.append(("prepare", len(cloud), cloud.source is not None, rng.random()))
        if len(cloud) == self.bad and self.stage == "prepare":
            raise StageFailure("prepare", "no faces")
        return len(cloud)

    def draw(self, state, views, rng):
        self.world.now += CALL_S + VIEW_S * len(views)
        self.world.log.append(("draw", state, tuple(views)))
        if state == self.bad and self.stage == "draw" and len(views) > 1:
            raise SystemExit("enough")
        return rng.random((len(views), *SIZE, 3), np.float32)


CALLS = [("prepare", 0), ("draw", 1), ("draw", 1), ("draw", 3)]
FAKE = Method("fake", load=lambda device: None, identity=str, version=1, source="")
MESH = Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros((1, 3)))
VIEWS = {n: tuple(View(float(10 * n + i), 0.0) for i in range(3)) for n in (1, 2)}


def subject(points):
    cloud = PointCloud(np.zeros((points, 3)), source=MESH)
    return Subject(f"cloud {points}", cloud, VIEWS[points], lambda: np.random.default_rng(points))


def take(suite=SMALL, method=FAKE, points=(1, 2), **fake):
    world = World()

    def load():
        world.now += LOAD_S
        world.log.append(("load",))
        return Fake(world, **fake)

    subjects = [subject(n) for n in points]
    samples, failures = take_samples(method, load, subjects, suite, world.clock)
    return world, samples, failures


def drawn(world):
    """Return the calls with the number of points, and the numbers of the views."""
    calls = []
    for call in world.calls:
        numbers = [tuple(int(v.azimuth_deg) for v in call[2])] if call[0] == "draw" else []
        calls.append((*call[:2], *numbers))
    return calls


def test_one_call_after_the_other():
    """A cold call, one warm-up that does not count, two rounds; the device is idle at each start,
    and what it still does counts."""
    world, samples, failures = take()
    cold = [("load",), ("prepare", 1), ("draw", 1, (10,))]
    warm_up = [
        *(("prepare", 1), ("draw", 1, (10, 11, 12))),
        *(("prepare", 2), ("draw", 2, (20, 21, 22))),
    ]
    one_round = [
        *(("prepare", 1), ("draw", 1, (10,)), ("draw", 1, (11,)), ("draw", 1, (10, 11, 12))),
        *(("prepare", 2), ("draw", 2, (20,)), ("draw", 2, (21,)), ("draw", 2, (20, 21, 22))),
    ]
    assert drawn(world) == cold + warm_up + 2 * one_round
    assert failures == []
    numbers = {(c[1], c[3]) for c in world.calls if c[0] == "prepare"}
    assert numbers == {(n, np.random.default_rng(n).random()) for n in (1, 2)}
    assert [entry if entry == "finish" else entry[0] for entry in world.log[:6]] == [
        *("finish", "load", "finish", "finish", "prepare", "finish")
    ]

    single, batch = CALL_S + VIEW_S + FINISH_S, CALL_S + 3 * VIEW_S + FINISH_S

    def sample(cloud, number, stage, views, wall_s):
        return TimingSample(cloud, number, stage, views, wall_s, 2 * wall_s)

    def warm(cloud, number):
        return [
            sample(cloud, number, "prepare", 0, PREPARE_S + FINISH_S),
            *[sample(cloud, number, "draw", 1, single)] * 2,
            sample(cloud, number, "draw", 3, batch),
        ]

    assert samples == [
        sample("", 0, "load", 0, LOAD_S + FINISH_S),
        sample("cloud 1", 0, "prepare", 0, PREPARE_S + FINISH_S),
        sample("cloud 1", 0, "draw", 1, single),
        *(s for number in (1, 2) for cloud in ("cloud 1", "cloud 2") for s in warm(cloud, number)),
    ]


@pytest.mark.parametrize(
    ("least", "most", "seconds", "rounds"),
    [
        (3, 100, 0.0, 3),  # at least
        (1, 5, 1e9, 5),  # at most
        # A round of two clouds takes 2 (10.125 + 2 * 1.375 + 1.875) = 29.5 s, the first 0.125 more.
        (1, 100, 29.625, 1),
        (1, 100, 29.75, 2),
        (1, 100, 60.0, 3),
    ],
)
def test_rounds_until_there_are_enough(least, most, seconds, rounds):
    suite = replace(SMALL, least_rounds=least, most_rounds=most, seconds=seconds)
    _, samples, _ = take(suite)
    assert {s.round for s in samples} == set(range(rounds + 1))


def test_only_the_ceiling_sees_the_mesh():
    for sees_mesh in (True, False):
        world, _, _ = take(method=replace(FAKE, sees_mesh=sees_mesh))
        assert {c[2] for c in world.calls if c[0] == "prepare"} == {sees_mesh}


@pytest.mark.parametrize(
    ("bad", "stage", "warm_ups", "reason", "kept"),
    [
        (1, "prepare", 1, "prepare: no faces", []),
        (2, "prepare", 1, "prepare: no faces", []),
        (2, "draw", 0, "SystemExit: enough", [("prepare", 0), ("draw", 1), ("draw", 1)]),
    ],
)
def test_a_cloud_that_fails_is_left_out_and_the_others_go_on(bad, stage, warm_ups, reason, kept):
    world, samples, failures = take(replace(SMALL, warm_ups=warm_ups), bad=bad, stage=stage)
    assert failures == [CloudFailure(f"cloud {bad}", reason)]
    assert [c for c in drawn(world) if c[:2] == ("prepare", bad)] == [("prepare", bad)]
    by_cloud = {n: [s for s in samples if s.cloud == f"cloud {n}"] for n in (1, 2)}
    assert [(s.round, s.stage, s.views) for s in by_cloud[bad]] == [(1, *call) for call in kept]
    # two rounds of the other; only the first cloud has cold times
    assert [s.round for s in by_cloud[3 - bad]] == [0, 0] * (bad == 2) + [1] * 4 + [2] * 4


def raising(error):
    def call(*_):
        raise error

    return call


BLANK = Fake(World())
BLANK.draw = lambda state, views, rng: np.ones((len(views), *SIZE, 3), np.float32)


@pytest.mark.parametrize(
    ("load", "reason"),
    [
        (lambda: BLANK, "draw: 3 of 3 images are blank; 1 points are too few"),
        (raising(AttributeError("no such thing\nat all")), "AttributeError: no such thing"),
    ],
)
def test_what_draws_nothing_or_cannot_be_loaded_is_not_timed(load, reason):
    samples, failures = take_samples(FAKE, load, [subject(1)], SMALL, BLANK.world.clock)
    assert failures == [CloudFailure("cloud 1", reason)]
    assert {s.round for s in samples} <= {0}


@pytest.mark.parametrize("error", [BadInput("no weights"), MissingDependency("no OpenGL")])
def test_what_the_user_has_to_fix_is_raised(error):
    fake = Fake(World())
    with pytest.raises(type(error)):
        take_samples(FAKE, raising(error), [subject(1)], SMALL, fake.world.clock)
    fake.prepare = raising(MissingDependency("no OpenGL"))
    with pytest.raises(MissingDependency):
        take_samples(FAKE, lambda: fake, [subject(1)], SMALL, fake.world.clock)


MANIFEST = {
    "methods": ["blank", "splat"],
    "conditions": ["2048", "512"],
    "threads": [1, 2],
    "views": 3,
    "seed": 0,
    "device": "cpu",
    "environment": {"gl": "some"},
    "versions": {"numpy": "2"},
    "machine": {"cpu": "some"},
}
OBJECTS = (Tetrahedron("a"), Tetrahedron("b"))


def units(suite=SMALL, objects=OBJECTS, code="code", **changes):
    return speed_units(suite, MANIFEST | changes, objects, code)


def test_a_unit_for_each_method_condition_and_number_of_threads():
    chosen = units()
    settings = [(u.method, u.condition, u.threads) for u in chosen]
    assert settings == [*product(("blank", "splat"), ("2048", "512"), (1, 2))]
    assert [chosen[0].perturbation, chosen[2].perturbation] == [Unchanged(), Stride(4)]
    assert len({u.key for u in chosen}) == len(chosen)
    assert chosen == units()


@pytest.mark.parametrize(
    "changes",
    [
        *({"suite": replace(SMALL, **{name: 7})} for name in ("singles", "seconds", "warm_ups")),
        *({"suite": replace(SMALL, **{name: 7})} for name in ("least_rounds", "most_rounds")),
        {"objects": (Tetrahedron("a"), Tetrahedron("c"))},
        *({name: 4} for name in ("views", "seed")),
        *({name: {"some": "other"}} for name in ("environment", "versions", "machine")),
        {"device": "cuda"},
        {"code": "other"},
    ],
    ids=lambda changes: ",".join(changes),
)
def test_whatever_times_depend_on_is_in_the_key(changes):
    assert {u.key for u in units()}.isdisjoint(u.key for u in units(**changes))


def test_all_code_that_a_timed_method_imports_is_in_the_key(tmp_path):
    """The files are those of this process, once the methods of the suite are loaded."""
    for method in suites.SPEED.methods:
        find_method(method).load("cpu")
    files = {Path(m.__file__) for m in [*sys.modules.values()] if getattr(m, "__file__", None)}
    ours = {f.relative_to(ROOT) for f in files if f.is_relative_to(ROOT)}
    packages = {path.parts[0] for path in ours if not path.parts[0].startswith(".")}
    assert {"learning", "bench"} <= packages - {"tests", "studies"} <= {*CODE}
    digests = {code_sha256(CODE, tmp_path)}
    for number, package in enumerate(CODE):
        path = tmp_path / package / "part" / "code.py"
        path.parent.mkdir(parents=True)
        path.write_text("pass\n")
        (path.parent / "notes.md").write_text("no code")
        digests.add(code_sha256(CODE, tmp_path))
        path.write_text("...\n")
        digests.add(code_sha256(CODE, tmp_path))
        (path.parent / "notes.md").write_text("still no code")
        assert code_sha256(CODE, tmp_path) in digests
        assert len(digests) == 3 + 2 * number


def test_clouds_views_and_random_numbers_are_those_of_the_other_suites():
    objects = tuple(ProceduralObject("chair", "test", number) for number in (0, 1))
    same = {"methods": ("splat",), "conditions": ("noise-0.10",), "objects": objects}
    same |= {"views": 4, "seed": 3}
    (unit,) = units(threads=(1,), **same)
    subjects, _ = subjects_of(unit)
    for job, subject in zip(plan(make_protocol(**same)).method_jobs, subjects, strict=True):
        assert subject.id == f"chair/{job.object.object_id}"
        assert np.array_equal(subject.cloud.points, cloud_of(job).points)
        assert subject.views == job.views
        assert subject.rng().random() == rng_of(job).random()


@pytest.mark.parametrize("views", [1, 3])
def test_a_measurement_of_a_real_method(views):
    """A single view is drawn alone only."""
    memory = iter((50.0, 75.0))
    objects = (Refusing("b"), Tetrahedron("a"))
    unit = Unit("k", SMALL, "blank", "2048", Unchanged(), objects, 1, views, 0, "cpu")
    measurement = measure(unit, peak_mib=lambda: next(memory))
    taken = {name: getattr(measurement, name) for name in ("threads", "views", "clouds", "device")}
    assert taken == {"threads": 1, "views": views, "clouds": 2, "device": "cpu"}
    assert measurement.failures == (CloudFailure("chair/b", "input: no such shape; draw one"),)
    warm = CALLS if views > 1 else CALLS[:2]
    calls = [(0, "load", 0), *((0, *call) for call in CALLS[:2])]
    calls += [(number, *call) for number in (1, 2) for call in warm]
    assert [(s.round, s.stage, s.views) for s in measurement.samples] == calls
    assert {s.cloud for s in measurement.samples[1:]} == {"chair/a"}
    assert all(s.wall_s >= 0 and s.core_s >= 0 for s in measurement.samples)
    assert (measurement.idle_mib, measurement.peak_mib) == (50.0, 75.0)
    assert measurement.elsewhere_cores >= 0


def test_peak_memory_is_a_high_water_mark():
    """Measure a process of its own: one that has had much memory may give some of it back."""
    code = """if True:
        import numpy as np, psutil
        from bench.suites.speed.measure import peak_mib

        before = peak_mib()
        now = psutil.Process().memory_info().rss / 2**20
        kept = np.ones(round(before - now + 64) * 2**17)  # 64 MiB above it
        during = peak_mib()
        del kept
        print(before, during, peak_mib())
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    before, during, after = map(float, done.stdout.split())
    assert during - before == pytest.approx(64, abs=16)
    # the kernel counts pages in batches of 64 for each thread, 0.25 MiB
    assert after == pytest.approx(during, abs=1.0)


def test_a_gpu_is_waited_for_only_where_one_is_used():
    waited = []
    finish_gpu({})
    for used in (False, True):
        cuda = SimpleNamespace(
            synchronize=lambda: waited.append(True), is_initialized=lambda used=used: used
        )
        finish_gpu({"torch": SimpleNamespace(cuda=cuda)})
        assert waited == [True] * used


MEASUREMENT = replace(
    lost(Unit("k", SMALL, "blank", "2048", Unchanged(), (), 1, 20, 0, "cpu"), ""),
    samples=(
        TimingSample("chair/a", 1, "draw", 20, 0.125, 0.25),
        TimingSample("", 0, "load", 0, 1.0, 1.0),
    ),
    failures=(CloudFailure("chair/ä", "draw: no\nfaces"),),
    peak_mib=12.5,
    elsewhere_cores=0.1,
)


def test_a_measurement_survives_its_file(tmp_path):
    assert read_measurement(tmp_path, "k") is None
    write_measurement(tmp_path, MEASUREMENT)
    assert read_measurement(tmp_path, "k") == MEASUREMENT
    assert [p.name for p in (tmp_path / "measurements").iterdir()] == ["k.json"]


def damaged(change):
    def damage(path):
        values = json.loads(path.read_text())
        change(values)
        path.write_text(json.dumps(values))

    return damage


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(path.read_bytes()[:-1]),
        lambda path: path.write_bytes(b"\xff" + path.read_bytes()),
        lambda path: path.write_text("[1, 2]"),
        lambda path: path.write_text("[" * 100_000),
        damaged(lambda values: values.update(form=2)),
        damaged(lambda values: values.update(key="other")),
        damaged(lambda values: values.pop("views")),
        damaged(lambda values: values["samples"][0].pop("wall_s")),
        damaged(lambda values: values.update(samples=3)),
    ],
)
def test_what_cannot_be_read_is_measured_again(tmp_path, damage):
    write_measurement(tmp_path, MEASUREMENT)
    damage(measurement_path(tmp_path, "k"))
    assert read_measurement(tmp_path, "k") is None
