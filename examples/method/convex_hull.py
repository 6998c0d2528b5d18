"""A method for pc2pix-bench: the convex hull of a cloud, in grey."""

from importlib.metadata import version

import numpy as np

from bench.catalogue.methods import Method
from data_prep.failures import StageFailure


class Hull:
    """A renderer. Its functions import heavy packages, because `bench list` imports this module."""

    def prepare(self, cloud, rng):
        """Return the state of one cloud, whose points are float32 [N, 3] in the unit sphere."""
        from scipy.spatial import ConvexHull, QhullError

        from data_prep.scene import Mesh

        try:
            faces = ConvexHull(cloud.points).simplices
        except (QhullError, ValueError) as error:  # becomes failed records with this reason
            raise StageFailure("hull", str(error).splitlines()[0]) from error
        return Mesh(cloud.points, faces, np.full((len(faces), 3), 160))

    def draw(self, state, views, rng):
        """Return the images of a set of views, float32 [V, 128, 128, 3] in [0, 1]."""
        from data_prep.rendering.images import to_float
        from data_prep.rendering.opengl import render

        return to_float(render(state, views))


METHOD = Method(
    "convex-hull",
    load=lambda device: Hull(),
    identity=lambda: f"scipy {version('scipy')}",  # what else its images depend on
    version=1,  # raised when a change here alters its images
    source="the smallest convex shape around the points",
    trained_on="nothing",
)
