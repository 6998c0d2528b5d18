"""The commands on finished runs: merge, table, report, check, recommend."""

from __future__ import annotations

import math
import secrets
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from bench.analysis.comparison import Estimate, milliseconds
from bench.analysis.frame import Run, read_run
from bench.analysis.paired import verdicts_of
from bench.analysis.recommend import (
    ALTERNATIVES,
    SSIM,
    Advice,
    MethodOption,
    Recommendation,
    Requirements,
    at_condition,
    make_request,
)
from bench.analysis.recommend import recommend as best_methods
from bench.catalogue.metrics import declared_metric
from bench.catalogue.suites import TRUTHS
from bench.commands.options import FormatOption, RunDirectory, names, path_argument, path_option
from bench.tables.build import how_timed
from bench.tables.grid import FEWER, MOVED, measured
from bench.tables.markdown import visible
from bench.tables.terminal import laid_out, line_width
from data_prep.failures import BadInput, CannotWrite

MOST_SEED = 2**32


def merge(
    directories: Annotated[
        list[Path], path_argument("DIR...", "The folders of all shards of a run.")
    ],
    out: Annotated[Path, path_option("The folder of the whole run.")],
    format_: FormatOption = None,
) -> None:
    """Join shards ('bench run --shard k/N') to the whole run."""
    from bench.commands.publish import merge_shards, print_outputs

    merged = merge_shards(directories, out)
    print_outputs(merged.outputs, format_)
    print(
        f"{merged.jobs} jobs of {len(directories)} shards, {merged.copied} copied now\n"
        f"results in {out}",
        file=sys.stderr,
    )


def table(directory: RunDirectory, format_: FormatOption = None) -> None:
    """Make the tables of a run again, from its records."""
    from bench.commands.publish import print_outputs
    from bench.tables.build import write_outputs

    print_outputs(write_outputs(read_run(directory)), format_)


def report(
    directories: Annotated[
        list[Path], path_argument("DIR...", "The folder of a finished run, or of several.")
    ],
    out: Annotated[
        Path | None,
        path_option(
            "The HTML file; of several runs a folder. Default: where the runs are.", "--out", "-o"
        ),
    ] = None,
) -> None:
    """Make an HTML page of a run: tables, curves, images, worst cases, failures; offline.

    Of several runs a page each, and an index over them: their leaderboards by data set and truth.
    """
    from bench.report.build import write_report
    from bench.report.index import write_index
    from bench.tables.build import make_outputs

    if len(directories) > 1:
        print(write_index(directories, out))
    else:
        print(write_report(make_outputs(read_run(directories[0])), out))


def check(
    directories: Annotated[
        list[Path], path_argument("DIR", "The folder of a finished run; several with --claims.")
    ],
    bless: Annotated[
        bool,
        typer.Option("--bless", help="Replace the golden values by this run's. Default: compare."),
    ] = False,
    claims: Annotated[
        bool,
        typer.Option(
            "--claims", help="Check the paper's claims on the runs instead of golden values."
        ),
    ] = False,
    methods: Annotated[
        str | None,
        typer.Option(help="Methods, comma-separated, for --claims. Default: all pc2pix."),
    ] = None,
    again: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Part of the jobs to compute again and to compare, over 0 to 1. Default: none.",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Which jobs, for --again. Default: another each time, printed."),
    ] = None,
) -> None:
    """Compare a run with the golden values, or with itself. Exit 0 if all agree, else 1."""
    from bench.checking import golden as checks
    from bench.commands.golden_deviation import write_deviations

    if again is not None and (bless or claims):
        raise BadInput("--again: compares a run with itself; leave --bless and --claims")
    if seed is not None and again is None:
        raise BadInput("--seed: chooses the jobs that are computed again; give --again with it")
    if claims:
        _check_claims(directories, names(methods) or ())
        return
    if methods is not None:
        raise BadInput("--methods: golden values are of all methods; give --claims with it")
    if len(directories) > 1:
        raise BadInput(f"{len(directories)} folders: give one, or several with --claims")
    (directory,) = directories
    if again is not None:
        _check_again(directory, again, secrets.randbelow(MOST_SEED) if seed is None else seed)
        return
    if bless:
        for path in checks.bless(directory):
            print(f"golden values written to {path}")
        return
    verdict = checks.check(directory)
    for line in verdict.remarks:
        print(line)
    first, others = verdict.by_headline
    for line in (*first, *others):
        print(f"REGRESSION {line}")
    if verdict.headline:
        print(
            f"{' and '.join(verdict.headline_metrics)}: {verdict.headline} values, "
            f"{len(first)} regressions; others: {verdict.compared - verdict.headline} values, "
            f"{len(others)} regressions"
        )
    print(f"{verdict.compared} golden values compared, {len(verdict.regressions)} regressions")
    try:
        drawn = write_deviations(directory, verdict.moved)
    except CannotWrite as error:  # the verdict counts also where the folder is read-only
        drawn = None
        print(f"bench: {error}", file=sys.stderr)
    if drawn:
        print(f"the objects that moved most: {drawn}")
    if verdict.regressions:
        raise typer.Exit(1)


