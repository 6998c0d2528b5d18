"""A whole run of the suite `thirteen-classes`, on a folder that has two of them."""

from __future__ import annotations

import csv
import math
import shutil

import pytest
import torch
import trimesh

import bench.analysis.scored_run
import bench.catalogue.metrics
import bench.running.run
from bench.analysis.scored_run import read_run
from bench.commands.publish import run_suite
from bench.judges.views import Labels, ViewsNetwork, to_file
from bench.records.run_folder import read_manifest
from bench.running.options import Options
from bench.tables.build import tables
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from pc2pix import weights as weight_files

from ..builders import rows_of

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

    monkeypatch.setattr(bench.running.run, "do_and_store", stop)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid


@pytest.fixture(scope="module")
def measured(folder, classifier, tiny_weights, tmp_path_factory):
    directory = tmp_path_factory.mktemp("classes") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(directory.parent))  # no weights for fid
        for module in (bench.catalogue.metrics, bench.analysis.scored_run):
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
    monkeypatch.setattr(bench.analysis.scored_run, "VIEWS_WEIGHTS", other)
    scored = read_run(measured.directory)
    assert not scored.has("class-confidence")
    assert scored.skipped["class-confidence"] == (
        "skipped: the features are not of the bundled weights of fd-views; start the run again"
    )
    (_, made, _) = tables(scored)
    rows = [row for row in rows_of(made) if row.metric == "class-confidence"]
    assert len(rows) == 12
    assert all(math.isnan(row.value) for row in rows)


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
