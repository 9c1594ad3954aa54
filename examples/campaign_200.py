"""200 rings: thermal resistance and 10-90 % rise time against buried oxide, radius and width.

    python examples/campaign_200.py [folder]

Runs examples/campaign_200.toml (started again, it goes on where it was) and draws campaign_200.png into the folder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm

import thermofem as th

CAMPAIGN = Path(__file__).with_name("campaign_200.toml")


def rise_time(data: xr.Dataset) -> np.ndarray:
    """Time from 10 % to 90 % of the steady rise of every finished geometry, in s."""
    steady = data.thermal_resistance[:, 0].values * data.power_step.values[0]
    times = data.time_step.values
    return np.array(
        [
            np.subtract(*np.interp([0.9, 0.1], rise / final, times))
            for rise, final in zip(data.delta_T_step[:, :, 0].values, steady, strict=True)
        ]
    )


def figure(data: xr.Dataset, path: Path) -> None:
    """Both quantities against the oxide, colour for the radius, size for the width."""
    fig, axes = plt.subplots(2, 1, figsize=(5.7, 7), layout="constrained")
    sizes = 12 + 80 * (data.width - 400e-9) / 200e-9
    for ax, values, label in (
        (axes[0], data.thermal_resistance[:, 0] / 1e3, "thermal resistance (K/mW)"),
        (axes[1], rise_time(data) * 1e6, "10–90 % rise time (µs)"),
    ):
        dots = ax.scatter(
            data.oxide * 1e6, values, c=data.radius * 1e6, s=sizes, norm=LogNorm(3, 15), edgecolor="w", lw=0.4
        )
        ax.set(xlabel="buried oxide (µm)", ylabel=label, yscale="log")
        ax.grid(alpha=0.25, which="both", linewidth=0.5)
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter("{x:g}")
        ax.tick_params(which="both", axis="y", labelsize="small")
    bar = fig.colorbar(dots, ax=axes, label="radius (µm)", format="{x:g}", ticks=[3, 5, 8, 12, 15])
    bar.ax.minorticks_off()
    for width in (400, 500, 600):
        axes[1].scatter([], [], s=12 + 80 * (width - 400) / 200, color="#888888", label=f"{width} nm")
    axes[1].legend(title="core width", loc="lower right", frameon=False, fontsize="small", title_fontsize="small")
    fig.savefig(path, dpi=200)


def main() -> None:
    """Run, draw, and print what correlates with what."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "campaign_200")
    summary = th.Campaign.from_toml(CAMPAIGN).run(folder)
    with th.campaign.open_campaign(folder) as data:
        finished = data.isel(case=data.status.values == "finished").load()
    figure(finished, folder / "campaign_200.png")
    print(f"{summary.total} geometries, {summary.finished} of them in {summary.seconds:.0f} s, {summary.failed} failed")
    for name in ("radius", "width", "oxide"):
        slope = np.corrcoef(np.log(finished[name]), np.log(finished.thermal_resistance[:, 0]))[0, 1]
        print(f"correlation of log R_th with log {name}: {slope:+.2f}")


if __name__ == "__main__":
    main()