def _check_again(directory: Path, share: float, seed: int) -> None:
    """Print a line for each job whose results are others than in the run, and how many are not."""
    from bench.checking.again import check_again

    result = check_again(directory, share, seed)
    for line in result.differing:
        print(visible(f"DIFFERS {line}"))
    agree = "equal" if result.same_environment else "within tolerances"
    verdict = f"{len(result.differing)} differ" if result.differing else f"all {agree}"
    print(f"{result.computed} of {result.total} jobs computed again: {verdict}")
    if result.differing:
        raise typer.Exit(1)


def _check_claims(directories: list[Path], methods: Sequence[str]) -> None:
    """Print the checklist, and write it into the first folder."""
    from bench.checking.checklist import check_claims, to_markdown, write_checklist

    checklist = check_claims(directories, methods)
    print(to_markdown(checklist))
    print(f"written to {write_checklist(checklist, directories[0])}", file=sys.stderr)


def recommend(
    directory: RunDirectory,
    budget_ms: Annotated[
        float | None,
        typer.Option(help="Milliseconds for a cloud with all its images. Default: no limit."),
    ] = None,
    views: Annotated[
        int | None, typer.Option(help="Images of a cloud. Default: as many as in the run.")
    ] = None,
    condition: Annotated[
        str | None, typer.Option(help="A condition of the run, in full. Default: all, in short.")
    ] = None,
    min_ssim: Annotated[
        float | None, typer.Option(help="Least SSIM that is good enough, 0 to 1. Default: none.")
    ] = None,
    metric: Annotated[
        str | None,
        typer.Option(
            help="Metrics of images that judge within the budget, comma-separated. Default: "
            "ssim-object, lpips."
        ),
    ] = None,
) -> None:
    """Recommend a method for a budget, or for a quality. Exit 1 if no method meets it."""
    run = read_run(directory).with_further(names(metric) or ())
    manifest = run.manifest
    request = make_request(manifest["views"] if views is None else views, budget_ms, min_ssim)
    metrics = _judging_metrics(run, names(metric))
    measured = [*metrics, SSIM] if min_ssim is not None and SSIM not in metrics else metrics
    compared = at_condition(run.compared(measured), condition)
    verdicts = verdicts_of(run, measured)
    given = [best_methods(comparison, request, metrics, verdicts) for comparison in compared]
    lines = advice_lines(given, request, manifest["views"], in_full=condition is not None)
    head = f"{how_timed(manifest)} Scores are against {TRUTHS[run.suite.truth]}."
    print("\n".join(laid_out((head, *lines), line_width())))
    if not all(recommendation.meets(request) for recommendation in given):
        raise typer.Exit(1)


def _judging_metrics(run: Run, wanted: Sequence[str] | None) -> list[str]:
    """Return the wanted metrics, else those of the headline that the run has.

    Raises BadInput for a metric that is none of images, or that the run does not have.
    """
    further = [metric for metric in wanted or () if declared_metric(metric)]
    images = [*run.suite.image_metrics, *run.suite.detail_metrics, *further]
    measured = run.measured(sorted(images, key=lambda metric: metric not in run.suite.headline))
    for name in wanted or ():
        if name not in measured:
            raise BadInput(f"--metric {name}: cannot judge here; there are {', '.join(measured)}")
    return list(wanted or run.headline or [SSIM])


def advice_lines(
    given: Sequence[Recommendation], request: Requirements, views_drawn: int, in_full: bool
) -> list[str]:
    """Return the lines for the budget and the minimum quality of each recommendation.

    `views_drawn` were drawn in a call when the costs were measured; `in_full` adds the alternatives
    and the regret.
    """
    lines = []
    if request.views != views_drawn:
        lines.append(
            f"Costs of {request.views} view{'s' * (request.views > 1)} are reckoned from the share "
            "of one; drawn in a call of their own they may differ."
        )
    several = len({recommendation.by_metric[0].class_name for recommendation in given}) > 1
    for recommendation in given:
        advice = recommendation.by_metric[0]
        name = advice.condition + f", {advice.class_name}" * several
        lines += [f"{visible(name)}: {line}" for line in _in_short(recommendation, request)]
        if in_full:
            lines += [f"  {line}" for line in _alternatives(recommendation, request)]
    return [*lines, *([f"{FEWER}."] if any(MOVED in line for line in lines) else [])]


def _in_short(recommendation: Recommendation, request: Requirements) -> list[str]:
    lines = []
    if request.budget_ms is not None:
        advices = recommendation.by_metric
        agreed = len({advice.best and advice.best.method for advice in advices}) == 1
        groups = [advices] if agreed else [(advice,) for advice in advices]
        lines += [
            _within_budget(group, request, request.budget_ms, "" if agreed else _by(group[0]))
            for group in groups
        ]
    if recommendation.by_ssim is not None and request.min_ssim is not None:
        lines.append(_good_enough(recommendation.by_ssim, request, request.min_ssim))
    return lines


