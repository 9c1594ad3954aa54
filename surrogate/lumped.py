"""The old place of the paper's laws, kept for scripts that import it; they are in `thermofem.models.lumped`."""

from thermofem.models.lumped import BORGHI2021_HEAT_CAPACITY, check_heat_capacity, newton, second_order

__all__ = ["BORGHI2021_HEAT_CAPACITY", "check_heat_capacity", "newton", "second_order"]
