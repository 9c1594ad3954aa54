"""A ring over an etched cavity: the same power heats it far more. Writes undercut.png: both fields after 20 us."""

from dataclasses import replace

import matplotlib.pyplot as plt

import thermofem as th

ring = th.heated_ring()
cavity = th.Part("cavity", "void", inner_radius=4e-6, outer_radius=12e-6, bottom=-6e-6, height=4e-6)
fig, axes = plt.subplots(2, 1, figsize=(5.7, 5.6), layout="constrained", sharex=True)
for ax, geometry, name in zip(
    axes, (ring, replace(ring, parts=(*ring.parts, cavity))), ("on silicon", "undercut"), strict=True
):
    heat = th.assemble(geometry)
    data = th.solve(heat, th.Pulse(10e-3, 20e-6), [20e-6], heated="heater", read="core", field_times=[20e-6])
    field = data.field.sel(field_time=20e-6)
    image = ax.tripcolor(
        data.r * 1e6, data.z * 1e6, data.triangles, field, shading="gouraud", cmap="inferno", vmin=0, vmax=130
    )
    for face in geometry.subdivision.faces:
        for outline in face.rings:
            ax.plot(*(outline[[*range(len(outline)), 0]].T * 1e6), color="white", linewidth=0.6, alpha=0.7)
    for at, text in ((-1.4, "oxide"), (-6.4, "silicon")):
        ax.annotate(text, (14, at), color="white", fontsize="small")
    ax.annotate("heater", (9, 2.3), (12, 3.1), arrowprops={"arrowstyle": "-"}, fontsize="small")
    ax.annotate(
        "core", (8.2, 0.1), (14, 0.6), color="white", arrowprops={"arrowstyle": "-", "color": "white"}, fontsize="small"
    )
    if name == "undercut":
        ax.annotate("cavity", (8, -4), ha="center", fontsize="small")
    ax.set(
        xlim=(0, 20),
        ylim=(-7, 4),
        xticks=range(0, 20, 5),
        xlabel="r (µm)",
        ylabel="z (µm)",
        title=f"{name}: core {data.delta_T.item():.0f} K at 10 mW",
    )
    ax.label_outer()
fig.colorbar(image, ax=axes, label="temperature rise (K)")
fig.savefig("undercut.png", dpi=220)
