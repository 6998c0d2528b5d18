from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import asdict, dataclass, replace
from itertools import islice

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from bench.catalogue.method import Method
from bench.catalogue.networks import COST_VARIANTS, NETWORK_METHODS
from bench.running.isolation import WorkerFailure
from bench.running.work import load_renderer
from data_prep.datasets.registry import ProceduralObject, open_dataset
from data_prep.failures import StageFailure
from data_prep.rendering.camera import project
from data_prep.rendering.images import blank, to_float, to_uint8
from data_prep.scene import IMAGE_SIZE, View
from studies.documents import NUMBERS, PAGES
from studies.metamorphic import (
    METHODS,
    Difference,
    compare,
    decimal,
    main,
    mean_difference,
    read_differences,
    study,
    summarise,
    to_csv,
)
from studies.relation_clouds import CloudSpec, choose_clouds, cloud_and_view
from studies.relations import RELATIONS

PIXELS = IMAGE_SIZE**2
SPEC = CloudSpec("procedural", ProceduralObject("chair", "validation", 0), "512")
EXACT = ("turned", "shuffled", "points-twice", "mirrored", "last-bit")


def as_images(count):
    """One image as float32 in which `count` pixels [128, 128] have as many grey levels less."""
    return to_float((255 - count)[None, :, :, None].repeat(3, axis=3).astype(np.uint8))


def hits(points, view):
    """Points in each pixel; they do not move to another one by a rounding error of a cloud."""
    pixels, _ = project(points, view)
    column, row = pixels.astype(int).T
    table = np.zeros((IMAGE_SIZE, IMAGE_SIZE), int)
    np.add.at(table, (row, column), 1)
    return table


