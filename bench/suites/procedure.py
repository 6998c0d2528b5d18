"""The request for a run, and its result, of suites with a procedure of their own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.catalogue.methods import find_method
from bench.catalogue.suites import Procedure
from bench.running.extension import with_methods_there
from bench.running.options import Options, refuse, refuse_absent_gpu, refuse_counts
from bench.tables.table import Table


@dataclass(frozen=True)
class SuiteRun:
    """A finished run of a suite.

    tables   for people
    printed  the output of `bench run`
    summary  its last line
    """

    directory: Path
    tables: tuple[Table[Any], ...]
    printed: list[str]
    summary: str


def methods_of(
    options: Options,
    suite: Procedure,
    **meaningless: str,
) -> tuple[str, ...]:
    """Return the methods of a run, each once, in the order of the request or else of the suite.

    An earlier run in the folder keeps its methods.

    meaningless  options that this suite does not take, and why

    Raises BadInput for a meaningless option, for counts out of their range, for a missing GPU and
    for unknown methods.
    """
    given = vars(options)
    meaningless = {
        "budget": "which is not done object by object",
        "truth": "which has no true images in grey",
        "metrics": "which does not compare images with true ones",
        **meaningless,
    }
    refuse(suite.id, [(name, given[name], why) for name, why in meaningless.items()])
    refuse_counts(options)
    refuse_absent_gpu(options)
    methods = tuple(dict.fromkeys(options.methods or suite.methods))
    for method in methods:
        find_method(method)
    return with_methods_there(options, suite.id, methods, suite.methods)
