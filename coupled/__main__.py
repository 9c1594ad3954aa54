"""Compile what nearly every first call needs: ``python -m coupled``, a minute of CPU time, once for each installation.

`make demo` runs it beside the installation; it needs NumPy, SciPy, Numba, xarray and pint alone.
"""

from __future__ import annotations


def main() -> None:
    """Simulate a ring with two poles of heat, and find its settled cycle."""
    import coupled
    from thermofem import Foster

    ring, model = coupled.borghi2021(), Foster(R=[2e3, 5.8e3], tau=[5.6e-8, 1.2e-6])
    coupled.pulsing(coupled.simulate(ring, model, power=6.31e-3, duration=2e-6))
    coupled.limit_cycle(ring, model, power=6.31e-3)


if __name__ == "__main__":
    main()
