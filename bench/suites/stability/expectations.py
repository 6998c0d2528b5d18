"""Expected outcomes of each method on each case of the suite `stability`, and the verdict.

An expectation is an image, the image of the case's `like` to within a tolerance, a change of
stated size against that, or a failure of a stated name. For methods that nobody has stated anything
about (those of other packages) every image and every named failure is in order; only what has no
name is not: an exception of Python, a crash, a time or memory limit.

What a method made of a case is an observation: small values, taken from records and images. One
`Outcome` is one cell of a matrix cases x subjects, whatever the subject is: a method, a metric, a
number format.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.metrics.silhouette import foreground
from bench.records.artifacts import read_array
from bench.records.job import Job, Result
from bench.suites.stability.cases import CASES, Case


@dataclass(frozen=True)
class Observation:
    """The outcome of one method on one case, as measured.

    reason         why there are no images; empty where there are
    notes          what the method repaired on its way
    shown          share of the pixels that are not white, mean over the views; None without
    mean_change    mean absolute difference to the images of the case it should be like, in grey
                   levels 0..255; None where there is none, or no images of either
    most_change    the largest
    prepare_s, draw_s  as in a record; None without images
    """

    case: str
    method: str
    reason: str
    notes: str
    shown: float | None
    mean_change: float | None
    most_change: int | None
    prepare_s: float | None
    draw_s: float | None


def observe(jobs: Sequence[Job], result: Callable[[str], Result]) -> list[Observation]:
    """Return an observation for each job, in their order; `result` gives that of a key."""
    first = {job.key: result(job.key).records[0] for job in jobs}
    drawn = {(job.method, job.condition): job for job in jobs if first[job.key].outcome == "ok"}
    likes = {case.id: case.like for case in CASES}
    observed = []
    for job in jobs:
        record = first[job.key]
        shown = mean = most = None
        if (job.method, job.condition) in drawn:
            images = read_array(job.artifact)
            shown = float(foreground(images).mean())
            other = drawn.get((job.method, likes[job.condition] or ""))
            if other is not None:
                mean, most = _change(images, read_array(other.artifact))
        observed.append(
            Observation(
                case=job.condition,
                method=job.method,
                reason=record.reason,
                notes=record.notes,
                shown=shown,
                mean_change=mean,
                most_change=most,
                prepare_s=record.prepare_s,
                draw_s=record.draw_s,
            )
        )
    return observed


def _change(images: NDArray[np.uint8], like: NDArray[np.uint8]) -> tuple[float, int]:
    """Return the mean and largest absolute difference; a shorter `like` is repeated."""
    counterpart = like[np.arange(len(images)) % len(like)]
    difference = np.abs(images.astype(np.int16) - counterpart)
    return float(difference.mean()), int(difference.max())


Kind = Literal["holds", "refused", "differs", "contained", "unexpected"]
KINDS: dict[Kind, str] = {  # and what they mean, for people
    "holds": "the stated value or invariant",
    "refused": "a named failure, as stated",
    "differs": "the invariant does not hold, as stated",
    "contained": "a defect of a library, as stated; it costs its own item",
    "unexpected": "none of what was stated",
}


@dataclass(frozen=True)
class Outcome:
    """The verdict on one case of one subject.

    case      kebab-case id, unique within a matrix
    group     what kind of case it is, "outlier" say; cases of a group stand together
    subject   the method, metric or format
    expected  in words: a value with its tolerance, an invariant, or a named failure
    observed  in words; what `expected` is compared with
    kind      the verdict, see `KINDS`
    """

    case: str
    group: str
    subject: str
    expected: str
    observed: str
    kind: Kind


# What an agreement leaves room for. Exactly the same numbers go in: float32 sums in another order
# differ by some 1e-6, which now and then takes a pixel over the edge between two grey levels.
EXACT_MEAN, EXACT_MOST = 0.01, 1
# The input is rounded, to 11 bits (float16) or to a thousandth of the radius. A point moves by up
# to 5e-4, which is 0.03 px; measured means were 0.004 to 0.4 grey levels.
ROUNDED_MEAN = 1.0
ROUNDED = ("float16", "millimetres")


@dataclass(frozen=True)
class Draws:
    """The expectation of images of the right shape, finite, none of one colour throughout."""


@dataclass(frozen=True)
class Agrees:
    """The expectation of the images of the case's `like`, to within grey levels 0..255."""

    mean: float
    most: int | None = None


@dataclass(frozen=True)
class Changes:
    """The expectation of images that differ from the case's `like`, against intuition."""

    mean: float
    why: str


