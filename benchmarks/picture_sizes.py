"""splat-net at other sizes than the 128 px that it was trained for.

`python -m benchmarks.picture_sizes --out DIR [--chairs N] [--weights W]` draws test chairs at 64,
128 and 256 px, once at that size and once at 128 px and resampled (area averages downwards, bicubic
upwards), against the mesh rendered at that size. It writes sizes.csv, sizes.md (mean SSIM and IoU
of silhouettes, 95 % intervals over chairs; milliseconds a picture) and sizes.png.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from PIL import Image

from baselines import splat_net
from bench.analysis.intervals import mean_interval
from bench.metrics.silhouette import silhouette_iou
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.conditions import CONDITIONS
from data_prep.datasets import ProceduralObject
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.scene import IMAGE_SIZE, Images
from data_prep.whole_files import write_whole

SIZES = (64, 128, 256)
TESTED = ("2048", "512", "noise-0.05")
VIEWS = 5
SHOWN = 4  # chairs in the picture


def resampled(pictures: Images, size: int) -> Images:
    """Pictures [V, S, S, 3] in 0..1 at another size: area averages downwards, bicubic upwards."""
    if size == pictures.shape[1]:
        return pictures
    planes = torch.from_numpy(pictures).permute(0, 3, 1, 2)
    if size < pictures.shape[1]:
        made = torch.nn.functional.interpolate(planes, size=(size, size), mode="area")
    else:
        made = torch.nn.functional.interpolate(
            planes, size=(size, size), mode="bicubic", align_corners=False
        )
    return made.clamp(0, 1).permute(0, 2, 3, 1).numpy()


def measure(weights: str, chairs: int) -> tuple[pd.DataFrame, list[np.ndarray]]:
    """A row per size, way, condition and chair; and columns of pictures of the first chairs."""
    renderers = {size: splat_net.load(weights, size=size) for size in SIZES}
    rows, shown = [], []
    for i in range(chairs):
        obj = ProceduralObject("chair", "test", i)
        views = obj.views(VIEWS, generator("sizes", "views", i))
        cloud, mesh = obj.cloud(generator("sizes", "cloud", i)), obj.load()
        truths = {size: render(mesh, views, size) for size in SIZES}
        for condition in (c for c in CONDITIONS if c.id in TESTED):
            seen = condition.perturbation.apply(cloud, generator("sizes", condition.id, i))
            plain = renderers[IMAGE_SIZE].draw(renderers[IMAGE_SIZE].prepare(seen), views)
            for size, renderer in renderers.items():
                state = renderer.prepare(seen)
                start = time.perf_counter()
                own = renderer.draw(state, views)
                taken_ms = 1e3 * (time.perf_counter() - start) / VIEWS
                ways = {"drawn": own, "resampled": resampled(plain, size)}
                for way, pictures in ways.items():
                    drawn = to_uint8(pictures)
                    rows.append(
                        {"size": size, "way": way, "condition": condition.id, "chair": i,
                         "ssim": float(ssim_per_image(truths[size], drawn).ssim.mean()),
                         "silhouette_iou": float(silhouette_iou(truths[size], drawn).mean()),
                         "draw_ms": taken_ms if way == "drawn" else np.nan}
                    )  # fmt: skip
                if i < SHOWN and condition.id == TESTED[0]:
                    shown += [truths[size][0], *(to_uint8(p[:1])[0] for p in ways.values())]
    return pd.DataFrame(rows), shown


def to_markdown(found: pd.DataFrame) -> str:
    """A row for each size and condition."""
    lines = [
        "| size | condition | SSIM drawn | resampled | IoU drawn | resampled | draw (ms) |",
        "|---" * 7 + "|",
    ]
    for (size, condition), rows in found.groupby(["size", "condition"], sort=False):
        of = dict(tuple(rows.groupby("way")))
        cells = []
        for metric in ("ssim", "silhouette_iou"):
            for way in ("drawn", "resampled"):
                values = of[way][metric].to_numpy()
                low, high = mean_interval(values)
                cells.append(f"{values.mean():.3f} [{low:.3f}, {high:.3f}]")
        lines.append(
            f"| {size} | {condition} | {' | '.join(cells)} | {of['drawn'].draw_ms.median():.1f} |"
        )
    return "\n".join(lines) + "\n"


def sheet(shown: Sequence[np.ndarray]) -> Image.Image:
    """Rows of chairs; for each size the truth, drawn and resampled, brought to 256 px."""
    wide = SIZES[-1]
    tiles = [Image.fromarray(p).resize((wide, wide), Image.Resampling.NEAREST) for p in shown]
    across = 3 * len(SIZES)
    made = Image.new("RGB", (across * wide, len(tiles) // across * wide))
    for i, tile in enumerate(tiles):
        made.paste(tile, (i % across * wide, i // across * wide))
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure from the command line."""
    parser = argparse.ArgumentParser(description="splat-net at other sizes than 128 px.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--chairs", type=int, default=24)
    parser.add_argument("--weights", default="chair")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    options.out.mkdir(parents=True, exist_ok=True)
    found, shown = measure(options.weights, options.chairs)
    found.to_csv(options.out / "sizes.csv", index=False, float_format="%.6f")
    text = to_markdown(found)
    write_whole(options.out / "sizes.md", text.encode())
    sheet(shown).save(options.out / "sizes.png")
    print(text)


if __name__ == "__main__":
    main()
