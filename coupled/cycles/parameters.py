"""The numbers a cycle depends on, by name: of the ring and its carriers, of the laser, and of a thermal network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thermofem import Foster, OutputMap, Quadratic, checks

from ..arguments import check_power
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..thermal import Compact, compact
from ..unknowns import FROM_ZERO, LIFETIMES, check_counts, idle, number_of, optical_names, varied
from .cycle_problem import CycleProblem

STEP = 1e-4  # of a number: its fourth power is the truncation, 1e-16 over it the round-off
LASER = {"power": "W", "detuning": "Hz"}


def parameter_names(ring: RingResonator, model: Compact) -> list[str]:
    """Every name that `changed` knows; "R1" and "tau1" are those of the fastest pole of a network."""
    own = sorted(name for name in optical_names(ring) if not idle(ring, name))
    shifts = [f"fcd{k + 1}" for k in range(len(ring.fcd))]
    order = 0 if isinstance(model, Quadratic) else _poles_of(model).order
    poles = [f"{name}{k + 1}" for name in ("R", "tau") for k in range(order)]
    return [*LASER, *own, *shifts, *poles]


def value_of(p: CycleProblem, name: str) -> float:
    """Return a number of a problem, in SI."""
    if name in optical_names(p.ring):
        check_counts("parameters", name, p.ring)
    else:
        checks.choice("a parameter", name, parameter_names(p.ring, p.model))
    if name in LASER:
        return float(getattr(p, name))
    kind, number = _pole(name)
    if kind == "fcd":
        return float(p.ring.fcd[number][0])
    if kind:
        return float(np.asarray(getattr(_poles_of(p.model), kind))[number])
    return number_of(p.ring, name)


def unit_of(p: CycleProblem, name: str) -> str:
    """SI unit of a number of a problem."""
    kind, number = _pole(name)
    if kind == "fcd":
        return f"m^{3 * p.ring.fcd[number][1]:g}"
    return LASER.get(name) or {"R": "K/W", "tau": "s"}.get(kind) or UNITS[name]


def changed(p: CycleProblem, name: str, value: float) -> CycleProblem:
    """Return the problem with another value of a number."""
    ring, model = p.ring, p.model
    kind, number = _pole(name)
    if name in LASER:
        return replace(p, power=check_power(value)) if name == "power" else replace(p, detuning=value)
    if kind == "fcd":
        terms = [(value, term[1]) if k == number else term for k, term in enumerate(ring.fcd)]
        ring = replace(ring, fcd=tuple(terms))
    elif kind:
        model = _network_with(model, kind, number, value)
    else:
        ring = varied(ring, {name: value})
    return replace(p, ring=ring, model=model)


def differences(p: CycleProblem, name: str) -> list[tuple[float, CycleProblem]]:
    """Weights and problems whose flows, added up, are the derivative by a number, in internal units over SI."""
    value = value_of(p, name)
    h = STEP * (p.ring.linear_rate / (2 * np.pi) if name == "detuning" else abs(value)) or FROM_ZERO.get(name, 0.0)
    if h == 0:
        raise checks.InputError(f"{name} is 0 and has no step for differences; give it a small value")
    if value != 0 or name == "detuning":
        return [(w / (12 * h), changed(p, name, value + k * h)) for k, w in ((1, 8), (-1, -8), (2, -1), (-2, 1))]
    return [(4 / (2 * h), changed(p, name, h)), (-1 / (2 * h), changed(p, name, 2 * h)), (-3 / (2 * h), p)]


def _pole(name: str) -> tuple[str, int]:
    """Split "R1", "tau12" or "fcd2" into its kind and a number from 0; ("", 0) for another name."""
    for kind in ("R", "tau", "fcd"):
        rest = name.removeprefix(kind)
        if rest != name and rest.isdigit() and rest != "0" and name not in (*LIFETIMES, "tau0"):
            return kind, int(rest) - 1
    return "", 0


def _poles_of(model: Compact) -> Foster:
    """The network of a model that has one."""
    if isinstance(model, Quadratic):
        raise checks.InputError("a quadratic model has no poles R and tau; name numbers of the ring or of the laser")
    return model.linear if isinstance(model, OutputMap) else model


def _network_with(model: Compact, kind: str, number: int, value: float) -> Compact:
    """The network, or the output map over one, with another R or tau."""
    linear = _poles_of(model)
    R, tau = np.array(linear.R, dtype=float), np.array(linear.tau, dtype=float)
    (R if kind == "R" else tau)[number] = value
    poles = replace(linear, R=R, tau=tau)  # checks them and sorts them
    checks.keep(poles, R=R, tau=tau)  # states and names keep their poles where one time constant passes another
    return compact(replace(model, linear=poles) if isinstance(model, OutputMap) else poles)
