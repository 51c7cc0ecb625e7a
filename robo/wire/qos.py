"""How many messages are kept while a receiver is busy.

One number, `depth`, says it on both ends. `depth=n` keeps the newest n and drops the oldest, and a
sender never waits. `depth=KEEP_ALL` loses nothing on one machine: a full receiver makes the sender wait.
To other hosts a router waits for nobody.
"""

from typing import Final

from robo.errors import ContractError

KEEP_ALL: Final = 0
"""Lose nothing: a receiver that falls behind slows the sender down, on the same machine."""

DEFAULT_DEPTH: Final = 10

DEFAULT_TIMEOUT: Final = 2.0
"""How long a call of a service waits for its answer, s."""


def check_depth(depth: int) -> int:
    """`depth` if it is KEEP_ALL or a positive number.

    Raises:
        ContractError: it is neither.
    """
    if depth < 0:
        raise ContractError(f"depth {depth}: use a positive number, or KEEP_ALL to lose nothing")
    return depth
