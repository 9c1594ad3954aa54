"""Examples of the public names whose docstring has none: `hooks.py` puts them on the API page, a test runs them all.

A cell begins with ``# %%`` and the names it is an example of. The cells run in order, in one scope and one folder.
"""
# ruff: noqa: B018, E402

# %% th.CrossSection th.Layer th.Part th.Boundary th.Interface
import thermofem as th

layers = (th.Layer("box", "SiO2", 2e-6, datum=True), th.Layer("cladding", "SiO2", 2.2e-6))
core = th.Part("core", "Si", inner_radius=4.8e-6, outer_radius=5.2e-6, bottom=0.0, height=220e-9, heated=True)
bonded = (th.Interface("core", 1e-9),)
section = th.CrossSection("ring", 60e-6, layers, (core,), bonded, bottom=th.Boundary("isothermal"))

# %% th.assemble
heat = th.assemble(th.strip_ring(), accuracy=1e-3)
heat.thermal_resistance("core"), heat.mesh, heat.discretization

# %% th.Constant th.SquareWave th.Sampled th.Telegraph th.Chirp
waves = [
    th.Constant(2e-3), th.SquareWave(power=2e-3, period=1e-6, duty=1 / 3), th.Sampled([0, 1e-6], [0, 1e-3]),
    th.Telegraph(2e-3, dwell=1e-7, duration=1e-5, seed=1), th.Chirp(2e-3, 1e-6, 1e-7, 1e-5),
    th.waveforms.PiecewiseCubic([0, 1e-6], [[0.0, 0.0, 1e3, 0.0]]),
]  # fmt: skip
[float(wave(5e-7)) for wave in waves]

# %% th.solve_periodic th.save th.load
square = th.solve_periodic(heat, th.SquareWave(power=2e-3, period=1e-6, duty=1 / 3))
th.save(square, "square.nc")
th.load("square.nc").attrs["kind"]

# %% th.read_trace
from pathlib import Path

Path("probe.csv").write_text("time (us),rise (K)\n" + "".join(f"{k},{1 - 0.5**k}\n" for k in range(20)))
measured = th.read_trace("probe.csv", 1e-3)

# %% th.Material
glass = th.Material("glass", 1.1, 2200.0, 740.0, conductivity_law=th.materials.Polynomial((1e-3,)))
warm = th.Material("alloy", 20.0, 8000.0, 500.0, conductivity_law=th.materials.Table((250.0, 350.0), (19.0, 22.0)))

# %% th.StateSpace
import numpy as np

one = np.ones((1, 1))
system = th.StateSpace(E=one * 1e-12, A=one * -2e-4, B=one, C=one)
system.thermal_resistance, system.step_response([1e-8])

# %% th.RingEdge
edge = th.RingEdge(bias=-5e9, linewidth=10e9, shift=9e9)
edge.bandwidth(th.Foster(R=[7e3], tau=[1e-6]))

# %% th.InputError
try:
    th.strip_ring(width=0.45)
except th.InputError as error:
    print(error)

# %% th.from_gdsfactory
import importlib.util

if importlib.util.find_spec("gdsfactory"):  # pip install "thermofem[gdsfactory]"
    import gdsfactory as gf

    drawn = th.from_gdsfactory(gf.components.ring_double_heater(radius=10))

# %% th.Campaign
from concurrent.futures import ThreadPoolExecutor

Path("ring.toml").write_text(th.strip_ring().to_toml())
vary = '[[vary]]\npath = "part.core.width"\nvalues = ["400 nm", "450 nm"]\n[[drive]]\npower = "1 mW"\n'
Path("widths.toml").write_text('geometry = "ring.toml"\n' + vary)
campaign = th.Campaign.from_toml("widths.toml")
campaign.run("widths", ThreadPoolExecutor(1))
th.campaign.open_campaign("widths").thermal_resistance

# %% surrogate.fit_newton surrogate.fit_second_order
import surrogate

newton, second = surrogate.fit_newton(square), surrogate.fit_second_order(square)
newton.parameters["heat_capacity"] / th.models.BORGHI2021_HEAT_CAPACITY, second.residual

# %% surrogate.fit_foster surrogate.fit_spectrum
import numpy as np

times = np.geomspace(1e-9, 1e-4, 60)
step = th.solve(heat, th.Constant(1e-3), times)
foster, spectrum = surrogate.fit_foster(step, order=4), surrogate.fit_spectrum(step)

