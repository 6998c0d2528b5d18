"""Expected outcomes of each method on each case of the suite `stability`.

A method without a statement, which is one of another package, may draw any image and may fail with
any name; an exception of Python, a crash, a time or memory limit is never expected of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bench.suites.stability.cases import Case

Kind = Literal["holds", "refused", "differs", "contained", "unexpected"]
KINDS: dict[Kind, str] = {  # with their meanings, which the tables print
    "holds": "the stated value or invariant",
    "refused": "a named failure, as stated",
    "differs": "the invariant does not hold, as stated",
    "contained": "a defect of a library, as stated; it costs its own item",
    "unexpected": "none of what was stated",
}


# Tolerance of an agreement of exactly the same inputs: float32 sums in another order differ by some
# 1e-6, which now and then takes a pixel over the edge between two grey levels.
EXACT_MEAN, EXACT_MOST = 0.01, 1
# The input is rounded, to 11 bits (float16) or to a thousandth of the radius. A point moves by up
# to 5e-4, which is 0.03 px; measured means were 0.004 to 0.4 grey levels.
ROUNDED_MEAN = 1.0
ROUNDED = ("float16", "millimetres")
# A unit more or less in the last place moves images by up to 1e-4 grey levels in the mean. Where a
# ball finds another face, and in the codes of pc2pix, it makes more of a difference: means of 0.01
# to 0.14 grey levels. Half a level would be another surface.
_LAST_BIT = 0.5


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

_SMALL = "scale-1e-30 scale-1e-9 scale-1e-3"
_LARGE = "scale-1e3 scale-1e9 scale-1e30"
_SHIFTS = "shift-1e3 shift-1e6"
_SCALED = f"{_SMALL} {_LARGE} {_SHIFTS}"
_FAR = "outlier-1e3 outlier-1e6 outlier-1e30"
_NOT_FINITE = "outlier-nan outlier-inf outlier--inf"
_REPEATED = "rows-twice rows-4-times"
_MANY = "100000-points 1000000-points"
_FEW = "1-points 2-points 3-points 4-points 16-points"
_CHAOTIC = "float16 shuffled turned millimetres"
_NOISIEST = "noise-5 noise-10"
_EXACT = Agrees(EXACT_MEAN, EXACT_MOST)
_BLANK = Fails("draw: 4 of 4 images are blank")
_SOME_BLANK = Fails("draw: . of 4 images are blank")
_CHAOS = Changes(0.5, "another order or a rounding error, and the surface has its spikes elsewhere")
_UNIT = Changes(1.0, "coordinates are taken as they are, and the camera stands where it does")
_FEW_IN_SIGHT = Either((Draws(), _SOME_BLANK), "few points are in sight")
_HARDLY_A_CLOUD = Either(
    (Draws(), _SOME_BLANK, Fails("marching-cubes: no surface")),
    "points that are no object have no inside, or a small one that no pixel shows",
)
_WRONG_NORMALS = Changes(1.0, "ten neighbours are fewer places, and normals go wrong")
_OFF = Fails("encode: the code lies ")
_INSIDE = Either((Draws(), _SOME_BLANK), "a camera may stand inside the surface")
_NEARLY = Agrees(_LAST_BIT)
_WITHOUT_A_POINT = Agrees(0.1)  # the far point is left out

_Statements = dict[str, Expectation]  # by cases, several with spaces between; the last one counts


def _at_least(count: int, what: str) -> _Statements:
    return {f"{n}-points": Fails(f"input: {n} points; {what} need") for n in range(count)}


def _slow(why: str) -> Either:
    return Either((Fails("timeout: ", "contained"), Draws()), why)


_FINITE_ONLY: _Statements = {_NOT_FINITE: Fails("input: 1 of 2048 points are not finite")}
_MESH_OF_THE_POINTS: _Statements = {  # ball pivoting, and methods built on it
    **_at_least(5, "normals"),
    **_FINITE_ONLY,
    _MANY: _slow("ball pivoting takes minutes"),
    f"collinear {_FAR}": Fails("ball-pivoting: no faces"),
    _SCALED: _BLANK,
    _NOISIEST: _FEW_IN_SIGHT,
    _REPEATED: _WRONG_NORMALS,
    _CHAOTIC: _CHAOS,
    "last-bit": _NEARLY,
}
_PC2PIX: _Statements = {
    "0-points": Fails("encode: the cloud is empty"),
    _NOT_FINITE: Fails("encode: the cloud has non-finite points"),
    f"{_FAR} {_LARGE} {_SHIFTS} {_NOISIEST}": _OFF,
    _SMALL: _UNIT,
    # The encoder sees a random part of a larger cloud, here with some rows twice.
    _REPEATED: Agrees(1.0),
    "turned": Changes(1.0, "the network knows chairs in one pose only"),
    "last-bit": _NEARLY,
}
_POINTS: _Statements = {  # methods that draw the points themselves
    **_FINITE_ONLY,
    "0-points": Fails("input: no points"),
    # One of 2,048 points is out of sight: its disc has 9 of 16,384 pixels, of up to 165 levels.
    _FAR: Agrees(0.1),
    f"{_SMALL} {_LARGE}": _UNIT,
}
_SPLAT_NET: _Statements = {
    **_POINTS,
    _SHIFTS: Either((_UNIT, _SOME_BLANK), "what it draws where it sees nothing is left open"),
    _NOISIEST: _FEW_IN_SIGHT,
    # The points look as before, but for rounding, which bfloat16 shows more.
    "turned": Agrees(0.02),
}
_USED_POINTS: _Statements = {  # methods that take each point once, sorted, in sight
    **_at_least(5, "surfaces"),
    **_FINITE_ONLY,
    f"all-equal int {_LARGE} {_SHIFTS}": Fails(r"input: \d+ of \d+ points are different"),
    _FAR: _WITHOUT_A_POINT,
    _SMALL: _BLANK,
    _NOISIEST: _FEW_IN_SIGHT,
}
# Rounding decides where the ball gets in; its grid is not turned; one point less may open a gap.
_WRAP: _Statements = {**_USED_POINTS, f"float16 turned millimetres {_FAR}": Agrees(2.0)}
# A mesh that cannot be made is left out. A turn changes the mesh of occupancy-net by more than a
# grey level, and the points, which turn with the cloud, make up for some of it.
_FUSED_NET = _SPLAT_NET | {"turned": Changes(0.5, "occupancy-net's planes are not turned")}
_STATED: Mapping[str, _Statements] = {
    "surface-apss": {
        **_at_least(5, "normals"),
        **_FINITE_ONLY,
        _MANY: _slow("APSS takes minutes for many points"),
        "all-equal coplanar int": Fails("apss: no faces"),
        "collinear": Fails("ball-pivoting: no faces"),
        _FAR: Fails("ball-pivoting: "),
        _SCALED: _BLANK,
        f"noise-1 noise-2 {_NOISIEST}": _INSIDE,
        _REPEATED: _WRONG_NORMALS,
        _CHAOTIC: _CHAOS,
        "last-bit": _NEARLY,  # of other clouds it may lose all but two digits
    },
    "surface-fit": {
        **_at_least(5, "normals"),
        **_FINITE_ONLY,
        f"all-equal int {_SCALED}": Fails(r"input: \d+ of \d+ points are left"),
        "collinear": Fails("ball-pivoting: no faces"),
        "coplanar": Fails("apss: no faces"),
        # Points beyond the camera are left out; the cubes of the others stay where they are.
        _FAR: _WITHOUT_A_POINT,
        _REPEATED: _EXACT,
        "float16 turned millimetres": _CHAOS,
        "last-bit": _NEARLY,
    },
    "surface-bpa": _MESH_OF_THE_POINTS | {"all-equal int": _BLANK},
    "poisson": _MESH_OF_THE_POINTS | {"all-equal int": Fails("poisson: no faces")},
    "alpha-wrap": _WRAP | {"noise-1 noise-2": _INSIDE},
    "denoised-wrap": _WRAP,
    "upsampled-wrap": {
        **_WRAP,
        # The ball rolls over four times as many points, so the last bit may let it in somewhere.
        "last-bit normalised-1-1e6": Agrees(2.0),
        "noise-1 noise-2": _INSIDE,
    },
    "open3d-poisson": {
        **_USED_POINTS,
        **_at_least(5, "tangent planes"),
        "16-points": Fails("input: 16 points; tangent planes need"),
        "collinear": Fails("normals: "),
        "last-bit": _NEARLY,
    },
    "pc2pix": _PC2PIX,
    "pc2pix@all": _PC2PIX | {"noise-2": _OFF},
    # Its code is small sums of large numbers, so that rounded points move it by more.
    "pc2pix@acgan": _PC2PIX | {"noise-2": _OFF, "millimetres": Agrees(2.0)},
    "splat-net splat-net@chair splat-net@grey points2pix": _SPLAT_NET,
    "fused-net fused-net@grey": _FUSED_NET,
    "occupancy-net": {
        **_FINITE_ONLY,
        "0-points": Fails("input: 0 points; occupancy networks need"),
        f"{_FEW} all-equal int": _HARDLY_A_CLOUD,
        f"{_LARGE} {_SHIFTS}": Fails(r"input: 0 of \d+ points are different and nearer"),
        _FAR: _WITHOUT_A_POINT,
        _SMALL: _UNIT,
        _NOISIEST: _FEW_IN_SIGHT,
        "turned": Changes(1.0, "its planes are not turned with the cloud"),
    },
    "splat": {
        **_POINTS,
        _SHIFTS: _BLANK,
        _REPEATED: Changes(
            1.0, "the nearest other point is at no distance, and discs are the smallest"
        ),
    },
    "splat-fill": {
        **_POINTS,
        **_at_least(1, "images"),
        _SHIFTS: _BLANK,
        _REPEATED: _EXACT,
    },
    "true-mesh true-mesh@grey constant blank": {},
}
# By method, its cases that are not simply drawn, or do not simply agree.
EXPECTED: Mapping[str, Mapping[str, Expectation]] = {
    method: {case: expected for cases, expected in stated.items() for case in cases.split()}
    for methods, stated in _STATED.items()
    for method in methods.split()
}


def expectation(method: str, case: Case) -> Expectation:
    """Return the expectation for a method and a case."""
    exceptions = EXPECTED.get(method)
    if exceptions is None:
        return NoExpectation()
    if case.id in exceptions:
        return exceptions[case.id]
    if case.like is None:
        return Draws()
    if case.repetitions > 1:
        return Agrees(EXACT_MEAN)
    return Agrees(ROUNDED_MEAN) if case.id in ROUNDED else _EXACT


def in_words(expected: Expectation, like: str | None) -> str:
    """Return an expectation in words for people; `like` is that of its case."""
    match expected:
        case Draws():
            return "images"
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
            return "images or a named failure" + (f", as {like}" if like else "")
