"""The words of the report, section by section; every number in them is a place that `claims` fills."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Picture:
    """A panel with its title and caption, and the stages it draws."""

    name: str
    title: str
    caption: str
    stages: tuple[str, ...]


@dataclass(frozen=True)
class Section:
    """A heading, a paragraph or two, and pictures."""

    title: str
    text: tuple[str, ...]
    pictures: tuple[Picture, ...]


NEWTON, SECOND, FEM = "maps/Newton, the paper's", "maps/second order", "maps/FEM"
MAPS, TRACES = ("maps",), ("loop", "marked")

SECTIONS = (
    Section(
        "How long carriers live",
        (
            "The paper measures this on a spiral (its Fig. 3). Here its Shockley-Read-Hall parameters are integrated "
            "from "
            "the density that a pump pulse leaves.",
        ),
        (
            Picture(
                "fig3a", "Fig. 3(a): decay of the carriers",
                "With the two trap lifetimes as the table prints them, and exchanged. The straight lines are the "
                "mean "
                "slopes of the first and the last 50 ns.", ("carriers",),
            ),
            Picture(
                "fig3b", "Fig. 3(b): instantaneous lifetime",
                "From {carriers/exchanged/low_injection_s|1e9|.1f} to {carriers/exchanged/high_injection_s|1e9|.1f} "
                "ns "
                "with the lifetimes exchanged, as the paper's text says; as printed it never falls below "
                "{carriers/printed/low_injection_s|1e9|.1f} ns.", ("carriers",),
            ),
        ),
    ),
    Section(
        "Newton's law of cooling",
        (
            "One exponential, with silicon's own specific heat and 275 ns (the paper's Model 1), pulses in the wrong "
            "half of "
            "the plane: it agrees with the FEM-coupled ring on {maps/Newton, the paper's/overlap|100|.0f} % of the "
            "points. "
            "Its duty cycle is about half of what it should be.",
        ),
        (
            Picture("fig4a", "Fig. 4(a): where Newton's ring pulses", "Black line: border of the FEM-coupled ring's "
                    "region. (1), (2), (3): the points whose traces are shown.", MAPS),
            Picture("fig4b", "Fig. 4(b): how fast", "The same colours in all maps of this report.", MAPS),
            Picture("fig4c", "Fig. 4(c): traces", "The FEM-coupled ring in black plays the experiment. Model 1 does "
            "not "
                    "pulse at (3). Model 2 has τ_th and c_p fitted to each trace.", TRACES),
            Picture("fig4d", "Fig. 4(d): what each trace needs", "Fitted to {fits/count||.0f} traces one by one: c_p "
                    "{fits/heat_capacity_ratio/0||.1f} to {fits/heat_capacity_ratio/1||.1f} times silicon's. Longer "
                    "periods need a longer τ_th (r = {fits/correlation_tau_period||.2f}).", ("fits",)),
        ),
    ),
    Section(
        "The temperature equation: FEM against ODE",
        (
            "Heat spreads through the oxide over a continuum of time scales, from {elements/shortest_tau_s|1e9|.2f} "
            "ns to "
            "{elements/longest_tau_s|1e6|.1f} µs in the reduction used here. One exponential cannot follow it.",
        ),
        (
            Picture("fig5a", "Fig. 5(a): 2 mW for 20 µs", "Mean rise of the core, up to {pulse/rise_K||.1f} K. "
            "Inset: the "
                    "field 1 µs after the power went off.", ("pulse",)),
            Picture("fig5b", "Fig. 5(b): the heat of self-pulsing", "The absorbed power of a settled cycle, given "
                    "to the FEM and to four models. With silicon's c_p the best single exponential has "
                    "{heating/one_pole_tau_s|1e9|.0f} ns; with both free it has {heating/newton/tau_th|1e9|.0f} ns "
                    "and "
                    "{heating/newton/heat_capacity_ratio||.1f} c_p.", ("heating",)),
        ),
    ),
    Section(
        "The second-order equation",
        (
            "Trained on three drop traces of the FEM-coupled ring, as the paper trains it on three measured ones, it "
            "agrees "
            "on {maps/second order/overlap|100|.1f} % of the map.",
        ),
        (
            Picture("fig6a", "Fig. 6(a): where it pulses", "Black line: border of the FEM-coupled ring.", MAPS),
            Picture("fig6a_frequency", "How fast", "", MAPS),
            Picture("fig6b_frequency", "Fig. 6(b): frequency", "Every point at which both pulse, model against "
            "FEM-coupled "
                    "ring; on the line they agree.", MAPS),
            Picture("fig6b_duty", "Fig. 6(b): duty cycle", "Newton's cycles are too short everywhere.", MAPS),
            Picture("fig6c", "Fig. 6(c): traces", "At the points marked in the map.", TRACES),
            Picture("overlaps", "Overlap with the FEM-coupled map", "", MAPS),
        ),
    ),
    Section(
        "How far the second-order equation can be trusted",
        (
            "Trained on a square wave of 1 µs it errs by {periods/second order/at_2us|100|.0f} % of the period at 2 "
            "µs and by "
            "{periods/second order/at_3us|100|.0f} % at 3 µs.",
        ),
        (
            Picture("fig7", "Fig. 7: error of the period", "Lines: the paper's method on square waves. Points: "
            "period of "
                    "the FEM-coupled ring minus that of the equation trained at Q = {rings/low/loaded_q||.0f}, where "
                    "the "
                    "duty cycle is 20 to 30 %.", ("periods", "rings")),
            Picture("period_models", "Period error of every model", "Largest from 0.1 to 10 µs: Newton "
                    "{periods/Newton/largest|100|.0f} %, second order {periods/second order/largest|100|.0f} %, "
                    "SINDy "
                    "{periods/SINDy/largest|100|.1f} %, reduction {periods/reduction/largest|100|.2g} "
                    "%.", ("periods",)),
        ),
    ),
    Section(
        "What the paper left open: the FEM in the loop",
        (
            "Its Section 7 says that only the FEM itself, coupled to the optics, would be universal, and that this "
            "takes too long. With the FEM in the loop (every one of its {loop/unknowns||.0f} unknowns, window by "
            "window) a "
            "simulated microsecond costs {loop/seconds_per_us||.2f} s. The FEM reduced to {elements/poles||.0f} "
            "poles is "
            "within {elements/bound||.0e} of it at every frequency, proven, costs "
            "{cost/reduction/against_second_order||.2f} times the second-order equation, and agrees with the FEM in "
            "the "
            "loop to {loop/worst_reduction_period_error|100|.3f} % of the period at {loop/count||.0f} points. SINDy "
            "learns "
            "{training/sindy/states||.0f} states from temperatures in and around the core.",
        ),
        (
            Picture("fem_map", "The FEM-coupled map", "From the FEM's own reduction to {elements/fine_bound||.0e} "
                    "({elements/fine_poles||.0f} poles), {maps/FEM/points||.0f} points; the circles are runs with "
                    "the FEM "
                    "itself in the loop, filled where they pulse.", (*MAPS, "loop_map")),
            Picture("fem_frequency", "How fast", "", MAPS),
            Picture("reduction_map", "The map of the reduction", "{elements/poles||.0f} poles. Line: the FEM.", MAPS),
            Picture("reduction_frequency", "How fast", "", MAPS),
            Picture("other_traces", "Traces", "", TRACES),
            Picture("cost", "Error against cost", "At (8 dBm, 0 GHz), against the FEM in the loop.", ("cost",)),
        ),
    ),
)  # fmt: skip

QUICK = (
    Section(
        "Square wave and self-pulsing",
        ("The one-minute version stops here; without --quick come the maps, the fits and the FEM in the loop.",),
        (
            Picture("square", "A square wave of 1 µs", "The FEM's periodic state, and models trained on it.",
                    ("squares", "training")),
            Picture("traces", "Self-pulsing at (8 dBm, 0 GHz)", "Every model with the ring's optics and carriers: "
                    "the "
                    "reduction gives {traces/reduction/period_s|1e9|.0f} ns.", ("traces",)),
        ),
    ),
)  # fmt: skip
