"""Runs with methods entered by images: their scores, failures, costs and what is done again."""

from __future__ import annotations

import csv
import json
import re
import shlex
import shutil
import subprocess
import sys
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from baselines.splat import Splat
from bench.commands.config import read_config
from bench.records.job import GROUND_TRUTH
from bench.running.export import export
from bench.running.options import Options
from bench.running.plan import ObjectJobs, plan
from bench.running.protocol import Protocol
from data_prep.datasets.exported import checksum_of
from data_prep.files.clouds import load_points
from data_prep.rendering.images import to_uint8
from data_prep.scene import PointCloud, View

from ..builders import refusal, write_run

REPOSITORY = Path(__file__).parents[3]
TIMES = {"prepare_s": 3.5, "draw_s": 0.25}


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    """Two chairs from two views at two conditions."""
    out = tmp_path_factory.mktemp("export") / "export"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.running.protocol.environment", dict)
        export(Options("chair-robustness", conditions=("512",), limit=2, views=2, workers=1), out)
    return out


def draw_tree(exported: Path, tree: Path, name="our-splat", **facts) -> Path:
    """Draw an export with `splat`, from its files alone, as an author would."""
    views: dict[tuple[str, str], list[View]] = {}
    for row in csv.DictReader((exported / "views.csv").read_text().splitlines()):
        view = View(float(row["azimuth_deg"]), float(row["elevation_deg"]))
        views.setdefault((row["class"], row["object"]), []).append(view)
    renderer = Splat()
    for row in csv.DictReader((exported / "clouds.csv").read_text().splitlines()):
        state = renderer.prepare(PointCloud(load_points(exported / row["file"]).astype(np.float32)))
        images = to_uint8(renderer.draw(state, views[row["class"], row["object"]]))
        folder = tree / row["condition"] / row["class"] / row["object"]
        folder.mkdir(parents=True)
        for view, image in enumerate(images):
            Image.fromarray(image).save(folder / f"{view:02d}.png")
    stated = {
        "name": name,
        "source": "discs",
        "trained_on": "nothing",
        "hardware": "a processor",
        **TIMES,
        "licence": "MIT",
        "export": json.loads((exported / "croissant.json").read_text())["identifier"],
    }
    lines = (f"{key} = {json.dumps(value)}\n" for key, value in (stated | facts).items())
    (tree / "method.toml").write_text("".join(lines))
    return tree


@pytest.fixture
def tree(exported, tmp_path) -> Path:
    return draw_tree(exported, tmp_path / "tree")


def jobs_of(exported: Path, *methods: str, conditions=("2048", "512")) -> list[ObjectJobs]:
    options = Options("chair-robustness", f"exported:{exported}", methods, conditions, views=2)
    return [*plan(Protocol.from_options(options))]


def keys_of(exported: Path, tree: Path) -> dict[str, str]:
    jobs = (job for obj in jobs_of(exported, f"images:{tree}", "blank") for job in obj.method_jobs)
    return {"/".join((job.method, job.condition, job.object.object_id)): job.key for job in jobs}


def test_the_checksum_is_that_of_the_two_lists(exported, tree):
    """It is what an author computes with `cat clouds.csv views.csv | sha256sum`."""
    lists = b"".join((exported / f"{name}.csv").read_bytes() for name in ("clouds", "views"))
    assert checksum_of(exported) == sha256(lists).hexdigest()
    assert f'export = "{checksum_of(exported)}"' in (tree / "method.toml").read_text()


def test_only_what_has_changed_is_done_again(no_machine, exported, tree):
    before = keys_of(exported, tree)
    assert keys_of(exported, tree) == before
    Image.new("RGB", (128, 128), (9, 9, 9)).save(tree / "512/chair/test-0001/00.png")
    after = keys_of(exported, tree)
    changed = {name for name in before if after[name] != before[name]}
    assert changed == {"our-splat/512/test-0001"}
    text = (tree / "method.toml").read_text()
    (tree / "method.toml").write_text(text.replace("draw_s = 0.25", "draw_s = 0.5"))
    changed = {name for name, key in keys_of(exported, tree).items() if key != before[name]}
    assert changed == {name for name in before if name.startswith("our-splat/")}
    (tree / "method.toml").write_text(text.replace("discs", "the same in other words"))
    assert keys_of(exported, tree) == after


def test_only_such_a_method_gets_to_know_which_cloud_it_is(no_machine, exported):
    from bench.catalogue.methods import find_method
    from bench.running.work import seen_by
    from data_prep.scene import CloudOrigin

    cloud = PointCloud(np.zeros((3, 3), np.float32), origin=CloudOrigin("512", "chair", "a", ()))
    assert seen_by(find_method("splat"), cloud).origin is None
    assert seen_by(find_method("true-mesh"), cloud).origin is None


