"""The inputs of the suite `stability`: extreme clouds and views, and which have to agree."""

from __future__ import annotations

from dataclasses import dataclass, replace

from data_prep.clouds.conditions import GaussianNoise, Perturbation, Stride, Unchanged
from data_prep.clouds.extremes import extreme
from data_prep.scene import View

VIEWS = (View(30.0, 20.0), View(-60.0, -10.0), View(120.0, 35.0), View(-150.0, 0.0))
TURN_DEG = 75.0  # the angle of the case "turned": no multiple of the angles between the views


@dataclass(frozen=True)
class Case:
    """An extreme input: a cloud at the edge of the domain, and views of it."""

    id: str  # kebab-case
    group: str  # what is extreme, as "number of points"; cases of a group are adjacent
    about: str  # the input in words
    perturbation: Perturbation
    # The case that should have the same images, view by view: a metamorphic check. Where this case
    # has more views, they are compared with that case's views from the first one again.
    like: str | None = None
    views: tuple[View, ...] = VIEWS
    batch: int | None = None  # views drawn in one call; None draws all at once
    repetitions: int = 1  # the number of clouds, each perturbed with other random numbers

    @property
    def conditions(self) -> tuple[str, ...]:
        """Return the condition of each repetition; that of the first is the id."""
        return (self.id, *(f"{self.id}-{number}" for number in range(2, self.repetitions + 1)))


def _turned(views: tuple[View, ...], degrees: float) -> tuple[View, ...]:
    return tuple(replace(view, azimuth_deg=view.azimuth_deg + degrees) for view in views)


def _at(**angle_deg: float) -> tuple[View, ...]:
    """Return `VIEWS` with one angle at an end of its range, each once."""
    return tuple(dict.fromkeys(replace(view, **angle_deg) for view in VIEWS))


CASES = (
    Case("plain", "plain", "the sampled cloud, 2,048 points", Unchanged()),
    *(
        Case(f"{count}-points", "number of points", f"{count:,} points", extreme("Count", count))
        for count in (0, 1, 2, 3, 4, 16, 100_000, 1_000_000)
    ),
    Case(
        "all-equal", "degenerate", "2,048 times the same point", extreme("Equal"), like="1-points"
    ),
    Case("collinear", "degenerate", "all points on the X axis", extreme("Flattened", 1)),
    Case("coplanar", "degenerate", "all points in the plane Z = 0", extreme("Flattened", 2)),
    Case("two-clusters", "degenerate", "two small halves far apart", extreme("TwoClusters")),
    Case(
        "box", "degenerate", "a clean sample of a cube: flat faces, sharp edges", extreme("UnitBox")
    ),
    *(
        Case(
            f"outlier-{x}",
            "outlier",
            f"one coordinate is {x}",
            extreme("FirstPoint", float(x)),
            "plain",
        )
        for x in ("1e3", "1e6", "1e30", "nan", "inf", "-inf")
    ),
    *(
        Case(f"scale-{x}", "scale", f"coordinates times {x}", extreme("Scaled", float(x)), "plain")
        for x in ("1e-30", "1e-9", "1e-3", "1e3", "1e9", "1e30")
    ),
    *(
        Case(f"shift-{x}", "scale", f"moved by {x}", extreme("Shifted", float(x)), "plain")
        for x in ("1e3", "1e6")
    ),
    Case("float16", "type of number", "float16 input", extreme("Cast", "float16"), like="plain"),
    Case("float64", "type of number", "float64 input", extreme("Cast", "float64"), like="plain"),
    Case("int", "type of number", "integers: 0 and +-1", extreme("Cast", "int64")),
    Case(
        "non-contiguous",
        "type of number",
        "every other column, Fortran order",
        extreme("Strided"),
        "plain",
    ),
    Case("every-2nd", "repeated points", "1,024 points", Stride(2)),
    Case(
        "rows-twice",
        "repeated points",
        "the same, each twice",
        extreme("Repeated", 2),
        like="every-2nd",
    ),
    Case("every-4th", "repeated points", "512 points", Stride(4)),
    Case(
        "rows-4-times",
        "repeated points",
        "the same, each four times",
        extreme("Repeated", 4),
        "every-4th",
    ),
    Case("noise-0", "noise", "noise of sigma 0", GaussianNoise(0.0), like="plain"),
    *(
        Case(f"noise-{sigma}", "noise", f"noise of sigma {sigma}", GaussianNoise(float(sigma)))
        for sigma in ("0.02", "0.2", "0.5", "1", "2", "5", "10")
    ),
    Case(
        "dropout-99",
        "missing points",
        "99 % of the points dropped at random",
        extreme("Kept", 0.01),
    ),
    Case("half", "missing points", "half of the object cut away", extreme("Half")),
    Case("elevation+90", "view", "from the zenith", Unchanged(), views=_at(elevation_deg=90.0)),
    Case("elevation-90", "view", "from the nadir", Unchanged(), views=_at(elevation_deg=-90.0)),
    Case("azimuth-180", "view", "azimuth -180", Unchanged(), views=_at(azimuth_deg=-180.0)),
    Case("azimuth+180", "view", "azimuth +180", Unchanged(), "azimuth-180", _at(azimuth_deg=180.0)),
    Case("azimuth+720", "view", "twice around", Unchanged(), "plain", _turned(VIEWS, 720.0)),
    Case(
        "shuffled", "metamorphic", "the points in another order", extreme("Shuffled"), like="plain"
    ),
    Case(
        "normalised",
        "metamorphic",
        "the cloud brought to the unit sphere",
        extreme("Normalised", 1.0, 0.0, False),
    ),
    *(
        Case(
            f"normalised-{factor}-{distance}",
            "metamorphic",
            f"times {factor}, moved by {distance}, brought to the unit sphere",
            extreme("Normalised", float(factor), float(distance), False),
            like="normalised",
        )
        for factor, distance in (
            ("1e-30", "0"),
            ("1e-3", "0"),
            ("1e3", "0"),
            ("1e30", "0"),
            ("1", "1e3"),
            ("1", "1e6"),
        )
    ),
    Case(
        "millimetres",
        "metamorphic",
        "times 1,000, rounded to integers, brought to the unit sphere",
        extreme("Normalised", 1000.0, 0.0, True),
        like="normalised",
    ),
    Case(
        "turned",
        "metamorphic",
        f"cloud and camera turned by {TURN_DEG:g} degrees",
        extreme("Turned", TURN_DEG),
        "plain",
        _turned(VIEWS, TURN_DEG),
    ),
    Case(
        "batch-doubled",
        "metamorphic",
        "all views twice in one call",
        Unchanged(),
        "plain",
        2 * VIEWS,
    ),
    Case("batch-split", "metamorphic", "one view a call", Unchanged(), like="plain", batch=1),
    Case(
        "last-bit",
        "metamorphic",
        "coordinates off by up to one unit in the last place, 30 times",
        extreme("LastBit"),
        "plain",
        repetitions=30,
    ),
)
