"""Small trees in the layouts of datasets, with a shape that has no symmetry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from data_prep.orientations import OURS, Orientation

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
    lines += ["v " + " ".join(map(repr, map(float, p))) for p in orientation.from_ours(points)]
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
    rows = [" ".join(map(repr, map(float, p))) for p in orientation.from_ours(points)]
    rows += [
        "3 " + " ".join(map(str, [*face, *color]))
        for face, color in zip(faces, colors, strict=True)
    ]
    path.write_text(header + "\n".join(rows) + "\n")


def write_off(path: Path, orientation: Orientation = OURS, *, glued: bool = False) -> None:
    """The shape as OFF; `glued`: without the line break after OFF, as hundreds of ModelNet are."""
    path.parent.mkdir(parents=True, exist_ok=True)
    points, faces, _ = shape()
    rows = [" ".join(map(repr, map(float, p))) for p in orientation.from_ours(points)]
    rows += ["3 " + " ".join(map(str, face)) for face in faces]
    head = "OFF" + ("" if glued else "\n") + f"{len(points)} {len(faces)} 0\n"
    path.write_text(head + "\n".join(rows) + "\n")