def problem(*methods: str, dataset: str) -> str:
    options = Options("chair-robustness", dataset, methods, ("512",), limit=1, views=2)
    return refusal(lambda: plan(Protocol.from_options(options)))


def test_a_run_that_cannot_use_a_tree_is_refused(no_machine, exported, tree, tmp_path):
    images, dataset = f"images:{tree}", f"exported:{exported}"
    assert problem(images, dataset="procedural").startswith(
        f"{images}: has images of an export, and procedural is none; give --dataset exported:PATH, "
    )
    other = draw_tree(exported, tmp_path / "other")
    assert problem(images, f"images:{other}", dataset=dataset) == (
        f"images:{other}: name 'our-splat' is that of {images}, too; give one of them another name"
    )
    foreign = draw_tree(exported, tmp_path / "foreign", "foreign", export="0" * 64)

    def differs() -> str:
        return problem(f"images:{foreign}", dataset=dataset)

    chair = foreign / "2048/chair/test-0000"
    shutil.rmtree(foreign / "2048/chair/test-0001")
    shutil.rmtree(foreign / "512")
    assert (
        "): the images are of other clouds or views, perhaps of another --seed or protocol; "
        in differs()
    )
    shutil.copy(chair / "00.png", chair / "02.png")
    assert "'chair/test-0000' has 3 images, and 2 views in the run; draw" in differs()
    (foreign / "2048/chair/mine").mkdir()
    assert "of other objects ('chair/mine' is none of the run); draw those of this e" in differs()


def test_other_commands_do_not_take_images(command, tree, tmp_path):
    out, cloud = tmp_path / "out", REPOSITORY / "examples" / "chair.ply"
    for arguments in (
        ("run", "--suite", "speed", "--methods", f"images:{tree}", "--out", out),
        ("render", cloud, "--method", f"images:{tree}", "-o", f"{out}.png"),
    ):
        status, _, err = command(*arguments)
        assert status == 2
        assert f"images:{tree}: images of an export, which cannot draw other clouds;" in err
        assert err.count("\n") == 1
        assert not out.exists()


