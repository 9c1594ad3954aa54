"""The list of thermal models that every contract test runs over: a new kind of model joins by one line."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from grids import facets_where, graded, tensor_mesh

import surrogate
import thermofem as th
from thermofem.fem.weak_forms import capacity, conduction
from thermofem.models import NonlinearSystem, foster
from thermofem.transient.nonlinear import Ledger, ledger_of, nodal_operator


@cache
def coarse(growth: float = 20) -> tuple[th.mesh.Mesh, th.fem.Discretization]:
    """The reference strip on a very coarse mesh."""
    um = 1e-6
    mesh = tensor_mesh(
        graded(0, 7.73 * um, 8.18 * um, 60 * um, finest=0.22 * um, growth=growth),
        graded(-32 * um, -2 * um, 0, 0.22 * um, 2.22 * um, finest=0.11 * um, growth=growth),
        lambda r, z: np.where((abs(r - 7.955 * um) < 0.225 * um) & (z > 0) & (z < 0.22 * um), 2, z > -2 * um),
        ("substrate", "oxide", "core"),
    )
    k, c = np.array([130, 1.38, 130])[mesh.region], np.array([2330 * 700, 2203 * 703, 2330 * 700])[mesh.region]
    held = facets_where(mesh, lambda r, z: np.isclose(z, -32 * um))
    return mesh, th.fem.discretize(mesh, k, c, th.fem.Surfaces(held=held))


def linear_ledger(d: th.fem.Discretization) -> Ledger:
    """The energy balance of matrices without temperature dependence."""
    flow, content = (nodal_operator((), matrix, d.free, 0.0) for matrix in (d.stiffness, d.mass))
    return ledger_of(flow, content, d.held)


@cache
def coarse_fem(growth: float = 20) -> th.StateSpace:
    """An exact model of itself."""
    return coarse(growth)[1].state_space(("core",), ("core",))


@cache
def coarse_poles() -> th.Foster:
    """All its poles, by diagonalization."""
    return foster(coarse_fem())


@cache
def coarse_warm_fem() -> NonlinearSystem:
    """The same with k and c_p of every region following laws around 300 K."""
    mesh, d = coarse(growth=300)
    flows, contents = [], []
    for regions, k, c, k_law, c_law in (
        ((0, 2), 130, 2330 * 700, th.materials.PowerLaw(-1.3), th.materials.PowerLaw(0.4)),
        ((1,), 1.38, 2203 * 703, th.materials.PowerLaw(0.3), th.materials.Polynomial((1e-3,))),
    ):
        cells = np.isin(mesh.region, regions)
        flows.append((conduction(d.basis, k * cells), k_law))
        contents.append((capacity(d.basis, c * cells), c_law))
    flow, content = (
        nodal_operator(flows, 0 * d.stiffness, d.free, 300.0),
        nodal_operator(contents, 0 * d.mass, d.free, 300.0),
    )
    return NonlinearSystem(
        d.state_space(("core",), ("core",)),
        replace(flow, matrix=flow.matrix[d.free]),
        replace(content, matrix=content.matrix[d.free]),
    )


@cache
def warm_fem() -> th.fem.HeatProblem:
    """The reference strip with k(T) and c_p(T), on its committed mesh."""
    film, oxide = th.materials.find("Si(T)"), th.materials.find("SiO2(T)")
    materials = (replace(film, name="Si"), replace(oxide, name="SiO2"))
    return th.assemble(replace(th.strip_ring(), materials=materials))


@cache
def reduced_fem() -> th.Foster:
    """Its certified reduction."""
    return surrogate.reduce(coarse_fem(), tolerance=1e-4).model


@cache
def fit_of_step() -> surrogate.fitting.fit.Fit:
    """A fit of five poles to a step of it."""
    times = np.geomspace(1e-9, 60e-6, 120)
    step = 1e-3 * coarse_poles().step_response(times)
    return surrogate.fit_foster(th.dataset.build(times, step, th.Constant(1e-3)), order=5)


def state_space(poles: th.Foster) -> th.StateSpace:
    """The same poles as matrices, mixed by a rotation, so that A is full."""
    n = poles.order
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(n, n)))[0]
    b = turn.T @ np.sqrt(poles.gain)
    A = -turn.T @ np.diag(1 / poles.tau) @ turn
    return th.StateSpace(np.eye(n), (A + A.T) / 2, b[:, None], b[None])


@cache
def quadratic() -> th.Quadratic:
    """Three poles whose rates fall by a few percent at 100 K, and with the power."""
    rate, R = np.array([2e7, 2e6, 1e5]), np.array([1000.0, 4000.0, 3000.0])
    couple = np.array([[2.0, 1, 0], [1, 2, 1], [0, 1, 2]]) * 1e-4  # 1/K
    H = rate[:, None, None] * couple[:, :, None] * np.array([0.5, 1.0, 0.5])
    H = (H + H.transpose(0, 2, 1)) / 2
    return th.Quadratic(-np.diag(rate), H, 3e3 * rate[:, None] * couple, rate * R, np.ones(3), largest_rise=1e3)


def identified_network() -> th.models.Network:
    """A chain of three heat capacities, core to ground, as SINDy writes it: A is not symmetric."""
    c, g = np.array([8e-12, 4e-11, 3e-10]), np.array([4e-4, 3e-4, 2.5e-4])  # J/K, W/K
    K = np.diag(g + np.append(0, g[:-1])) - np.diag(g[:-1], 1) - np.diag(g[:-1], -1)
    A, b = -K / c[:, None], np.array([1 / c[0], 0, 0])
    poles = th.models.gate(A, b, float((1 / g).sum()))
    return th.models.Network(A, b, ("core", "near", "far"), poles, largest_rise=20.0)


@cache
def ladder():
    """Newton's law and the second-order equation, trained on the reference strip."""
    return surrogate.train_all(th.assemble(th.strip_ring(), accuracy=1e-2), names=["Newton", "second order"])


_MAKERS = {
    "newton": lambda: surrogate.newton(tau_th=275e-9),
    "second order": lambda: surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31),
    "foster of five": lambda: th.Foster(R=[600, 1500, 2500, 2000, 1200], tau=[3e-9, 30e-9, 200e-9, 1.5e-6, 8e-6]),
    "state space, small": lambda: state_space(reduced_fem()),
    "fem": coarse_fem,  # after the small one: files of every kind are tested with its first
    "fem, reduced": reduced_fem,
    "foster, trained": lambda: fit_of_step().model,
    "fem, diagonalised": coarse_poles,
    "fem, k(T) and c_p(T)": coarse_warm_fem,
    "output map": lambda: th.OutputMap(reduced_fem(), -4e-4, largest_rise=1e3),
    "quadratic": quadratic,
    "Cauer ladder": lambda: surrogate.cauer(
        surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31)
    ),
    "SINDy network": identified_network,
    "a fit": fit_of_step,
    "a reduction": lambda: surrogate.reduce(coarse_fem(), tolerance=1e-4),
    "a truncation": lambda: surrogate.balanced_truncation(coarse_fem(), 5),
    "a quadratic reduction": lambda: surrogate.reduce_quadratic(coarse_warm_fem(), 38e-3, tolerance=2e-2),
    "an entry of a ladder": lambda: ladder().models["second order"],
}
MODELS = {name: cache(make) for name, make in _MAKERS.items()}  # each is made once a process: they are frozen
