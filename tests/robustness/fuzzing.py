"""Files as nobody should write them, and readers that are watched while they read them.

A case is a folder of its own with one file to read and, for some meshes, files beside it. It is
made from a format's valid files by a few mutations, drawn from one `random.Random`; what somebody
would do on purpose is in the table of `test_fuzzed_files`.

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
import re
import struct
import sys
import tempfile
import time
import traceback
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from bench.suites.speed.measure import peak_mib
from data_prep.clouds.normalise import normalise_points
from data_prep.datasets.paper import read_split, read_views
from data_prep.failures import BadInput
from data_prep.files.clouds import load_points
from data_prep.files.meshes import load_mesh
from learning.weights import FILES, objective_of
from pc2pix.weights import load_weights
from tests.data_prep.dataset_trees import gltf_binary
from tests.data_prep.files.pcd_files import pcd

SECRET = "secret"  # a file beside the cases' folders, which no case may read
PORT = 9  # "discard"; the hook sees who tries to connect
FACES = [(0, 2, 1), (0, 3, 2), (0, 1, 3), (1, 2, 3)]
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float32)

Files = dict[str, bytes]  # the file to read is the first


def table(rows: Any, separator: str = " ", before: str = "") -> str:
    """Return rows of numbers as lines."""
    return "".join(f"{before}{separator.join(map(str, row))}\n" for row in rows)


def mesh_ply(binary: bool) -> bytes:
    """Return a tetrahedron with colours of its faces."""
    kind = "binary_little_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\ncomment TextureFile paint.png\nelement vertex 4\n"
        "property float x\nproperty float y\nproperty float z\nelement face 4\n"
        "property list uchar int vertex_indices\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    faces = [(3, *face, 9, 99, 200) for face in FACES]
    if binary:
        rows = b"".join(struct.pack("<B3i3B", *face) for face in faces)
        return head.encode() + CORNERS.tobytes() + rows
    return (head + table(CORNERS.tolist()) + table(faces)).encode()


def mesh_obj() -> Files:
    """Return a tetrahedron with a material, a texture and groups."""
    text = "mtllib a.mtl\no thing\n" + table(CORNERS.tolist(), before="v ")
    text += "vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nusemtl paint\ng one\n"
    text += table(([f"{i + 1}/{k}/1" for k, i in enumerate(f, 1)] for f in FACES), before="f ")
    material = b"newmtl paint\nKd 1 0.5 0\nmap_Kd paint.png\n"
    return {"a.obj": text.encode(), "a.mtl": material, "paint.png": image()}


def image(mode: str = "RGB", size: tuple[int, int] = (4, 4)) -> bytes:
    """Return a PNG of one colour."""
    file = io.BytesIO()
    Image.new(mode, size, (9, 99, 200) if mode == "RGB" else 0).save(file, "PNG")
    return file.getvalue()


def mesh_off() -> bytes:
    return f"OFF\n4 4 6\n{table(CORNERS.tolist())}{table(FACES, before='3 ')}".encode()


def mesh_stl(binary: bool) -> bytes:
    corners = [[CORNERS[i].tolist() for i in face] for face in FACES]
    if binary:
        facets = [struct.pack("<12fH", 0, 0, 1, *np.ravel(c), 0) for c in corners]
        return bytes(80) + struct.pack("<I", len(FACES)) + b"".join(facets)
    text = "solid a\n"
    for facet in corners:
        vertices = table(facet, before="vertex ")
        text += f"facet normal 0 0 1\nouter loop\n{vertices}endloop\nendfacet\n"
    return (text + "endsolid a\n").encode()


def gltf_tree(blob: bytes, **buffer: object) -> dict[str, Any]:
    """Return the JSON of a tetrahedron with a material and a texture in its one buffer."""
    points, indices = CORNERS.nbytes, 12 * 2
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [1, 2, 3]}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "TEXCOORD_0": 2},
                        "indices": 1,
                        "material": 0,
                    }
                ]
            }
        ],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 2, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": end - start}
            for start, end in pairwise((0, points, points + indices, len(blob)))
        ],
        "buffers": [{"byteLength": len(blob), **buffer}],
    }


def gltf_blob() -> bytes:
    return CORNERS.tobytes() + np.array(FACES, "<u2").tobytes() + image()


def mesh_gltf(embedded: bool) -> Files:
    """Return a tetrahedron as JSON, its buffer in the JSON or in a file."""
    blob = gltf_blob()
    data = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    tree = gltf_tree(blob, uri=data if embedded else "a.bin")
    return {"a.gltf": json.dumps(tree).encode(), **({} if embedded else {"a.bin": blob})}


def cloud_ply(binary: bool) -> bytes:
    """Return eight points."""
    kind = "binary_big_endian" if binary else "ascii"
    points = (np.arange(24.0).reshape(8, 3) / 8).astype(">f8")
    head = f"ply\nformat {kind} 1.0\nelement vertex 8\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    body = points.tobytes() if binary else cloud_text(" ")
    return head.encode() + body


def cloud_text(separator: str) -> bytes:
    return table((np.arange(24.0).reshape(8, 3) / 8).tolist(), separator).encode()


def cloud_pcd(encoding: str) -> bytes:
    """Return eight points; a block is stored as it is, as the library `lzf` may be missing."""
    x, y, z = (np.arange(24, dtype="<f4").reshape(8, 3) / 8).T
    colours = np.arange(8, dtype="<u4") << 9
    return pcd({"x": x, "_": x, "y": y, "z": z, "rgb": colours}, encoding, packed=False)


def npy(array: np.ndarray) -> bytes:
    """Return any array as a file; one of objects is pickled."""
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def weights() -> bytes:
    """Return untrained weights of pc2pix, a sixteenth of the paper's width."""
    from tests.learning.trainings import whole  # loads torch

    return whole("pc2pix")


