"""Numbers of a step of heat that `reduce` and `show` print: R_th and rise time of every channel of a linear model."""

from __future__ import annotations

from typing import Any

from thermofem.errors import InputError

from ..console import say, written


def channels(model: Any) -> list[dict[str, Any]] | None:
    """Input, output, R_th (K/W) and rise time (s, 10 to 90 % of the steady rise) of every channel.

    None where the model has no independent poles.
    """
    import numpy as np
    from scipy.optimize import brentq

    from surrogate.export.poles import poles_of

    try:
        found = poles_of(getattr(model, "linear", model))
    except InputError:
        return None
    rows = []
    for to, C in zip(model.outputs, np.atleast_2d(found.C), strict=True):
        for source, B in zip(model.inputs, found.B.T, strict=True):
            R = C * B / found.rate
            at = [
                brentq(lambda t, R=R, share=share: -np.expm1(-found.rate * t) @ R / R.sum() - share,
                       1e-4 / found.rate.max(), 50 / found.rate.min(), xtol=1e-16, rtol=1e-10)
                for share in (0.1, 0.9)
            ]  # fmt: skip
            one = {"heated": source, "read": to, "thermal_resistance": float(R.sum())}
            rows.append(one | {"rise_time": float(at[1] - at[0])})
    return rows


def say_channels(rows: list[dict[str, Any]]) -> None:
    """Print one line for each channel."""
    for row in rows:
        of = "" if len(rows) == 1 else f" from {row['heated']} to {row['read']}"
        say(f"R_th = {row['thermal_resistance'] / 1e3:.4g} K/mW{of}, rise 10-90 % in {written(row['rise_time'], 's')}")
