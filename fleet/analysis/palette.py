"""One colour for each UAV, told apart also by the colour-blind: Okabe and Ito (2008), cycled.

The palette's black is left out, so that every colour shows on dark and on light ground.
"""

from __future__ import annotations

OKABE_ITO = (
    "#0072B2",  # blue
    "#E69F00",  # orange
    "#009E73",  # bluish green
    "#CC79A7",  # reddish purple
    "#56B4E9",  # sky blue
    "#D55E00",  # vermilion
    "#F0E442",  # yellow
)

ON_WHITE = OKABE_ITO[:-1]
"""Those that show as thin lines and small print on white, too: yellow does not."""


def colour_of(index: int) -> str:
    """The colour of the UAV in this place of the fleet (0 is the lowest ID), as `#RRGGBB`."""
    return OKABE_ITO[index % len(OKABE_ITO)]


def rgb_of(index: int) -> tuple[int, int, int]:
    """The same colour as red, green and blue from 0 to 255."""
    red, green, blue = bytes.fromhex(colour_of(index)[1:])
    return red, green, blue
