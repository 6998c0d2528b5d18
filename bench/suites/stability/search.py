"""The search for extremes: generated inputs, round by round, and the smallest that fail.

A round generates inputs from a seed, and workers examine them. Each new kind of failure is reduced
by hypothesis to a small input, and is known from then on, so that the search goes on behind it.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from typing import Any

from bench.catalogue.suites import Limits
from bench.running.isolation import TaskPool, WorkerFailure
from bench.suites.stability.oracles import Examination, SearchSubject, examine
from data_prep.failures import MissingDependency
from data_prep.progress import PLAIN_EVERY_S, log

ROUND = 500  # inputs
REPEATED = 5  # inputs of a round that the next one examines once more, after others
SEED_STEP = 1_000_003  # between rounds, so that searches with seeds 0 and 1 share none
LIMITS = Limits(time_s=60.0, memory_gib=4.0)  # of one input, as of a case
MOST_KEPT = 200  # rounds, some 2 kB an input
REDUCTION_S = 60.0  # for the reduction of one kind of failure
# Not the digits of a name: float32, SIGUSR1.
_NUMBER = re.compile(r"(?<![\w.])[-+]?(0x[0-9a-f]+|\d(,?\d)*(\.\d+)?(e[-+]?\d+)?)(?!\w)", re.I)

_KEPT: dict[tuple[Any, int], list[Any]] = {}  # inputs of a round by strategy and seed


@dataclass(frozen=True)
class FailingInput:
    """The smallest input found of one kind of failure.

    Attributes
    ----------
    seed : int
        Seed of the round; `--seed` finds the failure at once with it.
    seconds, inputs
        Time and number of inputs until the first failure of this kind.
    """

    input: Any
    problem: str
    seed: int
    seconds: float
    inputs: int


@dataclass
class SearchResult:
    """The result of the search on one subject.

    Attributes
    ----------
    inputs, refused : int
        Number of inputs, and how many of them were refused by name.
    failing : dict
        The smallest input by kind of failure.
    """

    subject: str
    seconds: float = 0.0
    inputs: int = 0
    refused: int = 0
    failing: dict[str, FailingInput] = field(default_factory=dict)


def kind_of(problem: str) -> str:
    """Return a problem with its numbers replaced; failures of one kind have the same."""
    return _NUMBER.sub("#", problem)


def require_hypothesis() -> None:
    """Raise MissingDependency where hypothesis is not installed."""
    try:
        import hypothesis
    except ImportError as error:
        raise MissingDependency(
            "--search: hypothesis is not installed; pip install 'pc2pix-bench[search]'"
        ) from error
    del hypothesis


def search(
    subject: SearchSubject,
    seconds: float,
    seed: int,
    workers: int,
    limits: Limits = LIMITS,
    clock: Callable[[], float] = time.monotonic,
) -> SearchResult:
    """Search a subject for so many seconds, plus the reduction of what fails at the end."""
    with closing(TaskPool(examine, workers, limits)) as pool:
        rounds = Rounds(subject, seconds, pool, clock)
        while rounds.result.seconds < seconds:
            rounds.carry_out(seed)
            seed += SEED_STEP
    return rounds.result


class Rounds:
    """The rounds of a search, with the result so far."""

    def __init__(
        self,
        subject: SearchSubject,
        seconds: float,
        pool: TaskPool[tuple[SearchSubject, Any], Examination],
        clock: Callable[[], float],
    ) -> None:
        self.result = SearchResult(subject.id)
        self._subject, self._pool = subject, pool
        self._seconds, self._clock = seconds, clock
        self._start = self._logged = clock()
        self._seed = 0
        self._under_way: dict[str, Any] = {}
        self._findings: dict[str, Examination] = {}  # of this round, by the text of the input
        self._digests: dict[str, str] = {}  # of those inputs of the round before that are repeated
        self._repeated: list[Any] = []

    def carry_out(self, seed: int) -> None:
        """Examine the inputs of a seed, and reduce each new kind of failure."""
        self._seed, self._findings = seed, {}
        drawn: list[Any] = []

        def take(given: Any) -> None:
            if self._elapsed() >= self._seconds:
                raise _TimeOver
            self._take(given)
            drawn.append(given)

        with suppress(_TimeOver):
            for given in (*self._repeated, *_KEPT.get((self._subject.inputs(), seed), ())):
                take(given)
            if len(drawn) == len(self._repeated):
                generate(self._subject, seed, take)
                _keep(self._subject, seed, drawn[len(self._repeated) :])
        while self._under_way:
            self._wait()
        for kind, failing in self.result.failing.items():
            if failing.seed == seed:
                self.result.failing[kind] = self._reduced(failing)
        shown = [given for given in drawn if self._digest(given)]
        self._repeated = shown[-REPEATED:]
        self._digests = {repr(given): self._digest(given) for given in self._repeated}
        self.result.seconds = self._elapsed()
        self._report()

    def _elapsed(self) -> float:
        return self._clock() - self._start

    def _digest(self, given: Any) -> str:
        return self._findings.get(repr(given), Examination()).digest

    def _report(self) -> None:
        if self._clock() - self._logged > PLAIN_EVERY_S:
            self._logged, result = self._clock(), self.result
            log(
                f"{result.subject}: {result.inputs:,} inputs, {len(result.failing)} kinds of "
                f"failure, {result.seconds:.0f} s of {self._seconds:.0f} s"
            )

    def _take(self, given: Any) -> None:
        """Give an input to a worker, unless the round had the same before."""
        text = repr(given)
        if text in self._findings or text in self._under_way:
            return
        while len(self._under_way) >= self._pool.capacity:
            self._wait()
        self._pool.submit((self._subject, given))
        self._under_way[text] = given

    def _wait(self) -> None:
        """Wait for results, and count them."""
        result = self.result
        for given, finding in self._ended():
            result.inputs += 1
            result.refused += bool(finding.refused)
            kind = kind_of(finding.problem)
            if kind and kind not in result.failing:
                log(f"{result.subject}: {finding.problem}")
                result.failing[kind] = FailingInput(
                    given, finding.problem, self._seed, self._elapsed(), result.inputs
                )

    def _ended(self) -> list[tuple[Any, Examination]]:
        ended = []
        for (_, given), finding in self._pool.wait_any():
            text = repr(given)
            self._under_way.pop(text, None)
            if isinstance(finding, WorkerFailure):
                finding = Examination(finding.reason)
            before = self._digests.get(text, "")
            if before and not finding.problem and finding.digest != before:
                finding = Examination("another result after other inputs")
            self._findings[text] = finding
            ended.append((given, finding))
        return ended

    def _reduced(self, failing: FailingInput) -> FailingInput:
        """Return the smallest input that fails alike, as far as the time goes.

        hypothesis generates the round again, up to the first input that fails so, and reduces it.
        """
        wanted, until = kind_of(failing.problem), self._clock() + REDUCTION_S
        smallest = failing

        def fail_alike(given: Any) -> None:
            nonlocal smallest
            text = repr(given)
            if text not in self._findings:
                if self._clock() > until:
                    return
                self._pool.submit((self._subject, given))
                self._ended()
            if kind_of(self._findings[text].problem) == wanted:
                smallest = replace(failing, input=given, problem=self._findings[text].problem)
                raise _FailsAlike

        with suppress(_FailsAlike):
            generate(self._subject, failing.seed, fail_alike, reduces=True)
        return smallest


def _keep(subject: SearchSubject, seed: int, inputs: list[Any]) -> None:
    """Keep the inputs of a round for other subjects: to generate them takes as long as to draw."""
    _KEPT[subject.inputs(), seed] = inputs
    if len(_KEPT) > MOST_KEPT:
        del _KEPT[next(iter(_KEPT))]


class _TimeOver(Exception):
    """The end of a round, as the time of the search is over."""


class _FailsAlike(Exception):
    """The failure that hypothesis reduces the input of."""


def generate(
    subject: SearchSubject, seed: int, take: Callable[[Any], object], reduces: bool = False
) -> None:
    """Call `take` with the inputs of a round, the same for the same seed; some may be equal.

    With `reduces`, the inputs after one for which `take` raises are smaller and smaller ones.
    """
    import hypothesis
    from hypothesis import HealthCheck, Phase

    checks: Any = HealthCheck  # an enum, which pyright does not see

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=ROUND,
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink) if reduces else (Phase.generate,),
        suppress_health_check=tuple(checks),
        report_multiple_bugs=False,
        print_blob=False,
    )
    @hypothesis.given(subject.inputs())
    def run(given: Any) -> None:
        take(given)

    run()
