"""Golden values by object, on runs of 7 objects x 3 methods x 2 conditions x 2 views."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

import bench.check.golden_values
from bench.analysis.run import read_run
from bench.catalogue.metrics import IMAGE_METRICS, column
from bench.catalogue.suites import SUITES, with_truth
from bench.check.golden import bless, check
from bench.check.golden_values import golden, golden_name
from bench.check.objects import Widths, golden_thumbnails, read_objects
from bench.check.thumbnails import ACROSS, SIDE, read_png, thumbnail, to_png
from bench.check.tolerances import PRINTED, object_tolerance
from bench.draw.finish import LABEL_HEIGHT, MARGIN, PROBLEM_GROUND
from bench.records.folder import open_store, read_manifest, write_manifest
from bench.records.frames import read_jobs, stored_artifacts
from bench.running.environment import environment_of, is_same, told_mixture
from bench.tables.build import write_outputs
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput

from ..builders import SUITE, damage_images, overwrite, rewrite, write_run, write_run_with_tables
from .conftest import be_default

OBJECTS = [f"chair/{name}" for name in "abcdefg"]
SAME = (
    "same environment as the golden values: means of objects are compared to the last digit, "
    "images to the last bit"
)
FEWER = "{} of 28 lines of the golden values are compared: this run has no others"
PART = "not all golden objects: means and distances of the run are not compared"


def parts(values):
    """Return the line on so many values of all image metrics, none of which moved."""
    first = 2 * values // len(IMAGE_METRICS)
    return (
        f"ssim-object and lpips: {first} values, 0 moved; others: {values - first} values, 0 moved"
    )


@pytest.fixture(scope="module")
def seven(tmp_path_factory):
    """A folder with a finished run, and results whose golden values are its own."""
    folder = tmp_path_factory.mktemp("seven")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench.check.golden_values, "GOLDEN", folder / "results" / "golden")
        be_default(patch, objects=OBJECTS)
        bless(write_run_with_tables(folder / "run", objects=OBJECTS))
    return folder


@pytest.fixture
def golden_results(seven, results, monkeypatch):
    """A copy of these golden values, to be altered; the run that they are of is the default."""
    be_default(monkeypatch, objects=OBJECTS)
    return Path(shutil.copytree(seven / "results", results))


@pytest.fixture
def run(seven, golden_results, tmp_path):
    """A copy of the run."""
    return Path(shutil.copytree(seven / "run", tmp_path / "run"))


@pytest.fixture
def part(tmp_path, golden_results):
    """A run of five of the objects."""
    return write_run(tmp_path / "part", objects=OBJECTS[:5])


def alter(run, by, score="ssim", method="splat", condition="512"):
    """Add to the scores of some objects, in records and tables."""
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    chosen = (frame["method"] == method) & (frame["condition"] == condition)
    frame.loc[chosen, score] += frame.loc[chosen, "object"].map(by).fillna(0.0)
    overwrite(path.parent, frame)
    write_outputs(read_run(run))


def set_manifest(run, **changes):
    write_manifest(run, read_manifest(run) | changes)


def values(run, objects, condition="512"):
    """SSIM of splat for each object, from the records."""
    frame = pd.read_parquet(run / "records.parquet")
    frame = frame[(frame["method"] == "splat") & (frame["condition"] == condition)]
    means = frame.groupby("object")["ssim"].mean()
    return [means[name] for name in objects]


@pytest.mark.parametrize("kind", ["run", "part"])
def test_three_objects_of_one_method_at_one_condition(kind, request, command):
    """The mean over 7 objects moves by 0.00086, less than the 0.001 that it may."""
    run = request.getfixturevalue(kind)
    was = values(run, "bcd")
    alter(run, dict.fromkeys("bcd", -0.002))
    status, out, err = command("check", run)
    assert (status, err) == (1, "")
    *remarks, line, _, count, drawn = out.splitlines()
    assert remarks == ([SAME] if kind == "run" else [PART, FEWER.format(20), SAME])
    beginning, _, worst = line.rpartition(": ")
    objects = 7 if kind == "run" else 5
    assert beginning == (
        f"moved (worse) ssim of splat at 512: 3 of {objects} objects moved by more than 0.000001"
    )
    assert sorted(worst.split("; ")) == [
        f"chair/{name} {before - 0.002:.6f}, golden {before:.6f} (same images)"
        for name, before in zip("bcd", was, strict=True)
    ]
    assert count.endswith("golden values compared, 1 moved")
    assert drawn == f"the objects that moved most: {run}/figures/moved.png"


def test_what_has_no_golden_value_is_named_and_left_out(tmp_path, golden_results, command):
    run = write_run_with_tables(
        tmp_path / "run",
        objects=["chair/a", "chair/new", "chair/b"],
        methods=["splat", "constant", "blank"],
        conditions=["1024", "512"],
    )
    status, out, _ = command("check", run)
    assert status == 0
    assert out.splitlines() == [
        PART,
        "without golden values, left out: methods constant",
        "without golden values, left out: conditions 1024",
        "without golden values, left out: objects chair/new",
        FEWER.format(4),
        SAME,
        # blank is the same at every condition, so that it has golden values at 1024
        parts(2 * 3 * len(IMAGE_METRICS)),
        f"{2 * 3 * len(IMAGE_METRICS)} golden values compared, 0 moved",
    ]


def test_another_environment_widens_the_tolerance(part):
    set_manifest(part, environment={"gl": "another driver"})
    # 0.0022, three times the largest move of a chair by a turn of 0.1 degree
    alter(part, dict.fromkeys("bcd", -0.002))
    verdict = check(part)
    assert verdict.differing == ()
    assert verdict.remarks == (
        PART,
        FEWER.format(20),
        "another environment than the golden values': gl another driver (golden: None); "
        "wider tolerances: ssim-object 0.0055, lpips 0.01 of splat, blank; ssim-object 1e-06, "
        "lpips 1e-06 of true-mesh (--strict: to the last digit)",
    )
    strict = check(part, Widths(strict=True))
    assert strict.remarks[2].startswith("another environment than the golden values', compared to ")
    assert "ssim of splat at 512: 3 of 5 objects moved by more than 0.000001" in strict.differing[0]
    alter(part, {"c": -0.001})
    (line,) = check(part).differing
    assert line.startswith("ssim of splat at 512: 1 of 5 objects moved by more than 0.002200: ")
    assert "chair/c" in line


def test_a_run_of_several_environments_is_compared_by_the_wider_tolerance(part):
    """The tolerance is the wider one even where the last jobs have the golden environment."""
    here = environment_of(read_manifest(part))
    alter(part, {"c": -0.001})
    assert len(check(part).differing) == 1
    set_manifest(part, environments=[here | {"jobs": 9}])
    assert len(check(part).differing) == 1
    set_manifest(part, environments=[here | {"jobs": 9}, here | {"jobs": 3, "torch": "0.1"}])
    result = check(part)
    assert result.differing == ()
    assert f"torch {here['torch']} | 0.1 (golden: {here['torch']}); wider" in result.remarks[-1]
    assert result.remarks[-1].endswith(
        f"its jobs were made in 2 environments: 9 with torch {here['torch']}; 3 with torch 0.1"
    )


def test_what_an_environment_is():
    manifest = {
        "device": "auto",
        "environment": {"gl": "driver", "render": "1"},
        "machine": {"cpu": "A", "instructions": "avx"},
        "versions": {"numpy": "2", "pandas": "3", "pc2pix-bench": "1"},
        "cluster": None,
    }
    plain = environment_of(manifest)
    assert (plain["gl"], plain["cpu"], plain["numpy"]) == ("driver", "A, avx", "2")
    for other in (
        {"environment": {"gl": "another"}},
        {"machine": {"cpu": "A", "instructions": "avx2"}},
        {"versions": {"numpy": "3"}},
        {"device": "cuda"},
        {"cluster": {"cpus": 4}},
        {"environments": [plain | {"jobs": 2}, plain | {"jobs": 1, "numpy": "3"}]},
    ):
        assert environment_of(manifest | other) != plain
    for same in (
        {"environment": {"gl": "driver", "render": "2"}},  # our own code: a regression shows
        {"versions": {"numpy": "2", "pandas": "4", "pc2pix-bench": "2"}},
        {"environments": [plain | {"jobs": 3}]},
    ):
        assert environment_of(manifest | same) == plain
    mixed = manifest | {"environments": [plain | {"jobs": 2}, plain | {"jobs": 1, "numpy": "3"}]}
    assert environment_of(mixed) == plain | {"numpy": "2 | 3"}
    assert is_same(plain, environment_of(manifest))
    assert not is_same(environment_of(mixed), environment_of(mixed))
    assert (
        told_mixture(mixed)
        == "its jobs were made in 2 environments: 2 with numpy 2; 1 with numpy 3"
    )


def test_tolerances_of_objects():
    for metric in IMAGE_METRICS:
        assert object_tolerance("splat", metric, same_environment=True) == PRINTED == 1e-6
        assert object_tolerance("true-mesh", metric, same_environment=False) == 1e-6
        network = object_tolerance("pc2pix", metric, same_environment=False)
        assert network > 1e-6
        assert object_tolerance("surface-apss", metric, same_environment=False) >= network
    # three times the deviation of a chair, 0.0156
    assert object_tolerance("surface-apss", "ssim", same_environment=False) == 0.047


def lines_of(name):
    objects = read_objects(name)
    assert objects is not None
    return objects.lines


def test_the_file_has_the_means_of_the_records(run, results):
    lines = lines_of(SUITE)
    assert lines[["method", "condition"]].drop_duplicates().to_numpy().tolist() == [
        ["splat", "2048"], ["splat", "512"], ["true-mesh", "any"], ["blank", "any"]
    ]  # fmt: skip
    assert lines["object"].tolist() == 4 * [*"abcdefg"]
    records = pd.read_parquet(run / "records.parquet").set_index(["method", "condition", "object"])
    for line in lines.to_dict("records"):
        condition = "2048" if line["condition"] == "any" else line["condition"]
        key: Any = line["method"], condition, line["object"]
        of_item = records.loc[key]
        for metric in IMAGE_METRICS:
            first, second = of_item[column(metric)]
            assert line[metric] == pytest.approx((first + second) / 2, abs=5.1e-7)
    assert lines["images"].nunique() == len(lines)
    size = (results / "golden" / f"{SUITE}-objects.csv").stat().st_size
    assert size < 140 * (len(lines) + 1)  # bytes


def test_no_value_is_golden_too(run, golden_results):
    path = run / "records.parquet"
    frame = pd.read_parquet(path)
    frame.loc[frame["method"] == "blank", "thin_precision"] = np.nan
    overwrite(path.parent, frame)
    write_outputs(read_run(run))
    bless(run)
    assert lines_of(SUITE)["thin-precision"].isna().sum() == 7
    assert check(run).differing == ()
    drawn = (frame["method"] == "blank") & (frame["object"] == "c") & (frame["view"] == 1)
    frame.loc[drawn & (frame["condition"] == "512"), "thin_precision"] = 0.25
    overwrite(path.parent, frame)
    write_outputs(read_run(run))
    (line,) = check(run).differing
    assert line == (
        "thin-precision of blank at 512: 1 of 7 objects moved by more than 0.000001: "
        "chair/c 0.250000, golden no value (same images)"
    )


def halves(left, right):
    """An image [128, 128, 3] of two colours."""
    image = np.empty((128, 128, 3), np.uint8)
    image[:, :64], image[:, 64:] = left, right
    return image


def paint(run):
    """Every artifact gets an image of two colours of its own; all by item.

    Those of a method that sees no cloud are the same at every condition.
    """
    painted, numbers = {}, {}
    for name, artifact in [*stored_artifacts(run).items()]:
        seen = name if name.method == "splat" else name._replace(condition="")
        number = numbers.setdefault(seen, len(numbers))
        painted[name] = halves((number, 255 - number, 0), (0, number, 255 - number))
        redraw(run, artifact.key, painted[name])
    return painted


def redraw(run, key, image):
    both = np.stack([image, 255 - image])
    rewrite(run, key, lambda result, arrays: (result, arrays | {"images": both}))


def item_of(run, obj, method="splat", condition="512"):
    (job,) = (
        job for job in read_jobs(run)
        if job.name[:2] == (method, condition) and job.name.object_id == obj
    )  # fmt: skip
    return job.name


def test_the_objects_that_moved_most_beside_their_golden_images(run, golden_results, command):
    golden = paint(run)
    bless(run)
    alter(run, {"c": -0.3, "e": 0.2})
    alter(run, {"a": 0.1}, method="blank", condition="2048")
    red = halves((255, 0, 0), (0, 0, 0))
    redraw(run, key_of(run, "c"), red)
    removed: Any = None
    damage_images(run, [key_of(run, "e")], data=removed)
    status, out, _ = command("check", run)
    assert status == 1
    assert f"chair/c {values(run, 'c')[0]:.6f}, golden" in out
    assert "; chair/e" in out
    assert out.count("(same images)") == 1  # of blank
    sheet = np.asarray(Image.open(run / "figures" / "moved.png"))
    tiles = [*tiles_of(sheet, 6)]
    for tile, image in (
        (tiles[0], red),
        (tiles[1], golden[item_of(run, "c")]),
        (tiles[3], golden[item_of(run, "e")]),
        (tiles[4], golden[item_of(run, "a", "blank", "2048")]),
        (tiles[5], golden[item_of(run, "a", "blank", "2048")]),
    ):
        assert (tile == image.repeat(2, axis=0).repeat(2, axis=1)).all()
    assert (tiles[2][0, 0] == PROBLEM_GROUND).all()  # no image any more

    alter(run, {"c": 0.3, "e": -0.2})
    alter(run, {"a": -0.1}, method="blank", condition="2048")
    status, out, _ = command("check", run)
    assert status == 1
    assert (
        "moved images of splat at 512: 2 of 7 objects have other images than the golden ones, "
        "though their values agree: chair/c; chair/e\n"
    ) in out
    assert not (run / "figures" / "moved.png").exists()
    for name in "ce":
        redraw(run, key_of(run, name), golden[item_of(run, name)])
    assert command("check", run)[0] == 0


def key_of(run, obj) -> Any:
    with open_store(run) as store:
        return next(job.key for job in store.listed() if job.name == item_of(run, obj))


def tiles_of(sheet, count):
    side = 256
    wide, high = side + MARGIN, side + LABEL_HEIGHT + MARGIN
    for i in range(count):
        left, top = MARGIN + i % 4 * wide, MARGIN + i // 4 * high + LABEL_HEIGHT
        yield sheet[top : top + side, left : left + side]


def test_a_read_only_folder_does_not_change_the_verdict(part, command):
    alter(part, {"a": -0.002})
    (part / "figures").mkdir()
    (part / "figures" / "moved.png").mkdir()  # cannot be replaced by a file
    status, out, err = command("check", part)
    assert status == 1
    assert ") ssim of splat" in out
    assert err.startswith(f"bench: {part}/figures/moved.png: cannot be written")


def restate(path, **protocol):
    """State another protocol of the golden values by object; None leaves an entry out."""
    stated = json.loads(path.read_text())
    stated["protocol"] |= protocol
    stated["protocol"] = {k: v for k, v in stated["protocol"].items() if v is not None}
    path.write_text(json.dumps(stated))


def reprotocol(path, version):
    """Write the golden means as of another version of the protocol; None leaves it out."""
    frame = pd.read_csv(path, dtype={"condition": str})
    written = frame.drop(columns="protocol") if version is None else frame.assign(protocol=version)
    written.to_csv(path, index=False)


OLDER = PROTOCOL_VERSION - 1


@pytest.mark.parametrize(
    ("name", "harm", "message"),
    [
        ("-objects.csv", lambda p: p.write_bytes(p.read_bytes()[:-20]), "damaged, or of another"),
        ("-objects.png", lambda p: p.write_bytes(p.read_bytes()[:999]), "damaged, or of another"),
        ("-objects.json", lambda p: p.write_text("{"), "are damaged"),
        ("-objects.json", lambda p: p.write_text("[]"), "are damaged"),
        ("-objects.csv", Path.unlink, "are damaged"),
        ("-objects.json", Path.unlink, "are damaged"),
        ("-objects.json", lambda p: restate(p, views=3), "of another protocol than the golden val"),
        (".csv", lambda p: reprotocol(p, None), "its protocol is None, no whole number; write it"),
        (".csv", lambda p: reprotocol(p, "x"), "its protocol is 'x', no whole number; write it"),
        (".csv", lambda p: reprotocol(p, f"{PROTOCOL_VERSION}.0"), ".0, no whole number; write it"),
        (".csv", lambda p: reprotocol(p, OLDER), f"of protocol {OLDER}, this version has protocol"),
    ],
)
def test_files_that_cannot_be_used_are_named_with_a_remedy(
    part, golden_results, refused, name, harm, message
):
    path = golden_results / "golden" / f"{SUITE}{name}"
    harm(path)
    said = refused("check", part)
    assert said.startswith(f"{golden_results}/golden/{SUITE}")
    assert message in said
    assert "'bench check DIR --bless results/golden'" in said


def test_nothing_is_blessed_without_its_images(run, golden_results, refused):
    before = {path: path.read_bytes() for path in golden_results.glob("golden/*")}
    damage_images(run, [key_of(run, "d")])
    assert refused("check", run, "--bless", golden_results / "golden") == (
        f"{run}: images of splat at 512 of chair/d cannot be read; "
        "start the run again with its command"
    )
    assert {path: path.read_bytes() for path in golden_results.glob("golden/*")} == before


def test_thumbnails_are_means_of_blocks():
    image = np.zeros((128, 128, 3), np.uint8)
    image[0:2, 0:2, 0] = [[1, 2], [3, 4]]  # 2.5, rounded half up
    image[126:, 126:, 2] = 255
    small = thumbnail(image)
    assert small.shape == (SIDE, SIDE, 3)
    assert small[0, 0].tolist() == [3, 0, 0]
    assert small[-1, -1].tolist() == [0, 0, 255]
    assert small.sum(dtype=int) == 3 + 255


def test_a_sheet_is_read_back_in_its_order(tmp_path):
    count = ACROSS + 2
    thumbnails = [np.full((SIDE, SIDE, 3), (i, 2 * i, 7 * i), np.uint8) for i in range(count)]
    path = tmp_path / "sheet.png"
    path.write_bytes(to_png(thumbnails))
    tiles = read_png(path)
    assert len(tiles) == 2 * ACROSS
    assert (tiles[:count] == np.stack(thumbnails)).all()
    assert (tiles[count:] == 255).all()
    Image.new("RGB", (100, 100)).save(path)
    with pytest.raises(BadInput, match="no sheet of thumbnails"):
        read_png(path)
    path.write_bytes(b"nothing")
    with pytest.raises(BadInput, match="not a readable PNG"):
        read_png(path)


@pytest.mark.parametrize("truth", ["coloured", "grey"])
def test_the_golden_objects_of_this_project(truth):
    """They are of the run of the golden means: where every image has a value, their means agree."""
    suite = with_truth(SUITES[0], truth)
    name = golden_name({"suite": suite.id, "truth": truth})
    objects = read_objects(name)
    assert objects is not None
    frame = golden(name)
    for metric in ("ssim", "luminance", "contrast", "structure", "silhouette-iou"):
        means = frame[frame["metric"] == metric].set_index(["method", "condition"])["value"]
        every = objects.part({"methods": suite.methods, "conditions": suite.conditions,
                              "objects": objects.names["objects"]})  # fmt: skip
        means_of_objects = every.groupby(["method", "condition"])[metric].mean()
        assert set(means_of_objects.index) == set(means.index)
        # both are rounded to six digits
        assert (means_of_objects - means).abs().max() < 1.1e-6
    assert objects.environment["gl"] != "None"
    sheet = golden_thumbnails(name)
    assert len(objects.lines) <= len(sheet) < len(objects.lines) + ACROSS
