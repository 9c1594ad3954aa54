"""Random cross-sections: layers of any conductivity, anisotropy, voids, heaters, contacts, probes, every boundary.

Seeded: the same number gives the same cross-section on every machine.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

import thermofem as th
from thermofem.checks import InputError

LOWEST, HIGHEST = 0.3, 300.0  # W/(m K): any two materials differ by a factor of up to 1000


def cross_section(seed: int) -> th.CrossSection:
    """The random cross-section with this number; drawn again until its parts fit."""
    for attempt in range(1000):
        try:
            return _draw(np.random.default_rng([seed, attempt]))
        except InputError:
            continue
    raise RuntimeError(f"no cross-section fits for seed {seed}")


def strip(seed: int) -> th.CrossSection:
    """A random strip, of silicon and oxide or of any materials: it takes the committed mesh with moved vertices."""
    rng = np.random.default_rng(seed)
    lengths = {
        "radius": _log(rng, 3e-6, 20e-6),
        "width": _log(rng, 300e-9, 800e-9),
        "height": _log(rng, 100e-9, 400e-9),
        "box": _log(rng, 0.5e-6, 4e-6),
        "cladding": _log(rng, 0.5e-6, 4e-6),
    }
    geometry = th.strip_ring(**lengths)
    if rng.random() < 0.5:
        return geometry
    return replace(geometry, materials=tuple(_material(rng, name) for name in ("Si", "SiO2")))


def _draw(rng: np.random.Generator) -> th.CrossSection:
    materials = [_material(rng, name) for name in "abcdef"]
    name = [str(rng.choice([m.name for m in materials])) for _ in range(8)]
    radius, width, height = _log(rng, 2e-6, 20e-6), _log(rng, 200e-9, 2e-6), _log(rng, 80e-9, 500e-9)
    below, above = rng.integers(0, 3), rng.integers(0, 3)
    layers = [th.Layer("substrate", name[0], _log(rng, 5e-6, 60e-6))]
    layers += [th.Layer(f"below {k}", name[1 + k], _log(rng, 50e-9, 3e-6)) for k in range(below)]
    layers += [th.Layer("box", name[3], _log(rng, 0.3e-6, 4e-6), datum=True)]
    layers += [th.Layer("cladding", name[4], height + _log(rng, 50e-9, 3e-6))] if rng.random() < 0.85 else []
    layers += [th.Layer(f"above {k}", name[5 + k], _log(rng, 50e-9, 3e-6)) for k in range(above if len(layers) else 0)]
    top = sum(layer.thickness for layer in layers[layers.index(next(x for x in layers if x.datum)) + 1 :])
    angle = math.radians(rng.uniform(65, 100)) if rng.random() < 0.3 else math.pi / 2
    inner, outer = radius - width / 2, radius + width / 2
    core = th.Part("core", str(rng.choice([m.name for m in materials])), inner, outer, 0.0, height, angle, heated=True)
    parts = [core]
    if rng.random() < 0.35:
        half = _log(rng, 0.3e-6, 2e-6)
        parts.append(
            th.Part(
                "heater", name[7], max(radius - half, 0.1e-6), radius + half, top, _log(rng, 50e-9, 300e-9), heated=True
            )
        )
    if rng.random() < 0.3:
        parts.insert(0, _void(rng, radius, width, layers))
    interfaces = [th.Interface("core", _log(rng, 1e-9, 1e-7))] if rng.random() < 0.3 else []
    probes = [th.Probe("shell", "core", _log(rng, 100e-9, 1e-6))] if rng.random() < 0.2 else []
    return th.CrossSection(
        "random",
        max(_log(rng, 20e-6, 200e-6), 1.5 * outer),
        tuple(layers),
        tuple(parts),
        interfaces=tuple(interfaces),
        probes=tuple(probes),
        materials=tuple(materials),
        bottom=_boundary(rng, ["isothermal", "isothermal", "open", "convection"]),
        top=_boundary(rng, ["insulated", "insulated", "convection", "isothermal"]),
        outer=_boundary(rng, ["insulated", "insulated", "isothermal", "open"]),
    )


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")


def _material(rng: np.random.Generator, name: str) -> th.Material:
    k = _log(rng, LOWEST, HIGHEST)
    k_z = min(max(k * _log(rng, 0.1, 10), LOWEST), HIGHEST) if rng.random() < 0.25 else None
    return th.Material(name, k, _log(rng, 1500, 6000), _log(rng, 300, 1000), conductivity_z=k_z)


def _void(rng: np.random.Generator, radius: float, width: float, layers: list[th.Layer]) -> th.Part:
    """An undercut below the ring, or a trench beside it."""
    if rng.random() < 0.5:
        depth = _log(rng, 0.3e-6, 3e-6)
        half = _log(rng, 0.5e-6, 3e-6)
        return th.Part(
            "undercut", "void", max(radius - half, 0.2e-6), radius + half, -depth - _log(rng, 0.2e-6, 2e-6), depth
        )
    start = radius + width / 2 + _log(rng, 0.3e-6, 3e-6)
    depth = _log(rng, 0.2e-6, 1.5e-6)
    above = sum(layer.thickness for layer in layers[next(k for k, x in enumerate(layers) if x.datum) + 1 :])
    return th.Part("trench", "void", start, start + _log(rng, 0.5e-6, 3e-6), above - depth, depth)


def _boundary(rng: np.random.Generator, kinds: list[str]) -> th.Boundary:
    kind = str(rng.choice(kinds))
    return th.Boundary(kind, _log(rng, 1e3, 1e6)) if kind == "convection" else th.Boundary(kind)