@pytest.mark.slow
def test_a_run_of_two_trees_has_a_row_of_each(
    no_machine, exported, tree, tmp_path, command, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    draw_tree(exported, tmp_path / "second", "second-splat", trained_on="<b>cars</b>")
    (tmp_path / "second/512/chair/test-0000/00.png").unlink()
    run = ("run", "--suite", "chair-robustness", "--dataset", f"exported:{exported}", "--views", 2)
    run = (*run, "--workers", 1, "--conditions", "2048,512", "--out", "out")
    status, out, err = command(*run, "--methods", "images:tree,images:second,splat")
    assert (status, "1 failed" in err) == (0, True), err
    records = pd.read_parquet("out/records.parquet")
    assert list(dict.fromkeys(records["method"])) == [
        *("blank", "our-splat", "second-splat", "splat")
    ]
    scores = ["ssim", "ssim_object", "lpips", "psnr", "silhouette_iou", "thin_recall"]
    ours, theirs = (
        records[records["method"] == name][scores].to_numpy() for name in ("splat", "our-splat")
    )
    np.testing.assert_array_equal(ours, theirs)
    failed = records[records["outcome"] == "failed"]
    assert set(failed["reason"]) == {"images: no image at 512/chair/test-0000/00.png"}
    assert set(failed["method"]) == {"second-splat"}
    manifest = json.loads(Path("out/manifest.json").read_text())
    assert manifest["methods"] == ["our-splat", "second-splat", "splat", "blank"]
    assert manifest["entered"]["our-splat"]["tree"] == str(tree)
    assert manifest["request"]["methods"] == [
        *(f"images:{tree}", f"images:{tmp_path / 'second'}", "splat", "blank")
    ]
    rows = [line for line in Path("out/cost.md").read_text().splitlines() if "-splat" in line]
    assert [row.count("3500.0 + 250.0 claimed") for row in rows] == [2, 2]
    assert GROUND_TRUTH not in out
    page = Path("out/report.html").read_text()
    assert "discs; entered by images, drawn elsewhere on a processor, its times are claimed" in page
    assert "&lt;b&gt;cars&lt;/b&gt;" in page
    assert "<b>cars" not in page
    # Without the trees everything can be read, and `bench add` keeps the methods with them.
    adding = ("add", "splat", "out", "--workers", 1)
    status, _, err = command(*adding)
    assert (status, "0 jobs done, 16 from before" in err) == (0, True), err
    assert json.loads(Path("out/manifest.json").read_text())["methods"] == manifest["methods"]
    repeated = read_config(Path("out/manifest.json"))["methods"]
    assert repeated.split(",") == manifest["request"]["methods"]
    (tmp_path / "tree").rename("gone")
    write_run(Path("other"))
    assert command("report", "out", "other", "--out", "site")[0] == 0
    index = Path("site/index.html").read_text()
    assert index.count("<small>claimed</small>") == 2  # costs of both
    assert "&lt;b&gt;cars&lt;/b&gt;" in index
    assert command("compare", "out", "--methods", "our-splat,second-splat")[0] == 0
    status, _, err = command(*adding)
    assert status == 2
    assert "its run cannot be continued on this machine: " in err


@pytest.mark.slow
def test_images_join_a_run_whose_inputs_are_those_of_the_export(
    no_machine, exported, tree, command, monkeypatch
):
    """`our-splat` are the images of `splat`, so that both have the same values."""
    monkeypatch.chdir(tree.parent)
    asked = ("--conditions", "2048,512", "--limit", 2, "--views", 2, "--workers", 1)
    run = ("run", "--suite", "chair-robustness", "--methods", "splat", *asked)
    assert command(*run, "--out", "base")[0] == 0
    assert command(*run, "--seed", 1, "--out", "other")[0] == 0
    status, _, err = command("add", f"images:{tree}", "other", "--workers", 1)
    assert (status, "its export has other clouds or views than " in err) == (2, True), err
    assert command("add", f"images:{tree}", "base", "--workers", 1)[0] == 0
    frame = pd.read_csv("base/tables/headline.csv")
    values = frame.pivot(index=["metric", "condition"], columns="method", values="value")
    np.testing.assert_allclose(values["our-splat"], values["splat"], rtol=1e-6)
    assert command("table", "base")[0] == 0
    assert command("check", "base", "--again", "1")[0] == 0
    status, _, err = command("add", f"images:{tree}", "base", "--workers", 1)
    assert (status, "0 jobs done" in err) == (0, True), err


@pytest.mark.slow
def test_images_of_some_conditions_join_a_run(no_machine, exported, tree, command, monkeypatch):
    """The run's methods are measured on the export first; then there is nothing left to do."""
    monkeypatch.chdir(tree.parent)
    shutil.rmtree(tree / "2048")
    (tree / "512/chair/test-0000/00.png").unlink()
    # The export has no clouds of 1024, so that nobody can have drawn them.
    asked = ("--conditions", "2048,512,1024", "--limit", 2, "--views", 3, "--workers", 1)
    run = ("run", "--suite", "chair-robustness", "--methods", "splat", *asked, "--out", "base")
    assert command(*run)[0] == 0
    adding = ("add", f"images:{tree}", "base", "--workers", 1)
    status, _, err = command(*adding)
    assert (status, "its export has other clouds or views than " in err) == (2, True), err
    status, out, err = command(*adding, "--dataset", f"exported:{exported}")
    assert (status, "3 failed" in err) == (0, True), err
    assert "has no clouds of 1024, which are left out" in err
    assert "our-splat has 1 of 2 conditions: 512. Places and comparisons here are of " in out
    assert "our-splat at 512: 2 of 4 images, the others scored as blank." in out
    assert "the best there by ssim-object and lpips: splat\nour-splat against splat on 2 " in out
    manifest = json.loads(Path("base-exported-export/manifest.json").read_text())
    assert (manifest["methods"], manifest["views"]) == (["splat", "blank", "our-splat"], 2)
    status, again, err = command("add", f"images:{tree}", "base-exported-export")
    assert (status, "0 jobs done" in err, again) == (0, True, out), err


def commands_of_page() -> list[list[str]]:
    """Return the commands of the section with the walk, in words."""
    text = (REPOSITORY / "docs" / "extending.md").read_text()
    section = text.partition("## A method that runs elsewhere\n")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    text = "".join(block for kind, block in blocks if not kind)
    lines = re.sub(r" *\\\n *", " ", text).splitlines()
    return [shlex.split(line) for line in lines]


@pytest.mark.slow
def test_the_page_leads_to_a_row(no_machine, tmp_path, command, monkeypatch):
    """Its commands on one object; where PyVista is not installed, `splat` draws in its place."""
    monkeypatch.chdir(tmp_path)
    exporting, (python, script, *folders), running = commands_of_page()
    small = ("--limit", 1, "--views", 2, "--workers", 1)
    assert command(*exporting[1:], *small)[0] == 0
    assert (python, folders) == ("python", ["exported-chairs", "images"])
    if find_spec("pyvista"):
        subprocess.run([sys.executable, REPOSITORY / script, *folders], check=True)
    else:
        assert (REPOSITORY / script).is_file()
        draw_tree(Path("exported-chairs"), Path("images"), "pyvista-points")
    status, _, err = command(*running[1:], *small, "--out", "out")
    assert (status, " 0 failed" in err) == (0, True), err
    table = Path("out/tables/headline.md").read_text()
    assert re.search(r"^\| pyvista-points +\|", table, re.MULTILINE), table
    assert len((REPOSITORY / script).read_text().splitlines()) <= 30
