"""Fourier series of the mean cycle of a drop trace: their fit to samples, and the phase that aligns two of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, Complex

HARMONICS = 32
LEVEL = 0.05  # of the mean: a smaller swing counts as that


@dataclass(frozen=True, eq=False)
class Cycle:
    """Mean cycle of a periodic drop trace, as a Fourier series.

    period [s]: nan where the trace does not pulse.
    harmonics [shape (33,), W]: c_k, with the phase of an arbitrary t_0; only the mean where the trace does not pulse.
    """

    period: float
    harmonics: Complex

    def curve(self, phase: Array, *, smooth: bool = False) -> Array:
        """Drop power at the phases ``phase``, given as fractions of the period; of their shape.

        ``smooth`` multiplies the harmonics by Lanczos factors sin(x)/x, x = pi k/33: an average over 1/33 of the period
        that suppresses the Gibbs oscillations at steep edges.
        """
        k = np.arange(self.harmonics.size)
        waves = np.exp(2j * np.pi * np.outer(phase, k))
        harmonics = self.harmonics * np.sinc(k / k.size) if smooth else self.harmonics
        return (waves @ harmonics).real

    @cached_property
    def swing(self) -> float:
        """Largest minus smallest drop power in the cycle."""
        phase = np.linspace(0, 1, 256, endpoint=False)
        return float(np.ptp(self.curve(phase)))

    @property
    def scale(self) -> float:
        """Unit of shape errors: the swing, but at least `LEVEL` times the mean."""
        return max(self.swing, LEVEL * float(abs(self.harmonics[0])))

    def shifted(self, by: float) -> Cycle:
        """The same cycle, advanced in time by the fraction ``by`` of its period."""
        k = np.arange(self.harmonics.size)
        return Cycle(self.period, self.harmonics * np.exp(2j * np.pi * by * k))


def still(mean: float) -> Cycle:
    """The cycle of a trace that does not pulse: period nan, and only the mean c_0."""
    return Cycle(float("nan"), np.append(mean, np.zeros(HARMONICS)).astype(complex))


def lag(model: Complex, measured: Complex) -> float:
    """Time shift of the model's cycle, in periods, that maximises its correlation with the measured one."""
    k = np.arange(1, model.size)
    products = model[1:] * measured[1:].conj()
    n = 16 * model.size
    correlation = np.fft.irfft(np.concatenate([[0], products]), n)
    shift = float(np.argmax(correlation)) / n
    for _ in range(4):
        turning = products * np.exp(2j * np.pi * k * shift)
        slope = float(np.sum(-k * turning.imag))
        bend = float(np.sum(-(k**2) * turning.real))
        if bend >= 0:
            break
        shift -= slope / bend / (2 * np.pi)
    return shift


class FourierFit(NamedTuple):
    """Fourier series of a given period T, by least squares on samples.

        drop = A c + residual,      residual = [A, d drop/d ln T] (dc, d ln T)

    harmonics [shape (K + 1,)]: c_0 to c_K.
    residual [shape (n,)]; design [shape (n, 2 K + 2)]: the matrix of the second equation.
    """

    harmonics: Complex
    residual: Array
    design: Array

    def period_step(self) -> float:
        """Correction d ln T of the period."""
        return float(np.linalg.lstsq(self.design, self.residual, rcond=None)[0][-1])

    def scatter(self) -> float:
        """Standard deviation of a sample."""
        samples, unknowns = self.design.shape
        return float(np.sqrt(self.residual @ self.residual / max(samples - unknowns, 1)))


def fourier_fit(t: Array, drop: Array, T: float, K: int) -> FourierFit:
    """Fit a mean and K harmonics of the period T to samples."""
    k = np.arange(1, K + 1)
    waves = np.exp(2j * np.pi * np.outer(t / T, k))
    A = np.hstack([np.ones((t.size, 1)), waves.real, -waves.imag])
    c = np.linalg.lstsq(A, drop, rcond=None)[0]
    z = c[1 : 1 + K] + 1j * c[1 + K :]
    period_slope = (1j * (waves * k) @ z).real * (-2 * np.pi * t / T)  # d drop/d ln T
    return FourierFit(np.append(c[0], z), drop - A @ c, np.column_stack([A, period_slope]))
