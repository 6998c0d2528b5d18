"""Damaged or hostile files of weights: every loader refuses them, in one line."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import save_file

from baselines.splat_net import weights as splat_net
from baselines.splat_net.network import NetworkConfig, SplatNet
from bench.judges.judge import JudgeNetwork, load_judge_network
from bench.judges.views import Labels, ViewsNetwork, load_views_network, to_file
from data_prep.failures import BadInput
from learning.weights import (
    file_sha256,
    objective_of,
    read_safetensors,
    without_counters,
    write_atomically,
)
from pc2pix import weights as pc2pix
from pc2pix.model import Decoder, Encoder, Generator, ModelConfig

TINY = {"width": 0.0625, "latent_dim": 4}


def write_pc2pix(path):
    tensors = {"code_mean": torch.zeros(4), "code_std": torch.ones(4)}
    for name, kind in (("encoder", Encoder), ("generator", Generator)):
        state = without_counters(kind(ModelConfig(**TINY)).state_dict())
        tensors |= {f"{name}.{key}": value for key, value in state.items()}
    header = {"format": pc2pix.FORMAT, "encoder": pc2pix.ENCODER_NAMES["paper"]}
    header |= {"model": json.dumps(TINY), "training": "{}"}
    write_atomically(path, tensors, header)


def write_decoder(path):
    """With the weights it belongs to beside it."""
    weights = path.with_name("of-decoder.safetensors")
    write_pc2pix(weights)
    header = {"format": pc2pix.DECODER_FORMAT, "weights": file_sha256(weights)}
    header |= {"model": json.dumps(TINY), "training": "{}"}
    write_atomically(path, Decoder(ModelConfig(**TINY)).state_dict(), header)


def load_decoder(path):
    """From where a decoder has to stand; `path` may be anything."""
    weights = path.with_name("of-decoder.safetensors")
    if not weights.exists():
        write_pc2pix(weights)
    loaded = pc2pix.load_weights(weights)
    pc2pix.decoder_path(weights).unlink(missing_ok=True)
    if os.path.lexists(path):
        path.rename(pc2pix.decoder_path(weights))
    return pc2pix.load_decoder(weights, loaded)


def write_splat_net(path):
    config = NetworkConfig(widths=(4, 6, 8, 10, 12), heads=("colour",))
    header = {"format": splat_net.FORMAT, "network": json.dumps(asdict(config)), "training": "{}"}
    write_atomically(path, without_counters(SplatNet(config).state_dict()), header)


def write_views(path):
    path.write_bytes(to_file(ViewsNetwork(Labels(("car",), ("car/van",), ("ladder",)))))


@dataclass(frozen=True)
class Kind:
    """Weights of one kind.

    tensor  the name of one; it has one dimension
    model   the key of the header that says how the network looks; "" if there is none
    told    how a refusal begins after the path of the file; "" if each has a text of its own
    """

    write: Callable[[Path], None]
    load: Callable[[Path], Any]
    tensor: str
    model: str = ""
    reported: str = ""


KINDS = {
    "pc2pix": Kind(write_pc2pix, pc2pix.load_weights, "code_mean", "model"),
    "decoder": Kind(write_decoder, load_decoder, "layers.0.bias", "model"),
    "splat-net": Kind(write_splat_net, splat_net.load_weights, "last.bias", "network"),
    "judge": Kind(
        lambda path: write_atomically(path, JudgeNetwork().state_dict(), {}),
        load_judge_network,
        "view.bias",
        reported="not the weights of the judge network (",
    ),
    "views": Kind(
        write_views,
        load_views_network,
        "heads.view.bias",
        "labels",
        "not the weights of fd-views (",
    ),
}
CHECKED = ("pc2pix", "decoder", "splat-net")  # tensor by tensor, and by the header


@pytest.fixture(params=KINDS)
def kind(request):
    return KINDS[request.param]


def refusal(kind, path):
    with pytest.raises(BadInput) as error:
        kind.load(path)
    message = str(error.value)
    assert "\n" not in message
    place = "of-decoder-decoder.safetensors" if kind.load is load_decoder else str(path)
    assert place in message
    if kind.reported:
        assert message.startswith(f"{path}: {kind.reported}")
    return message


def changed(kind, path, change):
    kind.write(path)
    tensors, header = read_safetensors(path)
    change(tensors, header)
    save_file(tensors, path, metadata=header)
    return refusal(kind, path)


def test_a_whole_file_is_loaded(kind, tmp_path):
    kind.write(tmp_path / "w.safetensors")
    assert kind.load(tmp_path / "w.safetensors")


@pytest.mark.parametrize("length", [0, 7, 1000, -1])
def test_a_truncated_file(kind, tmp_path, length):
    path = tmp_path / "w.safetensors"
    kind.write(path)
    path.write_bytes(path.read_bytes()[:length])
    assert "not a whole safetensors file" in refusal(kind, path)


def test_not_a_safetensors_file(kind, tmp_path):
    path = tmp_path / "w.safetensors"
    path.write_text("these are not the weights you are looking for")
    assert "not a whole safetensors file" in refusal(kind, path)


@pytest.mark.parametrize("name", ["pipe", "device", "folder", "giant", "gone", "n" * 300])
@pytest.mark.parametrize("read", [*KINDS, "objective_of", "file_sha256"])
def test_pipes_devices_and_giants_are_refused_at_once(tmp_path, read, name):
    readers = {"objective_of": objective_of, "file_sha256": file_sha256}
    path = tmp_path / name
    if name == "pipe":
        os.mkfifo(path)
    elif name == "device":
        path.symlink_to("/dev/zero")
    elif name == "folder":
        path.mkdir()
    elif name == "giant":
        with path.open("wb") as file:
            file.truncate(2**43)  # sparse
    if read == "decoder" and len(name) > 255:
        pytest.skip("a decoder's name is made from that of its weights, which are read first")
    with pytest.raises(BadInput):
        (readers.get(read) or KINDS[read].load)(path)


@pytest.mark.parametrize("name", KINDS)
def test_a_tensor_that_is_missing_or_of_another_shape(tmp_path, name):
    kind, path = KINDS[name], tmp_path / "w.safetensors"
    key = kind.tensor
    reported = changed(kind, path, lambda tensors, _: tensors.pop(key))
    assert key in reported
    reported = changed(kind, path, lambda tensors, _: tensors.update({key: torch.zeros(5, 2)}))
    assert key in reported
    reported = changed(kind, path, lambda tensors, _: tensors.update(extra=torch.zeros(1)))
    assert "extra" in reported


@pytest.mark.parametrize("name", CHECKED)
@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (lambda t, key: t.pop(key), "tensor {key} is missing"),
        (lambda t, key: t.update(extra=torch.zeros(1)), "tensor extra is unknown"),
        (lambda t, key: t.update({key: torch.zeros(5, 2)}), "{key} has shape [5, 2], expected ["),
        (lambda t, key: t[key].fill_(torch.nan), "{key} is not finite"),
        (lambda t, key: t[key].fill_(torch.inf), "{key} is not finite"),
    ],
)
def test_tensors_that_do_not_fit(tmp_path, name, change, reported):
    kind = KINDS[name]
    found = changed(
        kind, tmp_path / "w.safetensors", lambda tensors, _: change(tensors, kind.tensor)
    )
    assert reported.format(key=kind.tensor) in found


@pytest.mark.parametrize("kind", [torch.int32, torch.bool, torch.complex64, torch.float64])
@pytest.mark.parametrize("name", CHECKED)
def test_tensors_of_another_type(tmp_path, name, kind):
    key = KINDS[name].tensor
    reported = changed(
        KINDS[name],
        tmp_path / "w.safetensors",
        lambda tensors, _: tensors.update({key: tensors[key].to(kind)}),
    )
    assert f"{key} is of {kind}, not" in reported


@pytest.mark.parametrize("name", CHECKED)
def test_another_format(tmp_path, name):
    kind, path = KINDS[name], tmp_path / "w.safetensors"
    reported = changed(kind, path, lambda _, header: header.update(format="weights-999"))
    assert "expected format '" in reported
    assert "found 'weights-999'" in reported
    assert "found None" in changed(kind, path, lambda _, header: header.pop("format"))


@pytest.mark.parametrize("text", [None, "{", "[]", "null", '{"depth": 1}', "[" * 100_000])
@pytest.mark.parametrize("name", CHECKED)
def test_a_network_that_cannot_be_read(tmp_path, name, text):
    kind = KINDS[name]

    def change(tensors, header):
        header.pop(kind.model)
        header.update({kind.model: text} if text is not None else {})

    reported = changed(kind, tmp_path / "w.safetensors", change)
    assert "its header cannot be read" in reported


@pytest.mark.parametrize("text", [None, "[]", "3", "null", '[["a", 1]]', "[" * 100_000])
@pytest.mark.parametrize("name", ["pc2pix", "splat-net"])
def test_a_card_that_is_none(tmp_path, name, text):
    def change(tensors, header):
        header.pop("training")
        header.update({"training": text} if text is not None else {})

    reported = changed(KINDS[name], tmp_path / "w.safetensors", change)
    assert "its header cannot be read" in reported
