"""The command `bench train`: its options, and how a training ends."""

from __future__ import annotations

import itertools
import re
import time
from pathlib import Path

import pytest
import torch
import trimesh

from baselines.splat_net.weights import load_weights
from bench.catalogue.methods import find_method
from bench.commands.train import TRAIN_OPTIONS, print_once
from bench.training.options import TrainingOptions
from bench.training.session import open_training_objects
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.scene import View
from pc2pix.weights import load_weights as load_gan_weights
from tests.baselines.clouds import chair_cloud


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
    ("text", "found"), [("b", "b0 b1"), ("b,a", "b0 b1 a0 a1"), ("all", "a0 a1 b0 b1")]
)
def test_objects_of_each_class_are_taken(tmp_path, text, found):
    for place in ("a/0.ply", "a/1.ply", "a/2.ply", "b/0.ply", "b/1.ply"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).touch()
    classes = TRAIN_OPTIONS["classes"].convert(text)
    options = TrainingOptions(
        dataset=f"folder:{tmp_path}", classes=classes, objects=2, out=tmp_path
    )
    objects = open_training_objects(options)
    assert [o.class_name + o.object_id.removesuffix(".ply") for o in objects] == found.split()
    (chair,) = open_training_objects(TrainingOptions(objects=1, out=tmp_path))
    assert chair.split == "train"


def trained(command, tmp_path, name, *options):
    """Train on two chairs by the command; return the file that it names."""
    out = tmp_path / "trained"
    status, said, err = command("train", name, *options, "--objects", "2", "--out", str(out))
    assert status == 0, err
    return Path(said.strip())


def test_splat_net_from_the_command_line_to_a_method(command, tmp_path):
    """Both files are methods, and from their weights another training starts."""
    options = ("--views", "2", "--batch", "4", "--cool-down", "1")
    file = trained(command, tmp_path, "splat-net", *options, "--steps", "2")
    assert file == tmp_path / "trained" / "weights.safetensors"
    for name, heads in (("weights", ("grey", "albedo")), ("weights-grey", ("grey",))):
        method = find_method(f"splat-net@{file.with_name(name)}.safetensors")
        weights = method.load("cpu").weights
        assert weights.network.config.heads == heads
        assert weights.network.config.inputs.channels == 25  # all, and the noise
        assert weights.card["steps"] == 2
        assert weights.card["learning_rates"] == "0.002"  # the last step is at full rate
        assert method.identity().endswith(weights.sha256)
    (tmp_path / "further").mkdir()
    options = (*options, "--start", str(file), "--steps", "1")
    found = load_weights(trained(command, tmp_path / "further", "splat-net", *options))
    assert found.card["start"] == file_sha256(file)


def test_fused_net_from_the_command_line_to_a_method(command, tmp_path):
    """The meshes alone, then a step that starts from splat-net; both files are methods."""
    options = ("--views", "2", "--batch", "4", "--cool-down", "1", "--turned", "0.5")
    clean = (*options, "--no-augment")
    maps = trained(command, tmp_path, "fused-net", *clean, "--steps", "0")
    (kept,) = maps.iterdir()
    written = kept.stat().st_mtime_ns
    file = trained(command, tmp_path, "fused-net", *clean, "--start", "all", "--steps", "1")
    assert kept.stat().st_mtime_ns == written
    for name, heads in (("weights", ("grey", "albedo")), ("weights-grey", ("grey",))):
        method = find_method(f"fused-net@{file.with_name(name)}.safetensors")
        renderer = method.load("cpu")
        assert renderer.weights.network.config.heads == heads
        assert renderer.weights.card["turned"] == 0.5
        assert renderer.weights.sha256 in method.identity()
        for beside in ("occupancy-net", "upsampled-wrap"):
            assert find_method(beside).identity() in method.identity()


def test_the_gan_goes_on_from_weights_to_a_method(command, tmp_path):
    options = ("--views", "1", "--batch", "2", "--steps", "1", "--warm-up", "1")
    options = (*options, "--start", "chair", "--objective", "acgan-paper")
    file = trained(command, tmp_path, "gan", *options)
    weights = find_method(f"pc2pix@{file}").load("cpu").weights
    started = load_gan_weights("chair")
    assert weights.card["start"] == started.sha256
    assert weights.card["model"] == started.card["model"]  # the azimuth is not the default's
    assert weights.card["learning_rates"] == "generator 0 up to step 1"
    assert torch.equal(weights.encoder.code.weight, started.encoder.code.weight)


def test_occupancy_net_from_the_command_line_to_a_method(command, tmp_path):
    options = ("--batch", "2", "--steps", "1", "--cool-down", "1")
    file = trained(command, tmp_path, "occupancy-net", *options)
    method = find_method(f"occupancy-net@{file}")
    weights = method.load("cpu").weights
    assert weights.card["learning_rates"] == "0.001"  # the last step is at full rate
    assert method.identity().endswith(weights.sha256)


def test_the_up_sampler_from_the_command_line_to_a_method(command, tmp_path):
    """Its weights are of no other network."""
    options = ("--batch", "1", "--steps", "2", "--cool-down", "1", "--precision", "bfloat16")
    file = trained(command, tmp_path, "upsampler", *options)
    header, *_, last = file.with_name("losses.csv").read_text().splitlines()
    assert header == "step,distance,normals,validation"
    assert all(0 < float(value) < 2 for value in last.split(",")[1:])
    method = find_method(f"upsampled-wrap@{file}")
    renderer = method.load("cpu")
    assert renderer.weights.card["steps"] == 2
    assert method.identity().endswith(renderer.weights.sha256)
    images = renderer.draw(renderer.prepare(chair_cloud(256)), [View(30, 20)])
    assert images.shape == (1, 128, 128, 3)
    assert 0.05 < (images < 1).mean() < 0.5  # a chair
    with pytest.raises(BadInput, match="expected format 'occupancy-net-weights-1' in the header"):
        find_method(f"occupancy-net@{file}").load("cpu")


def test_a_time_limit_ends_a_training_with_weights(command, tmp_path, monkeypatch):
    """Each look at the clock takes a second."""
    monkeypatch.setattr(time, "monotonic", itertools.count().__next__)
    options = ("--batch", "2", "--steps", "1000", "--cool-down", "100", "--for", "40s")
    out = tmp_path / "x"
    status, said, err = command("train", "occupancy-net", *options, "--objects", "2", "--out", out)
    assert (status, said) == (0, f"{out / 'weights.safetensors'}\n")
    steps = find_method(f"occupancy-net@{said.strip()}").load("cpu").weights.card["steps"]
    assert 1 < steps < 20
    assert re.sub(r" \([0-9.]+/s\)", "", err.splitlines()[-1]) == (
        f"occupancy-net: --for 40s ended it after step {steps} of 1000, {2 * steps} clouds; the "
        f"same command goes on from {out}; its learning rate falls over the last 100 steps, and "
        f"has not fallen to the end: --steps {steps + 100} ends it with the fall from here"
    )


def test_occupancy_net_is_not_trained_on_sheets(command, tmp_path):
    (tmp_path / "chair").mkdir()
    triangle = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    triangle.export(tmp_path / "chair" / "0.ply")
    options = ("--dataset", f"folder:{tmp_path}", "--steps", "1", "--out", tmp_path / "x")
    status, said, err = command("train", "occupancy-net", *options)
    assert (status, said) == (2, "")
    assert err.splitlines()[-1].startswith("bench: chair/0")
    assert "inside and outside cannot be told apart at" in err.splitlines()[-1]
