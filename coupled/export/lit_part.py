"""The channel of a thermal model that a ring drives, and its RC network in the circuit of a ring."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from thermofem import InputError, StateSpace
from thermofem.export.poles import RCNetwork, rc_network
from thermofem.ring_temperature import detuning_output


def ring_network(model: Any, wanted: str, *, taken: Iterable[str]) -> tuple[RCNetwork, str]:
    """RC network with a pin "heat" at the part that light heats, and the pin of the output that detunes it.

    wanted: the temperature that the ring reads, "core" or "light".
    """
    net = rc_network(model, taken=(*taken, "heat"))
    channel = lit_part(model, wanted)
    net.pins[net.parts.index(channel.heated)] = "heat"
    return net, net.pins[net.parts.index(channel.read)]


def lit_channel(model: Any, wanted: str) -> Any:
    """The channel of a StateSpace from the light of a ring to what detunes it; any other model unchanged."""
    return model.channel(*lit_part(model, wanted)) if isinstance(model, StateSpace) else model


class LitPart(NamedTuple):
    """The input that the light of a ring heats, and the output that detunes it."""

    heated: str
    read: str


def lit_part(model: Any, wanted: str) -> LitPart:
    """The first input of a model, and the output that detunes a ring which reads ``wanted``, "core" or "light".

    Raises InputError: the model does not read that input, and reads several others.
    """
    heated = getattr(model, "heated", model.inputs)[0]
    read = detuning_output(wanted, heated, tuple(model.outputs))
    if read in model.outputs:
        return LitPart(heated, read)
    raise InputError(f"model heats {heated!r} and reads {', '.join(model.outputs)}: one must be {heated!r}, too")
