"""Does splat-net draw what it sees, or what it knows? Classes that it was never shown.

For each of the 13 classes a network is trained on the twelve others, and one on all of them with as
many steps; the bundled one knows chairs only. All draw test objects of the class, against
surface-apss on the same clouds: procedural ones, and with `--real FOLDER` meshes from a folder with
a sub-folder for each class.

`python -m benchmarks.unseen_classes --out DIR [--real FOLDER] [--classes a,b] [--steps N]
[--threads T] [--precision P]` trains what is not there yet and writes unseen.csv and unseen.md:
mean SSIM by class and condition, and the difference to surface-apss, paired, with 95 % intervals
over objects. A stopped study goes on where it was.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import torch

from baselines.splat_net.renderer import SplatNetRenderer
from baselines.splat_net.train import SplatNetConfig, train_splat_net
from baselines.splat_net.weights import export, load_weights
from baselines.surface import SurfaceApss
from bench.analysis.intervals import mean_interval
from bench.commands.train import training_set
from bench.metrics.structural_similarity import ssim_per_image
from data_prep.conditions import CONDITIONS
from data_prep.datasets import ProceduralObject, SceneObject, open_dataset
from data_prep.failures import StageFailure
from data_prep.images import to_uint8
from data_prep.randomness import generator
from data_prep.scene import Renderer
from data_prep.shapes.catalogue import CLASSES
from data_prep.training_set import SurfaceSet, TrainingSet, add_surfaces
from data_prep.whole_files import write_whole
from learning import training_loop

OBJECTS, VIEWS = 120, 8  # of each class
STEPS = 600
TEST_OBJECTS, TEST_VIEWS = 10, 5
TESTED = ("2048", "512", "noise-0.05", "noise-0.10")
RIVAL = "surface-apss"
ALL, CHAIRS = "all", "chairs only"


def without_class(data: SurfaceSet, classes: Sequence[str], name: str) -> SurfaceSet:
    """The objects of all other classes; `classes` [N] says which object is of which."""
    keep = np.array([other != name for other in classes])
    seen = data.seen
    return SurfaceSet(
        TrainingSet(
            seen.images[keep], seen.azimuth_deg[keep], seen.elevation_deg[keep], seen.clouds[keep]
        ),
        data.coverage[keep],
        data.grey[keep],
    )


def train(data: SurfaceSet, steps: int, precision: training_loop.Precision, folder: Path) -> Path:
    """Weights; a finished training is taken from `folder`."""
    config = SplatNetConfig(steps=steps, cool_down=steps // 3, precision=precision)
    checkpoint = train_splat_net(data, config, folder)
    weights = folder / "weights.safetensors"
    export(checkpoint, weights, "colour")
    return weights


def measure(
    renderer: Renderer, objects: Iterable[SceneObject], conditions: Sequence[str] = TESTED
) -> pd.DataFrame:
    """A row per object and condition: mean SSIM over its views. What fails is scored as blank."""
    rows = []
    for obj in objects:
        key = ("unseen", obj.class_name, obj.object_id)
        views = obj.views(TEST_VIEWS, generator(*key, "views"))
        cloud, truth = obj.cloud_and_truth(generator(*key, "cloud"), views)
        for condition in CONDITIONS:
            if condition.id not in conditions:
                continue
            random = generator(*key, condition.id)
            seen = condition.perturbation.apply(cloud, random)
            try:
                drawn = to_uint8(renderer.draw(renderer.prepare(seen, random), views, random))
            except StageFailure:
                drawn = np.full_like(truth, 255)
            found = float(ssim_per_image(truth, drawn).ssim.mean())
            rows.append(
                {"class": obj.class_name, "object": obj.object_id,
                 "condition": condition.id, "ssim": found}
            )  # fmt: skip
    return pd.DataFrame(rows)


def differences(measured: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Each network against the rival on the same clouds, by class and condition, paired."""
    keys = ["class", "condition", "object"]
    rows = []
    for network, table in measured.items():
        if network == RIVAL:
            continue
        both = table.merge(measured[RIVAL], on=keys, suffixes=("", "_of_rival"), validate="1:1")
        for name in dict.fromkeys(both["class"]):
            for condition in dict.fromkeys(both["condition"]):
                part = both[(both["class"] == name) & (both["condition"] == condition)]
                gain = (part["ssim"] - part["ssim_of_rival"]).to_numpy()
                low, high = mean_interval(gain)
                rows.append(
                    {"network": network, "class": name, "condition": condition,
                     "objects": len(gain), "ssim": float(part["ssim"].mean()),
                     RIVAL: float(part["ssim_of_rival"].mean()), "gain": float(gain.mean()),
                     "ci_low": low, "ci_high": high}
                )  # fmt: skip
    return pd.DataFrame(rows)


