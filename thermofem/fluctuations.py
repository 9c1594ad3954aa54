"""Thermal fluctuations of a ring, from the matrices of its heat: thermo-refractive noise.

The fluctuation-dissipation theorem, with one-sided densities and f in Hz:

    S_T(f)  = 4 k_B T^2 Re Z(2 pi i f),      Z(s) = c^T (K + s M)^-1 c
    S_nu(f) = (nu thermo_optic)^2 S_T(f)
    <dT^2>  = k_B T^2 c^T M^-1 c

c is the weight of the part or mode, the same for heat in and temperature out; its sum is 1. A Foster network has
Re Z = sum_k R_k/(1 + (2 pi f tau_k)^2) and c^T M^-1 c = sum_k R_k/tau_k. About a steady state with light the forces on
the poles pass through the linear ring, S_T = 4 k_B T^2 sum_k |H_k|^2.

The variance is that of the matrices: a reduction holds less of it, what it leaves out lies at high frequencies.

Sources: H. B. Callen and T. A. Welton, Phys. Rev. 83, 34 (1951); Yu. Levin, Phys. Lett. A 372, 1941 (2008).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.constants import Boltzmann, c as light_speed
from scipy.linalg import solve_continuous_lyapunov
from scipy.linalg.lapack import dgebal

from . import checks
from .algebra.factor import factorize
from .algebra.krylov import four_shifts
from .arrays import Array, ArrayLike
from .checks import InputError
from .data import dataset
from .fem import HeatProblem
from .geometry.section_parts import LIGHT
from .models import Foster, StateSpace
from .models.contract import bare
from .models.state_space import MOST_STATES, eigenmodes

CERTIFIED = 1e-4  # of Re Z at every frequency, where the space of a heat problem stops growing
NOISE_ROUND_OFF = 1e-9  # of Re Z: what solves leave (measured 1e-12)
TAKEN = "a HeatProblem, a Foster network, a StateSpace, or coupled.linearize(...) is needed"


class Spectrum(NamedTuple):
    """Noise of one temperature in units of 4 k_B T^2: ``real`` is Re Z in K/W, at every frequency, ``bound`` its error.

    mean_square [K/J]: c^T M^-1 c. shift [Hz/K]: of the resonance, None where it is not known.
    """

    real: Array
    bound: Array
    mean_square: float
    shift: float | None


def thermal_noise(heat: Any, frequencies: ArrayLike, read: str = LIGHT, temperature: float | None = None) -> xr.Dataset:
    """Return the thermal noise of a temperature of the ring, and of its resonance.

        S_T = 4 k_B T^2 Re Z,     S_nu = (nu thermo_optic)^2 S_T          one-sided, over f >= 0

    Parameters
    ----------
    heat : HeatProblem, Foster, StateSpace, or Linear
        a heat problem of which anything can be read; a model or reduction; a ring with light, `coupled.linearize`.
    frequencies : array, Hz
        increasing; 0 is the static value.
    read : str
        part, probe or "light", the mode of `HeatProblem.with_light`. A model with one output has no choice; of a linear
        ring "light" is the first output in K, and any other output in K has its name.
    temperature : float, K
        absolute, T; default the ambient of the geometry, and 300 K where there is none. Conductivities that depend on
        the temperature are those at the ambient of the geometry.

    Returns
    -------
    xarray.Dataset
        over frequency: S_T (K^2/Hz), bound (K^2/Hz, of the error of S_T by the reduction; nan where it is not known),
        and S_nu (Hz^2/Hz) where the shift of the resonance is known. Attributes: variance (K^2), rms_temperature (K),
        temperature (K), read, and where known thermal_shift (Hz/K) and rms_frequency (Hz).

    Raises
    ------
    InputError
        a negative frequency, a name that is not read, a heat problem without light, a model from one part to another,
        an unstable steady state, whose noise grows.

    Compared with e^x E1(x)/(4 pi k) of a Gaussian weight to 1e-4, and with ngspice ``.noise`` to six digits.

    >>> import thermofem as th
    >>> noise = th.thermal_noise(th.Foster(R=[7000.0], tau=[1e-6]), [0.0, 1e6], temperature=300.0)
    >>> print(f"{noise.S_T.values[0]:.3e} K^2/Hz, rms {noise.attrs['rms_temperature'] * 1e6:.1f} uK")
    3.479e-14 K^2/Hz, rms 93.3 uK
    """
    f = checks.array("frequencies", frequencies, increasing=True)
    checks.between("frequencies[0]", f[0], 0, np.inf, unit="Hz", hint="densities are one-sided")
    read = checks.text("read", read)
    # a model without a geometry is at 300 K
    ambient = heat.geometry.ambient if isinstance(heat, HeatProblem) else 300.0
    T = ambient if temperature is None else temperature
    T = checks.between("temperature", T, 1e-3, 5000, unit="K", hint="it is absolute: room temperature is 300")
    spectrum = _spectrum(heat, 2 * np.pi * f, read)
    return _described(spectrum, f, T, read)


def real_impedance(R: Array, tau: Array, frequency: Array) -> Array:
    """Re Z = sum_k R_k/(1 + (2 pi f tau_k)^2) of poles (K/W, s) at frequencies (Hz)."""
    phase = 2 * np.pi * np.multiply.outer(frequency, tau)
    return (R / (1 + phase**2)).sum(axis=-1)


def one_pole(frequency: Array, static: float, variance: float) -> Array:
    """S_T (K^2/Hz) of one pole with the same static density (K^2/Hz) and variance (K^2), tau = static/(4 variance)."""
    return real_impedance(np.array([static]), np.array([static / (4 * variance)]), frequency)


def linewidth(noise: xr.Dataset) -> float:
    """Full width at half maximum (Hz) of a line whose frequency has the noise S_nu of `thermal_noise`.

        width = sqrt(8 ln 2 A),     A = int S_nu df over the frequencies with S_nu > 8 ln 2 f/pi^2

    by the trapezoidal rule on the frequencies of the Dataset; observed for longer than its lowest period.

    Source: Di Domenico, Schilt and Thomann, Appl. Opt. 49, 4801 (2010); they find it within 10 % of exact widths.
    """
    f = noise["frequency"].values
    S = noise["S_nu"].values
    line = 8 * np.log(2) * f / np.pi**2
    slow = np.where(line < S, S, 0.0)
    area = np.trapezoid(slow, f)
    return float(np.sqrt(8 * np.log(2) * area))


def _spectrum(heat: Any, omega: Array, read: str) -> Spectrum:
    """Spectrum of whatever `thermal_noise` takes, at angular frequencies (rad/s)."""
    if isinstance(heat, HeatProblem):
        return _of_problem(heat, omega, read)
    if hasattr(heat, "thermal_forces"):
        return _of_linear(heat, omega, read)
    model = bare(heat)
    if isinstance(model, StateSpace) and model.order > MOST_STATES:
        return _certified(model, model.C[_output(model, read)], omega)
    return _of_poles(port_of("heat", model, read), omega, _reduction_error(heat, model, read))


def _reduction_error(heat: Any, model: Any, read: str) -> float:
    """Relative error bound that a reduction has for what is read; nan for what it does not heat, 0 for other models."""
    if not hasattr(heat, "channel_bounds"):
        return 0.0
    output = _output(model, read)
    part = model.outputs[output]
    if part not in model.inputs:
        return np.nan
    return float(heat.channel_bounds[output, model.inputs.index(part)])


def port_of(name: str, model: Any, read: str) -> Foster:
    """The poles of a small model with one weight for heat and temperature, that of its output ``read``.

    name: of the argument in messages. A model with one output has no choice.
    Raises InputError: a model of another kind, a name that is not read, a network between two parts.
    """
    checks.instance(name, model, Foster, StateSpace, hint=TAKEN)
    output = _output(model, read)
    if isinstance(model, StateSpace):
        rate, modes = eigenmodes(model)
        part = (model.outputs[output],)
        weight = model.C[output] @ modes
        return Foster(R=weight**2 / rate, tau=1 / rate, inputs=part, outputs=part)
    if model.inputs == model.outputs and model.passive:
        return model
    raise InputError(
        f"{name} is a network from {model.inputs[0]!r} to {model.outputs[0]!r} with R = {np.min(model.R):.3g} K/W; "
        "noise needs one port, the same weight for heat and temperature",
        "give the HeatProblem to thermal_noise, or reduce heat.channels(part, part)",
    )


def _output(model: Any, read: str) -> int:
    """Index of the output that is read; the only one where ``read`` is the default."""
    if len(model.outputs) == 1 and read == LIGHT:
        return 0
    checks.choice("read", read, model.outputs)
    return model.outputs.index(read)


def _of_problem(heat: HeatProblem, omega: Array, read: str) -> Spectrum:
    """Spectrum of a heat problem; the mode's shift where the light is read."""
    if read == LIGHT and LIGHT not in heat.readable:
        raise InputError(
            f"read = {LIGHT!r}, but the heat problem has no light",
            "heat.with_light(th.light(heat, wavelength=1.55e-6).mode()) has, or read='core'",
        )
    system = heat.channels(heat.heated[0], read)
    spectrum = _certified(system, system.C[0], omega)
    if read != LIGHT or heat.light is None:
        return spectrum
    nu = light_speed / heat.light.wavelength
    return spectrum._replace(shift=nu * heat.light.thermo_optic)