# %% surrogate.newton surrogate.fit_decay
law = surrogate.newton(tau_th=1e-6)
decay = surrogate.fit_decay(times, 5.0 * np.exp(-times / 1e-6), order=1)
decay.tau

# %% surrogate.balanced_truncation
rom = surrogate.reduce(heat.system, tolerance=1e-3)
shorter = surrogate.balanced_truncation(rom.model, 6) if isinstance(rom.model, th.StateSpace) else rom
rom.error_bound

# %% surrogate.save_model surrogate.load_model surrogate.export_model
surrogate.save_model(rom, "model.json")
surrogate.load_model("model.json").thermal_resistance, th.models.load_provenance("model.json")["method"]
surrogate.export_model(rom.model, "ring.cir", to="spice")

# %% surrogate.cauer
ladder = surrogate.cauer(surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31))
th.models.cauer.foster_of(ladder).tau, th.models.cauer.structure_function(ladder)

# %% surrogate.period_error
curve = surrogate.period_error(second.model, rom.model, np.geomspace(2e-7, 5e-6, 12))
surrogate.judging.validate.valid_range(curve), surrogate.judging.validate.validity(curve)

# %% surrogate.square_waves surrogate.compare
drives = surrogate.square_waves(periods=2) + surrogate.judging.validate.held_out_drives()[:1]
surrogate.compare({"Newton": newton.model, "second order": second.model}, rom.model, drives)

# %% surrogate.train_all surrogate.judge
ladder_of_models = surrogate.train_all(heat, hot=0, names=("Newton", "second order"))
judged = surrogate.judge(ladder_of_models.models, ladder_of_models.reference, periods=np.geomspace(3e-7, 3e-6, 4))
print(surrogate.judging.ladder.verdict(judged))

# %% surrogate.fit_sindy
poles = th.models.gate([[-1e6]], [7e9], static=7e3)
shells = th.solve(heat, th.SquareWave(2e-3, 1e-6, 1 / 3), np.linspace(0, 4e-6, 1201), read=("core", "box"))
network = surrogate.fit_sindy(shells, [heat.thermal_resistance("core", name) for name in ("core", "box")]).model

# %% surrogate.output_map surrogate.reduce_quadratic
warm = th.assemble(th.strip_ring().with_({"part.core.material": "Si(T)", "layer.box.material": "SiO2(T)"}))
nonlinear = warm.model("core", "core")
mapped = surrogate.output_map(nonlinear, 10e-3)
quadratic = surrogate.reduce_quadratic(nonlinear, 10e-3).model

# %% surrogate.train_family surrogate.load_family
vary = 'geometry = "ring.toml"\n[[vary]]\nname = "radius"\npath = "part.core.radius"\nfrom = "6 um"\nto = "8 um"\n'
vary += '[[vary]]\nname = "box"\npath = "layer.box.thickness"\nfrom = "1 um"\nto = "3 um"\n'
Path("radii.toml").write_text(vary)
surrogate.train_family("radii.toml", tolerance=1e-2, held_out=1).save("family.npz")
surrogate.load_family("family.npz").certify(radius=7e-6, box=2e-6)

# %% surrogate.design surrogate.uncertainty
from scipy import stats

family = surrogate.load_family("family.npz")
found = surrogate.design(family, target={"thermal_resistance": 9e3}, fixed={"box": 2e-6})
spread = surrogate.uncertainty(family, {"radius": stats.norm(7e-6, 20e-9), "box": stats.norm(2e-6, 40e-9)}, samples=64)

# %% surrogate.Optics
optics = surrogate.Optics({"bus_rate": {"radius": -2e15}}, at={"radius": 7e-6})
spread = surrogate.uncertainty(
    family,
    {"radius": stats.norm(7e-6, 20e-9)},
    lambda model, changes: changes["bus_rate"],
    samples=64,
    optics=optics,
)

# %% surrogate.calibrate
rise = family.model(radius=6.6e-6, box=2e-6).step_response(times) * 1e-3
trace = th.dataset.build(times, rise, th.Constant(1e-3))
surrogate.calibrate(family, trace).values

# %% surrogate.reduce_array
array = surrogate.reduce_array(heat, [[0.0, 0.0], [40e-6, 0.0]], tolerance=1e-2)
array.crosstalk

