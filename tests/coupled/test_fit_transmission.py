"""Slow sweeps fitted by the curve of all fixed points: true parameters, what the cubic says, and a measured ring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy.constants import c

import coupled
import thermofem as th
from coupled.equilibria.transmission import sweep

BASE = coupled.borghi2021()
FREE = ["thermal_resistance", "bus_rate", "loss_rate", "frequency"]
TRUE = {"thermal_resistance": 11e3, "bus_rate": 36e9, "loss_rate": 9e9, "frequency": BASE.frequency + 12e9}


def loops(port, unit, powers, noise=0.005, points=71):
    """Sweeps up and down of the true ring, noisy; the wavelength is what a laser shows."""
    ring = replace(BASE, **{name: value for name, value in TRUE.items() if name != "thermal_resistance"})
    heat, rng, found = th.Foster(R=[TRUE["thermal_resistance"]], tau=[1e-6]), np.random.default_rng(3), []
    for power in powers:
        for way in (1, -1):
            nu = np.linspace(-80e9, 60e9, points)[::way]
            y = sweep(ring, heat, power=power, detuning=nu - 12e9)[port].values
            y = y * {"W": 1.0, "1": 1 / power, "V": 200.0}[unit]
            y = y + noise * y.max() * rng.standard_normal(points)
            wavelength = ("step", c / (BASE.frequency + nu))
            found.append(
                xr.Dataset({port: ("step", y, {"units": unit}), "wavelength": wavelength}, attrs={"power": power})
            )
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("port", "unit"), [("drop", "W"), ("through", "1"), ("through", "V")])
def test_true_parameters_come_back_from_hysteresis(port, unit):
    """Of four parameters and three that follow none is off by five deviations: one in a million if normal."""
    found = coupled.fit_transmission(BASE, loops(port, unit, [1e-4, 2e-3, 4e-3]), free=FREE)
    true = TRUE | {"heating": TRUE["thermal_resistance"]}  # all of the loss is absorbed
    for name, value in true.items():
        assert abs(found.parameters[name] - value) < 5 * found.standard_deviations[name]
    # 0.5 % of noise on 426 samples is 2.4e-4 of a mean; loss_rate is seen as a tenth of the linewidth
    assert max(found.standard_deviations[n] / found.parameters[n] for n in true) < 0.03
    assert found.misfit < 1.5
    assert found.notes == ()


@pytest.mark.slow
def test_absorption_alone_shows_only_its_product_with_the_resistance():
    """Without carriers the tilt is R_th gamma_i/(gamma_i + gamma_s) for one intrinsic Q: neither factor is seen."""
    ring = replace(BASE, tpa_coefficient=0.0, fcd=((0.0, 1.0),), loss_rate=4e9, scattering_rate=2e9)
    heat = th.Foster(R=[20e3], tau=[1e-6])
    seen = [coupled.transmission(ring, heat, power=p, detuning=(-60e9, 40e9)) for p in (1e-4, 3e-3)]
    start = replace(ring, loss_rate=3e9, scattering_rate=3e9)
    free = ["thermal_resistance", "loss_rate", "scattering_rate"]
    found = coupled.fit_transmission(start, [s.drop_vars("through") for s in seen], free=free, model=heat)
    assert any("thermal_resistance alone" in note for note in found.notes)
    assert found.parameters["heating"] == pytest.approx(20e3 * 4 / 6, rel=1e-3)  # 600 points of a curve between points
    assert found.parameters["intrinsic_q"] == pytest.approx(ring.intrinsic_q, rel=1e-3)
    assert found.standard_deviations["heating"] < 0.01 * found.parameters["heating"]