def safetensors(header: object, body: bytes) -> bytes:
    """Return a safetensors file with any header."""
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + body


VIEWS = "".join(f"{18 * i - 180} {4 * i - 40} 0 2\n" for i in range(20)).encode()
SPLIT = json.dumps(
    {
        "03001627": {"name": "chair", "train": ["1a", "2b"], "test": ["3c"]},
        "03636649": {"name": "lamp,floor lamp", "train": ["4d"], "test": []},
    },
    indent=1,
).encode()


class Executed:
    """An object that makes a file when it is unpickled."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (self._path,)


def torch_file(canary: str) -> bytes:
    """Return the bytes that `torch.save` writes: a zip of a pickle that makes a folder."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        # a ZipInfo: a name alone would be stamped with the time, and no file be made again
        archive.writestr(zipfile.ZipInfo("archive/data.pkl"), pickle.dumps(Executed(canary), 2))
        archive.writestr(zipfile.ZipInfo("archive/version"), "3\n")
    return file.getvalue()


def postscript(canary: str) -> bytes:
    """Return an image whose decoder is Ghostscript, and which makes a file when that runs it."""
    return (
        "%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 4 4\n%%EndComments\n"
        f"({canary}) (w) file closefile\nshowpage\n%%EOF\n"
    ).encode()


INTEGERS = (0, 1, 3, 127, 255, 2**16 - 1, 2**24, 2**31 - 1, 2**32 - 1, 2**53, 2**63, 2**64 - 1)
TOKENS = (
    b"nan", b"-inf", b"1e308", b"1e999", b"-1", b"0", b"5e-324", b"99999999999999999999", b"0x10",
    b"1_0", b"", b"x", b'"', b"{", b"]", b"\\", b"null", b"[]", b"\xff\xfe", b"\x00",
    b"\xe2\x80\xae", b"\n\n", b"\r", b"../../" + SECRET.encode(), b"%s%n", b"3/-1/", b"list",
    b"[" * 20_000, b'{"a":' * 20_000, b"1 " * 40_000, b"\n" * 40_000, b"7" * 40_000,
)  # fmt: skip


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Return the data after one to four changes."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        data = rng.choice((_flip_bits, _cut_or_repeat, _put_an_integer, _replace_a_token))(
            rng, data
        )
    return data


