"""Many runs at once, of recordings and parameters: planned, run as processes, and put together as one table.

def score(run: Run) -> dict[str, float]:
    with bag.open(run.said) as said:
        return {"driven": [message.value.z for message in said.messages("r1/current_position")][-1]}
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robo.batch.call import Run

__all__ = ["Run"]


def __getattr__(name: str) -> object:
    """Import what is asked for: most of the room does without it."""
    if name not in __all__:
        raise AttributeError(f"module 'robo.batch' has no attribute {name!r}")
    from robo.batch.call import Run

    return Run
