"""Writes the pages that are made from the code and from the tests' numbers.

    python docs/generate.py

`geometry-reference.md` comes from the schema of the geometry file and the library of materials, `commands.md` from the
command line, `validation.md` from `validation.json`, which ``pytest --validation`` writes. A test fails while a page is
not what this makes.
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from thermofem.data import files, quantity
from thermofem.geometry import geometry_file as geometry_file
from thermofem.materials import material_library as materials

DOCS = Path(__file__).resolve().parent
COEFFICIENT = f"{{ {' or '.join(geometry_file._COEFFICIENT)} }}"
EXCHANGE = " or ".join(f"`{{ {kind} = ... }}`" for kind in geometry_file._COEFFICIENT)

# what each key means; the keys and their units come from the schema
WORDS: dict[str, dict[str, str]] = {
    "the file": {
        "name": "of the cross-section; default `cross-section`",
        "kind": "`ring` (default) or `straight`",
        "outer_radius": "**required** for a ring; where the domain ends",
        "length": "**required** for a straight section; along the guide",
        "half_width": "**required** for a straight section; from x = 0 to where the domain ends",
        "ambient": "temperature of everything at rest; default 293.15 K; matters where properties depend on it",
        "layer": "**required**; bottom to top, from the axis to `outer_radius`, or from -`half_width` to `half_width`",
        "part": "**required**; rings and discs, or straight bars; a later one overwrites earlier ones and the layers",
        "interface": "thermal boundary resistances",
        "probe": "what can be read besides layers and parts",
        "boundary": "what the sides do",
        "material": "`[material.NAME]`: changes or adds a material",
        "light": "what guides, and at which wavelength; `light` can then be read like a part",
        "bus": "one or two straight buses beside the ring",
        "plan": "the ring seen from above",
    },
    "[[layer]]": {
        "name": "**required**; layers and parts share one set of names",
        "material": "**required**; a built-in one or one of `[material]`",
        "thickness": "**required**",
        "datum": "on exactly one layer: z = 0 lies at its top",
    },
    "[[part]]": {
        "name": "**required**",
        "material": "**required**; `void` cuts a hole with insulated walls",
        "radius": "to its centre; with `width`",
        "width": "at half height; with `radius` or `x`",
        "x": "centre of a straight bar; with `width`",
        "inner_radius": "at half height, 0 for a disc; with `outer_radius`, instead of `radius` and `width`",
        "outer_radius": "at half height; with `inner_radius`",
        "bottom": "**required**; counted from the datum",
        "height": "**required**",
        "sidewall_angle": "default 90 deg, vertical; smaller is wider at the foot; 30 to 150 deg",
        "heated": "whether it may carry absorbed power",
        "resistance": "of a heater between its contacts, at `ambient`; or `resistivity` of its material",
        "tcr": "temperature coefficient α of the resistance, R = R₀ (1 + α ΔT); default 0",
    },
    "[[interface]]": {
        "part": "**required**; its whole surface has the resistance",
        "resistance": "**required**",
    },
    "[[probe]]": {
        "name": "**required**",
        "part": "**required**; the shell lies around it, or the copy is one of it",
        "shell": "thickness of the shell; either this or `distance`",
        "distance": "from the axis to the centre of a copy of the part: what a neighbouring ring reads; in a straight "
        "section from the part itself, along x",
    },
    "[boundary]": {
        "bottom": f"`isothermal` (default), `insulated`, `open` or {EXCHANGE}",
        "top": f"`insulated` (default), `isothermal` or {EXCHANGE}: whatever faces up, ridges included",
        "outer": f"`insulated` (default), `isothermal`, `open` or {EXCHANGE}",
    },
    "[light]": {
        "wavelength": "**required**; in vacuum",
        "part": "the core; default `core`, or the first heated part",
        "polarisation": "`TE` (default) or `TM`: its fundamental mode is taken",
        "loss": 'power loss of the guide, which heats; also `"7 dB/cm"`',
    },
    "[[bus]]": {
        "name": "default `bus` and `drop`; a campaign varies `bus.NAME.gap`",
        "gap": "**required**; between the walls of ring and bus at half height",
        "straight": "length of the straight section over which a racetrack couples; default 0",
        "width": "default that of the ring's guide; another one is refused",
    },
    "[plan]": {
        "straight": "makes the ring a racetrack: length of each of its two straights; its bends are the ring",
    },
    COEFFICIENT: dict.fromkeys(geometry_file._COEFFICIENT, "**required**; a side has one such key"),
    "[material.NAME]": {
        "conductivity": "text with a unit or a table, see below; required for a new material",
        "density": "required for a new material",
        "specific_heat": "text with a unit or a table, see below; required for a new material",
        "source": "where the numbers come from; travels with every result",
        "index": "refractive index for light: a number, the name of a law in the library, Sellmeier terms or a table",
        "thermo_optic": "dn/dT",
        "two_photon": "two-photon absorption",
        "kerr": "Kerr index",
        "resistivity": "of a heater: R₀ = ρ L/(w h), L the mean circumference of a ring or the `length` of a guide",
    },
}
SCHEMA: dict[str, dict[str, str]] = {
    "the file": geometry_file._TOP,
    "[[layer]]": geometry_file._LAYER,
    "[[part]]": geometry_file._PART,
    "[[interface]]": geometry_file._INTERFACE,
    "[[probe]]": geometry_file._PROBE,
    "[boundary]": geometry_file._BOUNDARY,
    "[light]": geometry_file._LIGHT,
    "[[bus]]": geometry_file._BUS,
    "[plan]": geometry_file._PLAN,
    COEFFICIENT: geometry_file._COEFFICIENT,
    "[material.NAME]": geometry_file._MATERIAL,
}

REFERENCE = """# Geometry file reference