def ahead(found: pd.DataFrame, conditions: Sequence[str]) -> dict[str, list[str]]:
    """By network, the classes where its mean SSIM is above the rival's in all these conditions."""
    chosen = found[found["condition"].isin(conditions)]
    least = chosen.groupby(["network", "class"], sort=False)["gain"].min()
    networks = dict.fromkeys(chosen["network"])
    return {n: [c for c, gain in least.loc[n].items() if gain > 0] for n in networks}


def to_markdown(found: pd.DataFrame) -> str:
    """A row for each network and class, a column for each condition."""
    lines = [
        "| network | class | objects | " + " | ".join(TESTED) + " |",
        "|---" * (len(TESTED) + 3) + "|",
    ]
    for (network, name), rows in found.groupby(["network", "class"], sort=False):
        by = rows.set_index("condition")
        cells = [
            f"{by.ssim[c]:.3f} ({by.gain[c]:+.3f} [{by.ci_low[c]:+.3f}, {by.ci_high[c]:+.3f}])"
            for c in TESTED
        ]
        lines.append(f"| {network} | {name} | {rows.objects.iloc[0]} | {' | '.join(cells)} |")
    lines.append("")
    judged = TESTED[1:]
    for network, classes in ahead(found, judged).items():
        where = ", ".join(classes) or "none"
        lines.append(
            f"{network}: above {RIVAL} at {', '.join(judged)} in {len(classes)} classes ({where})."
        )
    return "\n".join(lines) + "\n"


def study(
    out: Path, tested: Mapping[str, Sequence[SceneObject]], weights: Mapping[str, Path]
) -> str:
    """Draw and compare: `weights` by "without CLASS", ALL; `tested` objects by class."""
    chairs = SplatNetRenderer(load_weights("chair"))
    everything = SplatNetRenderer(load_weights(weights[ALL]))
    tables: dict[str, list[pd.DataFrame]] = {}
    for name, objects in tested.items():
        print(f"{out.stem}: {name}, {len(objects)} objects", flush=True)
        unseen = SplatNetRenderer(load_weights(weights[f"without {name}"]))
        for network, renderer in (
            (RIVAL, SurfaceApss()),
            ("all other classes", unseen),
            ("all classes", everything),
            (CHAIRS, chairs),
        ):
            tables.setdefault(network, []).append(measure(renderer, objects))
    found = differences({network: pd.concat(parts) for network, parts in tables.items()})
    found.to_csv(out.with_suffix(".csv"), index=False, float_format="%.6f")
    text = to_markdown(found)
    write_whole(out.with_suffix(".md"), text.encode())
    return text


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="Classes that splat-net was never shown.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--real", type=Path, help="meshes in a sub-folder for each class")
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--objects", type=int, default=OBJECTS, help="of each class, to train on")
    parser.add_argument("--classes", default=",".join(CLASSES), help="left out, each in its turn")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument(
        "--precision", choices=get_args(training_loop.Precision), default="bfloat16"
    )
    options = parser.parse_args(arguments)
    torch.set_num_threads(options.threads)
    classes = options.classes.split(",")
    if unknown := ", ".join(sorted({*classes} - {*CLASSES})):
        parser.error(f"--classes: unknown {unknown}; choose of {', '.join(CLASSES)}")
    objects = tuple(
        ProceduralObject(name, "train", i) for name in CLASSES for i in range(options.objects)
    )
    data = add_surfaces(training_set(objects, VIEWS), objects)
    labels = [obj.class_name for obj in objects]
    weights = {}
    for name in (ALL, *classes):
        key = ALL if name == ALL else f"without {name}"
        print(f"{key}: {options.steps} steps", flush=True)
        part = data if name == ALL else without_class(data, labels, name)
        folder = options.out / key.replace(" ", "-")
        weights[key] = train(part, options.steps, options.precision, folder)
    tested = {
        name: [ProceduralObject(name, "test", i) for i in range(TEST_OBJECTS)] for name in classes
    }
    print(study(options.out / "unseen", tested, weights))
    if options.real:
        real = open_dataset(f"folder:{options.real}")
        meshes = {name: list(real.objects(name, None, 0, "test")) for name in classes}
        print(study(options.out / "unseen-real", meshes, weights))


if __name__ == "__main__":
    main()
