"""What training, validation and periodic states of compact models cost.

    python benchmarks/bench_surrogate.py [repeats]

The reference is the certified reduction of the reference strip at 1e-6 of R_th. Times are medians of CPU time in
milliseconds; the error stands beside each.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

import surrogate
import thermofem as th


def median_ms(call: Callable[[], object], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def main(repeats: int) -> None:
    reference = surrogate.reduce(th.assemble(th.strip_ring(), accuracy=1e-4).system, 1e-6).model
    wave = th.SquareWave(2e-3, 1e-6, 1 / 3)
    times = th.waveforms.period_times(wave, 301)
    data = th.dataset.build(times, reference.periodic_response(wave, 301), wave, periodic=True)
    log_times = np.geomspace(1e-9, 1e-3, 121)
    known = {"thermal_resistance": reference.thermal_resistance}
    step = th.dataset.build(
        log_times, reference.response(th.Constant(2e-3), log_times), th.Constant(2e-3), attributes=known
    )
    periods, squares = np.geomspace(1e-7, 1e-5, 30), surrogate.square_waves()
    fit = surrogate.fit_second_order(data)

    def error(model: th.Foster) -> float:
        return 100 * float(np.sqrt((surrogate.compare({"": model}, reference, squares).rms_relative ** 2).mean()))

    def states() -> None:
        for period in np.geomspace(1e-7, 1e-5, 100):
            fit.model.periodic_response(th.SquareWave(2e-3, period, 1 / 3), 200)

    print(f"{'':34}{'CPU ms':>8}   rms over 55 square waves, % of swing")
    print(f"{'100 periodic states x 200 points':34}{median_ms(states, repeats):8.1f}   closed form")
    ms = median_ms(lambda: surrogate.period_error(fit.model, reference, periods), repeats)
    valid = surrogate.period_error(fit.model, reference, periods).validity
    print(f"{'period_error over 30 periods':34}{ms:8.1f}   {valid}")
    trained = {
        "fit_newton": lambda: surrogate.fit_newton(data),
        "fit_second_order": lambda: surrogate.fit_second_order(data),
        "fit_second_order, swarm": lambda: surrogate.fit_second_order(data, method="pso"),
        **{f"fit_foster, order {n}": lambda n=n: surrogate.fit_foster(step, n) for n in (3, 4, 5, 6, 8)},
        "fit_spectrum, 8 a decade": lambda: surrogate.fit_spectrum(step),
    }
    for name, call in trained.items():
        print(f"{name:34}{median_ms(call, repeats):8.1f}   {error(call().model):.3g}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
