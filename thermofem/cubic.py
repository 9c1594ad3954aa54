"""Old place of `thermofem.waveforms.Cubic`, kept for one release."""

from .waveforms.cubic import Cubic as Cubic