def _of_poles(port: Foster, omega: Array, error: float) -> Spectrum:
    """Spectrum of a network; ``error`` is relative to the static value."""
    real = real_impedance(np.asarray(port.R), np.asarray(port.tau), omega / (2 * np.pi))
    bound = np.full(omega.size, error * port.thermal_resistance)
    return Spectrum(real, bound, float(port.gain.sum()), None)


def _certified(system: StateSpace, weight: Array, omega: Array) -> Spectrum:
    """Spectrum of a mean of a large system from a rational Krylov space that grows until its error is bounded.

    With V the space, R = c - M V V^T c and r = c - (K + i w M) V y = phi R the residual of the reduced solution,

        |Z - Z_r| <= |phi|^2 min_j R^T (K + s_j M)^-1 R sqrt(1 + s_j^2/w^2)          over the shifts s_j

    which `surrogate.reduction.certified_space` derives; for s_j = 0 the root is 1.
    """
    port = StateSpace(system.E, system.A, weight[:, None], weight[None])
    space = four_shifts(port)
    for _ in range(15):  # rounds of four solves each; the reference strip needs 5
        space.grow()
        basis = space.basis()
        heating = basis.heating[:, 0]
        remainder = space.remainder[:, 0]
        y = heating / (basis.rate + 1j * omega[:, None])
        real = (y @ heating).real
        K_R = basis.read((space.K @ remainder)[None])
        M_R = basis.read((space.M @ remainder)[None])
        across = K_R[0] + 1j * omega[:, None] * M_R
        square = remainder @ remainder
        phi = np.zeros(omega.size)
        if square:
            phi = (remainder @ weight - (across * y).sum(axis=1)) / square
        residual = np.abs(phi) ** 2 * _smallest(space, remainder, omega)
        bound = residual + NOISE_ROUND_OFF * real
        if (bound <= CERTIFIED * real).all():
            break
    mean_square = weight @ factorize(space.M)(weight)
    return Spectrum(real, bound, float(mean_square), None)


