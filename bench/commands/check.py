"""`bench check`: a run against golden values, against itself, or against the paper's claims."""

from __future__ import annotations

import json
import math
import secrets
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal
from xml.etree import ElementTree

import typer

from bench.commands.options import OptionSpec, options_from_dataclass, path_argument
from bench.records.folder import locked_run
from bench.tables.markdown import visible
from data_prep.failures import BadInput, CannotWrite

if TYPE_CHECKING:
    from bench.check.golden import CheckResult
    from bench.check.objects import Widths

_SEEDS = 2**32  # the number of seeds that --again draws one of: as many as fill 32 bits


@dataclass(frozen=True)
class _CheckOptions:
    """The options of `bench check`."""

    golden: Path | None = None
    bless: Path | None = None
    tolerance: tuple[str, ...] | None = None
    strict: bool = False
    format: Literal["text", "json", "junit"] = "text"
    claims: bool = False
    methods: tuple[str, ...] | None = None
    again: float | None = None
    seed: int | None = None

    @property
    def golden_options(self) -> list[str]:
        """Return the flags given that only a comparison with golden values uses."""
        defaults = _CheckOptions()
        named = ("golden", "bless", "tolerance", "strict", "format")
        return [f"--{name}" for name in named if getattr(self, name) != getattr(defaults, name)]


@options_from_dataclass(
    _CheckOptions,
    {
        "golden": "A file of golden values of your own, from 'bench check DIR --bless FILE'. "
        "Default: those of the default runs, in results/golden.",
        "bless": "Write this run's values to a file of golden values; given the folder "
        "results/golden, replace those of the suite. Default: compare.",
        "tolerance": OptionSpec(
            "How far a value of an object may move from that in --golden, comma-separated. "
            "Default: the tolerances in docs/maintaining.md.",
            metavar="METRIC=X",
        ),
        "strict": "Compare objects to the last digit in another environment, too. Default: with "
        "wider tolerances, which are printed.",
        "format": "Format of the verdict on golden values.",
        "claims": "Check the paper's claims on the runs instead of golden values.",
        "methods": "Methods, comma-separated, for which --claims tests the claims about pc2pix. "
        "Default: all variants of pc2pix.",
        "again": OptionSpec(
            "Share of the jobs to compute again and to compare, above 0 and at most 1. Default: "
            "none.",
            metavar="SHARE",
        ),
        "seed": "Seed that chooses the jobs of --again. Default: another one each time, which is "
        "printed.",
    },
)
def check(
    options: _CheckOptions,
    directories: Annotated[
        list[Path], path_argument("DIR", "The folder of a finished run; several with --claims.")
    ],
) -> None:
    """Compare a run with golden values, or with itself. Exit 0 if all agree, else 1.

    A value beyond its tolerance is "moved (better)" or "moved (worse)"; both exit 1.
    """
    from bench.check import golden as checks
    from bench.check.deviations import moved_path, write_deviations

    again, seed, given = options.again, options.seed, options.golden_options
    if again is not None and (given or options.claims):
        conflicting = [*given, "--claims"] if options.claims else given
        raise BadInput(f"--again: compares a run with itself; leave out {', '.join(conflicting)}")
    if seed is not None and again is None:
        raise BadInput("--seed: chooses the jobs that are computed again; give --again with it")
    if options.claims and given:
        raise BadInput(f"--claims: compares with the paper; leave out {', '.join(given)}")
    if options.claims:
        _check_claims(list(dict.fromkeys(directories)), options.methods or ())
        return
    if options.methods is not None:
        raise BadInput(
            "--methods: golden values are compared for all methods; give --claims with it, or "
            "leave out --methods"
        )
    if len(directories) > 1:
        raise BadInput(
            f"{len(directories)} folders: golden values are compared with one run; give one "
            "folder, or --claims, which takes several"
        )
    (directory,) = directories
    if again is not None:
        _check_again(directory, again, secrets.randbelow(_SEEDS) if seed is None else seed)
        return
    if options.bless is not None:
        if others := [option for option in given if option != "--bless"]:
            raise BadInput(f"--bless: writes golden values; leave out {', '.join(others)}")
        for path in checks.bless(directory, options.bless):
            print(f"golden values written to {path}")
        return
    if options.tolerance and options.golden is None:
        raise BadInput(
            "--tolerance: the golden values of results/golden have tolerances of their own; give "
            "--golden FILE with it, or leave out --tolerance"
        )
    widths = _widths(options.tolerance or (), options.strict)
    verdict = checks.check(directory, widths, options.golden)
    try:
        drawn = None
        if verdict.moved or moved_path(directory).exists():
            with locked_run(directory):
                drawn = write_deviations(directory, verdict.moved, ours=options.golden is None)
    except CannotWrite as error:  # the verdict counts also where the folder is read-only
        drawn = None
        print(f"bench: {error}", file=sys.stderr)
    if options.format == "text":
        _print_verdict(verdict, drawn)
    elif options.format == "json":
        print(_as_json(directory, verdict))
    else:
        print(_as_junit(directory, verdict))
    if verdict.differing:
        raise typer.Exit(1)


