"""The equations of one ring and its heat written down plainly in SI, as the judge of what the package computes.

Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5, with 2 gamma_e for both buses.
"""

from __future__ import annotations

import numpy as np

import thermofem as th

EPSILON = 1e15  # 1/m^3, where N^p becomes linear


def right_hand_side(y, ring, model, power, detuning):
    """dy/dt of [Re a, Im a, N, x_1 .. x_n] in SI, x_i the rise over R_i."""
    a, N, x = complex(y[0], y[1]), y[2], y[3:]
    U = abs(a) ** 2
    shift = ring.thermal_shift * rise(x, model)
    shift += ring.index_rate * sum(c * N * (N * N + EPSILON**2) ** ((p - 1) / 2) for c, p in ring.fcd)
    D = -shift - ring.kerr_shift * U - 2 * np.pi * detuning
    own = ring.loss_rate + ring.eta_fca * N + ring.eta_tpa * U
    gamma = ring.bus_rate + ring.drop_bus_rate + ring.scattering_rate + own
    da = (1j * D - gamma) * a + 1j * np.sqrt(2 * ring.bus_rate * power)
    tau = ring.carriers.tau0 * (1 + ring.carriers.a * N) / (1 + ring.carriers.b * N)
    dN = ring.g_tpa * U * U - N / tau
    return np.array([da.real, da.imag, dN, *heat_flow(x, 2 * own * U, model)])


def rise(x, model):
    """dT in K of thermal states."""
    if isinstance(model, th.Quadratic):
        return float(model.C @ x)
    z = float(np.sum(x))
    return z + (model.coefficient * z * z if isinstance(model, th.OutputMap) else 0.0)


def heat_flow(x, power, model):
    """dx/dt under a power in W."""
    if isinstance(model, th.Quadratic):
        return model.A @ x + np.einsum("ijk,j,k->i", model.H, x, x) + (model.G @ x + model.B) * power
    linear = model.linear if isinstance(model, th.OutputMap) else model
    return (np.asarray(linear.R) * power - x) / np.asarray(linear.tau)


def jacobian(y, ring, model, power, detuning):
    """Its derivative by the states: differences of fourth order, relative to the size of each state."""
    size = np.abs(y)
    size[:2], size[3:] = np.hypot(*y[:2]), max(np.abs(y[3:]).sum(), 1e-3)
    columns = []
    for j in range(y.size):
        h = 1e-3 * max(size[j], 1e15 if j == 2 else 0.0)
        f = [right_hand_side(y + k * h * np.eye(y.size)[j], ring, model, power, detuning) for k in (-2, -1, 1, 2)]
        columns.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h))
    return np.array(columns).T


def state_at(branch, ring, model, power, detuning):
    """The state at a branch of `coupled.steady_states`: its field from the rates, its heat from the power absorbed."""
    U, N, dT, absorbed = (float(branch[name]) for name in ("energy", "carriers", "delta_T", "absorbed"))
    gamma = ring.linear_rate + ring.eta_fca * N + ring.eta_tpa * U
    D = -ring.thermal_shift * dT - ring.kerr_shift * U - 2 * np.pi * detuning
    D -= ring.index_rate * sum(c * N * (N * N + EPSILON**2) ** ((p - 1) / 2) for c, p in ring.fcd)
    a = 1j * np.sqrt(2 * ring.bus_rate * power) / (gamma - 1j * D)
    if isinstance(model, th.Quadratic):
        heat = model.steady_state(absorbed)
    else:
        heat = np.asarray((model.linear if isinstance(model, th.OutputMap) else model).R) * absorbed
    return np.array([a.real, a.imag, N, *heat])


def leading(J):
    """Largest real part of the eigenvalues, its frequency in Hz, and how many of them grow."""
    values = np.linalg.eigvals(J)
    first = values[values.real.argmax()]
    omega = abs(first.imag) if abs(first.imag) > 1e-6 * abs(first) else 0.0
    return float(first.real), omega / (2 * np.pi), int((values.real > 0).sum())
