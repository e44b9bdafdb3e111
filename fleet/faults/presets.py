"""Presets: rules for links that have been specified or measured, by name."""

from __future__ import annotations

import math
from collections.abc import Callable

from fleet.faults.kinds.burst import Burst
from fleet.faults.kinds.latency import Latency
from fleet.faults.kinds.range import Range
from fleet.faults.links import LinkRule
from fleet.faults.quantities import NM_M
from fleet.model.elementary import expm1, log

Preset = Callable[[float], list[LinkRule]]
"""The rules of a preset, given the time between two broadcasts of a UAV, in seconds."""


def perfect(_: float) -> list[LinkRule]:
    """No faults."""
    return []


def adsb(broadcast_s: float) -> list[LinkRule]:
    """Broadcasts are received as surveillance by ADS-B has to be: 95 % within 3 s out to 10 NM.

    As in RTCA DO-365, Minimum Operational Performance Standards for detect and avoid systems: with
    probability 0.95 one broadcast or more of those within 3 s is received at 10 NM. Broadcasts are
    lost independently, and received with probability exp(-(d / scale)^2).
    """
    received = -expm1(log(0.05) * (broadcast_s / 3.0))
    scale_m = 10.0 * NM_M / math.sqrt(-log(received))
    return [Range(classes="adsb", model="rayleigh", scale_m=scale_m)]


def wifi(_: float) -> list[LinkRule]:
    """WiFi of two multicopters: loss 5.335e-7 d^2 + 3.395e-5 d, d in m; nothing beyond 1.34 km.

    From the source code of the simulator ArduSim, whose model "802.11a with 5dBi antenna" is a fit
    to measurements between two multicopters, at 5.18 GHz (ArduSim: Accurate and real-time
    multicopter simulation, Simulation Modelling Practice and Theory, 2018,
    doi:10.1016/j.simpat.2018.06.009).
    """
    return [Range(model="polynomial", quadratic_per_m2=5.335e-7, linear_per_m=3.395e-5)]


def rayleigh(_: float) -> list[LinkRule]:
    """Rayleigh fading over free space: received with probability exp(-(d / 1 km)^2).

    The power received is exponentially distributed, its mean falls with d^2, and reception needs
    a least power (Tse and Viswanath, Fundamentals of Wireless Communication, 2005, 5.4.1, outage
    of a slow fading channel).
    """
    return [Range(model="rayleigh", scale_m=1000.0)]


def bursty(_: float) -> list[LinkRule]:
    """Loss of 20 %, in bursts of 5 ticks in the mean (Gilbert-Elliott)."""
    return [Burst(loss=0.2, mean_ticks=5.0)]


def adsb_latency(_: float) -> list[LinkRule]:
    """Broadcasts come as late as those of ADS-B may: 95 % within 1.2 s, exponentially distributed.

    The bound is that of RTCA DO-242A, Minimum Aviation System Performance Standards for ADS-B
    (R3.26 to R3.30), for positions that are not of high accuracy; the distribution is ours.
    """
    return [Latency(classes="adsb", jitter_s=1.2 / -log(0.05), distribution="exponential")]


def network_remote_id(_: float) -> list[LinkRule]:
    """Broadcasts go by network Remote ID: 95 % within 1 s, 99 % within 3 s; lognormal.

    The two quantiles are what ASTM F3411-22a asks of the answers of service providers; it refreshes
    once a second (`surveillance.broadcast_s = 1`).
    """
    return [
        Latency(classes="adsb", jitter_s=0.0705, sigma=1.612, distribution="lognormal", cap_s=10.0)
    ]


PRESETS: dict[str, Preset] = {
    f.__name__: f for f in (perfect, adsb, wifi, rayleigh, bursty, adsb_latency, network_remote_id)
}
