"""Small runs of the suites, and what parts of them leave out."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pandas as pd
import pytest
import torch
import trimesh

import bench.analysis.run
import bench.catalogue.metrics
import bench.running.run
from bench.analysis.run import read_run
from bench.catalogue.methods import find_setting
from bench.catalogue.suites import SUITES
from bench.judges.views import Labels
from bench.records.folder import read_manifest
from bench.running.options import Options
from bench.running.protocol import Protocol
from bench.tables.build import make_outputs
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.shapes.catalogue import CLASSES
from learning.weights import FILES
from tests.learning.trainings import write_views

from ..builders import drop_features, run_suite, write_run

ROBUSTNESS, TRADE, THIRTEEN, BEYOND, OWN = (suite.id for suite in SUITES)
CONDITIONS = ["512", "2048", "noise-0.05", "noise-0.20", "missing-0.50"]


def test_values_of_a_parameter_rise():
    """The figure of speed-accuracy joins them in this order."""
    values: dict[str, list[float]] = {}
    for method in SUITES[1].methods:
        if (setting := find_setting(method)) is not None:
            values.setdefault(setting.parameter.method, []).append(setting.value)
    assert {*values} == {"surface-apss", "surface-bpa", "poisson", "denoised-wrap", "splat"}
    assert all(len(of_method) >= 3 for of_method in values.values())
    assert all(of_method == sorted(of_method) for of_method in values.values())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of three chairs, two chairs called tables, and a class of no table."""
    root = tmp_path_factory.mktemp("meshes")
    names = [f"chair/{i}" for i in range(3)] + ["table/0", "table/1", "spoon/0"]
    for number, name in enumerate(names):
        mesh = CLASSES["chair"].draw(generator("class run", number)).mesh()
        (root / name).parent.mkdir(exist_ok=True)
        trimesh.Trimesh(mesh.vertices, mesh.faces).export(root / f"{name}.ply")
    return root


IN_ALL = {"headline", "table_ssim", "table_frechet", "table_detail"}


