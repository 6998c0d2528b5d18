"""The command `bench train`: its options, and how a training ends."""

from __future__ import annotations

from dataclasses import MISSING, fields
from pathlib import Path

import pytest
import torch

from baselines.fused_net.train import FusedNetConfig
from baselines.occupancy_net.train import OccupancyNetConfig
from baselines.splat_net.train import SplatNetConfig
from baselines.splat_net.weights import load_weights
from bench.catalogue.methods import find_method
from bench.commands.train import TRAIN_OPTIONS, print_once
from bench.training import options as training_options
from bench.training.networks import training_objects
from learning.weights import file_sha256
from pc2pix.train_autoencoder import AutoencoderConfig
from pc2pix.train_decoder import DecoderConfig
from pc2pix.train_gan import GanConfig
from pc2pix.weights import load_weights as load_gan_weights


def test_a_training_that_diverged_is_one_line(command, tmp_path):
    out = tmp_path / "x"
    options = ("--objects", "2", "--batch", "2", "--steps", "20", "--learning-rate", "1e30")
    status, printed, err = command("train", "autoencoder", *options, "--out", out)
    assert (status, printed) == (1, "")
    last = err.splitlines()[-1]
    assert last.startswith("bench: step ")
    assert last.endswith("; a lower learning rate may help")


def test_only_the_first_process_prints_the_file_of_a_training(capsys, monkeypatch):
    print_once(Path("here"))
    assert capsys.readouterr().out == "here\n"
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "x")
    monkeypatch.setenv("RANK", "1")
    print_once(Path("here"))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("kind", "config"),
    [
        (training_options.AutoencoderOptions, AutoencoderConfig),
        (training_options.GanOptions, GanConfig),
        (training_options.SplatNetOptions, SplatNetConfig),
        (training_options.FusedNetOptions, FusedNetConfig),
        (training_options.OccupancyNetOptions, OccupancyNetConfig),
        (training_options.DecoderOptions, DecoderConfig),
    ],
)
def test_defaults_are_those_of_the_configuration(kind, config):
    """A training by its command is the training by its function."""
    defaults = {field.name: field.default for field in fields(kind)}
    shared = [f for f in fields(config) if f.name in defaults and f.default is not MISSING]
    assert len(shared) >= 4
    for field in shared:
        if field.name not in ("network", "objects"):
            assert defaults[field.name] == field.default, field.name


@pytest.mark.parametrize(
    ("text", "classes"),
    [("chair", ("chair",)), ("chair,sofa", ("chair", "sofa")), ("all", ())],
)
def test_classes_to_train_on(text, classes):
    assert TRAIN_OPTIONS["classes"].convert(text) == classes


@pytest.mark.parametrize(
    ("classes", "found"),
    [(("b",), "b0 b1"), (("b", "a"), "b0 b1 a0 a1"), ((), "a0 a1 b0 b1")],
)
def test_objects_of_each_class_are_taken(tmp_path, classes, found):
    for place in ("a/0.ply", "a/1.ply", "a/2.ply", "b/0.ply", "b/1.ply"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).touch()
    options = training_options.TrainingOptions(
        dataset=f"folder:{tmp_path}", classes=classes, objects=2, steps=1, out=tmp_path
    )
    objects = training_objects(options)
    assert [o.class_name + o.object_id.removesuffix(".ply") for o in objects] == found.split()


def test_splat_net_from_the_command_line_to_a_method(command, tmp_path):
    """Two steps on two chairs; both files are methods, and a longer command goes on."""
    out = tmp_path / "trained"
    options = ("--objects", "2", "--views", "2", "--network", "tiny", "--batch", "4")
    options = (*options, "--cool-down", "1", "--out", str(out))
    status, said, err = command("train", "splat-net", *options, "--steps", "2")
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n"), err
    status, _, err = command("train", "splat-net", *options, "--steps", "3")
    assert status == 0, err
    for name, heads in (("weights", ("grey", "albedo")), ("weights-grey", ("grey",))):
        method = find_method(f"splat-net@{out / name}.safetensors")
        renderer = method.load("cpu")
        network = renderer.weights.network
        assert network.config.heads == heads
        # two discs, the farthest, three densities; tiny has neither normals nor flattened points
        assert network.config.inputs.channels == 6
        assert renderer.weights.card["steps"] == 3
        assert renderer.weights.card["learning_rates"] == "0.002"  # the last step is at full rate
        assert method.identity().endswith(renderer.weights.sha256)

    # and from its weights another goes on
    start = ("--start", str(out / "weights.safetensors"))
    further = (*options[:-1], str(tmp_path / "further"))
    status, said, err = command("train", "splat-net", *further, *start, "--steps", "1")
    assert status == 0, err
    found = load_weights(said.strip())
    assert found.card["start"] == file_sha256(out / "weights.safetensors")


