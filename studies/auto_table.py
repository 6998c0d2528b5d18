"""The table by which `auto` chooses, for `bench/catalogue/auto_table.py`, and what it gains.

    bench run --suite thirteen-classes --dataset procedural:validation --truth grey --views 2
        --limit 3 --conditions 2048,1024,512,256,noise-0.05,noise-0.10 --methods A,B --out SCORES
    bench run --suite speed-accuracy --limit 3 --conditions 2048,1024,512,256,noise-0.05,noise-0.10
        --methods A,B --out COSTS
    python -m studies.auto_table SCORES --costs COSTS/tables/frontier.csv

The score of a method on a cloud is the mean of `ssim` and 1 - `lpips` over its views, with a blank
image for each failed one. A cloud is noisy where its estimated noise is more than so many spacings
as tell the conditions with noise from the others with the fewest errors. On clean clouds of each
number of points, and on noisy ones, each method has its mean score over objects, and its cost from
the file of costs (of one view of a new cloud, on one machine; under noise that of the dearest
condition). Methods that cost no less than a better one are left out.

What it gains is judged by leaving out one object at a time: table and threshold are those of the
other objects, and the choice for a cloud depends on its own estimates. `single` is the best method
that is within the budget at all conditions that have such a one, `oracle` takes the best one within
the budget for each cloud; `closed` is the share of the gap between both that `auto` closes. `over`
is the share of clouds whose method costs more at their condition than the budget, because they were
taken for others; `refused` that of clouds for which no method is within the budget.

Writes bench/catalogue/auto_table.py, results/docs/auto.csv and results/docs/auto-costs.csv.
"""

from __future__ import annotations

import argparse
import csv
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.analysis.frontier import point_count
from bench.analysis.scored import ScoredRun, read_scored
from bench.catalogue.auto import AutoTable, Candidate, CloudEstimate
from bench.catalogue.auto_renderer import estimate_of
from bench.catalogue.methods import FLOOR, find_method
from bench.running.plan import plan
from bench.running.protocol import stored_protocol
from bench.running.work import cloud_of
from bench.tables.table import csv_text
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from studies.tables import markdown

REPOSITORY = Path(__file__).parents[1]
TABLE = REPOSITORY / "bench" / "catalogue" / "auto_table.py"
RESULTS = REPOSITORY / "results" / "docs"
COSTS = RESULTS / "auto-costs.csv"
BUDGETS_MS: tuple[float | None, ...] = (5, 20, 50, 200, 1000, None)
METRICS = ("ssim", "lpips")
WIDTH = 99
COST_FIELDS = ("condition", "views", "method", "cost_ms")
GAIN_FIELDS = (
    *("budget", "single", "single_score", "auto_score", "oracle_score"),
    *("closed", "over", "refused"),
)
Costs = Mapping[tuple[str, str], float]  # by condition and method


@dataclass(frozen=True)
class ScoredCloud:
    """A cloud of the run with the estimates that `auto` makes, and the score of each method."""

    obj: str
    condition: str
    estimate: CloudEstimate
    scores: Mapping[str, float]

    @property
    def clean(self) -> bool:
        """Return whether its condition only takes points away."""
        return point_count(self.condition) is not None


def read_clouds(run: ScoredRun) -> list[ScoredCloud]:
    """Return the clouds of a run on which `auto` may draw with the run's methods.

    Methods in colour, methods trained on one class and reference methods are no candidates.
    """
    estimates = _estimates(run)
    clouds = []
    for comparison in run.compared(METRICS):
        methods = [m for m in comparison.images if _is_candidate(m)]
        by_metric = [comparison.qualities[metric] for metric in METRICS]
        for i, obj in enumerate(comparison.objects):
            ssim, lpips = ({m: q[m].per_object[i] for m in methods} for q in by_metric)
            scores = {m: float(ssim[m] + 1 - lpips[m]) / 2 for m in methods}
            name = f"{comparison.class_name}/{obj}"
            estimate = estimates[name, comparison.condition]
            clouds.append(ScoredCloud(name, comparison.condition, estimate, scores))
    return clouds


def _is_candidate(method_id: str) -> bool:
    method = find_method(method_id)
    return method.color == "none" and method.trained_on != "chairs" and method.kind != "reference"


