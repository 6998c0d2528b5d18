"""Files as nobody should write them, and readers that are watched while they read them.

A case is a folder of its own with one file to read and, for some meshes, files beside it. It is
made from a format's valid files by a few mutations, or by a trick that somebody would play on
purpose; all drawn from one `random.Random`, so that number k of seed s can be made again alone.

Around the cases lie what no reader may touch: a secret to be read, and canaries that exist only if
something in a file has been executed.
"""

from __future__ import annotations

import base64
import functools
import io
import json
import os
import pickle
import random
import struct
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from data_prep.failures import BadInput

CANARY = "canary"  # begins the name of whatever an executed file would leave behind
SECRET = "secret"  # a file beside the cases' folders, which no case may read
PORT = 9  # "discard"; the hook sees who tries to connect
FACES = [(0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)]
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float32)

Files = dict[str, bytes]  # the file to read is the first


# --- valid files ----------------------------------------------------------------------------------


def mesh_ply(binary: bool) -> bytes:
    """A tetrahedron with colours of its faces."""
    kind = "binary_little_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\ncomment TextureFile paint.png\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\nelement face 4\n"
        "property list uchar int vertex_indices\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    ).encode()
    if binary:
        faces = b"".join(struct.pack("<B3i3B", 3, *f, 9, 99, 200) for f in FACES)
        return head + CORNERS.tobytes() + faces
    rows = [" ".join(map(str, c)) for c in CORNERS.tolist()]
    rows += [f"3 {a} {b} {c} 9 99 200" for a, b, c in FACES]
    return head + "\n".join(rows).encode() + b"\n"


def mesh_obj() -> Files:
    """A tetrahedron with a material, a texture and groups."""
    lines = ["mtllib a.mtl", "o thing", *(f"v {x} {y} {z}" for x, y, z in CORNERS.tolist())]
    lines += ["vt 0 0", "vt 1 0", "vt 0 1", "vn 0 0 1", "usemtl paint", "g one"]
    lines += [f"f {a + 1}/1/1 {b + 1}/2/1 {c + 1}/3/1" for a, b, c in FACES]
    material = b"newmtl paint\nKd 1 0.5 0\nmap_Kd paint.png\n"
    return {"a.obj": "\n".join(lines).encode(), "a.mtl": material, "paint.png": image()}


def image() -> bytes:
    """A small PNG."""
    file = io.BytesIO()
    Image.new("RGB", (4, 4), (9, 99, 200)).save(file, "PNG")
    return file.getvalue()


def mesh_off() -> bytes:
    """A tetrahedron."""
    rows = [" ".join(map(str, c)) for c in CORNERS.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in FACES]
    return ("OFF\n4 4 6\n" + "\n".join(rows) + "\n").encode()


def mesh_stl(binary: bool) -> bytes:
    """A tetrahedron."""
    corners = [[CORNERS[i].tolist() for i in face] for face in FACES]
    if binary:
        facets = [struct.pack("<12fH", 0, 0, 1, *np.ravel(c), 0) for c in corners]
        return bytes(80) + struct.pack("<I", len(FACES)) + b"".join(facets)
    text = "solid a\n"
    for facet in corners:
        text += "facet normal 0 0 1\nouter loop\n"
        text += "".join(f"vertex {x} {y} {z}\n" for x, y, z in facet)
        text += "endloop\nendfacet\n"
    return (text + "endsolid a\n").encode()


def gltf_tree(blob: bytes, **buffer: object) -> dict[str, Any]:
    """The JSON of a tetrahedron with a material and a texture in its one buffer."""
    points, indices = CORNERS.nbytes, 12 * 2
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 2, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points},
            {"buffer": 0, "byteOffset": points, "byteLength": indices},
            {
                "buffer": 0,
                "byteOffset": points + indices,
                "byteLength": len(blob) - points - indices,
            },
        ],
        "buffers": [{"byteLength": len(blob), **buffer}],
    }


def gltf_blob() -> bytes:
    """The buffer of `gltf_tree`."""
    return CORNERS.tobytes() + np.array(FACES, "<u2").tobytes() + image()


