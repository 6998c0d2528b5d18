"""Damaged or hostile files of weights: every loader refuses them, in one line."""

from __future__ import annotations

import json
import os
import re

import pytest
import torch
from safetensors.torch import save_file

from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from learning.tensor_files import read_safetensors
from learning.weights import card_of, objective_of

from .trainings import KINDS, load_decoder, whole

CHECKED = [name for name in KINDS if KINDS[name].training]  # tensor by tensor, and by the header
DEEP = "[" * 100_000


def one_line(error):
    message = str(error.value)
    assert "\n" not in message
    return message


def refusal(kind, path):
    with pytest.raises(BadInput) as error:
        kind.load(path)
    message = one_line(error)
    decoder = kind.load is load_decoder
    assert ("of-decoder-decoder.safetensors" if decoder else str(path)) in message
    if kind.reported:
        assert message.startswith(f"{path}: {kind.reported}")
    return message


def changed(name, path, change):
    """The refusal of a whole file of which one thing has been changed."""
    path.write_bytes(whole(name))
    tensors, header = read_safetensors(path)
    change(tensors, header)
    save_file(tensors, path, metadata=header)
    return refusal(KINDS[name], path)


@pytest.mark.parametrize("name", KINDS)
def test_only_whole_files_are_loaded(name, tmp_path):
    kind, path = KINDS[name], tmp_path / "w.safetensors"
    path.write_bytes(whole(name))
    assert kind.load(path)
    for content in (b"", b"7 bytes", whole(name)[:1000], whole(name)[:-1], b"x" * 50):
        path.write_bytes(content)
        assert "not a whole safetensors file" in refusal(kind, path)


@pytest.mark.parametrize("name", ["pipe", "device", "giant", "gone"])
@pytest.mark.parametrize("read", [*KINDS, "objective_of", "file_sha256"])
def test_pipes_devices_and_giants_are_refused_at_once(tmp_path, read, name):
    readers = {"objective_of": objective_of, "file_sha256": file_sha256}
    path = tmp_path / name
    if name == "pipe":
        os.mkfifo(path)
    elif name == "device":
        path.symlink_to("/dev/zero")
    elif name == "giant":
        with path.open("wb") as file:
            file.truncate(2**43)  # sparse
    with pytest.raises(BadInput):
        (readers.get(read) or KINDS[read].load)(path)


@pytest.mark.parametrize("name", KINDS)
def test_tensors_that_do_not_fit(tmp_path, name):
    path, key = tmp_path / "w.safetensors", KINDS[name].tensor
    missing = changed(name, path, lambda tensors, _: tensors.pop(key))
    shape = changed(name, path, lambda tensors, _: tensors.update({key: torch.zeros(5, 2)}))
    more = changed(name, path, lambda tensors, _: tensors.update(extra=torch.zeros(1)))
    assert key in missing
    assert key in shape
    assert "extra" in more
    if name == "views":  # whose header has the labels
        assert changed(name, path, lambda _, header: header.clear())
    if name in CHECKED:
        assert f"tensor {key} is missing" in missing
        assert f"{key} has shape [5, 2], expected [" in shape
        assert "tensor extra is unknown" in more
        for value in (torch.nan, -torch.inf):
            wild = changed(name, path, lambda tensors, _, v=value: tensors[key][:1].fill_(v))
            assert f"{key} is not finite; " in wild
        for dtype in (torch.int32, torch.bfloat16):
            other = changed(
                name, path, lambda tensors, _, d=dtype: tensors.update({key: tensors[key].to(d)})
            )
            assert f"{key} is of {dtype}, not" in other


@pytest.mark.parametrize("name", CHECKED)
def test_another_format(tmp_path, name):
    """Networks of the first format of splat-net had a code that none here understands."""
    path = tmp_path / "w.safetensors"
    for found, message in {
        "weights-999": r"expected format '.*found 'weights-999'; ",
        "": "found ''",
        "splat-net-weights-1": r"weights of version 1\.0\.0 or earlier \(format "
        r"splat-net-weights-1, now splat-net-weights-2\); train them again",
    }.items():
        text = changed(name, path, lambda _, header, f=found: header.update(format=f))
        if found != "splat-net-weights-1" or name in ("splat-net", "fused-net"):
            assert re.search(message, text)
    assert "found None" in changed(name, path, lambda _, header: header.pop("format"))


@pytest.mark.parametrize("text", [None, "{", "[]", "null", '{"depth": 1}', DEEP])
@pytest.mark.parametrize("name", CHECKED)
def test_a_header_that_cannot_be_read(tmp_path, name, text):
    """The header describes the network, and the training where drawing reads that."""
    for key in (KINDS[name].model, *(["training"] if name != "decoder" else [])):
        if key == "training" and text == '{"depth": 1}':
            continue  # which a card may say

        def change(tensors, header, key=key):
            header.pop(key)
            header.update({key: text} if text is not None else {})

        reported = changed(name, tmp_path / "w.safetensors", change)
        assert "its header cannot be read" in reported


