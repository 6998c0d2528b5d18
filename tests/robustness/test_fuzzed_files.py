"""Damaged and malicious files of every format: read or refused, and nothing else happens."""

from __future__ import annotations

import json
import os
import pickle
import random
import re
import socket
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.suites.speed.measure import peak_mib
from data_prep.failures import BadInput
from data_prep.files import meshes as mesh_files
from data_prep.files import textures
from data_prep.files.mesh_resources import MeshResources
from tests.data_prep.dataset_trees import gltf_binary
from tests.robustness.fuzzing import (
    FORMATS,
    OUTSIDE,
    SECRET,
    Executed,
    Files,
    Format,
    Task,
    gltf_blob,
    gltf_tree,
    image,
    listing,
    make_case,
    mesh_gltf,
    mesh_obj,
    mesh_ply,
    mesh_stl,
    npy,
    playground,
    postscript,
    read,
    safetensors,
    torch_file,
    write_case,
)

LONGEST_S, MOST_MIB = 10.0, 2048.0


def check(name: str, files: Files, root: Path, outcome: str | None = None) -> str:
    """Read a case in this process, where nothing may happen but that; return the refusal."""
    number = len(list((root / "cases").iterdir()))
    path = write_case(root / "cases" / str(number), files)
    before, memory = listing(root), peak_mib() or 0
    reading = read(Task(name, path))
    assert reading.outcome != "defect", reading.detail
    assert outcome in (None, reading.outcome), reading.detail
    assert reading.events == ()
    assert listing(root) == before
    assert reading.seconds < LONGEST_S
    assert reading.peak_mib < memory + MOST_MIB
    assert "\n" not in reading.detail
    assert len(reading.detail) < 2 * len(str(path)) + 500
    return reading.detail


@pytest.fixture
def root():
    with playground() as folder:
        yield folder


@pytest.mark.parametrize("examples", [14, pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", FORMATS)
def test_mutated_files(name: str, examples: int) -> None:
    """The slow run reads some 2,000 files."""

    @settings(derandomize=True, max_examples=examples, deadline=None, database=None)
    @given(rng=st.randoms(use_true_random=False))
    def read_mutated(rng: random.Random) -> None:
        with playground() as root:
            check(name, make_case(name, rng), root)

    read_mutated()


@pytest.mark.parametrize("name", FORMATS)
def test_valid_files_are_read(root: Path, name: str) -> None:
    for files in FORMATS[name].valid():
        check(name, files, root, "read")


def tree(**changes: object) -> Files:
    return {"a.glb": gltf_binary(gltf_tree(gltf_blob()) | changes, gltf_blob())}


CIRCLE = [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0, 1]}]
# 2**40 ways to its last node
THICKET = [{"mesh": 0, "children": [i + 1, i + 1]} for i in range(40)] + [{"mesh": 0}]
ACCESSORS = gltf_tree(gltf_blob())["accessors"]


