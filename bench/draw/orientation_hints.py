"""Guesses at clouds whose columns or axes seem to be mistaken for others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from data_prep.clouds.normalise import Placement
from data_prep.clouds.sampling import random_rows
from data_prep.scene import PointCloud

# The fewest points of a cloud whose up axis is guessed: with fewer, its symmetry cannot be judged.
_FEWEST_HINTED = 256
# The most points that the guess looks at, to be quick; of larger clouds it takes a random subset.
_MOST_HINTED = 2048
# A cloud is mirrored along an axis, and the mean distance of the mirrored points to the nearest
# point is compared with the distance between neighbouring points. Up to _SYMMETRIC times as far,
# the cloud counts as symmetric along the axis; from _ASYMMETRIC times on, as not symmetric.
# Both were chosen on 107 real meshes and 390 procedural shapes whose y axis points up. At most 1 %
# of them get a false hint, be they clean, sparse (512 points), or with noise of 5 or 10 % of the
# radius.
_SYMMETRIC, _ASYMMETRIC = 1.2, 3.0
# A cloud stands on its lowest part: all points within _LOWEST of its greatest extent above the
# lowest one, and at least the share _LEAST of all points. It would tip over where its centroid is
# not above the convex hull of that part, and stands firmly where its centroid is farther inside of
# the hull than _FIRM of the extent. Chosen on the same shapes, with the same share of false hints.
# Of the real ones turned so that z points up, `looks_lying` recognises 38 % where the front is at
# -y, and 62 % where it is at x; with 512 points 35 and 41 %, with noise 3 to 22 %.
_LOWEST, _LEAST, _FIRM = 0.02, 0.05, 0.05
# A centre that is so many radii from the origin along x and y is an easting and a northing.
_FAR_ON_A_MAP = 100
_MAP_HEIGHT = 0.1  # the largest height on such a map, as a share of the smaller of the two
_LINE = 1e-3  # points whose extent across is below this share of their length lie on a line


def _finite(cloud: PointCloud) -> NDArray[np.float64]:
    return cloud.points[np.isfinite(cloud.points).all(axis=1)].astype(np.float64)


def looks_like_a_line(cloud: PointCloud) -> bool:
    """Return whether the points lie on a line, as they do where a column of times is read as x."""
    points = _finite(cloud)
    if len(points) < 3:
        return False
    along, across, _ = np.linalg.eigvalsh(np.cov(points.T))[::-1]
    return across <= _LINE**2 * along


def lies_on_a_map(place: Placement) -> bool:
    """Return whether x and y of a cloud are far from the origin and z is not, as on maps."""
    x, y, z = np.abs(place.centre).tolist()
    return min(x, y) > _FAR_ON_A_MAP * place.radius and z < _MAP_HEIGHT * min(x, y)


def looks_lying(cloud: PointCloud) -> bool:
    """Return whether a cloud looks as if its z axis pointed up.

    That is where it would tip over with y up and stands firmly with z up. It is also where it is
    symmetric along y, but not along z: most objects are symmetric from left to right, and many from
    front to back, but hardly any from top to bottom. A cloud of few points does not look so.
    """
    points = _finite(cloud)
    if len(points) < _FEWEST_HINTED:
        return False
    points = points[random_rows(len(points), _MOST_HINTED)]
    return _only_z_is_stable(points) or _only_y_is_symmetric(points)


def _only_z_is_stable(points: NDArray[np.float64]) -> bool:
    """Return whether points [N, 3] tip over with y up, and stand firmly with z up."""
    return _depth_of_centroid(points, up=1) < 0 and _depth_of_centroid(points, up=2) > _FIRM


def _depth_of_centroid(points: NDArray[np.float64], up: int) -> float:
    """Return how far the centroid lies inside of the hull that the points stand on.

    The distance is that in the plane seen from above, as a share of the greatest extent of the
    cloud; negative outside of the hull, and where the lowest points lie on a line. `up` is the
    number of the axis that points up.
    """
    from scipy.spatial import ConvexHull, QhullError

    heights, extent = points[:, up], float(np.ptp(points, axis=0).max())
    limit = max(float(np.quantile(heights, _LEAST)), float(heights.min()) + _LOWEST * extent)
    flat = np.delete(points, up, axis=1)
    try:
        hull = ConvexHull(flat[heights <= limit])
    except QhullError:
        return -1.0
    # A row of `equations` is an outward normal and an offset: the distance to an edge, negated.
    return float(-(hull.equations @ np.append(flat.mean(axis=0), 1)).max()) / extent


def _only_y_is_symmetric(points: NDArray[np.float64]) -> bool:
    """Return whether points [N, 3] are symmetric along y, and not along z."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    # The distance to the second nearest point, as the nearest one is the point itself.
    spacing = float(np.median(tree.query(points, k=[2])[0]))
    asymmetry = []  # the mean distance of mirrored points to the nearest point, along y and along z
    for axis in (1, 2):
        mirrored = points.copy()
        mirrored[:, axis] = points[:, axis].min() + points[:, axis].max() - points[:, axis]
        asymmetry.append(float(np.mean(tree.query(mirrored)[0])))
    return asymmetry[0] < _SYMMETRIC * spacing and asymmetry[1] > _ASYMMETRIC * spacing
