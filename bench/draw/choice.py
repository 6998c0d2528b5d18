"""The choice of the method that draws a user's cloud, and notes that its user should read."""

from __future__ import annotations

from collections.abc import Sequence

from bench.catalogue.chosen import MOST_MEASURED, best_within
from bench.catalogue.lookup import family_of
from bench.catalogue.methods import RECOMMENDED, RECOMMENDED_IN_COLOUR, Method, find_method
from data_prep.failures import BadInput
from data_prep.scene import CLOUD_SIZE, PointCloud

# Lines for the user, on what is left out of a file, and on what a method did to the points.
Notes = tuple[str, ...]


def check_source(method: Method, cloud: PointCloud) -> None:
    """Raise BadInput for a method that draws the mesh behind a cloud where there is none."""
    if method.sees_mesh and cloud.source is None:
        raise BadInput(
            f"method '{method.id}' draws the mesh behind a cloud, and bare points have none; "
            "give another method"
        )


def method_of_mesh(colour: str) -> str | None:
    """Return the method that draws a mesh itself where no method is named; None for none.

    colour  "grey" and "invented", in colours that no mesh has, or another word
    """
    return {"grey": "true-mesh@grey", "invented": None}.get(colour, "true-mesh")


def check_colour(method_id: str, colour: str) -> None:
    """Raise BadInput for a method that makes colours up, where those of a file or none are wanted.

    colour  "grey" and "file" are refused; "auto" and "invented" are not
    """
    if colour in ("grey", "file") and find_method(method_id).color == "invented":
        raise BadInput(
            f"method '{method_id}' makes colours up; give method {RECOMMENDED}, or another one "
            f"that draws in grey, or leave out the colour '{colour}'"
        )


def check_camera(method_id: str) -> None:
    """Raise BadInput for a method that knows no cameras but those of azimuth and elevation."""
    if family_of(method_id) == "pc2pix":
        raise BadInput(
            f"method '{method_id}' knows a camera by azimuth and elevation alone; give these in "
            "place of the camera, or another method"
        )


def notes_on_size(methods: Sequence[str], size: int) -> Notes:
    """Return a line for each method whose images are resampled."""
    notes = []
    for name in methods:
        side = find_method(name).drawn_at(size)
        if side == size:
            continue
        note = f"{name} draws {side} x {side} pixels; resampled to {size} x {size} (Lanczos)"
        if side < size:
            note += ", which adds no detail; surfaces and discs are drawn at any size"
        notes.append(note)
    return tuple(notes)


def methods_to_draw(
    methods: Sequence[str], in_colour: bool = False, budget_ms: float | None = None
) -> tuple[str, ...]:
    """Return the methods, each once; where none is named, the one to choose.

    That is the best one of 2,048 points within the budget (`within_budget` chooses for others);
    without a budget it is the recommended method for objects of any class.

    in_colour  whether the method has to draw in colours, which a network makes up, instead of grey
    budget_ms  the most milliseconds for an image, or None

    Raises BadInput for arguments that exclude each other, and for a budget that no method meets.
    """
    if methods and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: it chooses the method, and {', '.join(methods)} is named; "
            "leave out one of the two"
        )
    if in_colour and budget_ms is not None:
        raise BadInput(
            f"budget {budget_ms:g}ms: the methods that it chooses from draw in grey; leave out "
            "the colour or the budget"
        )
    for method_id in methods:
        color = find_method(method_id).color
        if in_colour and color in ("none", "true"):
            draws = "in grey" if color == "none" else "a mesh in its own colours"
            raise BadInput(
                f"method '{method_id}' draws {draws}; leave out the colour, or the method: then "
                f"{RECOMMENDED_IN_COLOUR} draws"
            )
    if methods:
        return tuple(dict.fromkeys(methods))
    if budget_ms is not None:
        return (best_within(budget_ms).method,)
    return (RECOMMENDED_IN_COLOUR if in_colour else RECOMMENDED,)


def within_budget(budget_ms: float, points: int) -> tuple[str, str]:
    """Return the method that a budget chooses for a number of points, and a line that says why.

    Raises BadInput for a budget that no method meets.
    """
    chosen = best_within(budget_ms, points)
    note = (
        f"budget {budget_ms:g}ms: {chosen.method}, of the measured methods within it the best "
        f"on real meshes (score {chosen.score:.3f}); {chosen.one_view_ms:.3g} ms for one image "
        f"of {max(points, CLOUD_SIZE):,} points, where it was measured"
    )
    if points > MOST_MEASURED:
        note += f" (extrapolated from {MOST_MEASURED:,} points)"
    return chosen.method, note


def notes_on_methods(methods: Sequence[str]) -> Notes:
    """Return a line on methods that know only chairs."""
    notes = []
    if chairs := [name for name in methods if find_method(name).trained_on == "chairs"]:
        were = "was" if len(chairs) == 1 else "were"
        notes.append(
            f"{', '.join(chairs)} {were} trained on chairs and may draw a chair whatever the cloud "
            "is; for other objects leave out the method"
        )
    return tuple(notes)
