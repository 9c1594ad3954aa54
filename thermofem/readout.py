"""Read-outs: what an instrument sees of a temperature, an optical power that is not linear in it.

    MZI:       P/P0 = [1 + V cos(phi_0 + phi_T dT)]/2
    RingEdge:  P/P0 = 1 - D/(1 + (2 (delta + s dT)/w)^2)

Papers state times and bandwidths of this power, not of heat (Coenen et al., Photonics 11, 603 (2024)).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from scipy.optimize import brentq

from . import checks
from .arrays import Array
from .fem.heat_problem import HeatProblem
from .models import ThermalModel
from .waveforms import Constant, SquareWave, period_times

DECIBELS = {"optical": 0.5, "electrical": np.sqrt(0.5)}  # |Z|/R_th at -3 dB: 10 log10 of the light, or of its square
SAMPLES = 2001  # of a trace whose times are read, of a step on a logarithmic scale
TAIL, HEAD = 30.0, 1e-6  # last and first time of a step, in units of the time to 1 - 1/e

Trace = TypeVar("Trace")


@dataclass(frozen=True)
class EdgeTimes:
    """Times in s of the edges of a trace, each between its first and last value.

    rise, fall: from the edge to the first time at 1 - 1/e of the way, after the power was raised and lowered.
    rise_10_90, fall_10_90: between the first times at 10 % and at 90 % of the way.
    nan where there is no such edge.
    """

    rise: float
    fall: float
    rise_10_90: float
    fall_10_90: float


class _Readout(ABC):
    """Base class of read-outs, which define `_light`: light in units of P0 as a function of temperature rise in K."""

    @abstractmethod
    def _light(self, delta_T: Any) -> Any:
        """Light in units of P0 at a temperature rise in K."""

    def __call__(self, delta_T: Trace) -> Trace:
        """The optical power in units of P0 behind temperature rises in K.

        An array gives an array, a DataArray a DataArray, and a Dataset of temperatures the same Dataset with the
        variable ``optical``.
        """
        import xarray as xr

        if isinstance(delta_T, xr.Dataset):
            light = self._light(delta_T["delta_T"])
            return delta_T.assign(optical=light.assign_attrs(long_name="optical power over its maximum", units="1"))
        return self._light(delta_T if isinstance(delta_T, xr.DataArray) else np.asarray(delta_T, dtype=float))

    def bandwidth(self, model: ThermalModel | HeatProblem, *, decibels: str = "optical") -> float:
        """Frequency in Hz at which a small modulation of the heat has lost 3 dB of its optical signal.

            |Z(f)| = R_th/2 (decibels of the optical power),    |Z(f)| = R_th/sqrt 2 (of the electrical power)

        At small signals the optical power follows Z at every bias with a slope.

        Raises
        ------
        InputError
            ``decibels`` is neither "optical" nor "electrical", or ``model`` has no impedance.
        """
        share = DECIBELS[checks.choice("decibels", decibels, DECIBELS)]
        of = thermal(model)
        level = share * abs(of.thermal_resistance)

        def above(decade: float) -> float:
            frequency = np.array([10.0**decade])
            return float(np.abs(of.impedance(frequency)[0]) - level)

        return float(10 ** brentq(above, -3, 14, xtol=1e-10))

    def edge_times(self, model: ThermalModel | HeatProblem, wave: Constant | SquareWave) -> EdgeTimes:
        """Rise and fall times as an instrument reads them from the optical power.

        Parameters
        ----------
        model : ThermalModel or HeatProblem
        wave : Waveform
            a `Constant` is a step from rest, without a fall; a `SquareWave` of any period has both edges in its
            periodic state.

        Raises
        ------
        InputError
            another waveform.
        """
        of = thermal(model)
        if isinstance(wave, Constant):
            rise, rise_10_90 = _crossings(*self._step(of, wave))
            return EdgeTimes(rise, np.nan, rise_10_90, np.nan)
        checks.instance("wave", wave, SquareWave, hint="edge times are those of a Constant or a SquareWave")
        times = period_times(wave, SAMPLES)
        light = self._light(of.periodic_response(wave, SAMPLES))
        edge = wave.duty * wave.period
        off = int(np.argmin(np.abs(times - edge)))
        rise, rise_10_90 = _crossings(times[: off + 1], light[: off + 1])
        fall, fall_10_90 = _crossings(times[off:] - times[off], light[off:])
        return EdgeTimes(rise, fall, rise_10_90, fall_10_90)

    def _step(self, of: ThermalModel, wave: Constant) -> tuple[Array, Array]:
        """Times in s and light after a step of power; the last value, at t = inf, is that of the steady state."""
        R, power = of.thermal_resistance, float(wave.mean(0.0, 1.0))

        def missing(decade: float) -> float:
            return float(of.step_response(np.array([10.0**decade]))[0] / R - 1 + np.exp(-1))

        tau = 10 ** brentq(missing, -13, 4, xtol=1e-6)
        times = np.concatenate([[0.0], np.geomspace(HEAD * tau, TAIL * tau, SAMPLES)])
        light = self._light(of.response(wave, times))
        return np.append(times, np.inf), np.append(light, self._light(np.array(R * power)))


@dataclass(frozen=True)
class MZI(_Readout):
    """A Mach-Zehnder interferometer with the heat in one arm.

        P/P0 = [1 + V cos(phi_0 + phi_T dT)]/2,    phi_T = 2 pi L (dn_eff/dT)/lambda

    Parameters
    ----------
    bias : float, rad
        phi_0, the phase at rest; pi/2 is quadrature.
    visibility : float
        V, 0 to 1.
    shift : float, rad/K
        phi_T, phase per kelvin.

    >>> round(float(MZI(bias=np.pi / 2, shift=0.1)(np.array(5.0))), 9)  # 0.5 rad from quadrature
    0.260287231
    """

    bias: float = np.pi / 2
    visibility: float = 1.0
    shift: float = 1.0

    def __post_init__(self) -> None:
        checks.finite("bias", self.bias)
        checks.between("visibility", self.visibility, 0, 1)
        checks.finite("shift", self.shift)

    def _light(self, delta_T: Any) -> Any:
        return (1 + self.visibility * np.cos(self.bias + self.shift * delta_T)) / 2


@dataclass(frozen=True)
class RingEdge(_Readout):
    """A weak probe on the slope of a resonance that heat moves to lower frequencies.

        P/P0 = 1 - D/(1 + (2 (delta + s dT)/w)^2)

    Parameters
    ----------
    bias : float, Hz
        delta, frequency of the probe less that of the cold resonance.
    linewidth : float, Hz
        w, full width at half depth.
    shift : float, Hz/K
        s, by which a kelvin lowers the resonance.
    depth : float
        D of the resonance, 0 to 1; the drop port of a lossless ring has 1 - P/P0.
    """

    bias: float
    linewidth: float
    shift: float
    depth: float = 1.0

    def __post_init__(self) -> None:
        checks.finite("bias", self.bias)
        checks.positive("linewidth", self.linewidth, unit="Hz")
        checks.finite("shift", self.shift)
        checks.between("depth", self.depth, 0, 1)

    def _light(self, delta_T: Any) -> Any:
        detuning = self.bias + self.shift * delta_T
        return 1 - self.depth / (1 + (2 * detuning / self.linewidth) ** 2)


def thermal(model: Any) -> ThermalModel:
    """Return a thermal model; for a HeatProblem its system of the first heated part, read there."""
    if isinstance(model, HeatProblem):
        return model.channels(model.heated[0], model.heated[0])
    of: ThermalModel = model
    checks.has("model", of, "thermal_resistance", hint="give a thermal model, or what th.assemble returns")
    return of


def _crossings(times: Array, light: Array) -> tuple[float, float]:
    """First time at 1 - 1/e of the way from the first to the last value, and from 10 % to 90 %; nan if flat."""
    way = light[-1] - light[0]
    part = (light - light[0]) / way if way else np.zeros(light.size)

    def reaches(share: float) -> float:
        k = int(np.argmax(part >= share))
        if not k:
            return float("nan")
        dt = times[k] - times[k - 1]
        dp = part[k] - part[k - 1]
        return float(times[k - 1] + dt * (share - part[k - 1]) / dp)

    rise_10_90 = reaches(0.9) - reaches(0.1)
    return reaches(1 - np.exp(-1)), rise_10_90
