"""Clouds as a scanner has them: only points that one of its cameras sees."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from data_prep.clouds.conditions import mesh_behind
from data_prep.failures import BadInput

if TYPE_CHECKING:  # `bench list` answers at once
    import numpy as np

    from data_prep.scene import PointCloud, View

_TOGETHER = 8192  # points drawn at a time, of which most cameras see a fifth to a half
# The most times that so many are drawn: a million points. Where less than 2,048 of them are seen,
# less than .2 % of the surface is outside of all else.
_MOST_DRAWS = 128


@dataclass(frozen=True)
class Scanned:
    """A scan of the mesh: so many points as the cloud has, each seen by one of its cameras.

    The first camera is random, of uniform azimuth and of an elevation within +-40 degrees, at the
    distance of all cameras. The others stand at equal steps of azimuth around the object, each at a
    random elevation of its own. The mesh behind the cloud is sampled anew, uniformly over what the
    cameras see. A camera sees a face from either side, as the true image shows it.
    """

    cameras: int

    def apply(self, cloud: PointCloud, rng: np.random.Generator) -> PointCloud:
        """Return the seen points.

        Raises BadInput where the cloud has no mesh, and where cameras see next to nothing of it.
        """
        import numpy as np

        from data_prep.clouds.sampling import sample_faces
        from data_prep.rendering.raycast import sees

        mesh = mesh_behind(cloud)
        views = self.views(rng)
        corners = mesh.vertices.astype(np.float64)[mesh.faces]
        points, colors = [np.empty((0, 3))], [np.empty((0, 3), np.uint8)]
        for _ in range(_MOST_DRAWS):
            if sum(map(len, points)) >= len(cloud):
                break
            drawn, faces, _ = sample_faces(corners, rng, _TOGETHER)
            seen = np.any([sees(mesh, view, drawn, faces) for view in views], axis=0)
            points.append(drawn[seen])
            colors.append(mesh.face_colors[faces[seen]])
        if sum(map(len, points)) < len(cloud):
            raise BadInput(
                f"of {_MOST_DRAWS * _TOGETHER:,} points on the mesh the {self.cameras} cameras of "
                f"a scan see {sum(map(len, points)):,}, fewer than {len(cloud):,}; leave the "
                "object out, or this condition"
            )
        return replace(
            cloud,
            points=np.concatenate(points)[: len(cloud)],
            colors=None if cloud.colors is None else np.concatenate(colors)[: len(cloud)],
        )

    def views(self, rng: np.random.Generator) -> tuple[View, ...]:
        """Return the views of the cameras, the first one first."""
        from data_prep.clouds.sampling import random_views
        from data_prep.scene import View

        (first,) = random_views(1, rng)
        views = [first]
        for number in range(1, self.cameras):
            (other,) = random_views(1, rng)
            azimuth = first.azimuth_deg + 360 * number / self.cameras
            views.append(View(azimuth, other.elevation_deg))
        return tuple(views)
