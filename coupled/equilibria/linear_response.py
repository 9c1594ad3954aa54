"""The linear equations of a ring or a circuit about a steady state: frequency response, step, python-control."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg.lapack import dgebal

from thermofem import checks
from thermofem.arrays import Array, ArrayLike, Complex
from thermofem.errors import MissingLibraryError

UNITS = {"power": "W", "detuning": "Hz", "heat": "W", "ambient": "K", "drop": "W", "through": "W", "delta_T": "K"}


@dataclass(frozen=True, eq=False)
class Linear:
    """A ring or a circuit for small departures from a steady state: dx/dt = A x + B u, y = C x + D u, in SI.

    Attributes
    ----------
    A, B, C, D : array, shape (n, n), (n, inputs), (outputs, n), (outputs, inputs)
    inputs : tuple of str
        power (W), detuning (Hz), heat (W, more heat where the light heats), ambient (K), and every heater (W) by its
        name. Of a circuit "power in" by laser and "heat ring 1" by ring.
    outputs : tuple of str
        drop and through (W), delta_T (K), and everything else that the model reads (K) by its name. Of a circuit the
        power (W) at every port by its name and "delta_T ring 1" by ring.
    states : tuple of str
    state : xarray.Dataset
        the steady state, as `steady_states` describes it.
    thermal_forces : array, shape (n, m), or None
        one column for each pole, for `thermofem.thermal_noise`: the force of thermal fluctuations on the pole has the
        one-sided density 4 k_B T^2 times the square of the column. None where the heat is not known as a port.
    thermal_shift : float, Hz/K
        by which the (first) resonance falls per kelvin.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...] = field(repr=False)
    state: xr.Dataset = field(repr=False)
    thermal_forces: Array | None = field(repr=False)
    thermal_shift: float = field(repr=False)

    @cached_property
    def eigenvalues(self) -> Complex:
        """Eigenvalues of A in 1/s, by falling real part."""
        values = np.linalg.eigvals(self.A)
        return np.asarray(values[np.argsort(-values.real)], dtype=complex)

    @property
    def stable(self) -> bool:
        """Whether every small departure decays."""
        return bool(self.eigenvalues[0].real < 0)

    @property
    def static(self) -> Array:
        """Static gain D - C A^-1 B, shape (outputs, inputs)."""
        return self._at(np.zeros(1))[0].real

    @property
    def thermal_resistance(self) -> float:
        """R_eff = d delta_T/d heat at rest, in K/W, with the light's feedback; of a circuit that of its first ring.

        R_eff = R_th/(1 - R_th dP_abs/dT)
        """
        row = next(k for k, name in enumerate(self.outputs) if name.startswith("delta_T"))
        column = next(k for k, name in enumerate(self.inputs) if name.startswith("heat"))
        return float(self.static[row, column])

    def response(self, frequencies: ArrayLike) -> xr.Dataset:
        """Frequency response C (2 pi i f - A)^-1 B + D.

        Parameters
        ----------
        frequencies : array, Hz
            0 is the static gain.

        Returns
        -------
        xarray.Dataset
            response over frequency (Hz), output and input: complex, in the unit of the output per unit of the input.

        Raises
        ------
        InputError
            frequencies that are not finite or do not increase.
        """
        f = checks.array("frequencies", frequencies, increasing=True)
        about = {"units": "Hz", "long_name": "frequency"}
        return self._dataset("response", self._at(2 * np.pi * f), "frequency", f, about)

    def step(self, times: ArrayLike) -> xr.Dataset:
        """Response of every output to a unit step of every input.

            y(t) = D + C int_0^t exp(A s) ds B = D + C V diag((exp(w t) - 1)/w) V^-1 B,     A V = V diag(w)

        Parameters
        ----------
        times : array, s
            increasing, from 0 on.

        Returns
        -------
        xarray.Dataset
            step over time (s), output and input, in the unit of the output per unit of the input. The error is 1e-16
            times the condition number of V: 1e-12 for a ring, and more for rings that are equal and cold.

        Raises
        ------
        InputError
            times that are negative, not finite, or do not increase.
        """
        t = checks.array("times", times, increasing=True)
        checks.between("times[0]", t[0], 0, np.inf, unit="s")
        A, B, C = self._balanced
        rates, V = np.linalg.eig(A)
        begin = np.linalg.solve(V, B.astype(complex))
        growth = np.expm1(rates * t[:, None]) / rates
        output = C @ V
        values = (output @ (growth[:, :, None] * begin)).real + self.D
        about = {"units": "s", "long_name": "time"}
        return self._dataset("step", values, "time", t, about)

    def to_control(self, *, balanced: bool = False) -> Any:
        """The same as a ``StateSpace`` of python-control, with the names of inputs, outputs and states.

        Parameters
        ----------
        balanced : bool
            whether the states are scaled by powers of two to comparable size. In SI fields and carriers differ by
            1e30, which matrix exponentials, as of ``control.sample_system``, do not survive.

        Raises
        ------
        MissingLibraryError
            python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise MissingLibraryError('to_control needs python-control: pip install "thermofem[control]"') from None
        A, B, C = self._balanced if balanced else (self.A, self.B, self.C)
        names = {"inputs": list(self.inputs), "outputs": list(self.outputs), "states": list(self.states)}
        return control.ss(A, B, C, self.D, **names)

    @cached_property
    def _balanced(self) -> tuple[Array, Array, Array]:
        """A, B and C in states of comparable size, x = scale x', with scales that are powers of two."""
        # scipy.linalg.matrix_balance turns the scales into integers, which those of many states exceed
        A, _, _, scale, _ = dgebal(self.A, scale=1, permute=0)
        return A, self.B / scale[:, None], self.C * scale

    def _at(self, omega: Array) -> Complex:
        """C (i w - A)^-1 B + D at angular frequencies (rad/s), shape (frequencies, outputs, inputs)."""
        A, B, C = self._balanced
        shifted = 1j * omega[:, None, None] * np.eye(len(A)) - A
        states = np.linalg.solve(shifted, B.astype(complex))
        return np.asarray(C @ states + self.D)

    def _dataset(self, name: str, values: Any, over: str, axis: Array, about: dict[str, str]) -> xr.Dataset:
        """Values of shape (axis, outputs, inputs) with the names and units of outputs and inputs."""
        coordinates = {
            over: (over, axis, about),
            "output": list(self.outputs),
            "input": list(self.inputs),
            "output_unit": ("output", [unit_of(each, "K") for each in self.outputs]),
            "input_unit": ("input", [unit_of(each, "W") for each in self.inputs]),
        }
        attrs = {**self.state.attrs, "kind": f"linear {name}", "stable": int(self.stable)}
        return xr.Dataset({name: ((over, "output", "input"), values)}, coordinates, attrs)


def unit_of(name: str, other: str) -> str:
    """SI unit of an input or output by its name; ``other`` for heaters and probes."""
    return UNITS.get(name.split()[0], other)
