"""A condition for pc2pix-bench: every point is lost with the same chance, independently."""

from dataclasses import dataclass, replace

from data_prep.clouds.conditions import Condition


@dataclass(frozen=True)
class Dropout:
    """Points that get lost on their way. Its `repr` names finished work."""

    chance: float

    def apply(self, cloud, rng):
        """Return the points that are left, in their order; of a cloud at least the first one."""
        stays = rng.random(len(cloud)) >= self.chance
        stays[:1] |= not stays.any()  # a condition leaves at least one point
        return replace(cloud, points=cloud.points[stays])


CONDITION = Condition(
    "dropout-half",
    Dropout(0.5),
    "ours: a scanner whose connection loses half of its points",
    version=1,  # raised when a change here alters its clouds
)