This page is generated from the schema that reads the file; [describing a geometry](geometry.md) has a complete example.
Quantities are text with a unit; any unit of the right dimension will do.
A key that is not listed is an error that names the nearest.
"""
LAWS = """
## Laws of temperature

`conductivity` and `specific_heat` take a plain value, or a table:

```toml
{}
```

Take one of these lines. `exponent`: value × (T/reference)^exponent. `polynomial`: value × (1 + c₁ (T − reference) +
c₂ (T − reference)² + …), at most 20 coefficients. `temperature` and `values`: a monotone cubic through the points,
constant beyond them, 2 to 10,000 of both; a `value` beside them must be that of the curve at the reference.
`r` and `z`, given together: conductivity along and across the layers; beside `temperature` and `values`, `z` alone.

## Built-in materials

| name | k, W/m/K | ρ, kg/m³ | c_p, J/kg/K | source |
|---|---|---|---|---|
"""
VALIDATION = """# Validation

The numbers that the tests compare with other numbers (`make validation` writes them here). Each test fails beyond its
tolerance; the last column leads to its source. Three kinds of comparison are kept apart, and what was measured in a
laboratory stands by itself.
"""
MEASURED = """
## Measured in a laboratory

{count} figures from {papers} sources. Each is computed from the stack as far as the source, named below, states it.
Only numbers that were seen there are listed. Heaters of phase shifters are straight sections.
π power = λ/(2 L dn/dT R_th); ratio = computed over published. The range is what the computed
figure becomes when one unknown goes from end to end; what else is assumed stands in the
linked geometry file. `python tests/support/devices.py` computes the figures from these
files; `tests/surrogate/test_published_devices.py` holds them.

