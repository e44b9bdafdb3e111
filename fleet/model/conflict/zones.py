"""Who has a larger protected zone than others, and what a pair therefore requires (eq. 8).

Overlaps are looked for with one cylinder: what two UAVs with the least zones require. Of a pair
that requires more, relative positions are scaled so that its cylinder becomes that one, and all
tests stay as they are. What is laid on it (margin, widening between samples) grows in proportion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fleet.model.conflict.risk import NO_GROWTH, Growth, Required
from fleet.model.types import Array, Pair

ZoneRatio = tuple[float, float]
"""How many times as large as the least a zone is, horizontally and vertically; at least 1."""

LEAST_ZONE: ZoneRatio = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class ZoneRatios:
    """Of each UAV whose zone is larger than the least, how many times; without any all are alike.

    `required` below is always what two UAVs with the least zones require, or that with a margin.
    """

    larger: Mapping[int, ZoneRatio] = field(default_factory=dict)

    def of(self, uav: int) -> ZoneRatio:
        """The ratio of a UAV."""
        return self.larger.get(uav, LEAST_ZONE)

    def of_pair(self, pair: Pair, required: Required) -> Required:
        """What two UAVs require: the sums of the sizes of their zones."""
        if not self.larger:
            return required
        (level, upright), (its_level, its_upright) = map(self.of, pair)
        return Required(
            required.horizontal_m * (0.5 * (level + its_level)),
            required.vertical_m * (0.5 * (upright + its_upright)),
        )

    def of_pairs(self, pairs: Sequence[Pair]) -> Array:
        """How many times as much as the least each pair requires, shape (p, 2)."""
        if not self.larger:
            return np.ones((len(pairs), 2))
        ratios = np.array([(self.of(i), self.of(j)) for i, j in pairs]).reshape(-1, 2, 2)
        of_both: Array = 0.5 * (ratios[:, 0] + ratios[:, 1])
        return of_both

    def greatest(self, required: Required) -> Required:
        """What no pair requires more than."""
        ratios = [LEAST_ZONE, *self.larger.values()]
        level, upright = (max(column) for column in zip(*ratios, strict=True))
        return Required(required.horizontal_m * level, required.vertical_m * upright)

    def halves_m(self, uavs: Sequence[int], required: Required) -> Array:
        """What each of N UAVs adds to the distances required north, east and down: (N or 1, 3)."""
        half = 0.5 * np.array([[required.horizontal_m, required.horizontal_m, required.vertical_m]])
        return half * self.of_pairs([(i, i) for i in uavs])[:, [0, 0, 1]] if self.larger else half

    def scale(
        self,
        pairs: Sequence[Pair],
        required: Required,
        growth: Growth = NO_GROWTH,
        ages_s: Sequence[float] = (0.0,),
    ) -> Array | None:
        """Factors (p, 1, 3) on positions relative to each of a pair; None if they are all 1.

        With `growth`, of each pair the age of what is known of both together.
        """
        if not (self.larger or growth):
            return None
        ages = np.array(ages_s)[:, None]
        if not self.larger:
            return growth.scale(required, ages)
        return growth.scale(required, ages, self.of_pairs(pairs)[:, None])


ALL_ALIKE = ZoneRatios()
