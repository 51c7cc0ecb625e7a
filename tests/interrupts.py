"""Ctrl-C at the worst of moments, for tests of what waits."""

import threading
from typing import NoReturn

_LET_GO = "_release_save"


def strike(condition: threading.Condition, by: type[BaseException] = KeyboardInterrupt) -> None:
    """See that a signal's handler raises in the next wait once this has let go of its lock, and before it waits."""
    let_go = getattr(condition, _LET_GO)

    def struck() -> NoReturn:
        let_go()
        setattr(condition, _LET_GO, let_go)
        raise by

    setattr(condition, _LET_GO, struck)


def wait_and_be_struck(by: type[BaseException] = KeyboardInterrupt) -> None:
    """Wait, and be struck."""
    condition = threading.Condition()
    strike(condition, by)
    with condition:
        condition.wait()