def _by(advice: Advice) -> str:
    return f" by {advice.metric}"


def _alternatives(recommendation: Recommendation, request: Requirements) -> list[str]:
    lines = []
    if (by_ssim := recommendation.by_ssim) is not None:
        significant = (
            _text([(by_ssim, by_ssim.significant)], request) if by_ssim.significant else "none"
        )
        lines.append(f"surely that good, by the lower end of the interval: {significant}")
    for advice in recommendation.by_metric:
        by = _by(advice) * (len(recommendation.by_metric) > 1)
        if advice.below_blank:
            methods = ", ".join(map(visible, advice.below_blank))
            lines.append(f"below a white image{by}, no choice: {methods}")
        if advice.best is None:
            continue
        if request.budget_ms is None:
            lines.append(f"best at any cost{by}: {_text([(advice, advice.best)], request)}")
        for choice in advice.next:
            gap = _estimated(choice.gap, advice.metric, choice.method)
            lines.append(f"next{by}: {_text([(advice, choice)], request)}; behind by {gap}")
        regret, blind = (
            _estimated(value, advice.metric) for value in (advice.regret, advice.regret_blind)
        )
        lines.append(
            f"regret: {regret} {advice.metric} against the best of {advice.affordable} such "
            f"methods for each of {advice.objects} objects; {blind} where the method is chosen by "
            "the other objects"
        )
    return lines


def _within_budget(
    advices: Sequence[Advice], request: Requirements, budget_ms: float, by: str
) -> str:
    """Return the line for the budget, for metrics that choose the same method."""
    budget, first = f"{milliseconds(budget_ms)} ms", advices[0]
    if first.best is None:
        nearest = ""
        if first.cheapest:
            nearest = f"; the cheapest: {_text([(first, first.cheapest)], request)}"
        worse = " is better than a white image" if first.below_blank else ""
        return f"no method within {budget}{worse}{by}{nearest}"
    chosen = [(advice, advice.best) for advice in advices if advice.best]
    message = f"best within {budget}{by}: {_text(chosen, request)}"
    for advice in advices:
        if rivals := advice.undecided:
            more = f" and {len(rivals) - ALTERNATIVES} more" * (len(rivals) > ALTERNATIVES)
            by = _by(advice) * (len(advices) > 1)
            named = ", ".join(map(visible, rivals[:ALTERNATIVES]))
            message += f"; not shown to be ahead of {named}{more}{by}"
    if first.best.cost_ms.high > budget_ms:
        message += "; the interval of its cost reaches beyond the budget"
    return message


def _good_enough(advice: Advice, request: Requirements, min_ssim: float) -> str:
    least = f"ssim of at least {min_ssim:g}"
    if advice.by_mean is None:
        nearest = (
            f"; the nearest: {_text([(advice, advice.best_of_all)], request)}"
            if advice.best_of_all
            else ""
        )
        return f"no method with an {least}{nearest}"
    sure = advice.significant is not None and advice.significant.method == advice.by_mean.method
    message = (
        f"cheapest with an {least}, {'surely' if sure else 'on average'}: "
        f"{_text([(advice, advice.by_mean)], request)}"
    )
    if request.budget_ms is not None and advice.by_mean.cost_ms.value > request.budget_ms:
        message += "; over the budget"
    return message


def _text(chosen: Sequence[tuple[Advice, MethodOption]], request: Requirements) -> str:
    """Return a method with its quality by each metric, and its cost for the cloud and an image.

    A choice by SSIM is shown by the metrics that judge, too, and by these first.
    """
    choice = chosen[0][1]
    metrics = [advice.metric for advice, _ in chosen]
    shown = choice.qualities if metrics == [SSIM] else metrics
    qualities = ", ".join(
        f"{name} {_estimated(choice.qualities[name], name, choice.method)}" for name in shown
    )
    cost = f"{milliseconds(choice.cost_ms.value)} ms{_interval(choice.cost_ms, milliseconds)}"
    failed = f", {choice.n - choice.n_ok} of {choice.n} images failed" * (choice.n_ok < choice.n)
    image = milliseconds(choice.cost_ms.value / request.views)
    return f"{visible(choice.method)}, {qualities}, {cost} a cloud, {image} ms an image{failed}"


def _interval(estimate: Estimate, shown: Callable[[float], str]) -> str:
    if not math.isfinite(estimate.low):
        return ""
    return f" [{shown(estimate.low)}, {shown(estimate.high)}]"


def _estimated(estimate: Estimate, metric: str, *methods: str) -> str:
    cell = measured(estimate, metric, *methods)
    if cell.value is None:
        return "unknown"
    return cell.text + (" [{}, {}]".format(*cell.interval) if cell.interval else "")
