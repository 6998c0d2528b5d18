"""What a scene could contain, what it would change in the pictures, and what it would cost.

    python -m benchmarks.scene_economy [--dataset procedural:validation] [--dataset folder:PATH]
                                       [--reconstructed 8]
                                       [--chairs 24] [--views 10] [--rounds 3] [--out docs]

Draws the true meshes of the class chair with one thing added or left out at a time
(`benchmarks.scene_variants`); so it does with meshes that `surface-apss` makes of the first few
procedural ones, 2,048 points each, on a grid of 75 cells a side. Writes `scene-economy.csv` and the
sheet `scene-economy.png` to the folder, and the tables into its `scene-economy.md`, between the
marks there.

ssim, lowest   SSIM with the pictures of the scene it is held against: the mean over all pictures,
               and over those of the chair that changes most. Scenes of other sizes are reduced to
               128 pixels by the mean of their pixels, or enlarged bilinearly, before.
levels         Mean absolute difference in grey levels (0..255), over the pixels in which either
               scene shows the object (a pixel that is not white).
ms, times      Processor time of one view with everything a mesh needs (upload, drawing, reduction,
               read-back; not the making of normals or of another mesh), and its ratio to that of
               the default scene, all drawn in turns in one process: medians over the rounds of
               the mean over the chairs. Drawn here one by one and not by `data_prep.render`, so
               that all scenes are drawn alike; the default scene is slightly slower than there.

About five minutes of one thread for 24 procedural, 20 real and 8 reconstructed chairs.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from baselines.surface import SurfaceApss
from bench.metrics.structural_similarity import ssim_per_image
from bench.tables.markdown import row
from bench.tables.table import csv_text
from benchmarks.scene_variants import (
    CREASE_DEG,
    INTERPOLATED,
    LAMBERT,
    Scene,
    draw,
    vertices_of,
)
from data_prep.datasets import ProceduralObject, SceneObject, open_dataset
from data_prep.failures import BadInput
from data_prep.randomness import generator
from data_prep.sampling import random_views, sample_surface
from data_prep.scene import IMAGE_SIZE, Mesh, View

CLASS = "chair"
RESOLUTION = 75  # of reconstructions: some 10,000 to 20,000 faces
SHEET_CHAIR, SHEET_VIEW = 16, View(35, 20)
NAME = "scene-economy"
BEGIN, END = "<!-- tables -->", "<!-- end of tables -->"
Pictures = NDArray[np.uint8]  # [V, IMAGE_SIZE, IMAGE_SIZE, 3]


def divided(times: int) -> Callable[[Mesh], Mesh]:
    """Every face cut into 4, `times` over: the same surface."""

    def divide(mesh: Mesh) -> Mesh:
        for _ in range(times):
            corners = mesh.vertices[mesh.faces]  # [F, 3, 3]
            middles = ((corners + np.roll(corners, -1, axis=1)) / 2).astype(np.float32)
            a, b, c = mesh.faces.T
            new = np.arange(mesh.faces.size, dtype=np.int32) + len(mesh.vertices)
            ab, bc, ca = new.reshape(-1, 3).T
            mesh = Mesh(
                np.concatenate([mesh.vertices, middles.reshape(-1, 3)]),
                np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3),
                np.repeat(mesh.face_colors, 4, axis=0),
            )
        return mesh

    return divide


def decimated(part: float) -> Callable[[Mesh], Mesh]:
    """Edges collapsed by quadric error (Garland and Heckbert 1997, MeshLab) to a part of the faces.

    Collapsing leaves a face its colour.
    """

    def decimate(mesh: Mesh) -> Mesh:
        import pymeshlab

        library: Any = pymeshlab  # its names come from a compiled module
        opaque = np.pad(mesh.face_colors / 255.0, ((0, 0), (0, 1)), constant_values=1.0)
        meshes = library.MeshSet(verbose=False)
        meshes.add_mesh(library.Mesh(mesh.vertices, mesh.faces, f_color_matrix=opaque))
        meshes.meshing_decimation_quadric_edge_collapse(
            targetfacenum=int(part * len(mesh.faces)), preserveboundary=True, planarquadric=True
        )
        found = meshes.current_mesh()
        colors = np.floor(found.face_color_matrix()[:, :3] * 255 + 0.5)
        return Mesh(found.vertex_matrix(), found.face_matrix(), colors)

    return decimate


DEFAULT = Scene()


@dataclass(frozen=True)
class Variant:
    """One scene of the table, held against another one by name."""

    topic: str
    name: str
    scene: Scene = DEFAULT
    against: str = "default"
    of: Callable[[Mesh], Mesh] = lambda mesh: mesh


def _light(amount: str) -> str:
    """A colour under an amount of light that was added up before gamma: expression."""
    return f"face_color * pow(min({amount}, 1.0), 1.0 / GAMMA)"


FIXED = "max(dot(seen, fixed_light), 0.0)"
SHINY = "pow(min(pow(face_color, vec3(GAMMA)) * headlight + 0.5 * shine, 1.0), vec3(1.0 / GAMMA))"
FINEST = "64 samples"
VARIANTS = (
    Variant("default", "default"),
    Variant("normals", f"smooth, creases at {CREASE_DEG:.0f}°",
            Scene(normal=INTERPOLATED, crease_deg=CREASE_DEG)),
    Variant("normals", "smooth everywhere", Scene(normal=INTERPOLATED, crease_deg=180.0)),
    Variant("back faces", "not drawn", Scene(cull=True)),
    Variant("samples", FINEST, Scene(size=4 * IMAGE_SIZE, reduce="mean"), FINEST),
    Variant("samples", "16 samples", Scene(size=2 * IMAGE_SIZE, reduce="mean"), FINEST),
    Variant("samples", "4 samples, the default", DEFAULT, FINEST),
    Variant("samples", "4, 2 x 2 pixels for one",
            Scene(size=2 * IMAGE_SIZE, samples=1, reduce="mean"), FINEST),
    Variant("samples", "1 sample", Scene(samples=1), FINEST),
    Variant("lights", "none: a facet's own colour", Scene(color="face_color")),
    Variant("lights", "lamp at the camera instead", Scene(color=LAMBERT.replace(
        "headlight", "abs(dot(normal, to_camera))"))),
    Variant("lights", "headlight, a quarter ambient",
            Scene(color=_light("0.25 + 0.75 * headlight"))),
    Variant("lights", "headlight and a fixed one",
            Scene(color=_light(f"0.5 * headlight + 0.5 * {FIXED}"))),
    Variant("specular", "Blinn's, half the light", Scene(color=SHINY)),
    Variant("gamma", "shaded without", Scene(gamma=1.0)),
    Variant("gamma", "16 samples, mean of light",
            Scene(size=2 * IMAGE_SIZE, reduce="mean of light"), "16 samples"),
    Variant("mesh", "16 times the faces", of=divided(2)),
    Variant("mesh", "4 times the faces", of=divided(1)),
    Variant("mesh", "1/2 of the faces", of=decimated(1 / 2)),
    Variant("mesh", "1/4 of the faces", of=decimated(1 / 4)),
    Variant("mesh", "1/10 of the faces", of=decimated(1 / 10)),
    Variant("size", "512, reduced", Scene(size=4 * IMAGE_SIZE, reduce="mean")),
    Variant("size", "256, reduced", Scene(size=2 * IMAGE_SIZE, reduce="mean")),
    Variant("size", "64, enlarged", Scene(size=IMAGE_SIZE // 2)),
)  # fmt: skip


class Reconstructed(ProceduralObject):
    """What `surface-apss` makes of a procedural object."""

    def load(self) -> Mesh:
        """Its mesh. Raises StageFailure where reconstruction has none."""
        cloud = sample_surface(super().load(), generator("scene-economy", self.object_id))
        return SurfaceApss(RESOLUTION).prepare(cloud).mesh


class Measured(NamedTuple):
    """A row of the table; the names of its fields are those of the CSV."""

    dataset: str
    topic: str
    variant: str
    against: str
    ssim: float
    ssim_lowest: float
    levels: float
    ms: float
    times: float
    chairs: int
    views: int


def main() -> None:
    """Measure, write, print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--dataset", action="append", help="default: procedural:validation")
    options.add_argument("--reconstructed", type=int, default=8, help="0 leaves them out")
    options.add_argument("--chairs", type=int, default=24, help="of each dataset")
    options.add_argument("--views", type=int, default=10, help="of each chair")
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--out", type=Path, default=Path("docs"))
    given = options.parse_args()
    page = given.out / f"{NAME}.md"
    try:
        text = page.read_text(encoding="utf-8")
        rows: list[Measured] = []
        for i, spec in enumerate(given.dataset or ["procedural:validation"]):
            objects = open_dataset(spec).objects(CLASS, given.chairs, given.chairs)
            rows += measure(spec.partition(":")[0], objects, given.views, given.rounds)
            if i == 0:
                shown = objects[SHEET_CHAIR % len(objects)].load()
                write_sheet(given.out / f"{NAME}.png", shown, SHEET_VIEW)
        if given.reconstructed:
            made = [Reconstructed(CLASS, "validation", i) for i in range(given.reconstructed)]
            rows += measure("reconstructed", made, given.views, given.rounds)
        page.write_text(with_tables(text, tables(rows)), encoding="utf-8")
    except (BadInput, OSError) as error:
        raise SystemExit(f"scene_economy: {error}") from error
    (given.out / f"{NAME}.csv").write_text(csv_text(Measured._fields, rows), encoding="utf-8")
    print(tables(rows))


