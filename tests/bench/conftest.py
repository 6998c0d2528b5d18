from __future__ import annotations

import json
import os
import pty
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

# For `harness_objects`: spawned workers get this path, and import the objects of the tests by name.
sys.path.append(str(Path(__file__).parent))

BENCH = (sys.executable, "-c", "from bench.cli import main; main()")


def start_run(arguments, directory, code=BENCH[-1], **environment):
    """Start the command line in a session of its own, 100 columns wide, without fid's weights."""
    return subprocess.Popen(
        [*BENCH[:-1], code, *arguments, "--out", str(directory)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ
        | {"XDG_CACHE_HOME": str(directory.parent), "COLUMNS": "100"}  # pytest-xdist sets 80
        | environment,
    )


def on_terminal(columns, *arguments):
    """Run the command line with a terminal of so many columns as stdout; return its lines."""
    reader, writer = pty.openpty()
    with subprocess.Popen(
        [*BENCH, *map(str, arguments)],
        stdout=writer,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"COLUMNS": str(columns)},
    ) as process:
        os.close(writer)
        printed = b""
        with os.fdopen(reader, "rb", 0) as terminal, suppress(OSError):  # EIO: it has ended
            while part := terminal.read(4096):
                printed += part
    assert process.returncode == 0
    return printed.decode().splitlines()


@pytest.fixture
def command(capsys):
    """Run the command line in this process; return exit status, stdout and stderr."""
    from bench.cli import main

    def run(*arguments):
        capsys.readouterr()
        before = signal.getsignal(signal.SIGINT)
        with pytest.raises(SystemExit) as ended:
            main([*map(str, arguments)])
        signal.signal(signal.SIGINT, before)  # an interrupted command ignores further ones
        out, err = capsys.readouterr()
        return ended.value.code or 0, out, err

    return run


@pytest.fixture
def refused(command):
    """Run a command line that is refused with exit status 2; return its one line of error."""

    def run(*arguments):
        status, out, err = command(*arguments)
        assert (status, out) == (2, "")
        *progress, line = err.splitlines()
        assert all(" done, " in text for text in progress)  # where the machine is busy
        assert line.startswith("bench: ")
        return line.removeprefix("bench: ")

    return run


@pytest.fixture
def few_objects(monkeypatch):
    """Have intervals from two objects on, so that tests can be worked out by hand."""
    monkeypatch.setattr("bench.analysis.intervals.FEWEST", 2)


@pytest.fixture
def no_machine(monkeypatch):
    """Leave the machine out of protocols: to describe it takes seconds."""
    monkeypatch.setattr("bench.running.protocol.environment", dict)


@pytest.fixture(scope="session")
def tiny_weights(tmp_path_factory):
    """Return a file with small weights of pc2pix, untrained."""
    import torch

    from learning import checkpoint
    from learning.weights import FILES
    from pc2pix.model import Encoder, Generator, ModelConfig
    from pc2pix.weights import ENCODER_NAMES

    model = {"width": 0.0625, "latent_dim": 4}
    torch.manual_seed(0)
    tensors = {"code_mean": torch.zeros(4), "code_std": torch.ones(4)}
    for network in (Encoder(ModelConfig(**model)), Generator(ModelConfig(**model))):
        for key, value in network.state_dict().items():
            if not key.endswith("num_batches_tracked"):
                tensors[f"{type(network).__name__.lower()}.{key}"] = value
    header = {"format": FILES["pc2pix"].format, "encoder": ENCODER_NAMES["paper"]}
    header["model"] = json.dumps(model)
    path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    checkpoint.write_atomically(path, tensors, header | {"training": "{}"})
    return path


@pytest.fixture(scope="session")
def arguments(tiny_weights):
    """Return the command of a short run: 3 objects x 4 methods x 2 conditions, 2 views."""
    methods = f"splat,pc2pix@{tiny_weights},true-mesh,blank"
    return (
        *("run", "--suite", "chair-robustness", "--methods", methods),
        *("--conditions", "2048,noise-0.10", "--limit", "3", "--views", "2"),
    )


@pytest.fixture(scope="session")
def finished(arguments, tmp_path_factory):
    """Return the folder of that run, made with two workers, and its output."""
    directory = tmp_path_factory.mktemp("finished") / "run"
    with start_run((*arguments, "--workers", "2"), directory) as process:
        out, err = process.communicate()
    done = subprocess.CompletedProcess(process.args, process.returncode, out, err)
    assert done.returncode == 0, done.stderr
    return directory, done


@pytest.fixture(scope="module")
def same_machine(finished):
    """Give runs of this process the environment of that run, and no weights for fid."""
    from bench.records.folder import read_manifest

    environment = read_manifest(finished[0])["environment"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.running.protocol.environment", lambda: environment)
        patch.setenv("XDG_CACHE_HOME", str(finished[0].parent))
        yield


@pytest.fixture
def copied(finished, tmp_path):
    """Return a copy of that run, to be altered."""
    return Path(shutil.copytree(finished[0], tmp_path / "run"))