def glb(tree: object, blob: bytes) -> bytes:
    """A binary glTF."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def mesh_gltf(embedded: bool) -> Files:
    """A tetrahedron as JSON, its buffer in the JSON or in a file."""
    blob = gltf_blob()
    data = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    tree = gltf_tree(blob, uri=data if embedded else "a.bin")
    return {"a.gltf": json.dumps(tree).encode(), **({} if embedded else {"a.bin": blob})}


def cloud_ply(binary: bool) -> bytes:
    """Eight points."""
    kind = "binary_big_endian" if binary else "ascii"
    points = (np.arange(24.0).reshape(8, 3) / 8).astype(">f8")
    head = f"ply\nformat {kind} 1.0\nelement vertex 8\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    body = points.tobytes() if binary else cloud_text(" ")
    return head.encode() + body


def cloud_text(separator: str) -> bytes:
    """Eight points."""
    rows = (np.arange(24.0).reshape(8, 3) / 8).tolist()
    return "".join(separator.join(map(str, row)) + "\n" for row in rows).encode()


def npy(array: np.ndarray) -> bytes:
    """Any array; one of objects is pickled."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


@functools.cache
def weights() -> bytes:
    """Untrained weights of pc2pix, a sixteenth of the paper's width."""
    import torch

    from learning import checkpoint
    from pc2pix.model import Generator, ModelConfig, build_encoder
    from pc2pix.weights import ENCODER_NAMES, FORMAT

    model = {"width": 0.0625, "latent_dim": 4, "encoder": "pointnet"}
    torch.manual_seed(0)
    config = ModelConfig(**model)
    tensors = {"code_mean": torch.zeros(4), "code_std": torch.ones(4)}
    for name, part in (("encoder", build_encoder(config)), ("generator", Generator(config))):
        state = {k: v for k, v in part.state_dict().items() if "num_batches" not in k}
        tensors |= {f"{name}.{k}": v.half() if v.dim() > 1 else v for k, v in state.items()}
    header = {
        "format": FORMAT,
        "encoder": ENCODER_NAMES["pointnet"],
        "model": json.dumps(model),
        "training": json.dumps({"objective": "none", "steps": 0}),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "w.safetensors"
        checkpoint.write_atomically(path, tensors, header)
        return path.read_bytes()


def safetensors(header: object, body: bytes = b"", length: int | None = None) -> bytes:
    """A safetensors file with any header, of any alleged length."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + body


VIEWS = "".join(f"{18 * i - 180} {4 * i - 40} 0 2\n" for i in range(20)).encode()
SPLIT = json.dumps(
    {
        "03001627": {"name": "chair", "train": ["1a", "2b"], "test": ["3c"]},
        "03636649": {"name": "lamp,floor lamp", "train": ["4d"], "test": []},
    },
    indent=1,
).encode()


# --- what may not be executed ---------------------------------------------------------------------


class Executed:
    """Unpickled, it makes a file."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (self._path,)


def torch_file(canary: str) -> bytes:
    """What `torch.save` writes, by hand: a zip of a pickle that makes a folder."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps(Executed(canary), 2))
        archive.writestr("archive/version", "3\n")
    return file.getvalue()


def postscript(canary: str) -> bytes:
    """A picture whose decoder is Ghostscript, and which makes a file when that runs it."""
    return (
        "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n"
        f"({canary}) (w) file closefile\nshowpage\n%%EOF\n"
    ).encode()


# --- mutations ------------------------------------------------------------------------------------

INTEGERS = (0, 1, 2, 3, 127, 128, 255, 2**15, 2**16 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
INTEGERS += (2**40, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
TOKENS = (
    b"nan", b"inf", b"-inf", b"1e308", b"1e999", b"-1", b"0", b"1", b"5e-324", b"4294967296",
    b"99999999999999999999", b"1000000000000", b"0x10", b"1_0", b"", b"x", b'"', b"{", b"]", b"\\",
    b"null", b"true", b"[]", b"{}", b"-0", b"\xff\xfe", b"\x00", b"\xe2\x80\xae", b"\n\n", b"\r",
    b"../../" + SECRET.encode(), b"/etc/passwd", b"%s%n", b"3/-1/", b"list",
)  # fmt: skip


def mutated(rng: random.Random, data: bytes) -> bytes:
    """One to four mutations, one after another."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        data = rng.choice(_MUTATIONS)(rng, data)
    return data


def _flip_bits(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _double_a_block(rng: random.Random, data: bytes) -> bytes:
    start, end = _block(rng, data)
    return data[:end] + data[start:end] * rng.choice((1, 1, 2, 50)) + data[end:]


def _drop_a_block(rng: random.Random, data: bytes) -> bytes:
    start, end = _block(rng, data)
    return data[:start] + data[end:]


def _insert_noise(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice((1, 2, 8, 100))) + data[at:]


def _put_an_integer(rng: random.Random, data: bytes) -> bytes:
    size = rng.choice((1, 2, 4, 4, 8, 8))
    value = rng.choice(INTEGERS) % (1 << 8 * size)
    at = rng.choice((rng.randrange(len(data) + 1), rng.randrange(min(100, len(data)) + 1)))
    return data[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + data[at + size :]


def _replace_a_token(rng: random.Random, data: bytes) -> bytes:
    """A number or word becomes something that a parser may not expect."""
    at = rng.randrange(len(data) + 1)
    while at < len(data) and not chr(data[at]).isalnum():
        at += 1
    end = at
    while end < len(data) and chr(data[end]) not in ' \n\t,:;/"[]{}()':
        end += 1
    return data[:at] + rng.choice(TOKENS) + data[min(end, at + 40) :]


def _insert_a_monster(rng: random.Random, data: bytes) -> bytes:
    """Deep nesting, a long line, many lines, one long number."""
    monsters = (b"[" * 20_000, b'{"a":' * 20_000, b"1 " * 40_000, b"\n" * 40_000, b"7" * 40_000)
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((*monsters, b"\0" * 40_000, b"(" * 20_000)) + data[at:]


def _block(rng: random.Random, data: bytes) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.choice((1, 4, 16, 64, 1000)))


_MUTATIONS = (
    _flip_bits, _flip_bits, _truncate, _double_a_block, _drop_a_block, _insert_noise,
    _put_an_integer, _put_an_integer, _replace_a_token, _replace_a_token, _insert_a_monster,
)  # fmt: skip


# --- tricks ---------------------------------------------------------------------------------------

OUTSIDE = (
    f"../{SECRET}", f"../../{SECRET}", "{root}/" + SECRET, "/etc/passwd", "file:///etc/passwd",
    f"http://127.0.0.1:{PORT}/a.bin", f"https://127.0.0.1:{PORT}/a.png", "ftp://127.0.0.1/a",
    "/dev/zero", "/dev/stdin", "/proc/self/environ", "pipe", "link", "folder", "", ".", "~/x",
    "a\0b", "%2e%2e/secret", "..\\" + SECRET, "data:image/png;base64,AAAA", "data:,x", "n" * 5000,
)  # fmt: skip
# "pipe", "link" and "folder" are put beside each case: a FIFO, a link to the secret, a folder.


def _tricky_obj(rng: random.Random, root: str) -> Files:
    files = mesh_obj()
    outside = rng.choice(OUTSIDE).format(root=root)
    trick = rng.randrange(5)
    if trick == 0:
        files["a.obj"] = files["a.obj"].replace(b"a.mtl", outside.encode())
    elif trick == 1:
        files["a.mtl"] = files["a.mtl"].replace(b"paint.png", outside.encode())
    elif trick == 2:
        files["paint.png"] = postscript(f"{root}/{CANARY}-postscript")
    elif trick == 3:  # a bomb: few bytes, many pixels
        file = io.BytesIO()
        Image.new("1", (20_000, 10_000)).save(file, "PNG")
        files["paint.png"] = file.getvalue()
    else:
        files["a.obj"] += b"f " + b"1 " * 30_000 + b"\n"
    return files


def _tricky_ply(rng: random.Random, root: str) -> Files:
    data = mesh_ply(rng.random() < 0.5)
    trick = rng.randrange(4)
    count = str(rng.choice((0, 1, 5, 10**6, 10**9, 10**15, 10**30, -1))).encode()
    if trick == 0:
        data = data.replace(b"vertex 4", b"vertex " + count)
    elif trick == 1:
        data = data.replace(b"face 4", b"face " + count)
    elif trick == 2:
        data = data.replace(b"paint.png", rng.choice(OUTSIDE).format(root=root).encode())
    else:
        data = data.replace(b"list uchar int", rng.choice((b"list int int", b"list char double")))
    return {"a.ply": data, "paint.png": image()}


def _tricky_off(rng: random.Random, root: str) -> Files:
    count = str(rng.choice((10**6, 10**9, 10**15, 10**19, -1, 0)))
    return {
        "a.off": mesh_off().replace(b"4 4 6", rng.choice((f"{count} 4 6", f"4 {count} 6")).encode())
    }


def _tricky_stl(rng: random.Random, root: str) -> Files:
    data = bytearray(mesh_stl(True))
    data[80:84] = struct.pack("<I", rng.choice((0, 5, 10**6, 2**31, 2**32 - 1)))
    return {"a.stl": bytes(data) + rng.choice((b"", bytes(50)))}


def _tricky_tree(rng: random.Random, root: str) -> dict[str, Any]:
    blob = gltf_blob()
    tree = gltf_tree(blob)
    outside = rng.choice(OUTSIDE).format(root=root)
    huge = rng.choice((10**6, 10**9, 10**12, 2**63, 10**30, -1, 1.5, "4", None))
    trick = rng.randrange(12)
    if trick == 0:
        tree["images"] = [{"uri": outside}]
    elif trick == 1:
        tree["buffers"] = [{"byteLength": len(blob), "uri": outside}]
    elif trick == 2:
        tree["accessors"][rng.randrange(2)]["count"] = huge
    elif trick == 3:  # filled with zeros, as the standard says
        tree["accessors"][0] = {"componentType": 5126, "count": huge, "type": "VEC3"}
    elif trick == 4:
        tree["bufferViews"] *= rng.choice((10, 1000))
    elif trick == 5:
        tree["bufferViews"][rng.randrange(3)][rng.choice(("byteLength", "byteOffset"))] = huge
    elif trick == 6:
        tree["bufferViews"][0]["byteStride"] = rng.choice((0, 1, 12, -12, 2**40))
    elif trick == 7:  # a circle
        tree["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0, 1]}]
    elif trick == 8:  # 2**40 ways to the last node
        tree["nodes"] = [{"mesh": 0, "children": [i + 1, i + 1]} for i in range(40)] + [{"mesh": 0}]
    elif trick == 9:
        tree["nodes"] = [{"mesh": 0}] * 300
        tree["scenes"] = [{"nodes": list(range(300))}]
    elif trick == 10:
        tree["images"] = [
            {"uri": "data:,base64," + base64.b64encode(postscript(f"{root}/{CANARY}-ps")).decode()}
        ]
    else:
        tree["nodes"] = [{"mesh": 0, "matrix": [rng.choice((0, 1e308, 1e999, "x"))] * 16}]
    return tree


def _tricky_glb(rng: random.Random, root: str) -> Files:
    data = bytearray(glb(_tricky_tree(rng, root), gltf_blob()))
    if rng.random() < 0.2:
        data[12:16] = struct.pack("<I", rng.choice((0, 2**31, 2**32 - 1)))
    return {"a.glb": bytes(data)}


def _tricky_gltf(rng: random.Random, root: str) -> Files:
    tree = _tricky_tree(rng, root)
    if "uri" not in tree["buffers"][0]:
        tree["buffers"][0]["uri"] = "a.bin"
    return {
        "a.gltf": rng.choice((json.dumps(tree).encode(), b"{")),
        "a.bin": gltf_blob(),
        "model.gltf": mesh_gltf(True)["a.gltf"],  # another object, which must not stand in
    }


def _tricky_cloud_ply(rng: random.Random, root: str) -> Files:
    data = cloud_ply(rng.random() < 0.5)
    count = rng.choice((0, 7, 9, 10**6, 10**9, 10**12 - 1, 10**15, 10**30, -1))
    before = rng.choice((b"", b"element a 99999999999\nproperty char b\n", b"element a 3\n"))
    return {"a.ply": data.replace(b"element vertex 8", before + b"element vertex %d" % count)}


def _tricky_npy(rng: random.Random, root: str) -> Files:
    canary = f"{root}/{CANARY}-npy"
    header = "{'descr': %s, 'fortran_order': %s, 'shape': %s, }"
    kind = rng.choice(
        ("'<f8'", "'O'", "'|O'", "[('a', 'O')]", "'<U9'", "'V24'", "('<f8', (3,))", "'x'")
    )
    shape = rng.choice(
        ("(8, 3)", "(10000000000, 3)", "(-1, 3)", "(8, 3, 0)", "8", "(2**62, 3)", "()")
    )
    text = (header % (kind, rng.choice(("True", "False", "2")), shape)).encode()
    made = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(192)
    return {
        "a.npy": rng.choice(
            (
                npy(np.array([[Executed(canary)] * 3] * 2, object)),
                pickle.dumps(Executed(canary)),
                torch_file(canary),
                made,
            )
        )
    }


def _tricky_text(rng: random.Random, root: str) -> Files:
    rows = rng.choice(
        (b"nan inf -inf\n", b"1e308 1e309 5e-324\n", b"1 2\n", b"\xff\xfe1 2 3\n", b"\n")
    )
    return {"a.xyz": rows * rng.choice((1, 50_000))}


def _tricky_weights(rng: random.Random, root: str) -> Files:
    canary = f"{root}/{CANARY}-weights"
    entry = {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}
    model = {"width": rng.choice((1e6, 1e308, "1", None, True)), "latent_dim": 4}
    if rng.random() < 0.5:
        model = {"width": 0.0625, "latent_dim": rng.choice((10**9, 1.5, True, 2**70, -1, [4]))}
    lone = {
        "format": "pc2pix-weights-1", "encoder": "dilated-conv-k5", "model": json.dumps(model),
        "training": rng.choice(("{}", "[]", "3", '{"objective": ' + "[" * 20_000)),
    }  # fmt: skip
    twice = b'{"a":' + json.dumps(entry).encode() + b',"a":' + json.dumps(entry).encode() + b"}"
    data = rng.choice(
        (
            torch_file(canary),
            pickle.dumps(Executed(canary)),
            safetensors({}, length=rng.choice(INTEGERS)),
            safetensors({"a": entry, "b": entry}, bytes(8)),
            safetensors({"a": entry, "b": {**entry, "data_offsets": [4, 12]}}, bytes(12)),
            safetensors({"a": {**entry, "data_offsets": [0, rng.choice(INTEGERS)]}}, bytes(8)),
            safetensors({"a": {**entry, "shape": [2**32, 2**32, 2**32]}}, bytes(8)),
            safetensors(
                {"a": {**entry, "dtype": rng.choice(("BOOL", "F8_E4M3", "C64", "X"))}}, bytes(8)
            ),
            safetensors(twice, bytes(8)),
            safetensors(b"[" * 50_000),
            safetensors(b'{"__metadata__":' + b'{"a":' * 50_000),
            safetensors({"__metadata__": rng.choice((3, [], {"training": 3}, {"training": "["}))}),
            safetensors({"__metadata__": lone}),
            safetensors(rng.choice((b"null", b"3", b"[]", b"{}", b'""', b"\xff"))),
            _with_changed_header(rng),
        )
    )
    return {"w.safetensors": data}


def _with_changed_header(rng: random.Random) -> bytes:
    """Whole weights, but for one entry of the header."""
    data = weights()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    name = rng.choice([*header, *header["__metadata__"]])
    if name in header["__metadata__"]:
        header["__metadata__"][name] = rng.choice(
            ("", "{}", "[]", "x\n\x1b[2J", "null", "9" * 5000)
        )
    elif name != "__metadata__":
        changes = {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}
        key = rng.choice(list(changes))
        header[name][key] = changes[key]
    return safetensors(header, data[8 + length :])


def _tricky_inception(rng: random.Random, root: str) -> Files:
    return {"w.pth": torch_file(f"{root}/{CANARY}-inception")}


def _tricky_views(rng: random.Random, root: str) -> Files:
    return {"view.txt": rng.choice((VIEWS * 5000, b"1 " * 50_000, b"nan nan\n", b"\n" * 60_000))}


def _tricky_split(rng: random.Random, root: str) -> Files:
    name = rng.choice((*OUTSIDE, "..", "a/b", "\x1b[2J", "\u202ea", "a\nb")).format(root=root)
    tree = {"1": {"name": "chair", "train": [name], "test": []}}
    ids = [f"{i:x}" for i in range(50_000)]
    many = {"1": {"name": "chair", "train": ids, "test": ids[-1:]}}
    deep = b'{"1":' * 50_000
    return {"a_exp.json": rng.choice((json.dumps(tree).encode(), json.dumps(many).encode(), deep))}


# --- formats --------------------------------------------------------------------------------------


def _read_mesh(path: Path) -> None:
    from data_prep.mesh_files import load_mesh

    load_mesh(path)


def _read_cloud(path: Path) -> None:
    from data_prep.cloud_files import load_points
    from data_prep.normalise import normalise_points

    normalise_points(load_points(path))


def _read_weights(path: Path) -> None:
    from learning.weights import objective_of
    from pc2pix.weights import find_weights, load_weights

    find_weights(path)
    try:
        objective_of(path)
    finally:  # one may refuse what the other takes; neither may fail otherwise
        load_weights(path)


def _read_inception(path: Path) -> None:
    from bench.metrics.inception_weights import find_weights

    find_weights(str(path))


def _read_views(path: Path) -> None:
    from data_prep.dataset_paper import read_views

    read_views(path)


def _read_split(path: Path) -> None:
    from data_prep.dataset_paper import read_split

    read_split(path)


@dataclass(frozen=True)
class Format:
    """How files of a kind are made and read.

    valid      whole cases; their first file is mutated, and sometimes another
    trick      a case made on purpose, for a folder `root` around all cases
    read       the product's reader
    in_worker  whether the product reads them in a worker with limits
    """

    valid: Callable[[], tuple[Files, ...]]
    trick: Callable[[random.Random, str], Files]
    read: Callable[[Path], None]
    in_worker: bool


FORMATS: Mapping[str, Format] = {
    "mesh-ply": Format(
        lambda: tuple({"a.ply": mesh_ply(b), "paint.png": image()} for b in (False, True)),
        _tricky_ply, _read_mesh, True,
    ),
    "mesh-obj": Format(lambda: (mesh_obj(),), _tricky_obj, _read_mesh, True),
    "mesh-off": Format(lambda: ({"a.off": mesh_off()},), _tricky_off, _read_mesh, True),
    "mesh-stl": Format(
        lambda: tuple({"a.stl": mesh_stl(b)} for b in (False, True)), _tricky_stl, _read_mesh, True
    ),
    "mesh-glb": Format(
        lambda: ({"a.glb": glb(gltf_tree(gltf_blob()), gltf_blob())},),
        _tricky_glb, _read_mesh, True,
    ),
    "mesh-gltf": Format(
        lambda: (mesh_gltf(True), mesh_gltf(False)), _tricky_gltf, _read_mesh, True
    ),
    "cloud-ply": Format(
        lambda: tuple({"a.ply": cloud_ply(b)} for b in (False, True)),
        _tricky_cloud_ply, _read_cloud, True,
    ),
    "cloud-npy": Format(
        lambda: tuple({"a.npy": npy(np.arange(24, dtype=t).reshape(8, 3))} for t in ("<f4", ">i8")),
        _tricky_npy, _read_cloud, True,
    ),
    "cloud-text": Format(
        lambda: ({"a.xyz": cloud_text(" ")}, {"a.csv": cloud_text(",")}),
        _tricky_text, _read_cloud, True,
    ),
    "weights": Format(
        lambda: ({"w.safetensors": weights()},), _tricky_weights, _read_weights, False
    ),
    "inception": Format(
        lambda: ({"w.pth": torch_file("nowhere")},), _tricky_inception, _read_inception, False
    ),
    "view-txt": Format(lambda: ({"view.txt": VIEWS},), _tricky_views, _read_views, False),
    "split-json": Format(lambda: ({"a_exp.json": SPLIT},), _tricky_split, _read_split, False),
}  # fmt: skip
TRICKS = 0.25  # share of cases that are tricks


def make_case(name: str, rng: random.Random, root: str) -> Files:
    """A case of a format."""
    fmt = FORMATS[name]
    if rng.random() < TRICKS:
        files = fmt.trick(rng, root)
        if rng.random() < 0.7:
            return files
    else:
        files = dict(rng.choice(fmt.valid()))
    first, *others = files
    target = rng.choice(others) if others and rng.random() < 0.3 else first
    return files | {target: mutated(rng, files[target])}


def case_rng(seed: int, name: str, number: int) -> random.Random:
    """What number `number` of a format is made from."""
    return random.Random(f"{seed}/{name}/{number}")


@contextmanager
def playground() -> Iterator[Path]:
    """A folder for cases, with a secret in it; the user's cache is elsewhere meanwhile."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        root = Path(name)
        (root / SECRET).write_bytes(cloud_text(" "))
        (root / "cases").mkdir()
        yield root


def write_case(folder: Path, files: Files) -> Path:
    """Write a case with its FIFO, link and sub-folder; the path of the file to read."""
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to(f"../../{SECRET}")
    (folder / "folder").mkdir()
    return folder / next(iter(files))


def listing(root: Path) -> dict[str, tuple[int, int]]:
    """Everything below `root`, with size and time of its last change."""
    found = {}
    for where, folders, names in os.walk(root):
        for name in (*folders, *names):
            path = os.path.join(where, name)  # noqa: PTH118 (names may be anything)
            status = os.lstat(path)
            found[path] = (status.st_size, status.st_mtime_ns)
    return found


# --- watching -------------------------------------------------------------------------------------

FORBIDDEN = (
    "exec", "subprocess.", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn",
    "os.startfile", "os.system", "pty.", "socket.", "urllib.", "http.", "ftplib.", "smtplib.",
    "shutil.", "os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink",
    "os.truncate", "os.chmod", "os.chown", "os.utime", "pickle.find_class", "webbrowser.",
    "tempfile.",
)  # fmt: skip
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_LIBRARIES = str(Path(np.__file__).parents[1])  # outside of sys.prefix where a path file adds them
_ROOT = str(Path(__file__).resolve().parents[2])
_OWN = (sys.prefix, sys.base_prefix, _LIBRARIES, _ROOT, "/proc/self/")


@dataclass
class _Watch:
    """What the hook has seen since `folder` was set; None while nobody is watched."""

    folder: str | None = None
    events: list[str] = field(default_factory=list)


_watch = _Watch()


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _watch.folder is None:
        return
    if event == "open":
        path, _, flags = arguments
        if isinstance(path, int):
            return
        name = os.path.abspath(os.fsdecode(path))  # noqa: PTH100
        if flags & _WRITING:
            _watch.events.append(f"open {name} for writing")
        elif not name.startswith((_watch.folder, *_OWN)):
            _watch.events.append(f"open {name}")
    elif event == "exec":
        code = arguments[0]
        if not str(getattr(code, "co_filename", "")).startswith((*_OWN, "<frozen", "<string>")):
            _watch.events.append(f"exec {code}")
    elif event.startswith(FORBIDDEN):
        _watch.events.append(f"{event} {str(arguments)[:100]}")


@functools.cache
def _install_hook() -> None:
    sys.addaudithook(_hook)


@dataclass(frozen=True)
class Task:
    """A file to read as `format` does."""

    format: str
    path: Path


@dataclass(frozen=True)
class Reading:
    """What came of it.

    outcome   "defect": anything raised but BadInput
    detail    the message, or where the defect was raised
    events    what no reader may do, see `FORBIDDEN`; and files read outside the case's folder
    peak_mib  the most resident memory of the process while it read
    """

    outcome: Literal["read", "refused", "defect"]
    detail: str
    seconds: float
    peak_mib: float
    events: tuple[str, ...]


def read(task: Task) -> Reading:
    """Read a file with its format's reader, watched."""
    _install_hook()
    _warm_up(task.format)
    _reset_peak()
    start = time.perf_counter()
    _watch.events, _watch.folder = [], str(task.path.parent)
    outcome: Literal["read", "refused", "defect"] = "read"
    detail = ""
    try:
        FORMATS[task.format].read(task.path)
    except BadInput as error:
        outcome, detail = "refused", str(error)
    except Exception:
        outcome, detail = "defect", traceback.format_exc()
    finally:
        _watch.folder = None
    seconds = time.perf_counter() - start
    return Reading(outcome, detail, seconds, _peak_mib(), tuple(_watch.events))


@functools.cache
def _warm_up(name: str) -> None:
    """Read a valid file unwatched, so that what libraries do when imported is over."""
    with tempfile.TemporaryDirectory() as folder:
        for number, files in enumerate(FORMATS[name].valid()):
            path = write_case(Path(folder) / str(number), files)
            try:
                FORMATS[name].read(path)
            except BadInput:
                if name != "inception":  # whose valid file is not to be had
                    raise


def _reset_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:  # not Linux: the peak is that of the whole process
        return


def _peak_mib() -> float:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
    except OSError:
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