def measure(
    dataset: str,
    objects: Sequence[SceneObject],
    views: int,
    rounds: int,
    variants: Sequence[Variant] = VARIANTS,
) -> list[Measured]:
    """A row for each variant; those that others are held against have to be among them."""
    errors: dict[Variant, list[tuple[NDArray[np.float64], float]]] = {v: [] for v in variants}
    seconds = {v: np.zeros(rounds) for v in variants}
    for obj in objects:
        mesh = obj.load()
        seen = random_views(views, generator("scene-economy", obj.class_name, obj.object_id))
        drawn: dict[Variant, Pictures] = {}
        uploads = {v: vertices_of(v.of(mesh), v.scene.crease_deg) for v in variants}
        for turn in range(-1, rounds):  # the first one is not counted
            for variant in variants:
                start = time.process_time()
                drawn[variant] = draw(variant.scene, uploads[variant], seen)
                if turn >= 0:
                    seconds[variant][turn] += time.process_time() - start
        pictures = {v.name: at_image_size(drawn[v]) for v in variants}
        for variant in variants:
            found, wanted = pictures[variant.name], pictures[variant.against]
            errors[variant].append((ssim_per_image(found, wanted).ssim, levels(found, wanted)))
    default = seconds[variants[0]]
    count = len(objects)
    return [
        Measured(
            dataset,
            v.topic,
            v.name,
            v.against,
            float(np.mean([s.mean() for s, _ in errors[v]])),
            float(min(s.mean() for s, _ in errors[v])),
            float(np.mean([moved for _, moved in errors[v]])),
            1e3 * median(seconds[v].tolist()) / (count * views),
            median((seconds[v] / default).tolist()),
            count,
            views,
        )
        for v in variants
    ]