@dataclass(frozen=True)
class Fails:
    """The expectation of no images, for a reason that matches a regular expression."""

    reason: str
    kind: Kind = "refused"


@dataclass(frozen=True)
class Either:
    """The expectation of one of several, decided by rounding or the machine's speed."""

    options: tuple[Expectation, ...]
    why: str


@dataclass(frozen=True)
class NoExpectation:
    """The expectation of any image, or any failure with a name."""


Expectation = Draws | Agrees | Changes | Fails | Either | NoExpectation

_SMALL = ("scale-1e-30", "scale-1e-9", "scale-1e-3")
_LARGE = ("scale-1e3", "scale-1e9", "scale-1e30")
_SHIFTS = ("shift-1e3", "shift-1e6")
_FAR = ("outlier-1e3", "outlier-1e6", "outlier-1e30")
_NOT_FINITE = ("outlier-nan", "outlier-inf", "outlier--inf")
_REPEATED = ("rows-twice", "rows-4-times")
_EXACT = Agrees(EXACT_MEAN, EXACT_MOST)
_BLANK = Fails("draw: 4 of 4 pictures are blank")
_SOME_BLANK = Fails("draw: . of 4 pictures are blank")
_CHAOS = Changes(0.5, "another order or a rounding error, and the surface has its spikes elsewhere")
_UNIT = Changes(1.0, "coordinates are taken as they are, and the camera stands where it does")
_FEW_IN_SIGHT = Either((Draws(), _SOME_BLANK), "few points are in sight")
_WRONG_NORMALS = Changes(1.0, "ten neighbours are fewer places, and normals go wrong")
_OFF = Fails("encode: the code lies ")
_FINITE_ONLY = dict.fromkeys(_NOT_FINITE, Fails("input: 1 of 2048 points are not finite"))


def _at_least(count: int, what: str) -> dict[str, Expectation]:
    return {f"{n}-points": Fails(f"input: {n} points; {what} need") for n in range(count)}


def _slow(why: str) -> Either:
    return Either((Fails("timeout: ", "contained"), Draws()), why)


_INSIDE = Either((Draws(), _SOME_BLANK), "a camera may stand inside the surface")
_MANY = ("100000-points", "1000000-points")
_CHAOTIC = ("float16", "shuffled", "turned", "millimetres")

_MESH_OF_THE_POINTS: dict[str, Expectation] = {  # ball pivoting, and what is built on it
    **_at_least(5, "normals"),
    **dict.fromkeys(_MANY, _slow("ball pivoting takes minutes")),
    **dict.fromkeys(("collinear", *_FAR), Fails("ball-pivoting: no faces")),
    **_FINITE_ONLY,
    **dict.fromkeys((*_SMALL, *_LARGE, *_SHIFTS), _BLANK),
    **dict.fromkeys(("noise-5", "noise-10"), _FEW_IN_SIGHT),
    **dict.fromkeys(_REPEATED, _WRONG_NORMALS),
    **dict.fromkeys(_CHAOTIC, _CHAOS),
}
_PC2PIX: dict[str, Expectation] = {
    "0-points": Fails("encode: the cloud is empty"),
    **dict.fromkeys(_NOT_FINITE, Fails("encode: the cloud has non-finite points")),
    **dict.fromkeys((*_FAR, *_LARGE, *_SHIFTS, "noise-5", "noise-10"), _OFF),
    **dict.fromkeys(_SMALL, _UNIT),
    # Of a larger cloud random parts are seen, here with some rows twice.
    **dict.fromkeys(_REPEATED, Agrees(1.0)),
    "turned": Changes(1.0, "the network knows chairs in one pose only"),
}
_POINTS: dict[str, Expectation] = {  # what draws the points themselves
    "0-points": Fails("input: no points"),
    **_FINITE_ONLY,
    # One of 2,048 is out of sight: of a disc some 9 pixels by up to 165 levels in 16,384.
    **dict.fromkeys(_FAR, Agrees(0.1)),
    **dict.fromkeys((*_SMALL, *_LARGE), _UNIT),
}
_SPLAT_NET = _POINTS | {
    **dict.fromkeys(
        _SHIFTS,
        Either((_UNIT, _SOME_BLANK), "what it draws where it sees nothing is left open"),
    ),
    **dict.fromkeys(("noise-5", "noise-10"), _FEW_IN_SIGHT),
    # The points are seen as before, but for rounding, of which bfloat16 shows the more.
    "turned": Agrees(0.02),
}

