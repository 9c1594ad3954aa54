"""Options and arguments that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Geometry = Annotated[Path | None, typer.Argument(help="Geometry file (TOML); default: the reference strip.")]
Accuracy = Annotated[float, typer.Option(help="Wanted relative error of the mesh.")]
GeometryAccuracy = Annotated[float, typer.Option(help="Wanted relative error of a geometry's mesh.")]

Model = Annotated[Path, typer.Argument(help="Thermal model (JSON).")]
Heated = Annotated[str | None, typer.Option(help="Part that takes the heat, of a model of several parts.")]
Read = Annotated[str | None, typer.Option(help="Part that is read, of a model of several parts.")]
CHANNEL = "Part that the light heats and whose temperature shifts the resonance; or use --heated and --read."
Channel = Annotated[str | None, typer.Option(help=CHANNEL)]
Heater = Annotated[list[str] | None, typer.Option(help="Constant power of another part of the model: 'heater=5 mW'.")]

Ring = Annotated[
    str,
    typer.Option(help="Ring file (TOML), or borghi2021, borghi2021-lumped for Newton's law, or vanvaerenbergh2012."),
]
Power = Annotated[str, typer.Option(help="Power in the bus waveguide.")]
Detuning = Annotated[str, typer.Option(help="Laser minus cold resonance.")]
Duration = Annotated[str, typer.Option(help="Length of the run, from a cold start.")]
Duty = Annotated[float | None, typer.Option(help="Duty cycle of the square wave; default 1/3.")]
Points = Annotated[str, typer.Option(help="Number of powers and of detunings.")]

FieldTimes = Annotated[list[str] | None, typer.Option(help="Keep the field at '1 us, 5 us, ...'.")]
PARAVIEW = "Write the fields for ParaView: .xdmf; .vtu of one time; or .pvd, with NAME_0000.vtu and so on beside it."
Paraview = Annotated[Path | None, typer.Option(help=PARAVIEW)]
Figure = Annotated[Path | None, typer.Option(help="Also draw into this image.")]
Output = Annotated[Path, typer.Option("--output", "-o", help="File to write.")]
NetCDF = Annotated[Path, typer.Option("--output", "-o", help="File (netCDF) to write.")]