def at_image_size(pictures: Pictures) -> Pictures:
    """Smaller ones enlarged bilinearly."""
    if pictures.shape[1] == IMAGE_SIZE:
        return pictures
    size = (IMAGE_SIZE, IMAGE_SIZE)
    return np.stack([
        np.asarray(Image.fromarray(p).resize(size, Image.Resampling.BILINEAR)) for p in pictures
    ])  # fmt: skip


def levels(a: Pictures, b: Pictures) -> float:
    """Mean absolute difference over the pixels that are not white in both; 0 where all are."""
    shown = ((a < 255) | (b < 255)).any(axis=-1)
    return float(np.abs(a.astype(int) - b)[shown].mean()) if shown.any() else 0.0


def tables(rows: Sequence[Measured]) -> str:
    """Markdown: a table for each dataset."""
    lines: list[str] = []
    for dataset in dict.fromkeys(r.dataset for r in rows):
        own = [r for r in rows if r.dataset == dataset]
        lines += [f"### {own[0].chairs} {HEADINGS[dataset]} x {own[0].views} views", ""]
        lines += [row(COLUMNS), "|---|---|---|---:|---:|---:|---:|---:|"]
        for r in own:
            numbers = (f"{r.ssim:.4f}", f"{r.ssim_lowest:.4f}", f"{r.levels:.2f}")
            lines.append(row((r.topic, r.variant, r.against, *numbers, f"{r.ms:.2f}",
                              f"{r.times:.2f}")))  # fmt: skip
        lines.append("")
    return "\n".join(lines)


HEADINGS = {
    "procedural": "procedural chairs (validation split)",
    "folder": "real chairs",
    "reconstructed": "reconstructed chairs",
}
COLUMNS = ("", "scene", "against", "ssim", "lowest", "levels", "ms", "times")


def with_tables(page: str, made: str) -> str:
    """The page with what stands between its marks replaced. Raises BadInput without the marks."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise BadInput(f"{NAME}.md: no marks '{BEGIN}' and '{END}'; put them where tables belong")
    return f"{before}{begin}\n\n{made}\n{end}{after}"


def write_sheet(path: Path, mesh: Mesh, view: View, variants: Sequence[Variant] = VARIANTS) -> None:
    """Every variant's picture of one chair, and beside it what differs from the one it is held
    against (black, eight times enlarged)."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    shown = {
        v.name: at_image_size(draw(v.scene, vertices_of(v.of(mesh), v.scene.crease_deg), [view]))[0]
        for v in variants
    }
    columns = 4
    figure, axes = plt.subplots(-(-len(shown) // columns), columns, figsize=(14, 12.5))
    for axis in axes.flat:
        axis.axis("off")
    for axis, variant in zip(axes.flat, variants, strict=False):
        picture, wanted = shown[variant.name], shown[variant.against].astype(int)
        apart = 255 - np.minimum(8 * np.abs(picture - wanted), 255)
        axis.imshow(np.hstack([picture, apart.astype(np.uint8)]), interpolation="nearest")
        axis.set_title(f"{variant.topic}: {variant.name}", fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    plt.close(figure)


if __name__ == "__main__":
    main()