def test_fused_net_from_the_command_line_to_a_method(command, tmp_path):
    """The meshes alone, then steps that start from splat-net; both files are methods."""
    out = tmp_path / "trained"
    options = ("--objects", "2", "--views", "2", "--batch", "4", "--cool-down", "1")
    options = (*options, "--meshes", "denoised-wrap", "--out", str(out))
    clean = (*options, "--no-augment")
    status, said, err = command("train", "fused-net", *clean, "--steps", "0")
    assert (status, said) == (0, f"{out / 'maps'}\n"), err
    (kept,) = (out / "maps").iterdir()
    written = kept.stat().st_mtime_ns
    steps = ("--start", "all", "--steps", "1")
    status, said, err = command("train", "fused-net", *clean, *steps)
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n"), err
    assert kept.stat().st_mtime_ns == written
    for name, heads in (("weights", ("grey", "albedo")), ("weights-grey", ("grey",))):
        method = find_method(f"fused-net@{out / name}.safetensors")
        renderer = method.load("cpu")
        assert renderer.weights.network.config.heads == heads
        assert tuple(renderer.methods) == ("denoised-wrap",)
        assert renderer.weights.card["occupancy"] == ""
        assert renderer.weights.sha256 in method.identity()
        assert method.identity().endswith(find_method("occupancy-net").identity())
    # other meshes than those that are kept
    status, said, err = command("train", "fused-net", *options, "--steps", "0")
    assert (status, said) == (2, "")
    assert "are of other clouds, views, meshes or weights" in err.splitlines()[-1]


def test_the_gan_goes_on_from_weights_to_a_method(command, tmp_path):
    out = tmp_path / "trained"
    options = ("--objects", "2", "--views", "1", "--batch", "2", "--steps", "1", "--out", str(out))
    options = ("--start", "chair", "--objective", "acgan-paper", "--warm-up", "1", *options)
    status, said, err = command("train", "gan", *options)
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n"), err
    weights = find_method(f"pc2pix@{out / 'weights.safetensors'}").load("cpu").weights
    started = load_gan_weights("chair")
    assert weights.card["start"] == started.sha256
    assert weights.card["model"] == started.card["model"]  # the azimuth is not the default's
    assert weights.card["learning_rates"] == "generator 0 up to step 1"
    assert torch.equal(weights.encoder.code.weight, started.encoder.code.weight)


def test_occupancy_net_from_the_command_line_to_a_method(command, tmp_path):
    out = tmp_path / "trained"
    options = ("--objects", "2", "--batch", "2", "--steps", "2", "--cool-down", "1")
    status, said, err = command("train", "occupancy-net", *options, "--out", str(out))
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n"), err
    method = find_method(f"occupancy-net@{out / 'weights.safetensors'}")
    weights = method.load("cpu").weights
    assert weights.card["learning_rates"] == "0.001"  # the last step is at full rate
    assert method.identity().endswith(weights.sha256)


def test_occupancy_net_is_not_trained_on_sheets(command, tmp_path):
    sheet = "ply\nformat ascii 1.0\nelement vertex 3\n"
    sheet += "".join(f"property float {axis}\n" for axis in "xyz")
    sheet += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "chair").mkdir()
    (tmp_path / "chair" / "0.ply").write_text(f"{sheet}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    options = ("--dataset", f"folder:{tmp_path}", "--steps", "1", "--out", str(tmp_path / "x"))
    status, said, err = command("train", "occupancy-net", *options)
    assert (status, said) == (2, "")
    last = err.splitlines()[-1]
    assert last.startswith("bench: chair/0")
    assert "inside and outside cannot be told apart at" in last
