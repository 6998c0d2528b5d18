"""Does more data of a class help it, and does the chair gain from other classes?

The paper (section 4) says that pc2pix improves "with quantity of the training data" and "suffers
when there is dataset imbalance", and that the chair gained 2.7 points of FID when all classes were
used. Both are tested by trainings that differ in their objects alone:

* `first` and `second` see all classes. In `first`, every other class has MANY objects and the
  rest FEW; in `second` it is the other way round, so that each class is once well and once poorly
  stocked in trainings of about the same size. Batches are drawn among objects: a class with few is
  also seen rarely, as in the paper.
* `chairs` sees the MANY chairs alone for as many steps (seven times as many pictures of chairs),
  and `chairs-briefly` for so many steps that it sees as many chairs as the training of all classes
  where they are well stocked.

`python -m benchmarks.class_data --out DIR [--threads N]` trains what is not there yet (each with
an autoencoder of its own; by reconstruction alone, at an eighth of the paper's width), then draws
test objects that no training has seen, from full clouds. It writes class_data.csv and
class_data.md: mean differences of SSIM and silhouette-iou with 95 % intervals over objects, paired.
A stopped study goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import pc2pix
from bench.analysis.intervals import mean_interval
from bench.commands.train import training_clouds, training_set
from bench.metrics.image_scores import scores
from data_prep.datasets import ProceduralObject
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.sampling import random_views, sample_surface
from data_prep.shapes.catalogue import CLASSES
from pc2pix.model import ModelConfig
from pc2pix.train_autoencoder import AutoencoderConfig, AutoencoderData, load_encoder
from pc2pix.train_autoencoder import train_autoencoder as train_autoencoder_on
from pc2pix.train_gan import GanConfig, GanData
from pc2pix.train_gan import train_gan as train_gan_on
from pc2pix.weights import export

MANY, FEW = 300, 30
VIEWS = 6
STEPS = 4000
AUTOENCODER_STEPS = 600
BATCH = 16
TEST_OBJECTS, TEST_VIEWS = 40, 5
METRICS = ("ssim", "silhouette_iou")
MODEL = ModelConfig(width=0.125, latent_dim=128, encoder="pointnet", azimuth="sine-cosine")


@dataclass(frozen=True)
class Study:
    """A training: its name, the number of objects of each class, and its length."""

    name: str
    objects: dict[str, int]
    steps: int


def studies(classes: Sequence[str], steps: int = STEPS) -> tuple[Study, ...]:
    """The four trainings for these classes, "chair" among them."""
    first = {name: MANY if i % 2 == 0 else FEW for i, name in enumerate(classes)}
    second = {name: FEW if count == MANY else MANY for name, count in first.items()}
    stocked = first if first["chair"] == MANY else second
    share = MANY / sum(stocked.values())
    return (
        Study("first", first, steps),
        Study("second", second, steps),
        Study("chairs", {"chair": MANY}, steps),
        Study("chairs-briefly", {"chair": MANY}, round(steps * share)),
    )


def train(study: Study, folder: Path) -> Path:
    """The weights of a training; finished parts are taken from `folder`."""
    objects = tuple(
        ProceduralObject(name, "train", i)
        for name, count in study.objects.items()
        for i in range(count)
    )
    autoencoder = train_autoencoder_on(
        AutoencoderData(training_clouds(objects)),
        AutoencoderConfig(
            model=MODEL,
            steps=AUTOENCODER_STEPS,
            learning_rate=5e-4,
            augment=True,
            precision="bfloat16",
        ),
        folder / "autoencoder",
    )
    made = training_set(objects, VIEWS)
    checkpoint = train_gan_on(
        GanData(made.images, made.azimuth_deg, made.elevation_deg, made.clouds),
        load_encoder(autoencoder),
        GanConfig(
            model=MODEL,
            objective="paired",
            steps=study.steps,
            warm_up=study.steps,
            batch=BATCH,
            augment=True,
            precision="bfloat16",
        ),
        folder / "gan",
    )
    weights = folder / "weights.safetensors"
    export(checkpoint, weights)
    return weights


def measure(weights: Path, classes: Sequence[str]) -> pd.DataFrame:
    """A row per test object: class, object and the mean of each metric over its views."""
    renderer = pc2pix.load(weights)
    rows = []
    for name in classes:
        for i in range(TEST_OBJECTS):
            mesh = ProceduralObject(name, "test", i).load()
            views = random_views(TEST_VIEWS, generator("class data", "views", name, i))
            cloud = sample_surface(mesh, generator("class data", "cloud", name, i))
            drawn = renderer.draw(renderer.prepare(cloud), views)
            found = scores(render(mesh, views), to_uint8(drawn))
            rows.append(
                {"class": name, "object": i, **{m: float(np.mean(found[m])) for m in METRICS}}
            )
    return pd.DataFrame(rows)


def differences(measured: dict[str, pd.DataFrame], trained: Sequence[Study]) -> pd.DataFrame:
    """Paired differences, a row each: question, class, metric, with, without, gain, interval.

    "more data": the training where the class is well stocked against the one where it is not; the
    class `all` is the mean over classes, its interval over classes. "with other classes": the
    training of all classes where chairs are well stocked against chairs alone.
    """
    objects = {study.name: study.objects for study in trained}
    rows = []
    for metric in METRICS:
        values = {n: {c: g[metric].to_numpy() for c, g in t.groupby("class")}
                  for n, t in measured.items()}  # fmt: skip
        gains = []
        for name in objects["first"]:
            much, little = _stocked(objects, name)
            rows.append(_row("more data", name, metric, values[much][name], values[little][name]))
            gains.append(rows[-1]["gain"])
        low, high = mean_interval(np.array(gains))
        mean = float(np.mean(gains))
        rows.append({"question": "more data", "class": "all", "metric": metric, "gain": mean,
                     "ci_low": low, "ci_high": high})  # fmt: skip
        many, _ = _stocked(objects, "chair")
        for alone, question in (
            ("chairs-briefly", "with other classes, as many chairs seen"),
            ("chairs", "with other classes, as many steps"),
        ):
            pair = values[many]["chair"], values[alone]["chair"]
            rows.append(_row(question, "chair", metric, *pair))
    columns = ["question", "class", "metric", "with", "without", "gain", "ci_low", "ci_high"]
    return pd.DataFrame(rows)[columns]


def _stocked(objects: dict[str, dict[str, int]], name: str) -> tuple[str, str]:
    """The training where a class has many objects, and the one where it has few."""
    return ("first", "second") if objects["first"][name] == MANY else ("second", "first")


def _row(
    question: str,
    class_name: str,
    metric: str,
    with_it: NDArray[np.float64],
    without: NDArray[np.float64],
) -> dict[str, object]:
    low, high = mean_interval(with_it - without)
    return {
        "question": question,
        "class": class_name,
        "metric": metric,
        "with": float(with_it.mean()),
        "without": float(without.mean()),
        "gain": float((with_it - without).mean()),
        "ci_low": low,
        "ci_high": high,
    }


def to_markdown(found: pd.DataFrame) -> str:
    """The differences as a table."""
    lines = ["| question | class | metric | with | without | gain [95 %] |", "|---" * 6 + "|"]
    for row in found.itertuples(index=False):
        question, name, metric, much, little, gain, low, high = row
        shown = ["-" if pd.isna(v) else f"{v:.3f}" for v in (much, little)]
        lines.append(
            f"| {question} | {name} | {metric} | {shown[0]} | {shown[1]} "
            f"| {gain:+.3f} [{low:+.3f}, {high:+.3f}] |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the study from the command line."""
    import torch

    parser = argparse.ArgumentParser(description="Does more data of a class help it?")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    trained = studies(tuple(CLASSES))
    measured = {}
    for study in trained:
        print(f"{study.name}: {sum(study.objects.values())} objects, {study.steps} steps")
        weights = train(study, options.out / study.name)
        measured[study.name] = measure(weights, tuple(study.objects))
    found = differences(measured, trained)
    found.to_csv(options.out / "class_data.csv", index=False, float_format="%.6f")
    text = to_markdown(found)
    (options.out / "class_data.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
