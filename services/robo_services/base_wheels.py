"""The wheels that a running base takes itself to have: read from the parameters of its node."""

from typing import Annotated, NamedTuple

import msgspec
import zenoh
from msgspec import Meta

from robo.text.readable import readable
from robo.text.unreadable import UNREADABLE
from robo.wire.keys import parameters_key
from robo.wire.queries import Fault, first_answer
from robo_services.calibration import NONE, Corrections

TIMEOUT = 0.5
"""How long the node may take to answer, s."""
DIGITS = 4
"""Of what is printed: a tenth of a millimetre in a metre."""

_Multiplier = Annotated[float, Meta(ge=0.1, le=10)]


class Wheels(NamedTuple):
    """Of one base."""

    node: str
    """Whose parameters they are; empty for those of a plain Zenoh client."""
    separation: float
    """Between the wheels as odometry takes it, with its multiplier, m."""
    multipliers: Corrections = NONE
    """Those that are in odometry already."""


class _Said(msgspec.Struct, frozen=True):
    wheel_separation: Annotated[float, Meta(ge=0.001, le=100)] | None = None
    left_wheel_radius_multiplier: _Multiplier = 1.0
    right_wheel_radius_multiplier: _Multiplier = 1.0
    wheel_separation_multiplier: _Multiplier = 1.0


def ask_wheels(session: zenoh.Session, node: str) -> Wheels | None:
    """Ask a node for the wheels of its base.

    Args:
        session: the network.
        node: its full name.

    Returns:
        None where it does not answer, or has no such parameters.
    """
    namespace, _, name = node.strip("/").rpartition("/")
    answer = first_answer(session.get(parameters_key(namespace, name, "get"), timeout=TIMEOUT))
    if answer is None or isinstance(answer, Fault):
        return None
    try:
        said = msgspec.msgpack.decode(answer.payload.to_bytes(), type=readable(_Said))
    except UNREADABLE:
        return None
    if said.wheel_separation is None:
        return None
    multipliers = Corrections(
        said.left_wheel_radius_multiplier, said.right_wheel_radius_multiplier, said.wheel_separation_multiplier
    )
    return Wheels(name, said.wheel_separation * multipliers.separation, multipliers)


def as_yaml(wheels: Wheels, corrections: Corrections, errors: Corrections) -> str:
    """Their multipliers as a parameter file, each with its standard deviation.

    Args:
        wheels: as they are so far.
        corrections: by which they are to be multiplied.
        errors: of the corrections.
    """
    names = "left_wheel_radius_multiplier", "right_wheel_radius_multiplier", "wheel_separation_multiplier"
    lines = [f"{wheels.node or 'base'}:"]
    for name, now, found, error in zip(names, wheels.multipliers, corrections, errors, strict=True):
        lines.append(f"  {name}: {now * found:.{DIGITS}f}  # ± {now * error:.{DIGITS}f}")
    return "".join(f"{line}\n" for line in lines)
