"""A whole run of the suite `thirteen-classes`, on a folder that has two of them."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
import torch

import bench.catalogue.metrics
import bench.running.run
import bench.tables.build
from bench.checking.golden import _stale_tables
from bench.commands.publish import run_suite
from bench.judges.views import Labels, ViewsNetwork, to_file, view_features
from bench.records.artifacts import read_artifact
from bench.records.journal import read_manifest
from bench.report.build import read_page
from bench.running.protocol import Options
from bench.tables.build import class_orderings, make_outputs, read_scored, tables
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES

pytestmark = pytest.mark.slow

OBJECTS = {"chair": 3, "table": 2}


def write_ply(path, mesh):
    """ASCII, without colours."""
    lines = [
        *("ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"),
        *(f"property float {axis}" for axis in "xyz"),
        *(f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"),
        "end_header",
        *(" ".join(map(str, vertex)) for vertex in mesh.vertices.tolist()),
        *(" ".join(map(str, (3, *face))) for face in mesh.faces.tolist()),
    ]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three chairs, two more that are called tables, and something that is in no table."""
    root = tmp_path_factory.mktemp("meshes")
    chair, number = CLASSES["chair"], 0
    for name, count in {**OBJECTS, "spoon": 1}.items():
        (root / name).mkdir()
        for i in range(count):
            mesh = chair.draw(generator("class run", number)).mesh()
            write_ply(root / name / f"{i}.ply", mesh)
            number += 1
    return root


@pytest.fixture(scope="module")
def classifier(tmp_path_factory):
    """Untrained weights of fd-views that tell the two classes apart, somehow."""
    torch.manual_seed(0)
    network = ViewsNetwork(Labels(("chair", "table"), ("chair/stool",), ("none",)))
    path = tmp_path_factory.mktemp("views") / "views.safetensors"
    path.write_bytes(to_file(network))
    return path, network.eval()


@pytest.fixture
def with_classifier(classifier, monkeypatch):
    for module in (bench.catalogue.metrics, bench.tables.build):
        monkeypatch.setattr(module, "VIEWS_WEIGHTS", classifier[0])


@pytest.fixture
def planned_only(monkeypatch, tmp_path):
    """A run that ends before its jobs, and does not ask about the machine, which takes seconds."""

    def stop(*arguments):
        raise BadInput("far enough")

    monkeypatch.setattr(bench.running.protocol, "environment", dict)
    monkeypatch.setattr(bench.running.run, "do_jobs", stop)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid


@pytest.fixture(scope="module")
def measured(folder, classifier, tiny_weights, tmp_path_factory):
    directory = tmp_path_factory.mktemp("classes") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(directory.parent))  # no weights for fid
        for module in (bench.catalogue.metrics, bench.tables.build):
            patch.setattr(module, "VIEWS_WEIGHTS", classifier[0])
        done = run_suite(
            Options(
                suite="thirteen-classes",
                dataset=f"folder:{folder}",
                methods=("surface-apss", f"pc2pix@{tiny_weights}", "true-mesh", "blank"),
                views=3,
                workers=1,
                out=directory,
            )
        )
    return done


def test_the_classes_of_the_suite_that_the_folder_has(measured):
    objects = read_manifest(measured.directory)["objects"]
    assert objects == ["chair/0.ply", "chair/1.ply", "chair/2.ply", "table/0.ply", "table/1.ply"]
    assert (measured.done, measured.failed) == (20, 0)


def test_its_files(measured):
    found = {
        p.name for folder in ("tables", "figures") for p in (measured.directory / folder).iterdir()
    }
    assert found == {
        *("table5_classes.csv", "table5_classes.md", "table5_orderings.csv", "table5_orderings.md"),
        *("table_ssim.csv", "table_ssim.md", "table_detail.csv", "table_detail.md"),
        *("classes.png", "table5.png"),
    }


def test_its_report(measured, with_classifier):
    page = read_page(make_outputs(read_scored(measured.directory)))
    assert page.curves_title == "Class by class"
    assert [group.title for group in page.tables] == [
        "SSIM and its components against the true mesh (higher is better)",
        "Table 5: classes, against pictures of the true meshes",
        "Detail: the outline (higher is better)",
        "Which of the paper's orderings hold",
    ]
    counts, leads = page.tables[-1].tables
    assert counts.unfolded
    assert leads.unfolded
    assert [line.name for line in leads.lines] == ["chair", "table", "average"]
    # as published: 94.0 - 28.8, 127.2 - 39.7, 114.4 - 57.2
    assert [line.cells[1].text for line in leads.lines] == ["+65.2", "+87.5", "+57.2"]
    made = class_orderings(read_scored(measured.directory))
    assert made is not None
    ssim = [row.lead.value for row in made.rows if row.metric == "ssim"]
    column = [name for name, _ in leads.columns].index("ssim")
    assert [line.cells[column].value for line in leads.lines] == ssim
    explained = dict(page.meanings)["Metrics"]
    assert {"kid", "kd-views", "class-confidence"} < {metric for metric, _ in explained}
    assert len(explained) == len(dict(explained))


