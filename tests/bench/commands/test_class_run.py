"""A whole run of the suite `thirteen-classes`, on a folder that has two of them."""

from __future__ import annotations

import csv
import math
import shutil

import pytest
import torch
import trimesh

import bench.analysis.scored
import bench.catalogue.metrics
import bench.running.run
from bench.analysis.scored import read_scored
from bench.commands.publish import run_suite
from bench.judges.views import Labels, ViewsNetwork, to_file
from bench.records.run_folder import read_manifest
from bench.report.build import read_page
from bench.running.options import Options
from bench.tables.build import make_outputs, tables
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from pc2pix import weights as weight_files

from ..builders import write_run

OBJECTS = {"chair": 3, "table": 2}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of three chairs, two chairs called tables, and a class of no table."""
    root = tmp_path_factory.mktemp("meshes")
    chair, number = CLASSES["chair"], 0
    for name, count in {**OBJECTS, "spoon": 1}.items():
        (root / name).mkdir()
        for i in range(count):
            mesh = chair.draw(generator("class run", number)).mesh()
            trimesh.Trimesh(mesh.vertices, mesh.faces).export(root / name / f"{i}.ply")
            number += 1
    return root


@pytest.fixture(scope="module")
def classifier(tmp_path_factory):
    """Return untrained weights of fd-views for the two classes, and their network."""
    torch.manual_seed(0)
    network = ViewsNetwork(Labels(("chair", "table"), ("chair/stool",), ("none",)))
    path = tmp_path_factory.mktemp("views") / "views.safetensors"
    path.write_bytes(to_file(network))
    return path, network.eval()


def rows_of_table_5(directory):
    with (directory / "tables" / "table5_classes.csv").open() as file:
        return {(r["metric"], r["class"], r["method"]): r for r in csv.DictReader(file)}


@pytest.fixture
def planned_only(no_machine, monkeypatch, tmp_path):
    """Have runs end before their jobs."""

    def stop(*arguments):
        raise BadInput("far enough")

    monkeypatch.setattr(bench.running.run, "results", stop)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid


@pytest.fixture(scope="module")
def measured(folder, classifier, tiny_weights, tmp_path_factory):
    directory = tmp_path_factory.mktemp("classes") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(directory.parent))  # no weights for fid
        for module in (bench.catalogue.metrics, bench.analysis.scored):
            patch.setattr(module, "VIEWS_WEIGHTS", classifier[0])
        methods = ("surface-apss", f"pc2pix@{tiny_weights}", "true-mesh", "blank")
        dataset = f"folder:{folder}"
        options = Options("thirteen-classes", dataset, methods, views=3, workers=1, out=directory)
        return run_suite(options)


@pytest.mark.slow
def test_the_classes_that_the_folder_has_their_values_and_the_files(measured):
    out = measured.directory
    expected = [f"{name}/{i}.ply" for name, count in OBJECTS.items() for i in range(count)]
    assert read_manifest(out)["objects"] == expected
    assert (measured.done, measured.failed) == (25, 0)
    found = {path.name for name in ("tables", "figures") for path in (out / name).iterdir()}
    tables = ("headline", "table5_classes", "table5_orderings", "table_ssim", "table_detail")
    assert found == {
        *(f"{name}.{kind}" for name in tables for kind in ("csv", "md")),
        *("classes.png", "table5.png", "table5.svg"),
    }
    rows = rows_of_table_5(out)
    assert rows["class-confidence", "chair", "true-mesh"]["n"] == "9"
    assert rows["ssim", "average", "true-mesh"]["value"] == "1.000000"
    assert float(rows["fd-views", "average", "true-mesh"]["value"]) < 1e-6


@pytest.mark.slow
def test_other_weights_are_not_asked(measured, monkeypatch, classifier, tmp_path):
    other = tmp_path / "other.safetensors"
    other.write_bytes(to_file(ViewsNetwork(classifier[1].labels)))
    monkeypatch.setattr(bench.analysis.scored, "VIEWS_WEIGHTS", other)
    scored = read_scored(measured.directory)
    assert "class-confidence" not in scored.sums.metrics
    assert scored.skipped["class-confidence"] == (
        "skipped: the features are not of the bundled weights of fd-views; start the run again"
    )
    (_, made, _) = tables(scored)
    rows = [row for row in made.rows if row.metric == "class-confidence"]
    assert len(rows) == 12
    assert all(math.isnan(row.value) for row in rows)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a run with random scores and features of six chairs and two tables."""
    objects = [*(f"chair/{name}" for name in "abcdef"), "table/g", "table/h"]
    methods = ["surface-apss", "pc2pix", "true-mesh", "blank"]
    place = tmp_path_factory.mktemp("written")
    cells = {"objects": objects, "methods": methods, "conditions": ["2048"]}
    return write_run(place, suite="thirteen-classes", **cells)


def test_averages_have_intervals_and_the_papers_values_beside_them(written):
    rows = rows_of_table_5(written)
    assert rows["fid", "chair", "surface-apss"]["paper"] == "94.000000"
    # two tables: no jackknife of a class, but one of the average
    assert rows["fd-views", "table", "surface-apss"]["ci_low"] == ""
    assert rows["fd-views", "average", "surface-apss"]["ci_high"] != ""


def test_the_orderings_in_the_report(written):
    outputs = make_outputs(read_scored(written))
    page = read_page(outputs)
    assert page.curves_title == "Class by class"
    assert len(page.tables) == 4
    counts, leads = page.tables[-1].tables
    assert [counts.unfolded, leads.unfolded] == [True, True]
    assert [line.name for line in leads.lines] == ["chair", "table", "average"]
    # as published: 94.0 - 28.8, 127.2 - 39.7, 114.4 - 57.2
    assert [line.cells[1].text for line in leads.lines] == ["+65.2", "+87.5", "+57.2"]
    (made,) = (table for table in outputs.further if table.name == "table5_orderings")
    ssim = [row.difference.value for row in made.rows if row.metric == "ssim"]
    column = [name for name, _ in leads.columns].index("ssim")
    assert [line.cells[column].value for line in leads.lines] == ssim
    explained = [metric for metric, _ in dict(page.meanings)["Metrics"]]
    assert {"kid", "kd-views", "class-confidence"} < set(explained)
    assert len(explained) == len(set(explained))


@pytest.mark.usefixtures("planned_only")
def test_what_is_left_out_is_named_and_what_cannot_be_run_is_refused(
    folder, tmp_path, monkeypatch, capsys
):
    with pytest.raises(BadInput, match="far enough"):
        run_suite(Options("thirteen-classes", f"folder:{folder}", methods=("splat",), out=tmp_path))
    assert capsys.readouterr().err == (
        f"folder:{folder}: no airplane, bench, cabinet, car, display, lamp, loudspeaker, rifle, "
        "sofa, telephone, vessel; left out\n"
    )
    spoons = tmp_path / "spoons"
    shutil.copytree(folder / "spoon", spoons / "spoon")
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)  # without weights
    for dataset, method, message in (
        (spoons, "splat", r"no class 'airplane' .*found spoon"),
        (spoons / "spoon", "splat", "thirteen-classes compares classes, and this dataset has none"),
        (folder, "pc2pix@all", r"weights: 'all' is neither|all.safetensors: the bundled"),
    ):
        out = tmp_path / "x"
        with pytest.raises(BadInput, match=message):
            run_suite(Options("thirteen-classes", f"folder:{dataset}", methods=(method,), out=out))
        assert not out.exists()
