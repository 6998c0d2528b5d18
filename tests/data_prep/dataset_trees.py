"""Small trees in the layouts of datasets, with a shape that has no symmetry."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from data_prep.clouds.orientations import OURS, PAPER, Orientation
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.paper import CLOUDS, RADIUS, RENDERS, VIEWS, image_name
from data_prep.datasets.synsets import SYNSETS
from data_prep.files.clouds import save_ply
from data_prep.randomness import generator
from data_prep.scene import PointCloud, View

# A low box with a post at the front right corner and a slab along the back, in our axes.
PARTS = (
    ((0.0, -0.4, 0.0), (0.8, 0.2, 0.6), (200, 40, 40)),
    ((0.3, 0.0, -0.25), (0.1, 0.6, 0.1), (40, 160, 40)),
    ((0.0, -0.1, 0.28), (0.8, 0.4, 0.04), (40, 40, 200)),
)


def shape(scale: float = 1.0, offset: tuple[float, float, float] = (0, 0, 0)):
    """Vertices [24, 3], faces [36, 3], colours [36, 3]. Quarters and eighths: text keeps them."""
    vertices, faces, colors = [], [], []
    for centre, size, color in PARTS:
        box = trimesh.creation.box(size)
        faces.append(box.faces + 8 * len(vertices))
        vertices.append(box.vertices + centre)
        colors += [color] * len(box.faces)
    points = np.concatenate(vertices) * scale + offset
    return points, np.concatenate(faces), np.array(colors, np.uint8)


def write_obj(path: Path, orientation: Orientation = OURS, **changes) -> None:
    """The shape in the file's axes, with a .mtl of three materials beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points, faces, _ = shape(**changes)
    lines = [f"mtllib {path.stem}.mtl"]
    lines += ["v " + " ".join(map(repr, map(float, p))) for p in from_ours(orientation, points)]
    for i, part in enumerate(np.split(faces + 1, len(PARTS))):
        lines += [f"usemtl m{i}", *("f " + " ".join(map(str, face)) for face in part)]
    path.write_text("\n".join(lines) + "\n")
    materials = [
        f"newmtl m{i}\nKd " + " ".join(repr(c / 255) for c in color)
        for i, (_, _, color) in enumerate(PARTS)
    ]
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n")


def write_ply(path: Path, orientation: Orientation = OURS) -> None:
    """The shape with its colours, in double precision."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points, faces, colors = shape()
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n"
        "property uchar blue\nend_header\n"
    )
    rows = [" ".join(map(repr, map(float, p))) for p in from_ours(orientation, points)]
    rows += [
        "3 " + " ".join(map(str, [*face, *color]))
        for face, color in zip(faces, colors, strict=True)
    ]
    path.write_text(header + "\n".join(rows) + "\n")


def write_off(path: Path, orientation: Orientation = OURS, *, glued: bool = False) -> None:
    """The shape as OFF; `glued`: without the line break after OFF, as hundreds of ModelNet are."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points, faces, _ = shape()
    rows = [" ".join(map(repr, map(float, p))) for p in from_ours(orientation, points)]
    rows += ["3 " + " ".join(map(str, face)) for face in faces]
    head = "OFF" + ("" if glued else "\n") + f"{len(points)} {len(faces)} 0\n"
    path.write_text(head + "\n".join(rows) + "\n")


def gltf_binary(tree: object, blob: bytes) -> bytes:
    """A glTF in one file: a tree as JSON, and the bytes that it refers to."""
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def from_ours(orientation: Orientation, points: NDArray) -> NDArray:
    """Coordinates [..., 3] of ours in the axes of a file: the inverse of `Orientation.to_ours`."""
    there = np.empty_like(points)
    there[..., list(orientation.columns)] = points * np.array(orientation.signs, points.dtype)
    return there


def write_paper_object(
    root: Path,
    class_name: str,
    object_id: str,
    cloud: PointCloud,
    views: Sequence[View],
    images: NDArray[np.uint8],
) -> None:
    """Cloud, cameras and images [V, H, W, 3] as `dataset_paper` reads them, bit for bit."""
    synset = SYNSETS[class_name]
    points = from_ours(PAPER, cloud.points) * np.float32(RADIUS)
    save_ply(points, root / CLOUDS / synset / f"{object_id}.ply")
    renders = root / RENDERS / synset / object_id
    renders.mkdir(parents=True, exist_ok=True)
    lines = [f"{-view.azimuth_deg!r} {view.elevation_deg!r}\n" for view in views]
    (renders / VIEWS).write_text("".join(lines))
    for k, image in enumerate(images):
        Image.fromarray(image).convert("RGBA").save(renders / image_name(k))


def write_paper_split(
    root: Path, class_name: str, test: Sequence[str], train: Sequence[str] = ()
) -> None:
    """The split file of a class."""
    split = {SYNSETS[class_name]: {"name": class_name, "train": [*train], "test": [*test]}}
    (root / f"{class_name}_exp.json").write_text(json.dumps(split))


def write_paper_tree(root: Path, objects: Sequence[SceneObject], seed: int = 0) -> None:
    """Objects of a class with the clouds and the 20 views that a run with this seed takes."""
    for obj in objects:
        names = (obj.class_name, obj.object_id)
        views = obj.views(20, generator(seed, "views", *names))
        cloud, truth = obj.cloud_and_truth(generator(seed, "cloud", *names), views)
        write_paper_object(root, *names, cloud, views, truth)
    write_paper_split(root, objects[0].class_name, [obj.object_id for obj in objects])