_USED_POINTS: dict[str, Expectation] = {  # each once, sorted, in sight, not too many
    **_at_least(5, "surfaces"),
    **dict.fromkeys(
        ("all-equal", "int", *_LARGE, *_SHIFTS), Fails(r"input: \d+ of \d+ points are different")
    ),
    **_FINITE_ONLY,
    **dict.fromkeys(_FAR, Agrees(0.1)),  # it is left out
    **dict.fromkeys(_SMALL, _BLANK),
    **dict.fromkeys(("noise-5", "noise-10"), _FEW_IN_SIGHT),
}

# By method, the cases that are not simply drawn, and do not simply agree.
EXPECTED: Mapping[str, Mapping[str, Expectation]] = {
    "surface-apss": {
        **_at_least(5, "normals"),
        **dict.fromkeys(_MANY, _slow("APSS takes minutes for many points")),
        **dict.fromkeys(("all-equal", "coplanar", "int"), Fails("apss: no faces")),
        "collinear": Fails("ball-pivoting: no faces"),
        **dict.fromkeys(_FAR, Fails("ball-pivoting: ")),
        **_FINITE_ONLY,
        **dict.fromkeys((*_SMALL, *_LARGE, *_SHIFTS), _BLANK),
        **dict.fromkeys(("noise-1", "noise-2", "noise-5", "noise-10"), _INSIDE),
        **dict.fromkeys(_REPEATED, _WRONG_NORMALS),
        **dict.fromkeys(_CHAOTIC, _CHAOS),
    },
    "surface-fit": {
        **_at_least(5, "normals"),
        **dict.fromkeys(
            ("all-equal", "int", *_SMALL, *_LARGE, *_SHIFTS),
            Fails(r"input: \d+ of \d+ points are left"),
        ),
        "collinear": Fails("ball-pivoting: no faces"),
        "coplanar": Fails("apss: no faces"),
        # What lies beyond the camera is left out; the cubes of the others stay where they are.
        **dict.fromkeys(_FAR, Agrees(0.1)),
        **_FINITE_ONLY,
        **dict.fromkeys(_REPEATED, _EXACT),
        **dict.fromkeys(("float16", "turned", "millimetres"), _CHAOS),
    },
    "surface-bpa": _MESH_OF_THE_POINTS | dict.fromkeys(("all-equal", "int"), _BLANK),
    "poisson": _MESH_OF_THE_POINTS
    | dict.fromkeys(("all-equal", "int"), Fails("poisson: no faces")),
    "alpha-shape": {
        **_at_least(4, "tetrahedra"),
        **dict.fromkeys(("4-points", "16-points"), Fails("alpha-shape: no triangle fits")),
        **dict.fromkeys(
            ("all-equal", "collinear", "coplanar", "int", "outlier-1e30"), Fails("delaunay: QH")
        ),
        **dict.fromkeys(("outlier-1e3", "outlier-1e6"), Changes(1.0, "alpha grows with the box")),
        **_FINITE_ONLY,
        **dict.fromkeys((*_SMALL, *_LARGE, *_SHIFTS, "noise-5", "noise-10"), _BLANK),
        **dict.fromkeys(_REPEATED, _EXACT),
        "1000000-points": _slow("Delaunay takes a minute"),
        # Rounding decides which of several balls through nearly the same points is the empty one.
        "turned": Agrees(0.5),
    },
    "denoised-bpa": _USED_POINTS
    | {
        "collinear": Fails("ball-pivoting: no faces"),
        **dict.fromkeys(("float16", "turned", "millimetres"), _CHAOS),
    },
    "denoised-alpha": _USED_POINTS
    | {
        **dict.fromkeys(("collinear", "coplanar"), Fails("delaunay: QH")),
        "turned": Agrees(0.5),  # as of alpha-shape
    },
    "denoised-poisson": _USED_POINTS
    | {
        "collinear": Fails("ball-pivoting: no faces"),
        **dict.fromkeys(("float16", "turned", "millimetres"), _CHAOS),
    },
    "pgr": _USED_POINTS
    | {
        **dict.fromkeys(("collinear", "two-clusters", "scale-1e-3"), Fails("marching-cubes: ")),
        **dict.fromkeys(("scale-1e-30", "scale-1e-9"), Fails("gauss: the samples' system has no")),
        **dict.fromkeys(("noise-1", "noise-2"), _INSIDE),
        "turned": Changes(1.0, "its grid is not turned with the cloud"),
    },
    "open3d-poisson": _USED_POINTS
    | {
        **_at_least(5, "tangent planes"),
        "16-points": Fails("input: 16 points; tangent planes need"),
        "collinear": Fails("normals: "),
    },
    "pc2pix": _PC2PIX,
    "pc2pix@all": _PC2PIX | {"noise-2": _OFF},
    # The same code but for the seventh digit, and bfloat16 has three: single pixels move by more.
    "pc2pix@bf16": _PC2PIX | dict.fromkeys(("all-equal", "azimuth+180"), Agrees(EXACT_MEAN)),
    "pc2pix@acgan": _PC2PIX
    | {
        "noise-2": _OFF,
        "azimuth+180": Changes(1.0, "the azimuth is one number, with a jump at 180"),
        "shuffled": Changes(1.0, "the paper's encoder goes along the order of the points"),
        # Its encoder takes 2,048 points: it is given rows as often as that in any case.
        **dict.fromkeys(_REPEATED, _EXACT),
    },
    "pc2pix@widened": _PC2PIX,
    "splat-net": _SPLAT_NET,
    "splat-net@grey": _SPLAT_NET,
    "splat-net@all": _SPLAT_NET,
    "splat-net@all-grey": _SPLAT_NET,
    "points2pix": _SPLAT_NET,
    "points2pix@l1-patch": _SPLAT_NET,
    "depth-net": _SPLAT_NET,
    "splat-net@bf16": _SPLAT_NET,
    "splat-net@tiny": _SPLAT_NET,
    "splat": _POINTS
    | {
        **dict.fromkeys(_SHIFTS, _BLANK),
        **dict.fromkeys(
            _REPEATED,
            Changes(1.0, "the nearest other point is at no distance, and discs are the smallest"),
        ),
    },
    "true-mesh": {},
    "true-mesh@grey": {},
    "constant": {},
    "blank": {},
}


