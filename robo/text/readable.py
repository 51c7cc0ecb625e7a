"""Types that msgspec may read in every thread.

What msgspec has to know of a type it finds out when it is first to read one, field by field. While one thread has it
find out, another one gets what there is so far, with msgspec 0.22, and crashes with the rest: 1 process in 100 whose
first two threads read a type at the same moment.
"""

import sys
import threading
from typing import TypeVar

import msgspec

T = TypeVar("T")

_found_out: set[object] = set()
_finding_out = threading.RLock()  # a collection in the midst of it may run anything


def readable(type_: T) -> T:
    """The same type, of which msgspec knows all from now on.

    >>> msgspec.convert([1, 2], readable(list[int]))
    [1, 2]

    Args:
        type_: a class, or what else may stand in an annotation.

    Raises:
        TypeError: msgspec can read no such type; says why.
    """
    try:
        if type_ in _found_out:
            return type_
    except TypeError:  # what is said beside it has no hash
        _find_out(type_)
        return type_
    _find_out(type_)
    _found_out.add(type_)
    return type_


def _find_out(type_: object) -> None:
    # Messages know nothing of robo and take a lock of their own. Where they have not been imported, no type holds any.
    messages = sys.modules.get("robo_messages._registry")
    with _finding_out:
        getattr(messages, "decoder_of", msgspec.msgpack.Decoder)(type_)
