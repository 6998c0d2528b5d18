"""Methods with one parameter set: `surface-apss@resolution=64`, `poisson@depth=5`.

The parameters stand in a literal table; the method itself says what each does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

from bench.catalogue.lookup import family_of, variant_of
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Parameter:
    """A number that a method's class takes as a field.

    method         the id of the method that has it
    name           in ids of variants
    low, high      the values that are taken, both included
    about          what it is, with its unit
    field          of the method's class; "" where it has the parameter's name
    whole          whether only whole numbers are taken
    """

    method: str
    name: str
    low: float
    high: float
    about: str
    field: str = ""
    whole: bool = False


_whole = partial(Parameter, whole=True)

PARAMETERS = (
    _whole("surface-apss", "resolution", 10, 400, "grid cells along the longest side of the cloud"),
    Parameter(
        "surface-fit", "cell", 0.5, 4, "side of a grid cell, in pixels at the origin", "cell_px"
    ),
    Parameter(
        *("surface-bpa", "radius", 0.1, 20),
        *("of the ball, in percent of the diagonal of the cloud's box", "radius_percent"),
    ),
    _whole("poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("alpha-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "ball", 0.5, 8, "radius of the ball, in spacings of the points"),
    Parameter("denoised-wrap", "strength", 0, 4, "factor on the estimated noise"),
    _whole("open3d-poisson", "depth", 3, 10, "levels of the octree"),
    Parameter("splat", "spread", 0.1, 10, "factor on the radius of the discs"),
)


@dataclass(frozen=True)
class Setting:
    """A parameter and its value."""

    parameter: Parameter
    value: float

    @property
    def fields(self) -> dict[str, float]:
        """Return the arguments of the renderer's class."""
        return {self.parameter.field or self.parameter.name: self.value}


def find_setting(method_id: str) -> Setting | None:
    """Return the setting of an id METHOD@PARAMETER=VALUE; None for an id of another form.

    Raises BadInput for a parameter that the method does not have, and for a value out of its range.
    """
    method, setting = family_of(method_id), variant_of(method_id)
    name, equals, text = setting.partition("=")
    if not equals or method_id.endswith(".safetensors"):
        return None
    parameter = next((k for k in PARAMETERS if (k.method, k.name) == (method, name)), None)
    if parameter is None:
        variants = ", ".join(f"{k.method}@{k.name}=..." for k in PARAMETERS)
        raise BadInput(f"unknown variant '{method_id}': there are {variants}")
    try:
        value = int(text) if parameter.whole else float(text)
    except ValueError:
        value = math.nan
    if not parameter.low <= value <= parameter.high:
        kind = "whole number" if parameter.whole else "number"
        raise BadInput(
            f"'{method_id}': {name} must be a {kind} from {parameter.low:g} to {parameter.high:g}, "
            f"not '{text}'"
        )
    return Setting(parameter, value)
