"""The compiled equations of light, carriers and heat, and the methods that integrate them."""

from thermofem.checks import InputError

try:
    import numba  # noqa: F401 - it reads its variables of the environment
except ValueError as error:
    raise InputError(f"Numba does not start: {error} Look at the variables NUMBA_... of the environment") from None