def test_table_5(measured):
    with (measured.directory / "tables" / "table5_classes.csv").open() as file:
        rows = {(r["metric"], r["class"], r["method"]): r for r in csv.DictReader(file)}
    assert rows["class-confidence", "chair", "true-mesh"]["n"] == "9"
    assert rows["ssim", "average", "true-mesh"]["value"] == "1.000000"
    assert float(rows["fd-views", "average", "true-mesh"]["value"]) < 1e-6
    assert rows["fid", "chair", "surface-apss"]["paper"] == "94.000000"
    assert rows["fid", "chair", "surface-apss"]["note"].startswith("skipped: weights")
    assert rows["kid", "chair", "surface-apss"]["note"].startswith("skipped: weights")
    values = [
        float(rows["ssim", k, "surface-apss"]["value"]) for k in ("chair", "table", "average")
    ]
    assert values[2] == pytest.approx((values[0] + values[1]) / 2, abs=1e-6)  # 6 decimals
    # two tables: no jackknife of a class, but one of the average
    assert rows["fd-views", "table", "surface-apss"]["ci_low"] == ""
    assert rows["fd-views", "average", "surface-apss"]["ci_high"] != ""


def test_class_confidence_is_the_classifiers(measured, classifier, with_classifier):
    """From the pictures, through the network, against the value in the records."""
    _, network = classifier
    scored = read_scored(measured.directory)
    chosen = scored.records[
        (scored.records["method"] == "surface-apss") & (scored.records["object"] == "1.ply")
    ]
    assert set(chosen["class"]) == {"chair", "table"}
    images = {
        path: read_artifact(path)["images"]
        for path in (measured.directory / "artifacts").rglob("*.npz")
    }
    found = []
    for of_job in images.values():
        with torch.inference_mode():
            features = torch.from_numpy(view_features(network, of_job))
            found.append(network.heads["class"](features).double().softmax(dim=1).numpy())
    message = np.stack(found)  # [artifact, view, class]
    for i, name in enumerate(("chair", "table")):
        values = chosen[chosen["class"] == name].sort_values("view")["class_confidence"].to_numpy()
        # float32 sums of 64 products against float64
        nearest = np.abs(message[:, :, i] - values).max(axis=1).min()
        assert nearest < 1e-5


def test_other_weights_are_not_asked(measured, monkeypatch, classifier, tmp_path):
    other = tmp_path / "other.safetensors"
    other.write_bytes(to_file(ViewsNetwork(classifier[1].labels)))
    monkeypatch.setattr(bench.tables.build, "VIEWS_WEIGHTS", other)
    scored = read_scored(measured.directory)
    assert "class_confidence" not in scored.records
    assert scored.skipped["class-confidence"] == (
        "skipped: the features are not of the bundled weights of fd-views; start the run again"
    )
    (_, made, _) = tables(read_scored(measured.directory))
    rows = [row for row in made.rows if row.metric == "class-confidence"]
    assert len(rows) == 12
    assert all(math.isnan(row.value) for row in rows)


def test_the_tables_come_again_from_the_records(measured, with_classifier):
    ordered = class_orderings(read_scored(measured.directory))
    assert ordered is not None
    assert all(row.method.startswith("pc2pix@") for row in ordered.rows)
    assert (
        _stale_tables(measured.directory, [*tables(read_scored(measured.directory)), ordered]) == []
    )
    path = measured.directory / "tables" / "table5_orderings.csv"
    kept = path.read_bytes()
    path.write_bytes(kept.replace(b"chair", b"sofa!"))
    (message,) = _stale_tables(measured.directory, [ordered])
    path.write_bytes(kept)
    assert "table5_orderings.csv: not what the records give" in message


@pytest.mark.usefixtures("planned_only")
def test_what_is_left_out_is_named(folder, capsys, tmp_path):
    with pytest.raises(BadInput, match="far enough"):
        run_suite(Options("thirteen-classes", f"folder:{folder}", methods=("splat",), out=tmp_path))
    assert capsys.readouterr().err.splitlines() == [
        f"folder:{folder}: no airplane, bench, cabinet, car, display, lamp, loudspeaker, rifle, "
        "sofa, telephone, vessel; left out"
    ]


@pytest.mark.usefixtures("planned_only")
def test_nothing_of_the_suite(folder, tmp_path):
    (tmp_path / "spoon").mkdir()
    (tmp_path / "spoon" / "a.ply").write_bytes((folder / "spoon" / "0.ply").read_bytes())
    request = Options(
        "thirteen-classes", f"folder:{tmp_path}", methods=("splat",), out=tmp_path / "x"
    )
    with pytest.raises(BadInput, match=r"no class 'airplane' .*found spoon"):
        run_suite(request)
    flat = Options(
        "thirteen-classes", f"folder:{tmp_path / 'spoon'}", methods=("splat",), out=tmp_path / "x"
    )
    with pytest.raises(
        BadInput, match="thirteen-classes compares classes, and this dataset has none"
    ):
        run_suite(flat)
    assert not (tmp_path / "x").exists()


@pytest.mark.usefixtures("planned_only")
def test_one_network_for_all_that_is_not_there(monkeypatch, folder, tmp_path):
    """Until its weights are bundled, and where they are lost, the run says so before it begins."""
    from pc2pix import weights as weight_files

    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    request = Options(
        "thirteen-classes", f"folder:{folder}", methods=("pc2pix@all",), out=tmp_path / "x"
    )
    with pytest.raises(BadInput, match=r"weights: 'all' is neither|all.safetensors: the bundled"):
        run_suite(request)
    assert not (tmp_path / "x").exists()