REFUSED: dict[str, tuple[str, Files, str]] = {
    "stl-count": (
        "mesh-stl",
        {"a.stl": mesh_stl(True)[:80] + b"\xff" * 4},
        "4294967295 triangles, 214748364834 bytes, of which 84 are there",
    ),
    "ply-count": ("mesh-ply", {"a.ply": mesh_ply(True).replace(b"x 4", b"x 999999999")},
                  "999999999 rows of 'vertex'"),
    "off-count": ("mesh-off", {"a.off": b"OFF\n9999999999 1 0\n0 0 0\n3 0 0 0\n"},
                  "its counts '9999999999 1 0' say"),
    "zeros": (
        "mesh-glb",
        tree(accessors=[{"componentType": 5126, "count": 4 * 10**7, "type": "VEC3"}, ACCESSORS[1]]),
        "leave out 120000000 numbers",
    ),
    "views": (
        "mesh-glb",
        tree(bufferViews=[{"buffer": 0, "byteLength": 2**29}] * 3),
        r"its bufferViews\[0\] reaches beyond its buffer",
    ),
    "glb-json-length": (
        "mesh-glb",
        {"a.glb": struct.pack("<4sIII4s", b"glTF", 2, 20, 2**32 - 1, b"JSON")},
        "a chunk of 4294967295 bytes reaches beyond the end",
    ),
    "glb-chunk-length": (
        "mesh-glb",
        {"a.glb": struct.pack("<4sIII4s", b"glTF", 2, 30, 2**31, b"JSON") + b"{}" * 5},
        "a chunk of 2147483648 bytes reaches beyond the end",
    ),
    "glb-deep": (
        "mesh-glb",
        {"a.glb": struct.pack("<4sIII4s", b"glTF", 2, 90020, 90000, b"JSON") + b"[" * 90000},
        "RecursionError",
    ),
    "other-gltf": (
        "mesh-gltf",
        {"a.gltf": b"{", "model.gltf": mesh_gltf(True)["a.gltf"]},
        "no JSON",
    ),
    **{
        f"gltf-{uri[-6:]}": (
            "mesh-gltf",
            {"a.gltf": json.dumps(gltf_tree(gltf_blob(), uri=uri)).encode()},
            "its buffer 0, the file .* is not there",
        )
        for uri in (f"../../{SECRET}", "pipe", "link")
    },
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused_at_once(root: Path, case: str) -> None:
    name, files, problem = REFUSED[case]
    before = peak_mib() or 0
    message = check(name, files, root, "refused")
    assert re.search(problem, message), message
    assert (peak_mib() or 0) < before + 200  # no memory for what is only claimed


ENTRY = {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}
TWICE = b'{"a":' + json.dumps(ENTRY).encode() + b',"a":' + json.dumps(ENTRY).encode() + b"}"
PICKLE = pickle.dumps(Executed("canary-pickle"))


def _npy_header(descr: str, shape: str) -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + bytes(192)


# Read or refused, as long as nothing else happens; texts and headers are in the tests of readers.
HOSTILE: dict[str, tuple[Files, ...]] = {
    "mesh-obj": (
        mesh_obj() | {"paint.png": image("1", (20_000, 10_000))},
        mesh_obj() | {"a.obj": mesh_obj()["a.obj"] + b"f " + b"1 " * 30_000 + b"\n"},
    ),
    "mesh-ply": tuple(
        {"a.ply": mesh_ply(True).replace(old, new)}
        for old, new in [
            *((b"vertex 4", b"vertex " + count) for count in (b"0", b"5", b"-1", b"9" * 30)),
            *((b"face 4", b"face " + count) for count in (b"0", b"5", b"-1", b"9" * 30)),
            *((b"list uchar int", b"list int int"), (b"list uchar int", b"list char double")),
        ]
    ),
    "mesh-glb": tuple(
        tree(**changes)
        for changes in [
            {"nodes": CIRCLE},
            {"nodes": THICKET},
            {"nodes": [{"mesh": 0, "matrix": [1e999] * 16}]},
            {"bufferViews": gltf_tree(gltf_blob())["bufferViews"] * 1000},
            {"accessors": [ACCESSORS[0], ACCESSORS[1] | {"count": 10**30}]},
            {"accessors": [ACCESSORS[0] | {"count": "4"}, ACCESSORS[1]]},
            *({"images": [{"uri": uri}]} for uri in (*OUTSIDE, "data:,base64,JSFQUw==")),
        ]
    ),
    "cloud-npy": tuple(
        {"a.npy": data}
        for data in (
            npy(np.array([[Executed("canary-npy")] * 3] * 2, object)),
            *(PICKLE, torch_file("canary-npy")),
            *(_npy_header(kind, "(8, 3)") for kind in ("'O'", "[('a', 'O')]", "'<U9'", "'x'")),
            *(_npy_header("'<f8'", shape) for shape in ("(10**9, 3)", "(-1, 3)", "8", "(2**62,)")),
        )
    ),
    "weights": tuple(
        {"w.safetensors": data}
        for data in (
            *(PICKLE, torch_file("canary-weights"), safetensors(TWICE, bytes(8))),
            safetensors({"a": ENTRY, "b": ENTRY | {"data_offsets": [4, 12]}}, bytes(12)),
            *(
                safetensors({"a": ENTRY | wrong}, bytes(8))
                for wrong in (
                    *({"data_offsets": [0, 2**63]}, {"shape": [2**32, 2**32, 2**32]}),
                    *({"dtype": kind} for kind in ("BOOL", "C64", "X")),
                )
            ),
        )
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files(root: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(root)  # where a canary would be made
    for files in HOSTILE[name]:
        check(name, {n: d.replace(b"{root}", str(root).encode()) for n, d in files.items()}, root)


@pytest.mark.parametrize("outside", OUTSIDE)
def test_an_obj_reads_nothing_outside_its_folder(root: Path, outside: str) -> None:
    for place, name in (("a.obj", b"a.mtl"), ("a.mtl", b"paint.png")):
        files = mesh_obj()
        files[place] = files[place].replace(name, outside.format(root=root).encode())
        check("mesh-obj", files, root, "read")  # without its colours, at worst


def test_a_name_that_leads_out_stands_for_the_file_of_that_name(root: Path) -> None:
    path = write_case(root / "cases" / "0", {"a.obj": b"", "a.mtl": b"x", SECRET: b"own"})
    resources = MeshResources(path.parent, 100)
    assert resources.read(f"../../{SECRET}") == resources.read(f"{root}/{SECRET}") == b"own"
    assert resources.read("a.mtl ") == resources.read("/A.MTL") == b"x"
    for name in ("link", "pipe", "folder", "..", "gone", "/dev/zero", "a\0b"):
        assert resources.read(name) is None
    (path.parent / "large").write_bytes(bytes(101))
    with pytest.raises(BadInput, match="101 bytes, and at most"):
        resources.read("large")
    (path.parent / "rest").write_bytes(bytes(92))
    resources.read("rest")  # 8 bytes had been read before: that makes 100
    with pytest.raises(BadInput, match="1 bytes, and at most 0"):
        resources.read("a.mtl")


def test_postscript_is_not_run(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A Ghostscript of our own, which only leaves a trace.
    binary = root / "bin" / "gs"
    binary.parent.mkdir()
    trace = root / "gs-was-here"
    binary.write_text(f"#!/bin/sh\ntouch {trace}\n")
    binary.chmod(0o755)
    monkeypatch.setenv("PATH", str(binary.parent), prepend=os.pathsep)
    subprocess.run(["gs"], check=True)
    assert trace.exists()
    trace.unlink()
    files = mesh_obj() | {"paint.png": postscript(str(root / "x"))}
    check("mesh-obj", files, root)
    assert not trace.exists()


@pytest.mark.parametrize("name", ["mesh-obj", "mesh-glb"])
def test_a_small_file_of_many_pixels(root: Path, monkeypatch: Any, name: str) -> None:
    files = mesh_obj() if name == "mesh-obj" else tree()
    monkeypatch.setattr(textures, "MOST_PIXELS", 16)  # the image has 16
    check(name, files, root, "read")
    monkeypatch.setattr(textures, "MOST_PIXELS", 15)
    assert "a texture of 4 x 4 pixels, at most 15 are" in check(name, files, root, "refused")


def test_too_many_nodes(root: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(mesh_files, "MOST_FACES", 36)
    few, many = (
        tree(nodes=[{"mesh": 0}] * count, scenes=[{"nodes": list(range(count))}])
        for count in (9, 10)
    )
    check("mesh-glb", few, root, "read")
    assert "more than 36 faces or vertices; give a coarser mesh" in check(
        "mesh-glb", many, root, "refused"
    )


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_file_is_refused_at_once(root: Path, name: str) -> None:
    file = next(iter(FORMATS[name].valid()[0]))
    gone, folder, pipe, device, large = paths = [root / f"{kind}" / file for kind in range(5)]
    for path in paths:
        path.parent.mkdir()
    folder.mkdir()
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    large.touch()
    os.truncate(large, 2**43)
    for path in (gone, folder, pipe, device, large):
        reading = read(Task(name, path))
        assert reading.outcome == "refused", reading.detail
        assert reading.seconds < 1
        assert reading.peak_mib < (peak_mib() or 0) + 100


@pytest.mark.parametrize(
    ("act", "event"),
    [
        (lambda folder: (folder / "new").write_text("x"), "for writing"),
        (lambda folder: (folder.parent / "other").read_bytes(), "open "),
        (lambda folder: subprocess.run(["true"], check=True), "subprocess.Popen"),
        (lambda folder: os.system("true"), "os.system"),
        (lambda folder: socket.socket().close(), "socket."),
        (lambda folder: (folder / "a").unlink(), "os.remove"),
        (lambda folder: (folder / "d").mkdir(), "os.mkdir"),
        (lambda folder: torch.load(folder / "torch.pth", weights_only=False), "pickle.find_class"),
        (lambda folder: np.load(folder / "o.npy", allow_pickle=True), "pickle.find_class"),
        (lambda folder: exec(compile("1", str(folder / "a"), "exec")), "exec "),
    ],
    ids=["write", "read", "run", "shell", "connect", "remove", "mkdir", "torch", "npy", "exec"],
)
def test_the_watch_sees(tmp_path: Path, act, event: str) -> None:
    folder = tmp_path / "case"
    folder.mkdir()
    (tmp_path / "other").write_text("x")
    (folder / "a").write_text("x")
    (folder / "torch.pth").write_bytes(torch_file(str(folder / "made")))
    (folder / "o.npy").write_bytes(npy(np.array([Executed(str(folder / "made"))], object)))
    careless = Format(lambda: (), lambda path: act(path.parent))
    reading = read(Task("careless", folder / "a"), {"careless": careless})
    assert any(event in seen for seen in reading.events), reading
    # A pickle of the corpus does harm to the careless: else the canaries would mean nothing.
    assert (folder / "made").exists() == (event == "pickle.find_class")
