"""The command line: what is printed where, and how it ends."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys

import pytest
import torch

import bench.running.protocol
from bench.catalogue.methods import COST_VARIANTS, METHODS
from bench.catalogue.metrics import (
    CONTROL_METRICS,
    IMAGE_METRICS,
    KERNEL_METRICS,
    RECOGNITION_METRICS,
    SET_METRICS,
)
from bench.catalogue.parameters import PARAMETERS
from bench.catalogue.suites import LATENT, SPEED, STABILITY, SUITES
from bench.records.journal import write_manifest
from data_prep.conditions import CONDITIONS
from learning import checkpoint
from learning.weights import file_sha256
from pc2pix import weights as weight_files

from .builders import SUITE, make_manifest, write_run
from .conftest import BENCH


@pytest.fixture
def no_machine(monkeypatch, tmp_path):
    """Runs are not asked to look at the machine; their default folder is in `tmp_path`."""
    monkeypatch.setattr(bench.running.protocol, "environment", dict)
    monkeypatch.chdir(tmp_path)


def run_refused(command, *arguments):
    """The one line that a run ends with; nothing else is printed and nothing left behind."""
    status, out, err = command("run", "--suite", SUITE, *arguments)
    assert (status, out) == (2, "")
    assert err.startswith("bench: ")
    assert err.count("\n") == 1
    return err.removeprefix("bench: ").rstrip("\n")


# --- bad input ------------------------------------------------------------------------------------


def test_unknown_suite(command, no_machine):
    status, out, err = command("run", "--suite", "chair-robustnes")
    assert (status, out) == (2, "")
    assert err == (
        "bench: unknown suite 'chair-robustnes': did you mean 'chair-robustness'? "
        "there are chair-robustness, speed-accuracy, thirteen-classes, beyond-training, latent, "
        "stability, speed\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--methods", "splta,blank"), "unknown method 'splta': did you mean 'splat'? there are "),
        (("--methods", "pc2pix@x"), "unknown method 'pc2pix@x': did you mean 'pc2pix'? there are "),
        (("--methods", "blank", "--conditions", "2049"), "unknown condition '2049': did you mean "),
        (("--methods", " , "), "' , ': expected names separated by commas"),
        (("--limit", "0"), "--limit 0: must be at least 1"),
        (("--views", "-2"), "--views -2: must be at least 1"),
        (("--workers", "0"), "--workers 0: must be at least 1"),
        (("--methods", "pc2pix@no.safetensors"), "no.safetensors: no such weights file; train one"),
        (
            ("--dataset", "shapenet"),
            "unknown dataset 'shapenet': use procedural, procedural:validation, folder:PATH, ",
        ),
        (
            ("--dataset", "folder:"),
            "unknown dataset 'folder:': use procedural, procedural:validation, folder:PATH, ",
        ),
        (("--dataset", "folder:gone"), "gone: no such folder; give the folder that holds your "),
        (("--inception-weights", "no.pth"), "no.pth: no such file; "),
    ],
)
def test_bad_values(command, no_machine, tmp_path, arguments, message):
    assert message in run_refused(command, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_odd_names_stay_on_one_harmless_line(command, no_machine, tmp_path):
    message = run_refused(command, "--dataset", f"folder:{tmp_path}/a\nb\x1b[2J\u202e")
    assert message == (
        f"{tmp_path}/a\\nb\\x1b[2J\\u202e: no such folder; give the folder that holds your meshes"
    )


def test_folders_without_what_is_needed(command, no_machine, tmp_path):
    folder = tmp_path / "meshes"
    folder.mkdir()
    dataset = ("--dataset", f"folder:{folder}", "--methods", "blank")
    (folder / "notes.txt").touch()
    assert run_refused(command, *dataset) == (
        f"{folder}: no mesh in this folder; expected .ply, .obj, .off, .stl, .glb, .gltf "
        "(or clouds: .npy, .xyz, .csv, .pts, .las, .laz, .e57, .pcd)"
    )
    (folder / "sofa").mkdir()
    (folder / "sofa" / "one.obj").touch()
    assert run_refused(command, *dataset) == (
        f"folder:{folder}: no class 'chair' (a sub-folder of that name); found sofa"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "--suite", SUITE, "--views", "many"), "Invalid value for '--views': "),
        (("run", "--suite", SUITE, "--device", "gpu"), "'gpu' is not one of 'auto', 'cpu', 'cuda'"),
        (("run",), "Missing option '--suite'; see 'bench run --help'"),
        (("table",), "Missing argument 'DIR'; see 'bench table --help'"),
        (("run", "--suit", SUITE), "No such option: --suit (Possible options: "),
        (("runn",), "No such command 'runn'; see 'bench --help'"),
        (("train", "gan", "--steps", "x"), "see 'bench train gan --help'"),
    ],
)
def test_usage_errors_are_one_line(command, arguments, message):
    status, out, err = command(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith("bench: ")
    assert err.count("\n") == 1
    assert message in err


# --- weights --------------------------------------------------------------------------------------


def test_weights_that_do_not_fit(command, no_machine, tiny_weights, tmp_path):
    tensors, header = checkpoint.read_safetensors(tiny_weights)
    path = tmp_path / "odd.safetensors"
    checkpoint.write_atomically(path, tensors | {"code_std": torch.ones(5)}, header)
    assert run_refused(command, "--methods", f"pc2pix@{path}") == (
        f"{path}: code_std has shape [5], expected [4]; "
        "write the file again with pc2pix.weights.export"
    )
    path.write_bytes(tiny_weights.read_bytes()[:-1])
    message = run_refused(command, "--methods", f"pc2pix@{path}", "--fresh")
    assert message.startswith(f"{path}: not a whole safetensors file (")
    assert list(tmp_path.iterdir()) == [path]


def test_bundled_weights_with_another_checksum(
    command, no_machine, tiny_weights, tmp_path, monkeypatch
):
    path = tmp_path / "chair.safetensors"
    shutil.copy(tiny_weights, path)
    monkeypatch.setattr(weight_files, "FOLDER", tmp_path)
    monkeypatch.setitem(weight_files.BUNDLED, "chair", "0" * 64)
    found = file_sha256(path)
    assert run_refused(command, "--methods", "pc2pix") == (
        f"{path}: sha256 {found} is not the expected {'0' * 64}; reinstall the package"
    )


def test_inception_weights_that_are_not(command, no_machine, tmp_path):
    path = tmp_path / "weights.pth"
    path.write_bytes(b"nothing")
    message = run_refused(command, "--methods", "blank", "--inception-weights", path)
    assert message.startswith(f"{path}: sha256 ")
    assert "give --inception-weights download" in message


# --- --out ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"suite": "speed"}, "holds a run of suite 'speed', not 'chair-robustness'; give anoth"),
        ({"dataset": "folder:x"}, "holds a run of dataset 'folder:x', not 'procedural'; give an"),
        ({"seed": 3}, "holds a run of seed 3, not 0; give another --out, or --fresh to start"),
        ({"views": 7}, "holds a run of views 7, not 2; give another --out, or --fresh to start"),
        ({"schema_version": 99}, "written by a newer version (schema 99, this one reads up to 3)"),
    ],
)
def test_folders_of_other_runs(command, no_machine, tmp_path, change, message):
    out = tmp_path / "run"
    write_run(out, objects=["chair/a", "chair/b"], methods=["blank"], conditions=["2048"])
    write_manifest(out, make_manifest(**change))
    before = sorted(out.rglob("*"))
    arguments = ("--methods", "blank", "--views", "2", "--device", "cpu", "--out", out)
    assert run_refused(command, *arguments).startswith(f"{out}: {message}")
    assert sorted(out.rglob("*")) == before


def test_folders_of_other_things(command, no_machine, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.tex").touch()
    for fresh in ((), ("--fresh",)):
        for name, message in [
            ("thesis", "not empty and not a run; give a new --out"),
            ("thesis/chapter1.tex", "is a file; give a folder with --out"),
        ]:
            arguments = ("--methods", "blank", "--out", tmp_path / name, *fresh)
            assert run_refused(command, *arguments) == f"{tmp_path / name}: {message}"
    assert [path.name for path in tmp_path.iterdir()] == ["thesis"]


# --- results --------------------------------------------------------------------------------------


def test_list_names_everything(command):
    status, out, err = command("list")
    assert (status, err) == (0, "")
    sections = {}
    for section in re.split(r"^(?=\w+:$)", out, flags=re.MULTILINE)[1:]:
        title, *entries = section.splitlines()
        sections[title.rstrip(":")] = [entry.split()[0] for entry in entries]
        assert all(entry.startswith("  ") and len(entry.split()) > 1 for entry in entries)
    assert sections == {
        "suites": [suite.id for suite in (*SUITES, LATENT, STABILITY, SPEED)],
        "methods": [method.id for method in METHODS],
        "variants": [
            *(f"{parameter.method}@{parameter.name}=" for parameter in PARAMETERS),
            *(method.id for method in COST_VARIANTS),
        ],
        "conditions": [condition.id for condition in CONDITIONS],
        "metrics": [
            *IMAGE_METRICS,
            *(metric.id for metric in SET_METRICS),
            *KERNEL_METRICS,
            *RECOGNITION_METRICS,
            *CONTROL_METRICS,
        ],
        "datasets": [
            *("procedural", "procedural:validation", "folder:PATH"),
            *("shapenet:PATH", "modelnet:PATH", "paper:PATH"),
        ],
    }
    assert {"chair-robustness"} <= set(sections["suites"])
    assert {"pc2pix", "surface-apss", "splat", "true-mesh", "constant", "blank"} <= set(
        sections["methods"]
    )
    assert {"2048", "1024", "512", "noise-0.05", "noise-0.10"} <= set(sections["conditions"])
    assert {"ssim", "luminance", "contrast", "structure", "fid", "fd-views"} <= set(
        sections["metrics"]
    )


HEAVY = """
import sys
from bench.cli import main
try:
    main()
