"""`bench data export`, and what reads it back: `exported:PATH`."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.catalogue.lookup import find
from bench.catalogue.suites import SUITES
from bench.running.export import export
from bench.running.options import Options
from bench.running.plan import plan
from bench.running.protocol import Protocol
from bench.running.work import cloud_under, rng_of
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.files.meshes import read_mesh
from data_prep.randomness import generator
from data_prep.rendering.images import read_image

from ..builders import refusal, run_suite

OPTIONS = Options("chair-robustness", conditions=("noise-0.10", "512"), limit=2, views=3, workers=1)


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("export") / "tree"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.running.protocol.environment", dict)
        assert export(OPTIONS, out) == 2
    return out


@pytest.fixture
def copied(exported, tmp_path) -> Path:
    return Path(shutil.copytree(exported, tmp_path / "tree"))


@pytest.fixture
def jobs(no_machine):
    """The plans of a run on the source and of one on the export, object by object."""

    def of(dataset):
        options = Options("chair-robustness", dataset, ("blank",), ("2048", "512"), 2, views=3)
        return plan(Protocol.from_options(options))

    return of


def problem(tree: Path) -> str:
    return refusal(open_dataset, f"exported:{tree}")


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_its_objects_are_those_of_the_source_to_the_last_bit(exported, jobs):
    pairs = zip(jobs("procedural"), jobs(f"exported:{exported}"), strict=True)
    for ours, theirs in pairs:
        a, b = ours.truth, theirs.truth
        assert a.name.object == b.name.object
        assert a.views == b.views
        np.testing.assert_array_equal(a.object.truth(a.views), b.object.truth(b.views))
        for field in ("vertices", "faces", "face_colors"):
            one, other = (getattr(job.object.load(), field) for job in (a, b))
            assert one.dtype == other.dtype
            np.testing.assert_array_equal(one, other)
        for one, other in zip(ours.method_jobs, theirs.method_jobs, strict=True):
            assert (
                cloud_under(one, one.condition).points.tobytes()
                == cloud_under(other, other.condition).points.tobytes()
            )


def test_the_seed_is_that_of_the_export(no_machine, tmp_path, command):
    """Also of the clouds that it does not have, and of what methods draw."""
    tree = tmp_path / "tree"
    export(dataclasses.replace(OPTIONS, seed=5, limit=1, views=2, conditions=("512",)), tree)
    assert set(pd.read_csv(tree / "objects.csv")["seed"]) == {5}

    def jobs(dataset, seed=None):
        cells = {"methods": ("splat",), "conditions": ("2048", "512", "noise-0.05")}
        options = Options("chair-robustness", dataset, **cells, limit=1, views=2, seed=seed)
        protocol = Protocol.from_options(options)
        return protocol, [*plan(protocol).method_jobs]

    (source, ours), (protocol, theirs) = jobs("procedural", 5), jobs(f"exported:{tree}")
    assert protocol.seed == source.seed == 5
    for one, other in zip(ours, theirs, strict=True):
        assert one.views == other.views
        assert (
            cloud_under(one, one.condition).points.tobytes()
            == cloud_under(other, other.condition).points.tobytes()
        )
        assert rng_of(one).random() == rng_of(other).random()
    assert jobs(f"exported:{tree}", 5)[0] == protocol
    out = tmp_path / "run"
    arguments = ("run", "--suite", "chair-robustness", "--dataset", f"exported:{tree}")
    status, _, err = command(*arguments, "--views", "2", "--seed", "0", "--out", out)
    assert (status, err) == (
        2,
        f"bench: --seed 0: exported:{tree} was exported with --seed 5, which decides its clouds "
        "and views; leave --seed, or export it again with yours\n",
    )
    assert not out.exists()
    replace(tree / "objects.csv", ",5,procedural", ",five,procedural")
    assert "objects.csv:2: seed 'five' in an export with --seed 'five'" in problem(tree)


def test_a_grey_suite_reads_its_own_export(no_machine, tmp_path, exported):
    suite = find("chair-robustness", SUITES, "suite")
    tree = tmp_path / "grey"
    some = {"conditions": ("512",), "limit": 1, "views": 2, "workers": 1}
    export(Options(suite.id, **some, truth="grey"), tree)

    def jobs(dataset):
        options = Options(suite.id, dataset, ("splat",), ("2048", "512"), 1, views=2, truth="grey")
        return plan(Protocol.from_options(options))[0]

    ours, theirs = jobs("procedural"), jobs(f"exported:{tree}")
    images = [obj.truth.object.truth(obj.truth.views) for obj in (ours, theirs)]
    np.testing.assert_array_equal(*images)
    assert (images[1].max(axis=-1) - images[1].min(axis=-1)).max() == 0  # no colour
    for one, other in zip(ours.method_jobs, theirs.method_jobs, strict=True):
        assert (
            cloud_under(one, one.condition).points.tobytes()
            == cloud_under(other, other.condition).points.tobytes()
        )
    with pytest.raises(BadInput, match="chair/test-0000 was exported in colour; export it again"):
        jobs(f"exported:{exported}")


def test_verify_of_an_export_without_its_metadata_says_so(copied, command):
    (copied / "croissant.json").unlink()
    assert command("data", "verify", copied) == (
        2,
        "",
        f"bench: {copied}: an export without its croissant.json, which has the checksums of its "
        "lists; fetch that file, or export it again\n",
    )


def test_its_clouds_are_read_and_others_made(exported, jobs, monkeypatch):
    (obj, _) = jobs(f"exported:{exported}")
    job = obj.method_jobs[1]
    monkeypatch.setattr("data_prep.clouds.conditions.Stride.apply", None)  # nobody needs it
    assert job.condition == "512"
    assert len(cloud_under(job, "512")) == 512
    assert job.object.perturbed("noise-0.05") is None
    assert len(job.object.cloud(generator(0), 100)) == 100


def test_the_lists_have_every_file_with_its_checksum(exported, command):
    status, out, err = command("data", "verify", exported)
    assert (status, out, err) == (0, f"{3 + 2 * (1 + 3 + 3)} files are those of the list\n", "")
    clouds = pd.read_csv(exported / "clouds.csv", dtype={"condition": str})
    assert clouds["condition"].tolist() == ["2048", "noise-0.10", "512"] * 2
    assert clouds["points"].tolist() == [2048, 2048, 512] * 2


def test_verify_finds_what_was_altered(copied, command):
    (copied / "clouds/chair/00000/512.ply").write_bytes(b"ply")
    (copied / "images/chair/00001/02.png").unlink()
    replace(copied / "views.csv", "test-0000,0,", "test-0000,0,1")
    status, out, _ = command("data", "verify", copied)
    assert status == 1
    assert out.splitlines()[1:] == [
        "MISSING  images/chair/00001/02.png",
        "CHANGED  clouds/chair/00000/512.ply",
        "CHANGED  views.csv",
    ]


def test_an_altered_file_is_not_used(copied, jobs):
    (obj, _) = jobs(f"exported:{copied}")
    job = obj.method_jobs[1]
    for file, read in (
        ("clouds/chair/00000/512.ply", lambda: cloud_under(job, "512")),
        ("images/chair/00000/02.png", lambda: job.object.truth(job.views)),
        ("meshes/chair/00000.ply", job.object.load),
    ):
        other = (copied / file.replace("00000", "00001")).read_bytes()  # whole, and another's
        (copied / file).write_bytes(other)
        with pytest.raises(BadInput, match=f"{file}: does not have the checksum of the list"):
            read()


def test_the_mesh_lies_in_the_image_where_the_matrix_of_the_camera_says(exported):
    view = pd.read_csv(exported / "views.csv").iloc[1]
    pose = np.array(view["camera_to_world"].split(), float).reshape(4, 4)
    mesh = read_mesh(exported / "meshes" / "chair" / "00000.ply")
    x, y, z, _ = np.linalg.inv(pose) @ np.c_[mesh.vertices, np.ones(len(mesh.vertices))].T
    drawn = (read_image(exported / view["file"])[0] < 255).any(axis=2)
    for axis, (side, sign) in enumerate(((x, 1), (y, -1))):  # columns, then rows from the top
        pixels = 64 + sign * 64 * (58 / 16) * side / -z  # a lens of 58 mm, half a sensor of 16 mm
        (places,) = np.nonzero(drawn.any(axis=axis))
        ends = places[0], places[-1] + 1
        assert np.allclose(ends, (pixels.min(), pixels.max()), atol=1)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries of mlcroissant
def test_its_metadata_is_valid_croissant_and_reads_the_lists(exported):
    croissant = pytest.importorskip("mlcroissant")
    dataset = croissant.Dataset(jsonld=str(exported / "croissant.json"))
    assert not dataset.metadata.ctx.issues.errors
    assert not dataset.metadata.ctx.issues.warnings
    views = [*dataset.records("views")]
    expected = pd.read_csv(exported / "views.csv")
    assert [row["views/azimuth_deg"] for row in views] == expected["azimuth_deg"].tolist()
    described = json.loads((exported / "croissant.json").read_text())
    assert described["version"] == f"{PROTOCOL_VERSION}.0.0"


OURS = f"test-0000,{PROTOCOL_VERSION},"


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("objects.csv", OURS, "test-0000,99,", "objects.csv:2: of protocol 99, "),
        ("objects.csv", "class,object", "class,name", "objects.csv:1: expected class,object,"),
        ("clouds.csv", "clouds/chair/00000/", "../", "clouds.csv:2: '../2048.ply' is outside"),
        ("clouds.csv", "clouds/chair/00000/", "/etc/", "is outside of the folder"),
        ("views.csv", "test-0000,0,", "test-0000,0,x", "views.csv:2: could not convert"),
        ("views.csv", "test-0000,1,", "test-0000,2,", "views.csv:3: view '2' where 1 comes next"),
        ("clouds.csv", "test-0000,512", "test-0000,2048", "clouds.csv:4: '2048' is there twice"),
        ("views.csv", "chair,", ",", "views.csv: '' has 0 characters"),
    ],
)
def test_lists_that_are_refused(copied, name, old, new, message):
    replace(copied / name, old, new)
    assert message in problem(copied)


def test_an_object_without_clouds_and_one_with_too_few_images(copied):
    dataset = open_dataset(f"exported:{copied}")
    with pytest.raises(BadInput, match="--views 4: chair/test-0000 has 3 true images"):
        dataset.finite[0].views(4, generator(0))
    text = (copied / "clouds.csv").read_text()
    (copied / "clouds.csv").write_text(text.replace("test-0001", "test-0009"))
    assert "objects.csv:3: 'chair/test-0001' is not in clouds.csv" in problem(copied)


def test_a_folder_that_is_there_is_left_alone_and_nothing_is_left_of_a_failure(
    tmp_path, no_machine, monkeypatch
):
    with pytest.raises(BadInput, match="is there already"):
        export(OPTIONS, tmp_path)

    def full(path, data, synced=True):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("bench.running.export.write_whole", full)
    with pytest.raises(BadInput, match="No space left on device"):
        export(OPTIONS, tmp_path / "tree")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_run_on_it_has_the_tables_of_the_run_on_its_source(
    exported, tmp_path, no_machine, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # no weights for fid
    cells = {"methods": ("pc2pix", "surface-bpa", "true-mesh"), "conditions": ("2048", "512")}
    tables = []
    for name, dataset in (("there", "procedural"), ("here", f"exported:{exported}")):
        options = Options("chair-robustness", dataset, **cells, limit=2, views=3, workers=1)
        out = tmp_path / name
        run_suite(Options(**(vars(options) | {"out": out})))
        tables.append({path.name: path.read_bytes() for path in (out / "tables").iterdir()})
    assert "table4_fid.csv" in tables[0]
    assert tables[0] == tables[1]