def _estimates(run: ScoredRun) -> dict[tuple[str, str], CloudEstimate]:
    """Return the estimates of the run's clouds, made again, by object and condition."""
    names = [tuple(name.split("/", 1)) for name in run.manifest["objects"]]
    objects = ((class_name, obj) for class_name, obj in names)
    protocol = stored_protocol(run.manifest, objects, (FLOOR,), run.manifest["conditions"])
    return {
        (f"{job.name.class_name}/{job.name.object_id}", job.name.condition): estimate_of(
            cloud_of(job)
        )
        for job in plan(protocol).method_jobs
    }


def read_costs(files: Iterable[Path]) -> dict[tuple[str, str], float]:
    """Return the milliseconds of one view of a new cloud from tables of the frontier."""
    costs: dict[tuple[str, str], float] = {}
    for path in files:
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                if row["views"] == "1" and row["cost_ms"]:
                    costs.setdefault((row["condition"], row["method"]), float(row["cost_ms"]))
    return costs


def check_costs(clouds: Sequence[ScoredCloud], costs: Costs) -> None:
    """Raise BadInput where a method of the run has no cost at a condition."""
    pairs = {(cloud.condition, method) for cloud in clouds for method in cloud.scores}
    if missing := sorted(pairs - costs.keys()):
        conditions = ",".join(dict.fromkeys(condition for condition, _ in missing))
        methods = ",".join(dict.fromkeys(method for _, method in missing))
        raise BadInput(
            f"no cost of {methods} at {conditions}; measure them, 'bench run --suite "
            f"speed-accuracy --methods {methods} --conditions {conditions} --out DIR', and give "
            "--costs DIR/tables/frontier.csv, too"
        )


def fit(clouds: Sequence[ScoredCloud], costs: Costs) -> AutoTable:
    """Return the table of these clouds."""
    return AutoTable(
        threshold(clouds),
        clean=_cells([cloud for cloud in clouds if cloud.clean], costs),
        noisy=_cells([cloud for cloud in clouds if not cloud.clean], costs),
    )


def threshold(clouds: Sequence[ScoredCloud]) -> float:
    """Return the noise in spacings that tells noisy from clean clouds with the fewest errors."""
    noise = np.array([cloud.estimate.noise / cloud.estimate.spacing for cloud in clouds])
    clean = np.array([cloud.clean for cloud in clouds])
    values = np.unique(noise)
    tried = (values[:-1] + values[1:]) / 2
    errors = [int(((noise > value) == clean).sum()) for value in tried]
    best = tried[np.array(errors) == min(errors)]
    return round(float(np.median(best)), 3)


def _cells(clouds: Sequence[ScoredCloud], costs: Costs) -> dict[int, tuple[Candidate, ...]]:
    cells = {}
    for points in sorted({cloud.estimate.points for cloud in clouds}, reverse=True):
        of_cell = [cloud for cloud in clouds if cloud.estimate.points == points]
        conditions = {cloud.condition for cloud in of_cell}
        cells[points] = worth_their_cost(
            Candidate(
                method,
                round(float(np.mean([cloud.scores[method] for cloud in of_cell])), 4),
                round(max(costs[condition, method] for condition in conditions), 1),
            )
            for method in of_cell[0].scores
        )
    return cells