@dataclass(frozen=True)
class Dots:
    """A renderer of projected points, with one fault or none."""

    fault: str = ""

    def prepare(self, cloud, rng):
        points = cloud.points
        if self.fault == "most" and len(points) > 512:
            raise StageFailure("input", f"{len(points)} points are too many")
        if self.fault == "first half":
            points = points[: len(points) // 2]
        return points

    def draw(self, state, views, rng):
        (view,) = views
        if self.fault == "own camera":
            view = View(0.0, view.elevation_deg)
        if self.fault == "a pixel to the right":
            return np.roll(as_images(100 * (hits(state, view) > 0)), 1, axis=2)
        if self.fault == "counts":
            return as_images(hits(state, view))
        if self.fault == "random":
            return as_images(rng.integers(1, 200) * (hits(state, view) > 0))
        return as_images(100 * (hits(state, view) > 0))


def differences(fault="", spec=SPEC):
    renderer = Dots(fault)
    method = Method("dots", load=lambda _: renderer, identity=str, version=1, source="")
    return {row.relation: row for row in compare(spec, method, renderer)}


def test_a_renderer_of_projected_points_keeps_every_relation():
    rows = differences()
    assert [*rows] == [relation.id for relation in RELATIONS]
    assert {name: rows[name].difference for name in EXACT} == dict.fromkeys(EXACT, "0")
    cloud, view = cloud_and_view(SPEC)
    farther = replace(view, azimuth_deg=view.azimuth_deg + 1)
    changed = (hits(cloud.points, view) > 0) != (hits(cloud.points, farther) > 0)
    assert rows["camera-1-degree"].difference == decimal(100 * changed.sum() / PIXELS)
    assert changed.sum() > 100
    assert rows["turned"].azimuth_deg == decimal(view.azimuth_deg)


def broken(fault):
    """Return the relations that a fault breaks, with the differences."""
    rows = differences(fault)
    return {name: float(rows[name].difference) for name in EXACT if rows[name].difference != "0"}


def test_a_renderer_that_depends_on_the_order_is_found():
    moved = broken("first half")
    assert moved.keys() == {"shuffled"}
    # 256 of 512 points, of which a random half are others: at most 2 * 256 pixels change
    assert 20 * 100 / PIXELS < moved["shuffled"] < 512 * 100 / PIXELS


def test_a_renderer_that_counts_points_twice_is_found():
    cloud, _ = cloud_and_view(SPEC)
    # each of 512 points is one grey level in one pixel
    assert broken("counts") == {"points-twice": float(decimal(len(cloud) / PIXELS))}


def test_a_renderer_that_shifts_its_image_is_found_in_the_mirror():
    cloud, view = cloud_and_view(SPEC)
    seen = hits(cloud.points, view) > 0
    right, left = np.roll(seen, 1, axis=1), np.roll(seen, -1, axis=1)
    expected = 100 * (right != left).sum() / PIXELS
    assert broken("a pixel to the right") == {"mirrored": float(decimal(expected))}


def test_a_renderer_with_a_camera_of_its_own_is_found_when_the_cloud_turns():
    # in the mirror it is a camera at azimuth 0, which mirrors to itself
    assert broken("own camera").keys() == {"turned"}


def test_both_images_of_a_pair_have_the_same_random_numbers():
    assert broken("random") == {}


def test_failures_are_lines_without_a_difference():
    rows = differences("most")
    assert rows["points-twice"].reason == "input: 1024 points are too many"
    assert rows["points-twice"].difference == ""
    assert rows["turned"].reason == ""
    all_failed = differences("most", replace(SPEC, condition="2048"))
    assert {row.reason for row in all_failed.values()} == {"input: 2048 points are too many"}


@pytest.mark.parametrize("method", ["splat", "true-mesh"])
@pytest.mark.parametrize("chair", range(3))
def test_the_mirror_convention_is_that_of_the_renderers(method, chair):
    """Discs are drawn the same bit for bit, meshes but for the samples of their edges.

    The samples of a pixel are not mirrored: a pixel takes another mixture of the colours around it,
    and changes by no more than these differ, and rounding.
    """
    spec = CloudSpec("procedural", ProceduralObject("chair", "validation", chair), "2048")
    (mirror,) = (relation for relation in RELATIONS if relation.mirrored)
    renderer, rng = load_renderer(method, "cpu"), np.random.default_rng(0)
    cloud, view = cloud_and_view(spec)
    changed, other_view = mirror.apply(cloud, view, rng)

    def image(cloud, view):
        (drawn,) = to_uint8(renderer.draw(renderer.prepare(cloud, rng), [view], rng))
        return drawn.astype(int)

    original = image(cloud, view)
    restored = mirror.restore(image(changed, other_view)[None])[0]
    around = maximum_filter(original, (3, 3, 1)) - minimum_filter(original, (3, 3, 1))
    allowed = around + 1 if method == "true-mesh" else np.zeros_like(around)
    assert (np.abs(restored - original) <= allowed).all()
    # the same for a camera that does not change its side, or for an image that is not mirrored
    for wrong in (image(changed, view)[:, ::-1], image(changed, other_view)):
        assert np.abs(wrong - original).mean() > 4
        assert (np.abs(wrong - original) > around + 1).any()


def test_mean_difference_by_hand():
    black, white = blank(1), blank(1)
    black[0, :64] = 0
    assert mean_difference(black, white) == 127.5
    white[0, 0, 0, 0] = 250
    assert mean_difference(white, blank(1)) == 5 / (3 * PIXELS)
    assert decimal(5 / (3 * PIXELS)) == "0.000102"
    assert [*map(decimal, (0.0, 12.345, 0.1, 255.0))] == ["0", "12.3", "0.1", "255"]


# --- clouds ---------------------------------------------------------------------------------------


def write_mesh(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")


def test_clouds_of_several_datasets_come_in_turn(tmp_path):
    for name in ("chair/a.obj", "chair/b.obj", "table/c.obj", "scans/d.obj"):
        write_mesh(tmp_path / name)
    datasets = [open_dataset("procedural:validation"), open_dataset(f"folder:{tmp_path}")]
    clouds = list(islice(choose_clouds(datasets), 39 + 9))
    folder = [spec.key[1:] for spec in clouds if spec.dataset == "folder"]
    assert folder[:3] == [
        ("chair", "a.obj", "2048"), ("table", "c.obj", "noise-0.05"), ("chair", "b.obj", "512"),
    ]  # fmt: skip
    assert len(folder) == len({*folder}) == 9  # each with each condition, none of scans
    assert Counter(condition for *_, condition in folder) == {"2048": 3, "noise-0.05": 3, "512": 3}
    assert [spec.dataset for spec in clouds[:4]] == ["procedural", "folder"] * 2
    procedural = Counter(spec.key[1::2] for spec in clouds if spec.dataset == "procedural")
    assert len(procedural) == 39  # 13 classes with three conditions
    assert {*procedural.values()} == {1}
    assert str(tmp_path) not in str([spec.key for spec in clouds])


def test_the_cloud_and_view_of_a_specification_are_always_the_same():
    cloud, view = cloud_and_view(SPEC)
    cloud_and_view(replace(SPEC, condition="2048"))  # another one in the cache
    again, same_view = cloud_and_view(SPEC)
    assert again is not cloud
    assert np.array_equal(again.points, cloud.points)
    assert (len(cloud), same_view) == (512, view)


# --- files ----------------------------------------------------------------------------------------


def in_this_process(tasks, work, *_):
    """Carry out the tasks of a study one by one."""
    return ((task, work(task)) for task in tasks)


def test_a_study_goes_on_where_it_stopped(tmp_path):
    done = []

    def counting(tasks, work, *_):
        for task in tasks:
            done.append(task.cloud.key)
            yield task, work(task)

    asked = (("procedural:validation",), ("splat",))
    study(tmp_path, *asked, 2, 1, counting)
    whole = (tmp_path / "splat.csv").read_text()
    lines = whole.splitlines(keepends=True)
    assert len(lines) == 1 + 2 * len(RELATIONS)
    # stopped while it wrote a number of the second cloud
    (tmp_path / "splat.csv").write_text("".join(lines[:-1]) + lines[-1][:30])
    study(tmp_path, *asked, 2, 1, counting)
    assert done == [("procedural", "airplane", "validation-0000", "2048"),
                    *2 * [("procedural", "bench", "validation-0000", "noise-0.05")]]  # fmt: skip
    assert (tmp_path / "splat.csv").read_text() == whole
    study(tmp_path, *asked, 3, 1, counting)
    assert len(done) == 4
    # other weights or another version: all is measured again
    old = (tmp_path / "splat.csv").read_text()
    inputs = lines[1].partition(",")[0]
    (tmp_path / "splat.csv").write_text(old.replace(inputs, "00000000"))
    study(tmp_path, *asked, 3, 1, counting)
    assert len(done) == 7
    assert (tmp_path / "splat.csv").read_text() == old


def test_a_lost_worker_costs_one_cloud(tmp_path):
    def losing(tasks, work, *_):
        for i, task in enumerate(tasks):
            yield task, WorkerFailure("timeout", "no result") if i == 0 else work(task)

    study(tmp_path, ("procedural:validation",), ("splat",), 2, 1, losing)
    main(["--out", str(tmp_path), "--summary"])
    rows = list(csv.DictReader((tmp_path / "metamorphic.csv").read_text().splitlines()))
    assert {(row["n_ok"], row["n"]) for row in rows if row["condition"] == "all"} == {("1", "2")}
    lost = [row for row in rows if row["condition"] == "2048"]
    assert {(row["n_ok"], row["median"], row["worst_cloud"]) for row in lost} == {("0", "", "")}


def test_a_summary_worked_by_hand():
    def row(i, difference, reason=""):
        dataset = "folder" if i % 2 else "procedural"
        condition = ("2048", "noise-0.05", "512")[i % 3]
        return Difference(
            "", "mirrored", dataset, "chair", f"object-{i}", condition, "1", "2", difference, reason
        )

    rows = [*(row(i, str(i)) for i in range(20)), row(20, "", "draw: failed")]
    groups = {(r.dataset, r.condition): r for r in summarise("pc2pix", rows)}
    assert [*groups] == [("all", "all"), ("procedural", "all"), ("folder", "all"),
                         ("all", "2048"), ("all", "noise-0.05"), ("all", "512")]  # fmt: skip
    of_all = groups["all", "all"]
    assert asdict(of_all) == {
        "method": "pc2pix", "trained_on": "chairs", "relation": "mirrored",
        "dataset": "all", "condition": "all", "n_ok": 20, "n": 21, "identical_percent": "5.0",
        # 0 to 19: ten of twenty do not exceed 9, nineteen do not exceed 18
        "median": "9", "p95": "18", "worst": "19", "worst_cloud": "chair object-19 at noise-0.05",
    }  # fmt: skip
    odd = groups["folder", "all"]
    assert (odd.n, odd.median, odd.worst, odd.identical_percent) == (10, "9", "19", "0.0")
    assert groups["all", "2048"].worst_cloud == "chair object-18 at 2048"
    assert (groups["all", "512"].n_ok, groups["all", "512"].n) == (6, 7)
    same = next(summarise("pc2pix", [row(0, "0")]))
    assert (same.worst, same.worst_cloud, same.identical_percent) == ("0", "", "100.0")


def test_clouds_without_all_relations_are_no_differences(tmp_path):
    rows = [*differences().values()]
    path = tmp_path / "dots.csv"
    path.write_text(to_csv(Difference, rows))
    assert read_differences(path) == rows
    assert read_differences(path, rows[0].inputs) == rows
    assert read_differences(path, "another") == []
    path.write_text(to_csv(Difference, rows[1:]))
    assert read_differences(path) == []
    assert read_differences(tmp_path / "none.csv") == []


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--methods", "splta"], "metamorphic: unknown method 'splta': did you mean 'splat'"),
        (["--dataset", "procedual"], "metamorphic: unknown dataset 'procedual'"),
        (["--summary"], "no differences of a method; measure without --summary first"),
        (["--clouds", "0"], "2"),
    ],
)
def test_bad_arguments_write_nothing(arguments, problem, tmp_path):
    with pytest.raises(SystemExit, match=problem):
        main(["--out", str(tmp_path), *arguments])
    assert not list(tmp_path.iterdir())


