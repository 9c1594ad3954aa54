"""Ready-made circuits: a bus with rings, a SCISSOR and a CROW."""

import math
from collections.abc import Sequence

from thermofem import checks

from ..resonator import RingResonator
from .circuit import Circuit, Detector, LaserPort, Waveguide


def bus(
    rings: RingResonator | Sequence[RingResonator], *, phase: float = 0.0, loss: float = 0.0, delay: float = 0.0
) -> Circuit:
    """Return a circuit of rings in series on one bus, each with its own drop port: a filter bank.

    Laser "in"; detectors "through", and "drop 1" to "drop N" for rings with a second coupler.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        in the order in which the light of the bus passes them.
    phase, loss, delay : float; rad, dB, s
        of the waveguide between two rings.

    Raises
    ------
    InputError
        no ring, or a loss or delay below zero.

    >>> import coupled
    >>> coupled.bus(coupled.borghi2021()).ports
    ('through', 'drop 1')
    """
    every = _several(rings)
    n = len(every)
    between = _chain(n, "through", "in", loss, phase, delay)
    drops = [Detector(f"drop {k}", f"ring {k}.drop") for k, ring in enumerate(every, 1) if ring.drop_bus_rate]
    through = Detector("through", f"ring {n}.through")
    return Circuit(every, between, (LaserPort("in", "ring 1.in"),), (through, *drops), name="bus")


def scissor(
    rings: RingResonator | Sequence[RingResonator], *, phase: float = 0.0, loss: float = 0.0, delay: float = 0.0
) -> Circuit:
    """Return a SCISSOR: rings in parallel between two buses, with light in the second bus running backwards.

    The drop output of a ring feeds "add" of the previous ring. Rings with one coupler give a chain of all-pass filters.
    Laser "in"; detectors "through" at the far end of the first bus, "drop" at the near end of the second.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        in the order in which the light of the first bus passes them.
    phase, loss, delay : float; rad, dB, s
        of the waveguide between two rings, on each bus.

    Raises
    ------
    InputError
        no ring, or a loss or delay below zero.

    >>> import coupled
    >>> coupled.scissor([coupled.borghi2021()] * 3).ports
    ('through', 'drop')
    """
    every = _several(rings)
    n = len(every)
    ways = _chain(n, "through", "in", loss, phase, delay)
    detectors = [Detector("through", f"ring {n}.through")]
    if any(ring.drop_bus_rate for ring in every):
        ways += _chain(n, "drop", "add", loss, phase, delay, back=True)
        detectors.append(Detector("drop", "ring 1.drop"))
    return Circuit(every, ways, (LaserPort("in", "ring 1.in"),), detectors, name="scissor")


def crow(rings: RingResonator | Sequence[RingResonator]) -> Circuit:
    """Return a CROW (coupled-resonator optical waveguide): a chain of directly coupled rings.

    Neighbouring rings share a coupler. It is modelled by the second coupler of the one and the first of the other with
    a quarter-wave waveguide each way, so da_1/dt = ... - i mu a_2 with mu = sqrt(gamma_d1 gamma_e2), and the losses
    into these two couplers cancel. Laser "in" on the first ring; detectors "through" there, "drop" on the last ring.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        from the one with the laser to the one with the drop port, each with two couplers.

    Raises
    ------
    InputError
        no ring, or a ring without a second coupler.

    >>> import coupled
    >>> coupled.crow([coupled.borghi2021()] * 3).ports
    ('through', 'drop')
    """
    every = _several(rings)
    n = len(every)
    quarter = -math.pi / 2
    for k, ring in enumerate(every, 1):
        checks.positive(f"drop_rate of ring {k}", ring.drop_bus_rate, hint="a second coupler leads to the next ring")
    ways = _chain(n, "drop", "in", 0.0, quarter) + _chain(n, "through", "add", 0.0, quarter, back=True)
    detectors = (Detector("through", "ring 1.through"), Detector("drop", f"ring {n}.drop"))
    return Circuit(every, ways, (LaserPort("in", "ring 1.in"),), detectors, name="crow")


def _several(rings: RingResonator | Sequence[RingResonator]) -> list[RingResonator]:
    return [rings] if isinstance(rings, RingResonator) else list(rings)


def _chain(rings: int, start: str, stop: str, *of: float, back: bool = False) -> list[Waveguide]:
    """Waveguides from each ring to the next, or with ``back`` to the previous one; ``of`` are loss, phase and delay."""
    pairs = [(k + 1, k) if back else (k, k + 1) for k in range(1, rings)]
    return [Waveguide(f"ring {a}.{start}", f"ring {b}.{stop}", *of) for a, b in pairs]