finally:
    print(*({"torch", "numpy", "pandas", "scipy", "matplotlib", "rich"} & set(sys.modules)),
          file=sys.stderr)
"""


@pytest.mark.parametrize("argument", ["list", "--help"])
def test_simple_questions_load_no_heavy_package(argument):
    done = subprocess.run(
        [sys.executable, "-c", HEAVY, argument], capture_output=True, text=True, check=True
    )
    assert done.stderr == "\n"
    assert "chair" in done.stdout or "Usage" in done.stdout


def test_help_names_all_commands(command):
    status, out, err = command("--help")
    assert (status, err) == (0, "")
    commands = (
        "run",
        "list",
        "table",
        "check",
        "recommend",
        "render",
        "report",
        "shrink",
        "doctor",
        "train",
    )
    for name in commands:
        assert f"\n  {name} " in out
    for name in ("autoencoder", "gan", "views"):
        assert f"\n  {name} " in command("train", "--help")[1]


def test_table_prints_and_writes_the_same_bytes_again(finished, copied, command):
    shutil.rmtree(copied / "tables")
    shutil.rmtree(copied / "artifacts")  # records and features are enough
    shutil.rmtree(copied / "journal")
    once, twice = command("table", copied), command("table", copied)
    assert once == twice
    assert once[0] == 0
    assert once[2] == ""
    for name in ("table3_ssim", "table4_fid", "table_detail", "table_control"):
        for kind in ("csv", "md"):
            path = f"tables/{name}.{kind}"
            assert (copied / path).read_bytes() == (finished[0] / path).read_bytes()
        assert (copied / f"tables/{name}.md").read_text() in once[1]


def test_table_follows_the_records(tmp_path, command):
    directory = write_run(tmp_path / "run")
    before = command("table", directory)[1]
    (directory / "features" / "fd-views.parquet").unlink()
    after = command("table", directory)[1]
    assert "skipped: no features in this run" in after
    assert before != after


@pytest.mark.parametrize("wrong", ["gone", "empty", "file"])
@pytest.mark.parametrize("name", ["table", "check"])
def test_no_run_there(command, tmp_path, name, wrong):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    status, out, err = command(name, tmp_path / wrong)
    assert (status, out) == (2, "")
    assert err == (
        f"bench: {tmp_path / wrong}: no run here (manifest.json is missing); give a run's folder\n"
    )


def test_damaged_records(command, tmp_path):
    directory = write_run(tmp_path / "run")
    (directory / "records.parquet").write_bytes(b"PAR1")
    status, out, err = command("table", directory)
    assert (status, out) == (2, "")
    assert err.startswith(f"bench: {directory}/records.parquet: not readable (")
    assert err.count("\n") == 1


@pytest.mark.parametrize("buffered", [True, False])
def test_nobody_reads_the_output(buffered):
    """As in `bench list | true`: no traceback, and no claim to have been heard."""
    read, write = os.pipe()
    os.close(read)
    environment = os.environ | {"PYTHONUNBUFFERED": "" if buffered else "1"}
    with os.fdopen(write) as closed:
        done = subprocess.run(
            [*BENCH, "list"], stdout=closed, stderr=subprocess.PIPE, check=False, env=environment
        )
    assert (done.returncode, done.stderr) == (141, b"")
