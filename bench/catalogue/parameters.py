"""Methods with one parameter set: `surface-apss@resolution=64`, `poisson@depth=5`.

The parameters stand in a literal table; the method itself says what each does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.catalogue.lookup import family_of, variant_of
from data_prep.failures import BadInput


@dataclass(frozen=True)
class Parameter:
    """A number that a method's class takes as a field.

    method         the id of the method that has it
    name           in ids of variants
    renderer       module and class: "baselines.reconstruction.surface:SurfaceApss"
    field          of the class
    low, high      the values that are taken, both included
    whole          whether only whole numbers are
    about          what it is, with its unit
    """

    method: str
    name: str
    renderer: str
    field: str
    low: float
    high: float
    whole: bool
    about: str


PARAMETERS = (
    Parameter(
        "surface-apss",
        "resolution",
        "baselines.reconstruction.surface:SurfaceApss",
        "resolution",
        10,
        400,
        True,
        "grid cells along the longest side of the cloud",
    ),
    Parameter(
        "surface-fit",
        "cell",
        "baselines.reconstruction.surface_fit:SurfaceFit",
        "cell_px",
        0.5,
        4,
        False,
        "side of a grid cell, in pixels at the origin",
    ),
    Parameter(
        "surface-bpa",
        "radius",
        "baselines.reconstruction.surface:SurfaceBpa",
        "radius_percent",
        0.1,
        20,
        False,
        "of the ball, in percent of the diagonal of the cloud's box",
    ),
    Parameter(
        "poisson",
        "depth",
        "baselines.reconstruction.poisson:Poisson",
        "depth",
        3,
        10,
        True,
        "levels of the octree",
    ),
    Parameter(
        "alpha-wrap",
        "ball",
        "baselines.reconstruction.alpha_wrap:AlphaWrap",
        "ball",
        0.5,
        8,
        False,
        "radius of the ball, in spacings of the points",
    ),
    Parameter(
        "denoised-wrap",
        "ball",
        "baselines.reconstruction.alpha_wrap:DenoisedWrap",
        "ball",
        0.5,
        8,
        False,
        "radius of the ball, in spacings of the points",
    ),
    Parameter(
        "denoised-wrap",
        "strength",
        "baselines.reconstruction.alpha_wrap:DenoisedWrap",
        "strength",
        0,
        4,
        False,
        "factor on the estimated noise",
    ),
    Parameter(
        "open3d-poisson",
        "depth",
        "baselines.reconstruction.open3d_poisson:Open3dPoisson",
        "depth",
        3,
        10,
        True,
        "levels of the octree",
    ),
    Parameter(
        "splat",
        "spread",
        "baselines.splat:Splat",
        "spread",
        0.1,
        10,
        False,
        "factor on the radius of the discs",
    ),
)


@dataclass(frozen=True)
class Setting:
    """A parameter and its value."""

    parameter: Parameter
    value: float

    @property
    def fields(self) -> dict[str, float]:
        """Return the arguments of the renderer's class."""
        return {self.parameter.field: self.value}


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
