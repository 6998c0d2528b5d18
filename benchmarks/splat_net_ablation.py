"""What each input of splat-net pays, and what it costs.

The same training without one input at a time: normals, density, the flattened points, the depth
behind, the wide discs. All trainings are of the same length, by `l1`, shorter than that of the
bundled weights: what is compared is differences.

`python -m benchmarks.splat_net_ablation --out DIR [--without a,b] [--steps N] [--threads T]
[--precision P]` trains what is not there yet, draws validation chairs (choices are made on these),
and writes ablation.csv and ablation.md: mean SSIM and thin-recall against the whole network,
paired, with 95 % intervals over chairs; the cost of `prepare`, and of `draw` per picture of 20 in
bfloat16, in turns (medians).
A stopped study goes on where it was.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import torch

from baselines.splat_net.network import DEFAULT
from baselines.splat_net.renderer import SplatNetRenderer
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from baselines.splat_net.weights import export, load_weights
from bench.analysis.intervals import mean_interval
from bench.commands.train import do_without, training_set
from bench.metrics.image_scores import scores
from data_prep.conditions import CONDITIONS
from data_prep.datasets import ProceduralObject
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.scene import Renderer
from data_prep.training_set import SurfaceSet, add_surfaces
from data_prep.whole_files import write_whole
from learning import training_loop

WHOLE = "nothing"  # is left out
PARTS = (WHOLE, "normals", "density", "discs", "flattened", "far")
OBJECTS, VIEWS = 1500, 8
STEPS = 1500
TEST_CHAIRS, TEST_VIEWS = 40, 5
TESTED = ("2048", "512", "noise-0.05", "noise-0.10")
METRICS = ("ssim", "thin_recall", "thin_precision")
TIMED_VIEWS, ROUNDS = 20, 15


def train(
    data: SurfaceSet, part: str, steps: int, precision: training_loop.Precision, folder: Path
) -> Path:
    """The weights of the training without `part`; a finished one is taken from `folder`."""
    network = DEFAULT if part == WHOLE else do_without(DEFAULT, (part,))
    config = SplatNetConfig(network=network, steps=steps, cool_down=steps // 4, precision=precision)
    checkpoint = train_splat_net(data, config, folder)
    weights = folder / "weights.safetensors"
    export(checkpoint, weights, "colour")
    return weights


def measure(renderer: Renderer, chairs: int = TEST_CHAIRS) -> pd.DataFrame:
    """A row per condition and validation chair: the mean of each metric over its views."""
    rows = []
    for i in range(chairs):
        obj = ProceduralObject("chair", "validation", i)
        views = obj.views(TEST_VIEWS, generator("ablation", "views", i))
        cloud, truth = obj.cloud_and_truth(generator("ablation", "cloud", i), views)
        for condition in CONDITIONS:
            if condition.id not in TESTED:
                continue
            random = generator("ablation", condition.id, i)
            seen = condition.perturbation.apply(cloud, random)
            drawn = renderer.draw(renderer.prepare(seen, random), views, random)
            found = scores(truth, to_uint8(drawn))
            means = {m: float(np.nanmean(found[m])) if _any(found[m]) else np.nan for m in METRICS}
            rows.append({"condition": condition.id, "chair": i, **means})
    return pd.DataFrame(rows)


def _any(values: np.ndarray) -> bool:
    return bool(np.isfinite(values).any())


def differences(measured: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Without a part less with all: a row per part, condition and metric, with its interval."""
    rows = []
    for part, table in measured.items():
        for condition in TESTED:
            for metric in METRICS:
                values = _values(table, condition, metric)
                change = (values - _values(measured[WHOLE], condition, metric)).dropna().to_numpy()
                low, high = mean_interval(change)
                rows.append(
                    {"without": part, "condition": condition, "metric": metric,
                     "value": float(values.mean()), "change": float(change.mean()),
                     "ci_low": low, "ci_high": high}
                )  # fmt: skip
    return pd.DataFrame(rows)


def _values(table: pd.DataFrame, condition: str, metric: str) -> pd.Series:
    """A metric by chair."""
    return table[table["condition"] == condition].set_index("chair")[metric]


def costs(renderers: dict[str, SplatNetRenderer]) -> dict[str, tuple[float, float]]:
    """Milliseconds of `prepare` and of `draw` per picture, taken in turns; medians."""
    obj = ProceduralObject("chair", "validation", 0)
    random = generator("ablation", "cost")
    views, cloud = obj.views(TIMED_VIEWS, random), obj.cloud(random)
    states = {part: renderer.prepare(cloud) for part, renderer in renderers.items()}
    taken: dict[str, list[tuple[float, float]]] = {part: [] for part in renderers}
    for turn in range(ROUNDS + 2):
        for part, renderer in renderers.items():
            pair = (
                _milliseconds(lambda r=renderer: r.prepare(cloud)),
                _milliseconds(lambda r=renderer, s=states[part]: r.draw(s, views)) / len(views),
            )
            if turn >= 2:  # the first rounds lay out kernels and map memory
                taken[part].append(pair)
    return {part: tuple(np.median(pairs, axis=0)) for part, pairs in taken.items()}


def _milliseconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return 1e3 * (time.perf_counter() - start)


def to_markdown(found: pd.DataFrame, cost: dict[str, tuple[float, float]]) -> str:
    """A row for each part: change of SSIM by condition, of thin-recall on whole clouds, cost."""
    head = [f"SSIM at {condition}" for condition in TESTED]
    lines = [
        "| without | " + " | ".join(head) + " | thin-recall at 2048 | prepare (ms) | draw (ms) |",
        "|---" * (len(TESTED) + 4) + "|",
    ]
    for part, (prepare_ms, draw_ms) in cost.items():
        of = found[found["without"] == part]
        cells = [_cell(of, c, "ssim") for c in TESTED] + [_cell(of, "2048", "thin_recall")]
        lines.append(f"| {part} | {' | '.join(cells)} | {prepare_ms:.1f} | {draw_ms:.2f} |")
    return "\n".join(lines) + "\n"


def _cell(of: pd.DataFrame, condition: str, metric: str) -> str:
    ((part, value, change, low, high),) = of.loc[
        (of["condition"] == condition) & (of["metric"] == metric),
        ["without", "value", "change", "ci_low", "ci_high"],
    ].itertuples(index=False)
    return f"{value:.3f}" if part == WHOLE else f"{change:+.3f} [{low:+.3f}, {high:+.3f}]"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="What each input of splat-net pays.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--without", default=",".join(PARTS[1:]))
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--objects", type=int, default=OBJECTS)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--precision", choices=get_args(training_loop.Precision), default="bfloat16"
    )
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    objects = tuple(ProceduralObject("chair", "train", i) for i in range(options.objects))
    data = add_surfaces(training_set(objects, VIEWS), objects)
    renderers, measured = {}, {}
    for part in (WHOLE, *options.without.split(",")):
        print(f"without {part}: {options.steps} steps", flush=True)
        weights = load_weights(
            train(data, part, options.steps, options.precision, options.out / part)
        )
        renderers[part] = SplatNetRenderer(weights, precision="bfloat16")
        measured[part] = measure(renderers[part])
    found = differences(measured)
    found.to_csv(options.out / "ablation.csv", index=False, float_format="%.6f")
    text = to_markdown(found, costs(renderers))
    write_whole(options.out / "ablation.md", text.encode())
    print(text)


if __name__ == "__main__":
    main()