def _widths(given: Sequence[str], strict: bool) -> Widths:
    """Return the tolerances given as METRIC=X. Raises BadInput for one that cannot be used."""
    from bench.check.objects import Widths
    from bench.check.tolerances import OBJECT_RENDERING

    by_metric: dict[str, float] = {}
    for text in given:
        metric, _, number = text.partition("=")
        if metric not in OBJECT_RENDERING:
            raise BadInput(
                f"--tolerance {text}: {metric!r} is no metric of golden values; give METRIC=X with "
                f"one of {', '.join(OBJECT_RENDERING)}"
            )
        try:
            width = float(number)
        except ValueError:
            width = math.nan
        if not 0 <= width < math.inf:
            raise BadInput(f"--tolerance {text}: must be a number from 0, as in {metric}=0.01")
        if by_metric.setdefault(metric, width) != width:
            raise BadInput(
                f"--tolerance {text}: {metric} has {by_metric[metric]:g} already; give each metric "
                "one tolerance"
            )
    return Widths(by_metric, strict)


def _print_verdict(verdict: CheckResult, drawn: Path | None) -> None:
    for line in verdict.remarks:
        print(visible(line))
    first, others = verdict.by_headline
    for line in (*first, *others):
        print(visible(line))
    if verdict.headline:
        print(
            f"{' and '.join(verdict.headline_metrics)}: {verdict.headline} values, "
            f"{len(first)} moved; others: {verdict.compared - verdict.headline} values, "
            f"{len(others)} moved"
        )
    print(f"{verdict.compared} golden values compared, {len(verdict.differing)} moved")
    if drawn:
        print(f"the objects that moved most: {drawn}")


def _as_json(directory: Path, verdict: CheckResult) -> str:
    """Return a verdict as JSON; a value that is missing or not finite is null."""

    def finite(number: float) -> float | None:
        return number if math.isfinite(number) else None

    told = {
        "run": visible(str(directory)),
        "agrees": not verdict.differing,
        "compared": verdict.compared,
        "moved": [
            {
                "method": comparison.method,
                "condition": comparison.condition,
                "metric": comparison.metric,
                "problem": comparison.problem,
                "better": comparison.better,
            }
            for comparison in verdict.comparisons
            if comparison.problem
        ],
        "others": verdict.others,
        "objects": [
            {
                **deviation.item._asdict(),
                "metric": deviation.metric,
                "value": finite(deviation.actual),
                "golden": finite(deviation.golden),
                "tolerance": deviation.allowed,
            }
            for deviation in verdict.moved
        ],
        "remarks": verdict.remarks,
    }
    return json.dumps(told, indent=1, ensure_ascii=False)


def _as_junit(directory: Path, verdict: CheckResult) -> str:
    """Return a verdict as JUnit's XML: a test case for each metric of a method at a condition.

    Characters that XML cannot hold are escaped in all names and lines.
    """
    suite = ElementTree.Element("testsuite", name=visible(f"bench check {directory}"))
    for compared in verdict.comparisons:
        method = visible(compared.method)
        name = visible(f"{compared.metric} at {compared.condition}")
        case = ElementTree.SubElement(suite, "testcase", classname=method, name=name)
        if compared.problem:
            kind, said = compared.verdict, visible(str(compared))
            ElementTree.SubElement(case, "failure", type=kind, message=said)
    for line in verdict.others:
        case = ElementTree.SubElement(suite, "testcase", classname="tables", name=visible(line))
        ElementTree.SubElement(case, "failure", message=visible(line))
    remarks = "\n".join(map(visible, verdict.remarks))
    ElementTree.SubElement(suite, "system-out").text = remarks
    suite.set("tests", str(len(verdict.comparisons) + len(verdict.others)))
    suite.set("failures", str(len(verdict.differing)))
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True)


def _check_again(directory: Path, share: float, seed: int) -> None:
    """Compute a share of a run's jobs again; print those with other results, and a summary.

    Raises typer.Exit where a job has other results.
    """
    from bench.check.again import check_again

    result = check_again(directory, share, seed)
    for line in result.differing:
        print(visible(f"DIFFERS {line}"))
    if result.differing:
        verdict = f"{len(result.differing)} differ"
    elif result.same_environment:
        verdict = "all equal"
    else:
        verdict = "all within tolerances"
    print(f"{result.computed} of {result.total} jobs computed again: {verdict}")
    if result.differing:
        raise typer.Exit(1)


def _check_claims(directories: list[Path], methods: Sequence[str]) -> None:
    """Print the checklist of the paper's claims, and write it into the first run's folder."""
    from bench.check.checklist import check_claims, to_markdown, write_checklist

    checklist = check_claims(directories, methods)
    try:
        with locked_run(directories[0]):
            told = f"written to {write_checklist(checklist, directories[0])}"
    except CannotWrite as error:  # the verdicts count also where the folder is read-only
        told = f"bench: {error}"
    print(to_markdown(checklist))
    print(told, file=sys.stderr)
