"""Random rings and thermal models for the page that computes a ring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import coupled
import thermofem as th
from coupled.explore.contents import model_of, ring_data


def ring_and_model(seed):
    """A ring with other quality factors, lifetime, dispersion and Kerr effect, and a network of 1 to 14 poles."""
    draw = np.random.default_rng(seed)
    base = [coupled.borghi2021(), coupled.borghi2021().with_lumped_fcd(), coupled.vanvaerenbergh2012()][seed % 3]
    factor = 10 ** draw.uniform(-0.4, 0.4)
    carriers = base.carriers
    if seed % 4 == 0:
        carriers = coupled.ConstantLifetime(10 ** draw.uniform(-8.5, -7.2))
    ring = replace(
        base,
        bus_rate=base.bus_rate * factor,
        loss_rate=base.loss_rate * 10 ** draw.uniform(-0.3, 0.3),
        scattering_rate=base.loss_rate * draw.uniform(0.01, 1),
        carriers=carriers,
        kerr_coefficient=4.5e-18 if seed % 5 == 0 else 0.0,
        fca_cross_section=base.fca_cross_section * draw.uniform(0.5, 1.5),
        index_confinement=0.9 if seed % 60 == 23 else None,
    )
    poles = int(draw.integers(1, 15))
    shares = draw.uniform(0.2, 1, poles)
    model = th.Foster(R=draw.uniform(4e3, 2e4) * shares / shares.sum(), tau=10 ** draw.uniform(-8.3, -5.3, poles))
    if seed % 7 == 0:
        model = th.OutputMap(model, draw.uniform(-4e-4, 4e-4))
    width = ring.linear_rate / np.pi
    power = 10 ** draw.uniform(-3.2, -2) * (ring.linear_rate / 9e10) ** 0.7
    return ring, model, power, width * draw.uniform(-1.2, 0.8)


def argument(ring, model, power, detuning, **more):
    return {
        "ring": ring_data(ring), "model": model_of("model", model), "power": power, "detuning": detuning, **more,
    }  # fmt: skip


def run_from_cold(seed):
    """Ring, model, power, detuning and duration of a run from cold; of odd seeds the heat is up to 20 times slower."""
    ring, model, power, detuning = ring_and_model(seed)
    draw = np.random.default_rng(10_000 + seed)
    if seed % 2:
        network = model.linear if isinstance(model, th.OutputMap) else model
        slow = th.Foster(R=network.R, tau=np.asarray(network.tau) * 10 ** draw.uniform(0, 1.3, network.order))
        model = th.OutputMap(slow, model.coefficient) if isinstance(model, th.OutputMap) else slow
    return ring, model, power * 10 ** draw.uniform(-0.3, 1), detuning, 10 ** draw.uniform(-6, -4.3)
