"""How far apart two samples of one and the same distribution are, by the Fréchet distances.

    python -m benchmarks.frechet_bias [--out DIR]

The distance of a distribution to itself is 0. That of two finite samples is not: their moments
differ by chance, and the distance only ever adds that up. This prints what it amounts to for n =
10 to 2,000 pictures in each sample, and writes `frechet-bias.csv` and `frechet-bias.png` to DIR
(default: docs). About two minutes on one thread.

Samples
-------
one view a chair   Pictures of true meshes: chairs 0 to 3,999 of the validation split, each from one
                   random view, so that all pictures are independent. A repeat shuffles them and
                   takes the first and the second n. The features' network was trained on other
                   chairs (train split).
20 views a chair   Chairs 0 to 99, each from 20 random views, as in a run. A repeat shuffles the
                   chairs; a sample of n pictures shows n / 20 of them, with all their views. Views
                   of one chair are not independent, so that this is worth less than n pictures.
normal, d = 2048   Vectors of 2,048 independent standard normal numbers, drawn anew for each repeat.
                   They stand in for the features of `fid` in number only; what they have for them
                   is an expectation to compare with, see `expected_normal_distance`.

Mean and standard deviation are over the repeats (10; of the normal vectors 3). Repeats overlap
where they take more than a part of the pool, so that for n near the pool's half the deviation is
too small.

The two sets of a cell of a run are not such samples: they show the same chairs from the same views,
and their moments err alike. `true-mesh` against the truth is exactly 0 for any n. The bias told
here is the one of sets that have no picture in common (another renderer's test set, another
split), and the upper end of what may be in a cell.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.metrics import find_extractor
from bench.metrics.frechet import frechet_distance
from data_prep.datasets import ProceduralObject
from data_prep.randomness import generator
from data_prep.render import render
from data_prep.sampling import random_views

SIZES = (10, 20, 40, 100, 200, 480, 1000, 2000)  # 480: 24 chairs x 20 views, a default run
REPEATS = 10
POOL = 2 * SIZES[-1]
CHAIRS, VIEWS = 100, 20
METRICS = ("fd-views", "fd-views-grey")
SINGLE, SEVERAL, NORMAL = "one view a chair", "20 views a chair", "normal, d = 2048"
NORMAL_DIMENSION = 2048
NORMAL_REPEATS = 3

Features = NDArray[np.float32]


@dataclass(frozen=True)
class Bias:
    """The distance of two samples of `n` from one distribution; lower would be better, 0 is right.

    expected  where theory has a value
    """

    metric: str
    sample: str
    n: int
    mean: float
    deviation: float
    repeats: int
    expected: float | None = None


def main() -> None:
    """Run the study from the command line."""
    parser = argparse.ArgumentParser(description="The bias of the Fréchet distances.")
    parser.add_argument("--out", type=Path, default=Path("docs"))
    folder = parser.parse_args().out
    rows = [*of_pictures(), *of_normal_vectors()]
    print(to_markdown(rows), end="")
    folder.mkdir(parents=True, exist_ok=True)
    write_csv(folder / "frechet-bias.csv", rows)
    write_figure(folder / "frechet-bias.png", rows)


def of_pictures() -> Iterator[Bias]:
    """Both metrics on pictures of true meshes."""
    single = _pictures(POOL, 1)[:, 0]
    several = _pictures(CHAIRS, VIEWS)
    for metric in METRICS:
        source = find_extractor(metric)
        extract = source.load(str(source.weights(None)))
        singles = extract(single)
        severals = extract(several.reshape(-1, *several.shape[2:])).reshape(CHAIRS, VIEWS, -1)
        for n in SIZES:
            yield summary(metric, SINGLE, n, [_of_split(singles, n, i) for i in range(REPEATS)])
            if n % VIEWS == 0 and 2 * n <= CHAIRS * VIEWS:
                found = [_of_split(severals, n // VIEWS, i) for i in range(REPEATS)]
                yield summary(metric, SEVERAL, n, found)


def of_normal_vectors() -> Iterator[Bias]:
    """Standard normal vectors of as many numbers as Inception has features."""
    d = NORMAL_DIMENSION
    for n in SIZES:
        found = []
        for i in range(NORMAL_REPEATS):
            rng = generator("frechet bias", "normal", n, i)
            found.append(frechet_distance(rng.normal(size=(n, d)), rng.normal(size=(n, d))))
        yield summary("normal", NORMAL, n, found, expected_normal_distance(n, d))


def _pictures(chairs: int, views: int) -> NDArray[np.uint8]:
    """Pictures [chairs, views, H, W, 3] of validation chairs."""
    return np.stack(
        [
            render(
                ProceduralObject("chair", "validation", i).load(),
                random_views(views, generator("frechet bias", "views", views, i)),
            )
            for i in range(chairs)
        ]
    )


def _of_split(pool: Features, count: int, repeat: int) -> float:
    """The distance of the first and the second `count` rows of a shuffled pool [N, ..., d]."""
    order = generator("frechet bias", "split", count, repeat).permutation(len(pool))
    x, y = (pool[part].reshape(-1, pool.shape[-1]) for part in np.split(order[: 2 * count], 2))
    return frechet_distance(x, y)


def summary(
    metric: str, sample: str, n: int, distances: list[float], expected: float | None = None
) -> Bias:
    """Mean and standard deviation (ddof 1) of the distances of all repeats."""
    mean, deviation = float(np.mean(distances)), float(np.std(distances, ddof=1))
    return Bias(metric, sample, n, mean, deviation, len(distances), expected)


def expected_normal_distance(n: int, d: int) -> float:
    """Expected distance of two samples of n >= 2 standard normal vectors of d numbers.

    With m = n - 1 and S1, S2 independent Wishart matrices over m (covariances of ddof 1):

        E |mean1 - mean2|^2 + E tr S1 + E tr S2 - 2 E tr sqrt(S1 S2)  =  2 d / n + 2 d - 2 d r

    The first three terms are exact. r is the mean of sqrt over the eigenvalues of S1 S2, taken from
    its limit for large d at constant y = d / m. The S-transform of one such matrix is 1 / (1 + y z)
    (Marchenko and Pastur), that of the product of two free ones 1 / (1 + y z)^2 (Voiculescu 1987):
    at the eigenvalue x the moment transform z solves (1 + z) (1 + y z)^2 = x z, and the density is
    -Im z / (pi x) on the branch below the real axis. For y <= 1 this gives r = 1 - y / 4. What is
    left out is 1 / d of the result, or less; for y <= 1 its first order, d (d + 1) / 2m for
    d^2 / 2m, is put in. For n far below d the value is 2 d (1 + 1/n) - 16 / (3 pi) sqrt(m d).
    """
    m = n - 1
    if m >= d:
        return 2 * d / n + d * (d + 1) / (2 * m)
    return 2 * d / n + 2 * d - 2 * d * mean_root(d / m)


def mean_root(y: float) -> float:
    """r of `expected_normal_distance` by quadrature, for y >= 1: where eigenvalues begin at 0."""
    # the largest: x(z) = (1 + z) (1 + y z)^2 / z is least at x'(z) = 0, 2 y z^2 + y z = 1
    z = (np.sqrt(y * y + 8 * y) - y) / (4 * y)
    end = (1 + z) * (1 + y * z) ** 2 / z
    # Gauss and Legendre in the angle, x = end sin^6: no singularity is left at either end
    nodes, weights = np.polynomial.legendre.leggauss(200)
    angle = np.pi / 4 * (nodes + 1)
    x = end * np.sin(angle) ** 6
    slope = 6 * x / np.tan(angle)
    density = np.array([_density(value, y) for value in x])
    return float(np.sum(np.pi / 4 * weights * np.sqrt(x) * density * slope))


def _density(x: float, y: float) -> float:
    roots = np.roots([y * y, y * y + 2 * y, 2 * y + 1 - x, 1.0])
    return float(-roots.imag.min() / (np.pi * x))


def to_markdown(rows: list[Bias]) -> str:
    """A line for each metric, sample and n; a bias of 1 / n gives the same n x mean throughout."""
    lines = [
        "| metric | sample | n | mean | deviation | n x mean | expected |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        expected = "" if row.expected is None else f"{row.expected:.4g}"
        lines.append(
            f"| {row.metric} | {row.sample} | {row.n} | {row.mean:.4g} | {row.deviation:.2g} | "
            f"{row.n * row.mean:.4g} | {expected} |"
        )
    return "\n".join(lines) + "\n"


def write_csv(path: Path, rows: list[Bias]) -> None:
    """All fields, one line a row; numbers keep six digits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(Bias)])
        for row in rows:
            values = asdict(row).values()
            writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])


def write_figure(path: Path, rows: list[Bias]) -> None:
    """The bias against n, both logarithmic: 1 / n is a straight line downwards."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    colours: dict[str, str] = {}
    for key in dict.fromkeys((row.metric, row.sample) for row in rows):
        of_key = [row for row in rows if (row.metric, row.sample) == key]
        metric, sample = key
        colour = colours.setdefault(metric, f"C{len(colours)}")
        axis.errorbar(
            [row.n for row in of_key],
            [row.mean for row in of_key],
            yerr=[row.deviation for row in of_key],
            label=sample if metric == "normal" else f"{metric}, {sample}",
            color=colour,
            marker="s" if sample == SEVERAL else "o",
            linestyle="--" if sample == SEVERAL else "-",
            markersize=4,
            linewidth=1.2,
            capsize=2,
        )
    theory = [(row.n, row.expected) for row in rows if row.expected is not None]
    if theory:
        axis.plot(*zip(*theory, strict=True), "k:", label="normal, expected", zorder=5)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("n, pictures (vectors) in each of the two samples")
    axis.set_ylabel("Fréchet distance of two samples (features squared)")
    axis.set_title("Two samples of one distribution: the right answer is 0")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=8)
    figure.savefig(path, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    main()
