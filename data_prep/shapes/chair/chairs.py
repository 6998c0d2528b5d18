"""Procedural chairs: the embedded data set's best-stocked class.

A chair is drawn in two steps, so that a shape can be separated from the random choices that made
it: `draw_chair_spec` turns randomness into a description, `build_chair` the description into a
mesh.
"""

from __future__ import annotations

import numpy as np

from data_prep.clouds.normalise import normalise
from data_prep.scene import Mesh
from data_prep.shapes.chair.armchairs import armchair_parts
from data_prep.shapes.chair.backs import arm_parts, back_parts
from data_prep.shapes.chair.bases import base_parts
from data_prep.shapes.chair.seats import lay_out, seat_parts
from data_prep.shapes.chair.spec import ChairSpec, Family, draw_chair_spec, draw_spec_of
from data_prep.shapes.solids import Part, join


def chair(rng: np.random.Generator) -> Mesh:
    """Return a random chair, normalised: +Y up, the front (away from the back) towards -Z."""
    return build_chair(draw_chair_spec(rng))


def build_chair(spec: ChairSpec) -> Mesh:
    """Return the chair of a description, normalised; equal descriptions give equal meshes."""
    return normalise(join(_chair_parts(spec)))


def _chair_parts(spec: ChairSpec) -> list[Part]:
    """Return the watertight solids that a chair is made of, in metres above the floor."""
    if spec.family == "armchair":
        return armchair_parts(spec)
    layout = lay_out(spec)
    return [
        *base_parts(spec, layout),
        *seat_parts(spec, layout),
        *back_parts(spec, layout),
        *arm_parts(spec, layout),
    ]


def chair_of(rng: np.random.Generator, family: Family) -> list[Part]:
    """Return the solids of a random chair of this family."""
    return _chair_parts(draw_spec_of(rng, family))