INPUTS = ("windows", "normals", "density", "flattened", "far", "meshes")  # of splat-net's network


@pytest.mark.parametrize(
    ("name", "where", "value", "text"),
    [
        ("pc2pix", "width", 1e6, "width 1000000.0, expected up to 4.0"),
        ("pc2pix", "width", float("inf"), "width inf, expected up to"),
        ("pc2pix", "width", float("nan"), "width must be positive, got nan"),
        ("pc2pix", "width", 4.0, "has shape"),
        ("pc2pix", "width", "1", "not supported"),
        ("pc2pix", "latent_dim", 10**9, "latent_dim 1000000000, expected up to 4096"),
        ("pc2pix", "latent_dim", 4.5, "latent_dim 4.5, expected up to"),
        ("pc2pix", "latent_dim", 0, "latent_dim must be at least 1, got 0"),
        ("pc2pix", "encoder", ["paper"], "encoder must be paper or pointnet"),
        ("pc2pix", "azimuth", "degrees", "azimuth must be scalar or sine-cosine, got 'degrees'"),
        ("splat-net", "heads", ["colour", "grey"], "expected one"),
        ("splat-net", "heads", ["silver"], "silver"),
        ("splat-net", "heads", [], "heads"),
        ("splat-net", "heads", [["colour"]], "unhashable"),
        ("splat-net", "widths", [4, 6, 8, 10, 0], "each at least 1"),
        ("splat-net", "widths", [4, 6, 8, 10], "expected five numbers"),
        ("splat-net", "widths", [4, 6, 8, 10, True], "widths"),
        ("splat-net", "widths", [4096] * 5, "is missing"),
        *(
            ("splat-net", "windows", value, "windows")
            for value in ([], [4, 7], [7, 3], [3, 3], [True, 7], [3, 65], "37")
        ),
        ("splat-net", "windows", [3, 5, 7], "first.conv.weight has shape"),
        ("splat-net", "normals", 1, "expected true or false"),
        ("splat-net", "density", 1e9, "expected true or false"),
        ("splat-net", "flattened", None, "expected true or false"),
        ("splat-net", "far", False, "has shape"),
        ("splat-net", "meshes", ["a"], "has shape"),
        ("splat-net", "meshes", ["a", "a"], "different names"),
        ("splat-net", "meshes", [1], "different names"),
        ("splat-net", "meshes", ["a" * 99], "different names"),
        ("splat-net", "meshes", [str(n) for n in range(99)], "different names"),
        ("splat-net", "more", 1, "more"),
        ("splat-net", "body", "x", "body x"),
        ("occupancy-net", "resolution", 9, "resolution 9 with 2 levels"),
        ("occupancy-net", "widths", [4, 10**9], "sizes"),
        ("occupancy-net", "blocks", True, "sizes"),
        ("occupancy-net", "hidden", 6, "has shape"),
        *(("upsampler", "width", value, "sizes") for value in (0, True, 10**9, 8.0)),
        ("upsampler", "rounds", 0, "sizes"),
        ("upsampler", "width", 8, "has shape"),
        ("upsampler", "rounds", 1000, "is missing"),
    ],
)
def test_networks_that_nobody_has_trained(tmp_path, monkeypatch, name, where, value, text):
    """Refused before memory is taken for them."""
    whole(name)  # made before memory is watched

    def change(tensors, header):
        network = json.loads(header[KINDS[name].model])
        inside = where in INPUTS
        (network["inputs"] if inside else network)[where] = value
        header[KINDS[name].model] = json.dumps(network)

    def outline_only(tensor, *_):
        assert tensor.is_meta, "memory was taken"

    monkeypatch.setattr(torch.nn.init, "uniform_", outline_only)
    assert text in changed(name, tmp_path / "w.safetensors", change)


def raw(header, length=None):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return (len(text) if length is None else length).to_bytes(8, "little") + text


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "Expecting value"),
        (b"\xff" * 8, "it states a length of 18446744073709551615 bytes"),
        (raw({}, length=3), "it states a length of 3 bytes"),
        (raw([]), "'list' object"),
        (raw(b"\xff\xff"), "utf-8"),
        (raw(DEEP.encode()), "recursion"),
        (raw({"__metadata__": 3}), "'int' object"),
        (raw({"__metadata__": {"training": 3}}), "must be str"),
        (raw({"__metadata__": {"training": '{"objective": 3}'}}), "no short text"),
        (raw({"__metadata__": {"training": json.dumps({"objective": "x" * 101})}}), "no short"),
    ],
)
def test_an_objective_that_cannot_be_trusted(tmp_path, content, expected):
    path = tmp_path / "w.safetensors"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=expected) as error:
        objective_of(path)
    assert one_line(error).startswith(f"{path}: its header cannot be read (")


def test_a_long_header_is_not_read(tmp_path):
    path = tmp_path / "w.safetensors"
    path.write_bytes(raw({"__metadata__": {"note": "x" * 100}}))
    assert objective_of(path) == ""
    with pytest.raises(BadInput, match="it states a length of"):
        card_of(path, most_header_bytes=100)
