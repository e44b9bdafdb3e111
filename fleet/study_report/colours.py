"""Colours of a study's charts and figures, told apart by the colour-blind and in grey print."""

from __future__ import annotations

from fleet.analysis.palette import OKABE_ITO

RAMP = (
    *("#fee838", "#e5cf52", "#c8b866", "#aea371", "#948e77", "#7c7b78"),
    *("#666970", "#4f576c", "#35456c", "#083370", "#00224e"),
)
"""From little (light) to much (dark), in equal steps: cividis reversed.

Source: J. R. Nuñez, C. R. Anderton and R. S. Renslow, PLoS ONE 13 (2018), e0199239.
"""

LINE_COLOURS = tuple(OKABE_ITO[n] for n in (0, 5, 2, 3, 4, 1))
"""Of lines, one a level; the yellow is left out, which hardly shows on white."""