# %% surrogate.reduce_layout th.Shape th.racetrack
section = th.straight_guide()
shapes = [th.racetrack("ring 1", section), th.Shape("strip", section, path=[(20e-6, 0.0), (20e-6, 30e-6)])]
surrogate.reduce_layout(shapes, tolerance=1e-2).crosstalk

# %% th.read_layout
if importlib.util.find_spec("gdstk"):  # pip install "thermofem[gds]"
    import gdstk

    cell = gdstk.Cell("chip")
    cell.add(gdstk.ellipse((0, 0), 10.225, inner_radius=9.775, layer=1, tolerance=1e-3))
    library = gdstk.Library()
    library.add(cell)
    library.write_gds("chip.gds")
    th.read_layout("chip.gds", layers={"core": (1, 0)}, section=section)

# %% coupled.RingResonator coupled.ShockleyReadHall coupled.State
import dataclasses

import coupled

ring, model = coupled.borghi2021(), surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31)
narrow = dataclasses.replace(ring, bus_rate=30e9)
run = coupled.simulate(narrow, model, power=6e-3, duration=1e-6, method=coupled.kernel.tableaus.Method.RODAS5P)
start = coupled.State(field=0j, carriers=1e22, thermal=np.zeros(2))

# %% coupled.export_ring
second_order = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31)
coupled.export_ring(coupled.borghi2021(), second_order, "whole_ring.cir", power=6.3e-3, period=685e-9)
Path("whole_ring_demo.cir").read_text()

# %% coupled.pulsing coupled.Event
run = coupled.simulate(ring, model, power=6.31e-3, duration=10e-6, event=coupled.Event("delta_T", 10.0, stop=False))
found = coupled.pulsing(run)
found.regime == coupled.runs.pulsing.Regime.SELF_PULSING, found.period

# %% coupled.fold_curves coupled.hopf_curves coupled.stability_map
powers, detunings = np.geomspace(3e-3, 1e-2, 6), np.linspace(-10e9, 10e9, 6)
stable = coupled.stability_map(ring, model, powers, detunings)
hopf, folds = (f(ring, model, powers, detunings) for f in (coupled.hopf_curves, coupled.fold_curves))

# %% coupled.pulsing_map
small = np.geomspace(5e-3, 8e-3, 2), np.linspace(-2e9, 2e9, 2)
maps = [coupled.pulsing_map(ring, m, *small, duration=8e-6) for m in (model, newton.model)]
coupled.maps.pulsing_map.overlap(*maps)

# %% coupled.Waveguide coupled.LaserPort coupled.Detector coupled.Splitter
circuit = coupled.Circuit(
    {"a": ring, "b": ring},
    [coupled.Waveguide("a.through", "b.in"), coupled.Waveguide("split.out 1", "a.in")],
    [coupled.LaserPort("laser", "split.in 1")],
    [coupled.Detector("out", "b.through")],
    [coupled.Splitter("split", cross=0.1)],
)

# %% coupled.Volts coupled.Amperes
shifter = th.assemble(th.heated_ring().with_({"part.heater.resistance": "120 ohm"}))
heated = surrogate.reduce(shifter.channels(("core", "heater"), "core"), tolerance=1e-3)
for drive in (coupled.Volts(0.6), coupled.Amperes(5e-3)):  # 3 mW, both
    coupled.simulate(ring, heated, power=1e-3, heaters={"heater": drive}, duration=1e-6).heater_power

# %% coupled.Linear
linear = coupled.linearize(ring, model, power=1e-3, detuning=-5e9)
gain = linear.response([1e3, 1e6])["response"].sel(input="detuning", output="delta_T")  # K/Hz
linear.thermal_resistance, linear.stable

# %% coupled.FEM
coupled.cosimulate(ring, coupled.FEM(heat, max_discrepancy=1e-2), power=1e-3, duration=5e-8)

# %% coupled.identify
times = np.linspace(0, 20e-6, 8001)
traces = [coupled.simulate(ring, model, power=p, duration=20e-6, times=times) for p in (6e-3, 7e-3)]
coupled.identification.newton_traces.fit_newton_per_trace(ring, traces)
coupled.identify(ring, traces, free=["kappa", "tau_f", "tau_s", "eta"], runs=1)
