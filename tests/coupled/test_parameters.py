"""Published sets of parameters, each against a result that its paper publishes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.constants import c

import coupled
import thermofem as th
from coupled.explore import contents
from coupled.explore.contents import rings_of
from coupled.parameters import VAN_VAERENBERGH as LAW

RING = coupled.vanvaerenbergh2012()
MODEL = th.Foster(R=[LAW.tau_th / LAW.heat_capacity], tau=[LAW.tau_th])
# Fig. 3 of the paper: 0.6 mW, 62 pm above the resonance. The points are J. Lamo's reading of the curves of the full
# model (T_4D.csv, N_4D.csv): five periods, whose tops and bottoms scatter by 1 %.
LASER = {"power": 0.6e-3, "detuning": c / (1552.770e-9 + 62e-12) - c / 1552.770e-9}
TOPS = np.array([100.10, 177.73, 255.78, 333.50, 411.36, 489.02])  # ns
WARMEST, COLDEST = [2.036, 2.029, 2.021, 2.030, 2.036, 2.035], [1.177, 1.178, 1.161, 1.177, 1.185]  # K
MOST = [1.288e23, 1.296e23, 1.299e23, 1.296e23, 1.293e23, 1.298e23]  # 1/m^3


def test_van_vaerenbergh_pulses_as_in_its_figure():
    run = coupled.simulate(RING, MODEL, **LASER, duration=2e-6, initial=coupled.State(0, 0, [0.7]))
    found = coupled.pulsing(run)
    assert found.regime == "self-pulsing"
    assert found.period == pytest.approx(np.polyfit(np.arange(TOPS.size), TOPS, 1)[0] * 1e-9, rel=0.01)
    last = run.isel(time=run["time"].values > 1e-6)
    assert float(last.delta_T.max()) == pytest.approx(np.mean(WARMEST), rel=0.01)
    assert float(last.delta_T.min()) == pytest.approx(np.mean(COLDEST), rel=0.01)
    assert float(last.carriers.max()) == pytest.approx(np.mean(MOST), rel=0.01)


def test_van_vaerenbergh_is_excitable_beside_its_pulses():
    """A stable point beside the pulses of the figure, and an onset subcritical at some wavelengths (abstract)."""
    assert "stable" in coupled.steady_states(RING, MODEL, **LASER).regime
    powers, detunings = np.geomspace(0.1e-3, 1e-3, 8), np.linspace(-8e9, 0, 9)
    onsets = [curve for curve in coupled.hopf_curves(RING, MODEL, powers, detunings) if curve.leading.all()]
    assert any((curve.lyapunov > 0).any() for curve in onsets)
    assert any((curve.lyapunov < 0).any() for curve in onsets)


def test_van_vaerenbergh_loses_and_heats_as_its_paper_counts_them():
    """The rates of its normalised equations, written with tau_ph, k = 1 and eta_lin, by hand from the same numbers."""
    tau_ph = 102.5e-12
    assert RING.linear_rate == pytest.approx(1 / tau_ph, rel=1e-12)
    assert RING.loaded_q == pytest.approx(np.pi * c / 1552.770e-9 * tau_ph, rel=1e-12)
    # f n / tau_ph with f = Gamma_FCA sigma c/(2 w |dn/dN|) and n = 2 Q |dn/dN| N/n_Si
    assert RING.eta_fca == pytest.approx(0.9996 * 1e-21 * c / (2 * 3.476), rel=1e-12, abs=0)
    # theta = |a|^2 at low power: P_0th = m c_p n_Si ((1 + k)/k)^2/(4 dn/dT tau_th eta Gamma_th Q_i), Q_i = 2 Q
    warmed = MODEL.thermal_resistance * 2 * RING.loss_rate
    assert warmed == pytest.approx(0.9355 * 65e-9 * 0.4 / (2330 * 3.19e-18 * 700 * tau_ph), rel=1e-12, abs=0)


def test_the_preset_of_the_page_leads_to_the_figure():
    """A cold ring comes to rest at the laser of Fig. 3; the cycle of the preset leads to the figure's."""
    rings, models = rings_of(RING, MODEL.thermal_resistance), contents.paper_models()
    rows = contents.presets(rings, models, {"ring": 0, "model": 0})
    state = next(row["state"] for row in rows if row["name"].startswith("Van Vaerenbergh"))
    assert rings[state["ring"]]["name"] == RING.name
    law = models[state["model"]]
    assert (law["R"], law["tau"]) == (MODEL.R.tolist(), MODEL.tau.tolist())
    figure = LASER["detuning"]
    branch = coupled.continue_cycle(
        RING, MODEL, "detuning", (figure, -6e9), power=1e-3 * 10 ** (state["power"] / 10),
        detuning=state["detuning"] * 1e9,
    )  # fmt: skip
    assert float(branch["detuning"][-1]) == pytest.approx(figure, rel=1e-9)
    assert branch["stability"].values[-1] == "stable"
    # the readings scatter by 1 %
    assert float(branch["period"][-1]) == pytest.approx(np.polyfit(np.arange(TOPS.size), TOPS, 1)[0] * 1e-9, rel=0.01)