def expectation(method: str, case: Case) -> Expectation:
    """Return the stated expectation for a method and a case."""
    stated = EXPECTED.get(method)
    if stated is None:
        return NoExpectation()
    if case.id in stated:
        return stated[case.id]
    if case.like is None:
        return Draws()
    return Agrees(ROUNDED_MEAN) if case.id in ROUNDED else _EXACT


def in_words(expected: Expectation, like: str | None) -> str:
    """Return an expectation for people; `like` is that of its case."""
    match expected:
        case Draws():
            return "pictures"
        case Agrees(mean, most):
            at_most = "" if most is None else f", at most {most}"
            return f"as {like}: mean change up to {mean:g} grey levels{at_most}"
        case Changes(mean, why):
            return f"not as {like} (mean change above {mean:g}): {why}"
        case Fails(reason):
            return f"failed: {reason.rstrip(': ')}"
        case Either(options, why):
            return " or ".join(in_words(option, like) for option in options) + f" ({why})"
        case NoExpectation():
            return "pictures or a named failure" + (f", as {like}" if like else "")


def outcome(observation: Observation) -> Outcome:
    """Return the verdict on one observation."""
    case = next(case for case in CASES if case.id == observation.case)
    expected = expectation(observation.method, case)
    return Outcome(
        case=case.id,
        group=case.group,
        subject=observation.method,
        expected=in_words(expected, case.like),
        observed=_seen_in_words(observation),
        kind=_verdict(expected, observation),
    )


def _verdict(expected: Expectation, seen: Observation) -> Kind:
    change = seen.mean_change
    match expected:
        case Fails():
            fits = seen.reason and re.match(expected.reason, seen.reason)
            return expected.kind if fits else "unexpected"
        case Either():
            for option in expected.options:
                if (kind := _verdict(option, seen)) != "unexpected":
                    return kind
            return "unexpected"
        case NoExpectation():
            return _verdict_of_unstated(seen)
        case _ if seen.reason:
            return "unexpected"
        case Draws():
            return "holds"
        case Agrees():
            agrees = change is not None and change <= expected.mean
            if expected.most is not None:
                agrees &= seen.most_change is not None and seen.most_change <= expected.most
            return "holds" if agrees else "unexpected"
        case Changes():
            return "differs" if change is not None and change > expected.mean else "unexpected"


def _verdict_of_unstated(seen: Observation) -> Kind:
    if seen.reason:
        # A stage is named in kebab-case; Python's exceptions and lost workers are no stages.
        stage = re.match(r"(?!timeout|memory|crash)[a-z][a-z0-9-]*: ", seen.reason)
        return "refused" if stage else "unexpected"
    if seen.mean_change is None:
        return "holds"
    return "holds" if seen.mean_change <= ROUNDED_MEAN else "differs"


def _seen_in_words(seen: Observation) -> str:
    if seen.reason:
        return f"failed: {seen.reason}"
    words = f"pictures, {100 * (seen.shown or 0):.1f} % not white"
    if seen.mean_change is not None:
        words += f"; change {seen.mean_change:.3g}, at most {seen.most_change}"
    return f"{words}; {seen.notes}" if seen.notes else words