def test_a_folder_of_other_classes_is_refused(tmp_path):
    write_mesh(tmp_path / "meshes" / "scans" / "a.obj")
    with pytest.raises(SystemExit, match="no class of airplane, bench"):
        main(["--out", str(tmp_path / "out"), "--dataset", f"folder:{tmp_path / 'meshes'}"])
    assert not (tmp_path / "out").exists()


# --- model cards ----------------------------------------------------------------------------------

CARDS = [
    page
    for page in PAGES
    if page.parent.name == "weights" and "metamorphic.csv" in page.read_text(encoding="utf-8")
]
MARK = re.compile(r"<!-- numbers: ([^>]*metamorphic\.csv[^>]*)-->")
FEWEST_CLOUDS = 20  # a 95th percentile is then another number than the worst
NETWORKS = {method.id: method for method in (*NETWORK_METHODS, *COST_VARIANTS)}


def measured_in(card):
    """Return the networks in the table of a card."""
    (mark,) = MARK.findall(card.read_text())
    return [name for name in NETWORKS if re.search(rf"method:[^ *;]*\b{name}(?=[,*;\s])", mark)]


@pytest.mark.parametrize("card", CARDS, ids=lambda card: f"{card.parents[1].name}-{card.stem}")
def test_each_card_has_its_relations(card):
    methods = measured_in(card)
    assert methods
    for method in methods:
        weights = NETWORKS[method].weights_file()
        assert (weights.parent, weights.stem[: len(card.stem)]) == (card.parent, card.stem)


def test_the_networks_of_every_family_are_in_a_card():
    measured = {name for card in CARDS for name in measured_in(card)}
    assert measured >= {*METHODS, "pc2pix@acgan", "pc2pix@all", "pc2pix@widened"}


def test_the_numbers_of_the_cards():
    rows = list(csv.DictReader((NUMBERS / "metamorphic.csv").read_text().splitlines()))
    of_all = {
        (row["method"], row["relation"]): row
        for row in rows
        if (row["dataset"], row["condition"]) == ("all", "all")
    }
    measured = [name for card in CARDS for name in measured_in(card)]
    assert of_all.keys() == {(name, relation.id) for name in measured for relation in RELATIONS}
    for (name, relation), row in of_all.items():
        assert int(row["n"]) >= FEWEST_CLOUDS, name
        if not name.startswith("pc2pix") and relation in ("shuffled", "points-twice"):
            assert (row["identical_percent"], row["worst"]) == ("100.0", "0"), name
