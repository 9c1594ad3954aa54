"""Constants of physics, exact in the SI since 2019.

Source: BIPM, The International System of Units, 9th edition (2019), Section 2.2. `scipy.constants` holds the same
numbers; its import takes .2 CPU s, more than a usual run of `thermofem simulate` computes.
"""

from __future__ import annotations

import math

c = 299792458.0  # m/s, speed of light in vacuum
h = 6.62607015e-34  # J s, Planck
hbar = h / (2 * math.pi)  # J s
e = 1.602176634e-19  # C, elementary charge
k = 1.380649e-23  # J/K, Boltzmann
