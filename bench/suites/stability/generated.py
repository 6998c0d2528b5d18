"""Generated inputs of the search for extremes: descriptions, their arrays, and their strategies.

A description is small, and its `repr` makes it again, so that a failure can be repeated from the
text of a table. `hypothesis`, which generates and reduces descriptions, is imported by the
functions that make strategies, and by nothing else.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.sampling import sample_surface
from data_prep.datasets.registry import ProceduralObject
from data_prep.scene import IMAGE_SIZE, Mesh, PointCloud, UInt8Images, View

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

Array = NDArray[Any]
Kind = Literal["times", "plus", "put", "round", "repeat", "sort"]
Shape = Literal["ball", "cube", "chair"]
MOST_POINTS = 100_000
MAGNITUDES = (  # with both ends of float32, its denormal numbers, and squares that overflow it
    *(0.0, 1.0, 0.5, 2.0, -1.0, 1e-3, 1e3, 1e6, 1e-9, 1e9, 1e19, 1e30, 3e38, 1e-30, 1e-38, 1e-45),
    *(float("nan"), float("inf"), float("-inf")),
)
STEPS = (1, 2, 3, 10, 1_000_000)  # the last one takes the first row alone


@dataclass(frozen=True)
class RowChange:
    """A change of every `step`-th row of an array, in one column or (None) in all of them.

    times   multiply by `value`: another scale, or two scales in one cloud
    plus    add `value`
    put     become `value`: a plane, a line, an outlier, NaN
    round   round to multiples of `value`: a lattice, and equal points
    repeat  each `step`-th row, `step` times: `value` and `column` mean nothing
    sort    all rows by a column
    """

    kind: Kind
    value: float = 1.0
    column: int | None = None
    step: int = 1

    def apply(self, rows: Array) -> Array:
        """Return changed rows [n, d], n and d as before."""
        rows = rows.copy()
        column = None if self.column is None else self.column % rows.shape[1]
        part = rows[:: self.step] if column is None else rows[:: self.step, column]
        with np.errstate(all="ignore"):
            value = rows.dtype.type(self.value)
            if self.kind == "times":
                part *= value
            elif self.kind == "plus":
                part += value
            elif self.kind == "put":
                part[...] = value
            elif self.kind == "round":
                part[...] = np.rint(part / value) * value
            elif self.kind == "repeat":
                rows = np.repeat(rows[:: self.step], self.step, axis=0)[: len(rows)]
            else:
                rows = rows[np.argsort(rows[:, column or 0], kind="stable")]
        return rows


@dataclass(frozen=True)
class NumberRows:
    """Rows of numbers: a few that are written out, or else `count` random ones; then changes.

    ball   normal deviates, the only shape with other than three columns
    cube   points of the surface of a cube
    chair  points of the surface of a procedural chair
    """

    written: tuple[tuple[float, ...], ...] = ()
    count: int = 0
    shape: Shape = "ball"
    seed: int = 0
    changes: tuple[RowChange, ...] = ()

    def array(self, columns: int, dtype: str = "float32") -> Array:
        """Return the rows [n, columns]."""
        with np.errstate(over="ignore"):
            rows = np.array(self.written, dtype).reshape(len(self.written), columns)
        if not self.written:
            rows = self._sample(np.random.default_rng(self.seed), columns).astype(dtype)
        for change in self.changes:
            rows = change.apply(rows)
        return rows

    def _sample(self, rng: np.random.Generator, columns: int) -> Array:
        if self.shape == "chair" and self.count:
            return sample_surface(chair(), rng, self.count).points
        if self.shape == "cube":
            rows = rng.uniform(-0.5, 0.5, (self.count, 3))
            rows[np.arange(self.count), rng.integers(0, 3, self.count)] = rng.choice(
                [-0.5, 0.5], self.count
            )
            return rows
        return 0.3 * rng.standard_normal((self.count, columns))


@functools.cache
def chair() -> Mesh:
    """Return the mesh behind all generated clouds, which `true-mesh` draws."""
    source = ProceduralObject("chair", "test", 0).cloud(np.random.default_rng(0)).source
    assert source is not None
    return source


@dataclass(frozen=True)
class CloudInput:
    """A cloud and views of it."""

    points: NumberRows
    views: tuple[View, ...]

    def cloud(self) -> PointCloud:
        """Return the cloud."""
        return PointCloud(self.points.array(3), chair())


@dataclass(frozen=True)
class ImagePattern:
    """Images: bytes repeated to fill them, or (with a seed) noise; then rectangles of one level.

    patches  top, left, height, width and level of each
    """

    filling: bytes = b"\xff"
    seed: int | None = None
    patches: tuple[tuple[int, int, int, int, int], ...] = ()

    def images(self, count: int, height: int, width: int) -> UInt8Images:
        """Return images [count, height, width, 3]; a patch moves by a pixel from each to the next.

        An empty filling is black.
        """
        shape = (count, height, width, 3)
        filling = self.filling or b"\0"
        size = math.prod(shape)
        repeated = filling * (size // len(filling) + 1)
        images = np.frombuffer(repeated[:size], np.uint8).reshape(shape).copy()
        if self.seed is not None:
            images = np.random.default_rng(self.seed).integers(0, 256, shape, dtype=np.uint8)
        for top, left, rows, columns, level in self.patches:
            for i, image in enumerate(images):
                image[top : top + rows, left + i : left + i + columns] = level
        return images


@dataclass(frozen=True)
class ImagesInput:
    """Two sets of images of one size, for metrics of images."""

    truth: ImagePattern
    image: ImagePattern
    counts: tuple[int, int] = (1, 1)
    size: tuple[int, int] = (IMAGE_SIZE, IMAGE_SIZE)

    def arrays(self) -> tuple[Array, Array]:
        """Return true images and images."""
        first, second = self.counts
        return self.truth.images(first, *self.size), self.image.images(second, *self.size)


@dataclass(frozen=True)
class FeaturesInput:
    """Two sets of features, for distances between sets."""

    first: NumberRows
    second: NumberRows
    columns: int
    dtype: str = "float32"

    def arrays(self) -> tuple[Array, Array]:
        """Return both sets."""
        first, second = (rows.array(self.columns, self.dtype) for rows in (self.first, self.second))
        return first, second


@dataclass(frozen=True)
class AnglesInput:
    """Answers of the judge (sine, cosine, elevation, one number of a code) and true angles."""

    answers: tuple[tuple[float, float, float, float], ...]
    angle_deg: float

    def arrays(self) -> tuple[Array, Array]:
        """Return answers [n, 4] and angles [n]."""
        answers = np.array(self.answers, np.float32).reshape(len(self.answers), 4)
        return answers, np.full(len(answers), self.angle_deg)


# --- strategies -----------------------------------------------------------------------------------


def _numbers() -> SearchStrategy[float]:
    from hypothesis import strategies as st

    return st.sampled_from((0.0, 0.25, -0.5, 1.0, *MAGNITUDES)) | st.floats(width=32)


def _counts(most: int) -> SearchStrategy[int]:
    from hypothesis import strategies as st

    usual = [*range(17), *range(17), 31, 32, 33, 100, 255, 256, 257, 1000, 2047, 2048, 2049]
    rare = [16_384, most] * 2  # which take as much time as all others
    counts = [count for count in usual + rare if count <= most]
    return st.sampled_from(counts) | st.integers(0, min(most, 2048))


@functools.cache
def _changes(columns: int) -> tuple[RowChange, ...]:
    """Return changes to choose from in one draw, which is faster than to draw each part."""
    kinds: tuple[Kind, ...] = ("times", "plus", "put", "round")
    places = [None, *range(min(columns, 3))]
    return (
        *(
            RowChange(kind, value, column, step)
            for step, column, kind, value in itertools.product(STEPS, places, kinds, MAGNITUDES)
        ),
        *(RowChange("repeat", step=step) for step in (2, 3, 10) * 40),
        *(RowChange("sort", column=column) for column in range(min(columns, 3)) for _ in range(20)),
    )


def _rows(columns: int, most: int, shapes: tuple[Shape, ...]) -> SearchStrategy[NumberRows]:
    from hypothesis import strategies as st

    changed = st.builds(
        RowChange,
        st.sampled_from(("times", "plus", "put", "round")),
        st.floats(width=32),
        st.none() | st.integers(0, columns - 1),
        st.sampled_from(STEPS),
    )
    known = _changes(columns)
    usual = st.integers(0, len(known) - 1).map(known.__getitem__)
    lists = st.lists(usual | usual | changed, max_size=3).map(tuple)
    numbers = _numbers()
    written = st.lists(st.tuples(*[numbers] * min(columns, 3)), max_size=5).map(
        lambda rows: tuple(tuple(itertools.islice(itertools.cycle(r), columns)) for r in rows)
    )
    sampled = st.builds(
        NumberRows,
        st.just(()),
        _counts(most),
        st.sampled_from(shapes),
        st.integers(0, 2**16),
        lists,
    )
    return st.builds(NumberRows, written) | sampled | sampled


@functools.cache  # the same strategy each time
def clouds(most_points: int = MOST_POINTS) -> SearchStrategy[CloudInput]:
    """Return the strategy of clouds of at most so many points, with one or two views."""
    from hypothesis import strategies as st

    usual = itertools.product(
        (0.0, 30.0, -150.0, 90.0, 180.0, -180.0, 720.0, 1e9, 1e300), (0.0, 20.0, -35.0, 90.0, -90.0)
    )
    degrees = st.floats(allow_nan=False, allow_infinity=False)
    view = st.sampled_from([View(*angles) for angles in usual])
    view = view | st.builds(View, degrees, st.floats(-90.0, 90.0))
    views = st.lists(view, min_size=1, max_size=2).map(tuple)
    return st.builds(CloudInput, _rows(3, most_points, ("ball", "cube", "chair")), views)


@functools.cache
def images() -> SearchStrategy[ImagesInput]:
    """Return the strategy of pairs of sets of images, of which most have the usual size."""
    from hypothesis import strategies as st

    place, level = st.integers(0, IMAGE_SIZE - 1), st.integers(0, 255)
    extent = st.integers(1, 8) | place
    pattern = st.builds(
        ImagePattern,
        st.binary(max_size=12) | st.sampled_from((b"\xff", b"\x00")),
        st.none() | st.none() | st.integers(0, 2**16),
        st.lists(st.tuples(place, place, extent, extent, level), max_size=3).map(tuple),
    )
    count = st.sampled_from((1, 1, 1, 2, 3, 0, 12))
    counts = count.map(lambda n: (n, n)) | count.map(lambda n: (n, n)) | st.tuples(count, count)
    usual, side = st.just((IMAGE_SIZE, IMAGE_SIZE)), st.integers(1, 70)
    return st.builds(ImagesInput, pattern, pattern, counts, usual | usual | st.tuples(side, side))


@functools.cache
def features() -> SearchStrategy[FeaturesInput]:
    """Return the strategy of pairs of sets of up to 64 features."""
    from hypothesis import strategies as st

    def pair(columns: int) -> SearchStrategy[FeaturesInput]:
        rows = _rows(columns, 200, ("ball",))
        types = st.sampled_from(("float32", "float64", "float16"))
        return st.builds(FeaturesInput, rows, rows, st.just(columns), types)

    return st.sampled_from((1, 2, 3, 8, 64)).flatmap(pair)


@functools.cache
def angles() -> SearchStrategy[AnglesInput]:
    """Return the strategy of finite answers and angles."""
    from hypothesis import strategies as st

    number = st.floats(-1, 1, width=32) | st.floats(width=32, allow_nan=False, allow_infinity=False)
    answers = st.lists(st.tuples(*[number] * 4), max_size=8).map(tuple)
    return st.builds(AnglesInput, answers, st.floats(-1e6, 1e6))
