"""A method for pc2pix-bench: the convex hull of a cloud, in grey."""

from importlib.metadata import version

import numpy as np

from bench.catalogue.methods import Method
from data_prep.failures import StageFailure


class Hull:
    """Heavy packages are imported where they are needed: `bench list` looks at this module, too."""

    def prepare(self, cloud, rng):
        """Once a cloud: its points are float32 [N, 3], in the unit sphere."""
        from scipy.spatial import ConvexHull, QhullError

        from data_prep.scene import Mesh

        try:
            faces = ConvexHull(cloud.points).simplices
        except (QhullError, ValueError) as error:  # becomes failed records with this reason
            raise StageFailure("hull", str(error).splitlines()[0]) from error
        return Mesh(cloud.points, faces, np.full((len(faces), 3), 160))

    def draw(self, state, views, rng):
        """Once a set of views: float32 [V, 128, 128, 3] in [0, 1]."""
        from data_prep.rendering.images import to_float
        from data_prep.rendering.opengl import render

        return to_float(render(state, views))


METHOD = Method(
    "convex-hull",
    load=lambda device: Hull(),
    identity=lambda: f"scipy {version('scipy')}",  # what else its pictures depend on
    version=1,  # raised when a change here alters its pictures
    source="the smallest convex shape around the points",
)