Static figures of heat come within 30 % of the laboratory, but for the tungsten heater, of which only metal and radius
are known: its published figure is that of a heater 5 µm wide here. Of nine times and bandwidths of heaters heat alone
brings one within a factor of 1.3; −3 dB is then that of the temperature, as an electrical signal counts it. Papers
measure light (Coenen et al., Photonics 11, 603 (2024)). With the read-out (`th.MZI`) seven of nine come within 1.3.
No paper states its decibels: half of the optical power is taken for all bandwidths, and a thickness is fitted for
two. For times the bias of the interferometer is fitted, a swing of a full fringe is taken, and half periods of 10 to
250 µs are the plausible range.
That is what the numbers allow, no proof of how they were measured. What remains: the titanium heater with thin oxides
is ten to twenty times faster here than published: no bias or period explains that, the electronics count there.
The doped ridge is 62 µm long, so that some of its heat leaves through its ends, which the section lacks.

Beyond times of heaters: of the trench that keeps crosstalk away neither place nor depth is stated. Any depth removes
more than was measured at 5 µm, and less at 15 µm; no single depth gives both. A microtoroid has no read-out to blame,
since its light follows the resonance itself: with the pillar fitted to the slow corner and all other sizes assumed,
the fast corner follows. The disc settles in 85 ns only under a pulse: its plain step takes 33 times as long,
and a pulse of five times the power that holds the shift (fitted) brings the shift in the published time.