def _flip_bits(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if changed else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _cut_or_repeat(rng: random.Random, data: bytes) -> bytes:
    start = rng.randrange(len(data) + 1)
    end = rng.choice((len(data), start, min(len(data), start + rng.choice((1, 4, 64, 1000)))))
    between = rng.choice((b"", data[start:end] * rng.choice((2, 3, 50)), rng.randbytes(8)))
    return data[:start] + between + data[end:]


def _put_an_integer(rng: random.Random, data: bytes) -> bytes:
    size = rng.choice((1, 2, 4, 4, 8, 8))
    value = rng.choice(INTEGERS) % (1 << 8 * size)
    at = rng.choice((rng.randrange(len(data) + 1), rng.randrange(min(100, len(data)) + 1)))
    return data[:at] + value.to_bytes(size, rng.choice(("little", "big"))) + data[at + size :]


def _replace_a_token(rng: random.Random, data: bytes) -> bytes:
    """Replace a number or word by something that a parser may not expect."""
    words = [*re.finditer(rb"[^\s,:;/\"\[\]{}()]{1,40}", data)]
    start, end = rng.choice(words).span() if words else (0, 0)
    return data[:start] + rng.choice(TOKENS) + data[end:]


OUTSIDE = (
    f"../{SECRET}", f"../../{SECRET}", "{root}/" + SECRET, "/etc/passwd", "file:///etc/passwd",
    f"http://127.0.0.1:{PORT}/a.bin", f"https://127.0.0.1:{PORT}/a.png", "ftp://127.0.0.1/a",
    "/dev/zero", "/dev/stdin", "/proc/self/environ", "pipe", "link", "folder", "", ".", "~/x",
    "a\0b", "%2e%2e/secret", "..\\" + SECRET, "data:image/png;base64,AAAA", "data:,x", "n" * 5000,
)  # fmt: skip
# "pipe", "link" and "folder" are put beside each case: a FIFO, a link to the secret, a folder.


def _read_cloud(path: Path) -> None:
    normalise_points(load_points(path))


def _read_weights(path: Path) -> None:
    FILES["pc2pix"].find(path)
    try:
        objective_of(path)
    finally:  # one may refuse what the other takes; neither may fail otherwise
        load_weights(path)


@dataclass(frozen=True)
class Format:
    """The way in which files of a kind are made and read.

    valid  whole cases; their first file is mutated, and sometimes another
    read   the product's reader
    """

    valid: Callable[[], tuple[Files, ...]]
    read: Callable[[Path], object]


FORMATS: Mapping[str, Format] = {
    "mesh-ply": Format(lambda: tuple({"a.ply": mesh_ply(b)} for b in (False, True)), load_mesh),
    "mesh-obj": Format(lambda: (mesh_obj(),), load_mesh),
    "mesh-off": Format(lambda: ({"a.off": mesh_off()},), load_mesh),
    "mesh-stl": Format(lambda: tuple({"a.stl": mesh_stl(b)} for b in (False, True)), load_mesh),
    "mesh-glb": Format(
        lambda: ({"a.glb": gltf_binary(gltf_tree(gltf_blob()), gltf_blob())},), load_mesh
    ),
    "mesh-gltf": Format(lambda: (mesh_gltf(True), mesh_gltf(False)), load_mesh),
    "cloud-ply": Format(lambda: tuple({"a.ply": cloud_ply(b)} for b in (False, True)), _read_cloud),
    "cloud-npy": Format(
        lambda: tuple({"a.npy": npy(np.arange(24, dtype=t).reshape(8, 3))} for t in ("<f4", ">i8")),
        _read_cloud,
    ),
    "cloud-text": Format(
        lambda: ({"a.xyz": cloud_text(" ")}, {"a.csv": cloud_text(",")}), _read_cloud
    ),
    "cloud-pcd": Format(
        lambda: tuple({"a.pcd": cloud_pcd(e)} for e in ("ascii", "binary", "binary_compressed")),
        _read_cloud,
    ),
    "weights": Format(lambda: ({"w.safetensors": weights()},), _read_weights),
    "view-txt": Format(lambda: ({"view.txt": VIEWS},), read_views),
    "split-json": Format(lambda: ({"a_exp.json": SPLIT},), read_split),
}


def make_case(name: str, rng: random.Random) -> Files:
    """Return a valid case of a format with one of its files mutated."""
    files = dict(rng.choice(FORMATS[name].valid()))
    first, *others = files
    target = rng.choice(others) if others and rng.random() < 0.3 else first
    return files | {target: mutated(rng, files[target])}


@contextmanager
def playground() -> Iterator[Path]:
    """Yield a folder for cases, with a secret in it."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        root = Path(name)
        (root / SECRET).write_bytes(cloud_text(" "))
        (root / "cases").mkdir()
        yield root


def write_case(folder: Path, files: Files) -> Path:
    """Write a case with its FIFO, link and sub-folder; return the path of the file to read."""
    folder.mkdir(parents=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to(f"../../{SECRET}")
    (folder / "folder").mkdir()
    return folder / next(iter(files))


def listing(root: Path) -> dict[str, tuple[int, int]]:
    """Return everything below `root`, with size and time of its last change."""
    actual = {}
    for where, folders, names in os.walk(root):
        for name in (*folders, *names):
            path = os.path.join(where, name)  # noqa: PTH118 (names may be anything)
            status = os.lstat(path)
            actual[path] = (status.st_size, status.st_mtime_ns)
    return actual


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
    """The events that the hook has seen since `folder` was set; None while nobody is watched."""

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
    """The outcome of reading a file.

    outcome   "defect": anything raised but BadInput
    detail    the message, or where the defect was raised
    events    what no reader may do, see `FORBIDDEN`; and files read outside the case's folder
    peak_mib  the most resident memory of the process while it read; 0 where Linux does not say
    """

    outcome: Literal["read", "refused", "defect"]
    detail: str
    seconds: float
    peak_mib: float
    events: tuple[str, ...]


def read(task: Task, formats: Mapping[str, Format] = FORMATS) -> Reading:
    """Read a file with its format's reader, watched."""
    _install_hook()
    if formats is FORMATS:
        _warm_up(task.format)
    _reset_peak()
    start = time.perf_counter()
    _watch.events, _watch.folder = [], str(task.path.parent)
    outcome: Literal["read", "refused", "defect"] = "read"
    detail = ""
    try:
        formats[task.format].read(task.path)
    except BadInput as error:
        outcome, detail = "refused", str(error)
    except Exception:
        outcome, detail = "defect", traceback.format_exc()
    finally:
        _watch.folder = None
    seconds = time.perf_counter() - start
    return Reading(outcome, detail, seconds, peak_mib() or 0.0, tuple(_watch.events))


@functools.cache
def _warm_up(name: str) -> None:
    """Read a valid file unwatched, so that what libraries do when imported is over."""
    with tempfile.TemporaryDirectory() as folder:
        for number, files in enumerate(FORMATS[name].valid()):
            path = write_case(Path(folder) / str(number), files)
            FORMATS[name].read(path)


def _reset_peak() -> None:
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:  # not Linux, where there is no peak either
        return