def _smallest(space: Any, remainder: Array, omega: Array) -> Array:
    """min_j R^T (K + s_j M)^-1 R sqrt(1 + s_j^2/w^2) at every w."""
    squares = np.array([remainder @ solve(remainder) for solve in space.solvers])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(space.shifts > 0, space.shifts / omega[:, None], 0.0)
    bounds = squares * np.sqrt(1 + ratio**2)
    return bounds.min(axis=1)


def _of_linear(ring: Any, omega: Array, read: str) -> Spectrum:
    """Spectrum of a ring with light, dx/dt = A x + F xi: 4 k_B T^2 sum_k |C (i w - A)^-1 F_k|^2.

    The variance k_B T^2 C P C^T has A P + P A^T + 2 F F^T = 0.
    """
    if ring.thermal_forces is None:
        raise InputError(
            "the forces on the poles of this linear ring are not known: its heat is read elsewhere than it is made, is "
            "not linear, is shared by several rings, or moves the resistance of a heater (tcr)",
            "linearize it with the reduction of one part, or of all parts that are read",
        )
    if not ring.stable:
        raise InputError("the steady state is unstable: its noise grows without end", "lower the power")
    if read == LIGHT:
        read = next(name for name in ring.outputs if name.startswith("delta_T"))
    output = ring.outputs.index(checks.choice("read", read, ring.outputs))
    # states of comparable size: in SI those of light and carriers differ by 1e30, which the solvers do not survive
    A, _, _, scale, _ = dgebal(ring.A, scale=1, permute=0)
    weight = ring.C[output] * scale
    forces = ring.thermal_forces / scale[:, None]
    shifted = 1j * omega[:, None, None] * np.eye(len(A)) - A
    by_force = weight @ np.linalg.solve(shifted, forces.astype(complex))
    real = (np.abs(by_force) ** 2).sum(axis=1)
    covariance = solve_continuous_lyapunov(A, -2 * forces @ forces.T)
    mean_square = float(weight @ covariance @ weight)
    return Spectrum(real, np.zeros(omega.size), mean_square, ring.thermal_shift)


def _described(spectrum: Spectrum, f: Array, temperature: float, read: str) -> xr.Dataset:
    """The Dataset of `thermal_noise`."""
    unit = 4 * Boltzmann * temperature**2
    variance = unit / 4 * spectrum.mean_square
    about = {"units": "K^2/Hz", "long_name": "bound of the error of S_T by the reduction"}
    variables = {
        "S_T": ("frequency", unit * spectrum.real, dataset.describe("S_T")),
        "bound": ("frequency", unit * spectrum.bound, about),
    }
    attrs = dataset.stamp("thermal noise")
    attrs["temperature"] = float(temperature)
    attrs["read"] = read
    attrs["variance"] = variance
    attrs["rms_temperature"] = float(np.sqrt(variance))
    shift = spectrum.shift
    if shift is not None:
        S_nu = shift**2 * unit * spectrum.real
        variables["S_nu"] = ("frequency", S_nu, dataset.describe("S_nu"))
        attrs["thermal_shift"] = shift
        attrs["rms_frequency"] = float(shift * np.sqrt(variance))
    coordinates = {"frequency": ("frequency", f, dataset.describe("frequency"))}
    return xr.Dataset(variables, coordinates, attrs)