Measured curves are compared elsewhere: thermal steps of an LED and a transistor, and bistable loops of a ring, under
[families](families.md#calibration).

"""
CLOUD = """
![Pi power against time constant of twelve published phase shifters and of the computed ones](images/shifters.png)

Twelve thermal phase shifters of a review (Micromachines 13, 1509 (2022), its table of thermo-optic shifters), and those
of this page whose times are stated. Heat alone makes ours slower at the same π power; with the read-out they lie beside
the measured ones. π power times time goes from 30 to 1050 mW µs: a trench or an undercut lowers the one and
raises the other, and stays on one line. `python tests/support/devices.py figure` draws it.
"""
KINDS = {
    "Exact or published": "Closed forms, series and transforms, and values of other authors, with their source.",
    "Another program": "Programs that are no part of this package: a finite-element code with elements of high order "
    "for the heat, another integrator and a scan for the light. The source of each test has its reference.",
    "Our own earlier numbers": "Numbers of the prototype of this project. They are no evidence of correctness; they "
    "show that a result has not moved.",
}


def kind(source: str) -> str:
    """Which of `KINDS` the source of an expected value is."""
    if source.startswith("prototype"):
        return "Our own earlier numbers"
    return "Another program" if source.startswith("independent") else "Exact or published"


def geometry_reference() -> str:
    """Every table of the geometry file with its keys, and the built-in materials."""
    text = REFERENCE
    for table, keys in SCHEMA.items():
        if set(keys) != set(WORDS[table]):
            raise SystemExit(f"docs/generate.py: {table} has keys without words: {set(keys) ^ set(WORDS[table])}")
        text += f"\n## {'Top of ' if table == 'the file' else ''}{_code(table)}\n\n| key | value | |\n|---|---|---|\n"
        text += "".join(f"| `{key}` | {_kind(kind)} | {WORDS[table][key]} |\n" for key, kind in keys.items())
    laws = [line.strip() for line in (materials.__doc__ or "").splitlines() if line.startswith("    ")]
    text += LAWS.format("\n".join(laws))
    for name, m in materials.LIBRARY.items():
        along = f"{m.conductivity:g}" + (f" (r), {m.conductivity_z:g} (z)" if m.conductivity_z is not None else "")
        varies = " at 300 K, varies" if m.varies else ""
        text += f"| `{name}` | {along}{varies} | {m.density:g} | {m.specific_heat:g} | {m.source} |\n"
    return text


def _code(table: str) -> str:
    return table if table == "the file" else f"`{table}`"


def _kind(kind: str) -> str:
    """What a key's value looks like."""
    words = {"text": "text", "true or false": "`true` or `false`", "anything": "see right", "a table": "table"}
    if kind in words or kind == files.TABLES:
        return words.get(kind, "tables")
    measures, example, _ = quantity._KINDS[kind]
    return f'{measures}, `"{example}"`'


def validation() -> str:
    """The rows that the tests recorded, by kind of comparison and by subject."""
    rows: list[dict[str, Any]] = json.loads((DOCS / "validation.json").read_text(encoding="utf-8"))
    text = VALIDATION
    for title, words in KINDS.items():
        own = [row for row in rows if kind(row["source"]) == title]
        text += f"\n## {title}\n\n{words}\n"
        for subject in dict.fromkeys(row["subject"] for row in own):
            text += (
                f"\n### {subject}{_SUFFIX[title]}\n\n| what | expected | ours | error | tolerance | expected is | |\n"
            )
            text += "|---|---|---|---|---|---|---|\n"
            for row in own:
                if row["subject"] == subject:
                    file, _, test = row["test"].partition("::")
                    text += f"| {row['what']} | {row['expected']:.7g} {row['unit']} | {row['ours']:.7g} {row['unit']} "
                    text += f"| {row['error']:.1e} | {row['tolerance']:.0e} | {row['source']} "
                    text += f'| [test](../{file} "{test}") |\n'
    return text + "\nErrors and tolerances are relative to the expected value.\n" + measured()


def measured() -> str:
    """Published figures of devices beside what the stack gives."""
    devices: list[dict[str, Any]] = tomllib.loads((DOCS / "measured.toml").read_text(encoding="utf-8"))["device"]
    figures, papers = sum(len(row["figure"]) for row in devices), len({row["paper"] for row in devices})
    text = MEASURED.format(count=figures, papers=papers)
    text += "| device | figure | published | heat alone | ratio | range | heat and read-out | ratio | range |\n"
    text += "|---|---|---|---|---|---|---|---|---|\n"
    for row in devices:
        for figure in row["figure"]:
            ours, low, high = figure["ours"], *figure["range"]
            text += f"| [{row['name']}](measured/{row['geometry']}) | {figure['what']} | {figure['published']:g} "
            text += f"{figure['unit']} | {ours:g} {figure['unit']} | {ours / figure['published']:.2f} "
            text += f"| {low:g} to {high:g} | "
            if "light" in figure:
                ends = "{:g} to {:g}".format(*figure["light_range"])
                ratio = figure["light"] / figure["published"]
                text += f"{figure['light']:g} {figure['unit']} | {ratio:.2f} | {ends} |\n"
            else:
                text += "| | |\n"
    text += CLOUD
    for row in devices:
        vary = row["vary"]
        text += f"\n**{row['name']}.** {row['paper']}. Seen in: {row['seen']}. Not stated: {row['unknown']}. "
        text += f"Range: `{vary['path']}`, taken as {_taken(row)}, from {vary['from']} to {vary['to']}."
        text += "".join(f" Fitted to the {f['what']}: {f['light_at']}." for f in row["figure"] if "light_at" in f)
        if "drive" in row and row["drive"]["bias"]:
            half, bias = row["drive"]["half_period"], row["drive"]["bias"]
            text += f" Read-out: a square wave of half period {half}, phase {bias:g}π (fitted)"
            swing, (first, last) = row["drive"]["swing"], row["drive"]["plausible"]
            text += f" + {swing:g}π (taken); range: half periods of {first} to {last}."
        if "pulse" in row:
            factor, (first, last) = row["pulse"]["factor"], row["pulse"]["plausible"]
            text += f" Read-out: a pulse of {factor} times the power that holds the shift (fitted); range: {first} to "
            text += f"{last} times."
        text += "\n"
    return text


def _taken(row: dict[str, Any]) -> str:
    """What the geometry file of a device assumes for the unknown that its range varies."""
    content = tomllib.loads((DOCS / "measured" / row["geometry"]).read_text(encoding="utf-8"))
    table, name, key = row["vary"]["path"].split(".")
    return str(next(one for one in content[table] if one["name"] == name)[key])


_SUFFIX = {
    "Exact or published": "",
    "Another program": ", another program",
    "Our own earlier numbers": ", earlier numbers",
}


COMMANDS = """# Commands

`--help` after each command prints the same text. Quantities are text with a unit, as `"8 dBm"`, `"-10 GHz"`, `"20 us"`.
An input error prints one line and exits with code 2. `thermofem --version` prints the version.
A detuning is a frequency or, as `"80 pm"`, a distance in wavelength; a longer wavelength is a negative detuning.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | `doctor` found something missing, the fit of `identify` failed, or a row of `reproduce` has no number |
| 2 | bad input, or a file that cannot be read or written |
| 70 | an error that nobody foresaw, in one line; `--verbose` shows where |
| 130 | interrupted with Ctrl-C |

`thermofem --install-completion` installs tab completion for bash, zsh, fish or PowerShell; open a new shell afterwards.
Results are printed on standard output; warnings and progress on standard error, where `-q` drops them. With `--json`
every command prints its numbers in SI as one JSON object on standard output, and all words on standard error.

Every command takes `--json`, `--quiet` (`-q`), `--verbose` (`-v`), `--seed` and `--threads`; the tables leave them out.

| stage | takes | gives | commands |
|---|---|---|---|
| heat | geometry (TOML) | training data (netCDF) | [solve](#solve), [campaign](#campaign) |
| light | geometry | modes; `ring.toml`, a ring with the origin of every number | [modes](#modes), [ring](#ring) |
| compact models | data, table or geometry | model (JSON) | [fit](#fit), [reduce](#reduce), [show](#show) |
| judging | model or geometry | error curves | [validate](#validate) |
| many rings | campaign (TOML) | family (JSON) | [family](#family) |
| | family | designs, spreads | [design](#design), [uncertainty](#uncertainty), [calibrate](#calibrate) |
| ring and light | model, `--ring` (TOML) | traces | [simulate](#simulate) |
| | | maps | [map](#map), [stability](#stability) |
| | model, traces of light, sweeps of a laser | parameters of the ring | [identify](#identify), [sweep](#sweep) |
| | model, `--ring` | a page that computes | [explore](#explore) |
| FEM in the loop | geometry, `--ring` | traces | [cosimulate](#cosimulate) |
| hand on | model, results | files, references | [export](#export), [cite](#cite) |
| the paper | | report.html | [reproduce](#reproduce) |
| the machine | | what works here | [doctor](#doctor) |
"""


SHARED = {"help", "json", "quiet", "verbose", "seed", "threads"}


def commands() -> str:
    """Every command with its arguments and options."""
    from typer.main import get_command

    from thermofem_cli import app

    text = COMMANDS
    for name, command in get_command(app).commands.items():
        text += f"\n## {name}\n\n{' '.join((command.help or '').split())}\n"
        rows = [_parameter(p) for p in command.params if p.name not in SHARED]
        if rows:
            text += "\n| | | default |\n|---|---|---|\n" + "".join(rows)
    return text


def _parameter(p: Any) -> str:
    """One row: how it is written, what it is, its default."""
    written = ", ".join(p.opts) if p.param_type_name == "option" else (p.metavar or p.name.upper())
    default = p.default if isinstance(p.default, (str, int, float, Path)) and p.default is not False else None
    shown = f"{default:.3g}" if isinstance(default, float) else str(default)
    shown = "" if default is None or p.required else f"`{shown}`"
    return f"| `{written.replace('|', 'or')}` | {(p.help or '').replace('|', 'or')} | {shown} |\n"


def pages() -> dict[str, str]:
    """Every generated page with its text."""
    return {"geometry-reference.md": geometry_reference(), "commands.md": commands(), "validation.md": validation()}


if __name__ == "__main__":
    for name, text in pages().items():
        (DOCS / name).write_text(text, encoding="utf-8")