def worth_their_cost(candidates: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the candidates, the best first, without those that cost no less than a better one."""
    kept: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda c: (-c.score, c.cost_ms, c.method)):
        if not kept or candidate.cost_ms < kept[-1].cost_ms:
            kept.append(candidate)
    return tuple(kept)


def gain(clouds: Sequence[ScoredCloud], costs: Costs, budget_ms: float | None) -> dict[str, object]:
    """Return the row of a budget: what `auto` gains where each object is left out of its table."""
    within = {
        cloud.condition: [m for m in cloud.scores if _affordable(costs, cloud, m, budget_ms)]
        for cloud in clouds
    }
    single = _best_single(clouds, within)
    tables = {
        name: fit([cloud for cloud in clouds if cloud.obj != name], costs)
        for name in dict.fromkeys(cloud.obj for cloud in clouds)
    }
    scores, over = [], 0
    for cloud in clouds:
        if not within[cloud.condition]:
            continue
        try:
            method = tables[cloud.obj].choose(cloud.estimate, budget_ms).method
        except BadInput:  # it was taken for a cloud on which all methods cost more
            continue
        over += method not in within[cloud.condition]
        best = max(cloud.scores[m] for m in within[cloud.condition])
        scores.append((cloud.scores[single] if single else np.nan, cloud.scores[method], best))
    lowest, chosen, oracle = np.mean(scores, axis=0) if scores else (np.nan,) * 3
    closed = (chosen - lowest) / (oracle - lowest) if oracle > lowest else np.nan
    return {
        "budget": "none" if budget_ms is None else f"{budget_ms:g}",
        "single": single or "",
        "single_score": _number(lowest, 4),
        "auto_score": _number(chosen, 4),
        "oracle_score": _number(oracle, 4),
        "closed": _number(closed, 2),
        "over": _number(over / len(scores) if scores else np.nan, 3),
        "refused": _number(1 - len(scores) / len(clouds), 3),
    }


def _affordable(costs: Costs, cloud: ScoredCloud, method: str, budget_ms: float | None) -> bool:
    return budget_ms is None or costs[cloud.condition, method] <= budget_ms


def _best_single(clouds: Sequence[ScoredCloud], within: Mapping[str, Sequence[str]]) -> str | None:
    """Return the best method that is within the budget at all conditions that have such a one."""
    possible = [cloud for cloud in clouds if within[cloud.condition]]
    if not possible:
        return None
    always = [
        m for m in clouds[0].scores if all(m in within[cloud.condition] for cloud in possible)
    ]
    means = {m: float(np.mean([cloud.scores[m] for cloud in possible])) for m in always}
    return max(means, key=lambda m: means[m]) if means else None


def _number(value: float, digits: int) -> str:
    return "" if np.isnan(value) else f"{round(value, digits) + 0.0:.{digits}f}"  # no minus zero


def source_text(table: AutoTable, about: Sequence[str]) -> str:
    """Return the module with a table."""
    lines = [
        '"""The measured table of `auto`. `python -m studies.auto_table` writes this file.',
        "",
        *(line for text in about for line in textwrap.wrap(text, WIDTH)),
        '"""',
        "",
        "from bench.catalogue.auto import AutoTable, Candidate",
        "",
        "TABLE = AutoTable(",
        f"    noisy_from={table.noisy_from},",
    ]
    for name, cells in (("clean", table.clean), ("noisy", table.noisy)):
        lines.append(f"    {name}={{")
        for points, candidates in cells.items():
            lines.append(f"        {points}: (")
            lines += [
                f'            Candidate("{c.method}", {c.score}, {c.cost_ms}),' for c in candidates
            ]
            lines.append("        ),")
        lines.append("    },")
    return "\n".join([*lines, ")", ""])


def about_run(run: ScoredRun, clouds: Sequence[ScoredCloud]) -> list[str]:
    """Return lines on the origin of a table."""
    m = run.manifest
    return [
        f"Scores: `bench run --suite {m['suite']} --dataset {m['dataset']} --truth grey`, "
        f"{len(m['objects'])} objects, {m['views']} views each, at {', '.join(m['conditions'])}.",
        f"Candidates: {', '.join(clouds[0].scores)}.",
        "The score is the mean of `ssim` and 1 - `lpips`, more is better. The cost is of one view "
        "of a new cloud in milliseconds, on one thread of one machine "
        "(results/docs/auto-costs.csv). Methods that cost no less than a better one are left out.",
    ]


def _csv(fields: Sequence[str], rows: Iterable[Mapping[str, object]]) -> bytes:
    return csv_text(fields, ([row[name] for name in fields] for row in rows)).encode()


def main() -> None:
    """Read a run and costs from the command line."""
    parser = argparse.ArgumentParser(description="The table of auto.")
    parser.add_argument("directory", type=Path)
    parser.add_argument(
        "--costs", type=Path, action="append", help=f"frontier tables; default {COSTS.name}"
    )
    options = parser.parse_args()
    run = read_scored(options.directory)
    clouds = read_clouds(run)
    costs = read_costs(options.costs or [COSTS])
    check_costs(clouds, costs)
    gains = [gain(clouds, costs, budget) for budget in BUDGETS_MS]
    used = sorted({(cloud.condition, method) for cloud in clouds for method in cloud.scores})
    rows = [(condition, "1", method, costs[condition, method]) for condition, method in used]
    write_whole(COSTS, _csv(COST_FIELDS, (dict(zip(COST_FIELDS, r, strict=True)) for r in rows)))
    write_whole(RESULTS / "auto.csv", _csv(GAIN_FIELDS, gains))
    write_whole(TABLE, source_text(fit(clouds, costs), about_run(run, clouds)).encode())
    print(markdown(GAIN_FIELDS, [[str(row[name]) for name in GAIN_FIELDS] for row in gains], 2))


if __name__ == "__main__":
    main()
