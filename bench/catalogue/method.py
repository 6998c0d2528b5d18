"""The type of a method: a renderer with an id, and what is known about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bench.catalogue.lookup import family_of
from data_prep.failures import BadInput

if TYPE_CHECKING:
    from bench.catalogue.image_tree import ImageTree
    from data_prep.scene import Renderer

Kind = Literal["", "reconstruction", "network", "splat", "reference"]
TrainedOn = Literal["chairs", "13 classes", "nothing"]  # of our own methods
Color = Literal["", "none", "invented", "true"]


@dataclass(frozen=True)
class Method:
    """A renderer with an id, and what is known about it.

    Attributes
    ----------
    id : str
        Kebab-case; a variant follows its method's id and "@".
    load : callable
        Returns the renderer for a device: "auto", "cpu" or "cuda".
    identity : callable
        Returns as text what else its images depend on: the versions of its libraries, the
        checksum of its weights.
    version : int
        Raised by hand when a change alters its images; finished work is then done again.
    source : str
        One line about what it does and where it comes from.
    sees_mesh : bool
        Whether it draws the mesh behind the cloud, as only the ceiling does.
    sees_cloud : bool
        Whether its images depend on the cloud. If not, they are the same under every condition
        and drawn once.
    weights_file : callable or None
        Finds the file of weights of a network.
    trained_on : str or None
        The objects that a network has seen: "chairs", "13 classes" or "nothing"; free text for a
        method entered by images. None means unknown, as for weights in a file.
    reconstruction : str
        The chain that makes a surface of the points: "paper" for the paper's chain or a part of
        it, "other" for another one, "" for none.
    kind : str
        "reconstruction", "network", "splat" or
        "reference" (blank, constant and true-mesh); "" means unknown. A method with a
        `reconstruction` is of kind "reconstruction".
    color : str
        The colours of its images: "none" (grey), "invented" (guessed by a network) or "true" (of
        the mesh); "" means unknown.
    images : ImageTree or None
        The images of a method that was run elsewhere; it draws only clouds of an export, and its
        times are claimed.

    Raises
    ------
    BadInput
        A `reconstruction` of another `kind`.
    """

    id: str
    load: Callable[[str], Renderer]
    identity: Callable[[], str]
    version: int
    source: str
    sees_mesh: bool = False
    sees_cloud: bool = True
    weights_file: Callable[[], Path] | None = None
    trained_on: str | None = None
    reconstruction: Literal["", "paper", "other"] = ""
    kind: Kind = ""
    color: Color = ""
    images: ImageTree | None = None

    def __post_init__(self) -> None:
        if self.reconstruction and self.kind not in ("", "reconstruction"):
            raise BadInput(
                f"method '{self.id}': kind '{self.kind}' with reconstruction "
                f"'{self.reconstruction}'; leave one of the two out"
            )
        if self.reconstruction:
            object.__setattr__(self, "kind", "reconstruction")

    @property
    def address(self) -> str:
        """Return the text by which a run finds the method: its id, or where its images are."""
        return self.images.address if self.images else self.id

    @property
    def family(self) -> str:
        """Return the id without its variant; it fixes colour and marker in every plot."""
        return family_of(self.id)

    @property
    def role(self) -> str:
        """Return "ceiling", "floor" (a reference method that sees no cloud) or "" (competes)."""
        if self.sees_mesh:
            return "ceiling"
        return "floor" if self.kind == "reference" and not self.sees_cloud else ""