@pytest.mark.slow
@pytest.mark.usefixtures("no_machine")
@pytest.mark.parametrize(
    ("suite", "methods", "options", "done", "tables", "figures"),
    [
        (
            *(TRADE, "splat@spread=2,splat,pc2pix@TINY,blank"),
            *({"conditions": ("2048", "512"), "limit": 2}, 16),
            *(IN_ALL | {"frontier", "points"}, 12),
        ),
        (
            *(THIRTEEN, "surface-apss,pc2pix@TINY,true-mesh,blank"),
            *({"dataset": "folder:FOLDER", "workers": 1}, 25),
            *(IN_ALL - {"table_frechet"} | {"table5_classes", "table5_orderings"}, 3),
        ),
        (
            *(BEYOND, "splat,blank"),
            *({"conditions": ("2048", "outliers-0.10", "missing-0.50"), "limit": 1}, 5),
            *(IN_ALL, 3),
        ),
    ],
)
def test_a_run_leaves_its_tables_and_figures(
    folder, tmp_path, tiny_weights, monkeypatch, suite, methods, options, done, tables, figures
):
    """A suite that compares times has one worker."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid
    torch.manual_seed(0)
    labels = Labels(("chair", "table"), ("chair/stool",), ("none",))
    write_views(None, tmp_path / "views.safetensors", labels)
    for module in (bench.catalogue.metrics, bench.analysis.run):
        monkeypatch.setattr(module, "VIEWS_WEIGHTS", tmp_path / "views.safetensors")
    if "dataset" in options:
        options = options | {"dataset": f"folder:{folder}"}
    names = tuple(methods.replace("TINY", str(tiny_weights)).split(","))
    finished = run_suite(Options(suite, methods=names, views=2, out=tmp_path / "run", **options))
    out = finished.directory
    assert (finished.done, finished.failed) == (done, 0)
    assert read_manifest(out)["workers"] == 1 or suite == BEYOND
    found = {path.name for path in (out / "tables").iterdir()}
    assert found == {f"{name}.{kind}" for name in tables for kind in ("csv", "md")}
    assert len([*(out / "figures").iterdir()]) == figures
    if suite == THIRTEEN:
        values = pd.read_csv(out / "tables" / "table5_classes.csv")
        values = values.set_index(["metric", "class", "method"])
        assert values.loc[("class-confidence", "chair", "true-mesh"), "n"] == 6
        assert values.loc[("ssim", "average", "true-mesh"), "value"] == 1
        assert values.loc[("fd-views", "average", "true-mesh"), "value"] < 1e-6


def test_answers_of_other_weights_are_not_asked(tmp_path):
    """The features of the run are of no weights that its manifest names."""
    scored = read_run(write_run(tmp_path, suite=THIRTEEN))
    assert scored.skipped["class-confidence"] == (
        "skipped: the features are not of the bundled weights of fd-views; start the run again"
    )


def test_what_is_left_out_is_named_and_what_cannot_be_run_is_refused(
    folder, tmp_path, monkeypatch, capsys, no_machine
):
    def stop(*arguments):
        raise BadInput("far enough")

    monkeypatch.setattr(bench.running.run, "do_and_store", stop)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid
    spoons = tmp_path / "spoons"
    shutil.copytree(folder / "spoon", spoons / "spoon")
    with pytest.raises(BadInput, match="far enough"):
        run_suite(Options(THIRTEEN, f"folder:{folder}", methods=("splat",), out=tmp_path / "run"))
    assert capsys.readouterr().err == (
        f"folder:{folder}: no airplane, bench, cabinet, car, display, lamp, loudspeaker, rifle, "
        "sofa, telephone, vessel; left out\n"
    )
    monkeypatch.setitem(
        FILES, "pc2pix", replace(FILES["pc2pix"], folder=tmp_path)
    )  # without weights
    for dataset, method, message in (
        (spoons, "splat", r"no class 'airplane' .*found spoon; --suite own-meshes takes all"),
        (spoons / "spoon", "splat", "this dataset has none; .*, or --suite own-meshes"),
        (folder, "pc2pix@all", r"weights: 'all' is neither|all.safetensors: the bundled"),
    ):
        out = tmp_path / "x"
        with pytest.raises(BadInput, match=message):
            run_suite(Options(THIRTEEN, f"folder:{dataset}", methods=(method,), out=out))
        assert not out.exists()


@pytest.mark.parametrize(
    ("part", "truth", "names", "networks", "name"),
    [
        ("", None, ["chair/0", "chair/1", "spoon/0", "table/0", "table/1"], "@grey", "meshes0"),
        ("chair", "grey", ["chair/0", "chair/1"], "@grey", "chair"),
        ("spoon", "coloured", ["spoon/0"], "", "spoon-truth-coloured"),
    ],
)
def test_own_meshes_are_all_classes_or_the_one_without_a_name(
    folder, part, truth, names, networks, name
):
    """They are in grey unless colours are asked for, and the manifest finds the same again."""
    options = Options(OWN, f"folder:{folder / part}", limit=2, truth=truth)
    protocol = Protocol.from_options(options, probe=dict)
    manifest = protocol.to_manifest(options.request, len(names), 1)
    expected = [f"{name}.ply" for name in names]
    assert protocol.names == Protocol.from_manifest(manifest).names == expected
    assert protocol.suite.truth == manifest.get("truth", "coloured") == (truth or "grey")
    assert {f"splat-net{networks}", f"fused-net{networks}", "alpha-wrap"} < {*protocol.methods}
    assert options.directory.name == f"own-meshes-folder-{name}"


def test_runs_without_families_two_methods_or_features_have_less(tmp_path):
    methods = ["splat", "blank"]
    few = write_run(tmp_path / "a", suite=BEYOND, methods=methods, conditions=CONDITIONS)
    drop_features(few, "fd-views")
    outputs = make_outputs(read_run(few))
    assert outputs.condition_sweep is None
    assert {*outputs.curves["metric"]} == {"ssim", "lpips", "silhouette-iou"}
    assert outputs.curves.groupby(["family", "metric", "method"]).ngroups == 3 * 2 * 3

    no_family = write_run(tmp_path / "b", suite=BEYOND, conditions=["2048", "density-3"])
    outputs = make_outputs(read_run(no_family))
    assert (len(outputs.curves), outputs.condition_sweep) == (0, None)

    trade = write_run(tmp_path / "c", suite=TRADE)
    drop_features(trade, "fd-views")
    frontier, _ = make_outputs(read_run(trade)).frontier_tables
    metrics = frontier.frame["metric"].unique().tolist()
    assert metrics == ["ssim-object", "lpips", "ssim", "structure", "silhouette-iou"]
