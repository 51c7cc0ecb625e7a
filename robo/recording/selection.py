"""Which topics are recorded: key expressions that are wanted, and those that are not. Pure."""

from collections.abc import Iterable, Sequence

import zenoh

from robo.errors import BagError
from robo.text.brief import shown
from robo.wire import names
from robo.wire.keys import is_hidden

EVERYTHING = "**"
_TF, _TF_STATIC = "tf", "tf_static"

_MOST_KEYS = 20_000
"""Of which it is remembered whether they are wanted."""


class Selection:
    """Which topics are wanted. Any thread may ask."""

    def __init__(self, asked: Iterable[str], exclude: Iterable[str] = (), beside: Iterable[str] = ()) -> None:
        """
        Args:
            asked: key expressions of topics, as `names.key_of` makes them.
            exclude: of these, what is not wanted.
            beside: what is wanted too, though nobody has asked for it by name.

        Raises:
            BagError: nothing is asked for, or what is no topic, or nothing but what is not wanted.
        """
        self.asked = list(dict.fromkeys(asked))
        """What has to come, else it is told."""
        if not self.asked:
            raise BagError("no topic is named to be recorded; name some, or ask for all of them")
        exclude = list(exclude)
        for name in (*self.asked, *exclude):
            if _is_internal(name):
                raise BagError(
                    f"{shown(name)} is no topic: parts that begin with @ are of keys by which Zenoh and robo work"
                )
        self._excluded = list(map(_expression, exclude))
        if all(any(out.includes(_expression(key)) for out in self._excluded) for key in self.asked):
            raise BagError(f"all that is asked for is excluded, by {', '.join(map(shown, exclude))}")
        every = list(map(_expression, dict.fromkeys((*self.asked, *beside))))
        self._expressions = [
            one for number, one in enumerate(every) if not any(_covers(other, one) for other in _others(every, number))
        ]
        self.keys = list(map(str, self._expressions))
        """The expressions to subscribe; together they have all that is wanted. A message may come by several."""
        self._shows_hidden = [is_hidden(key) for key in self.keys]
        self._sources: dict[str, int] = {}

    def source(self, key: str) -> int:
        """By which of `keys` the messages of a topic are taken, by number; -1 where it is not wanted."""
        found = self._sources.get(key)
        if found is None:
            if len(self._sources) >= _MOST_KEYS:
                self._sources.clear()
            found = self._sources[key] = self._find(key)
        return found

    def excludes(self, key: str) -> bool:
        """Whether somebody has said of a topic that it is not wanted."""
        exact = _expression(key)
        return any(one.intersects(exact) for one in self._excluded)

    def missing(self, came: Iterable[str]) -> list[str]:
        """What was asked for and of which nothing has come.

        Args:
            came: the topics of which something has.
        """
        exact = [zenoh.KeyExpr(key) for key in came]
        return [one for one in self.asked if not any(_expression(one).intersects(key) for key in exact)]

    def _find(self, key: str) -> int:
        try:
            exact = zenoh.KeyExpr(key)
        except zenoh.ZError:
            return -1
        if _is_internal(key) or self.excludes(key):
            return -1
        hidden = is_hidden(key)
        for number, one in enumerate(self._expressions):
            if one.intersects(exact) and (self._shows_hidden[number] or not hidden):
                return number
        return -1


def beside_robot(asked: Iterable[str], *, transforms: bool = True) -> list[str]:
    """What belongs to the robots whose topics are asked for: static transforms, in each of their namespaces; and
    where all of a robot is asked for, what all robots share, the clock of a simulation and transforms.

    Args:
        asked: key expressions of topics.
        transforms: whether those are wanted.

    >>> beside_robot(["r1/arm/joint_states"])
    ['r1/arm/tf_static', 'r1/tf_static', 'tf_static']
    >>> beside_robot(["r1/**"])
    ['clock', 'tf', 'r1/tf_static', 'tf_static']
    >>> beside_robot(["r1/**"], transforms=False)
    ['clock']
    """
    asked = list(asked)
    found: dict[str, None] = {}
    if any(key.endswith(EVERYTHING) for key in asked):
        found = dict.fromkeys(("clock", _TF) if transforms else ("clock",))
    for key in asked if transforms else ():
        chunks = key.split("/")[:-1]
        for end in range(len(chunks), -1, -1):
            found[names.join(*chunks[:end], _TF_STATIC)] = None
    return list(found)


def _is_internal(key: str) -> bool:
    return "/@" in f"/{key}"


def _expression(key: str) -> zenoh.KeyExpr:
    try:
        return zenoh.KeyExpr(key)
    except zenoh.ZError as error:
        raise BagError(f"{shown(key)} is no name of topics: {error}") from None


def _others(every: Sequence[zenoh.KeyExpr], number: int) -> list[zenoh.KeyExpr]:
    """The expressions that may stand for one: of two that are the same, the first."""
    own = str(every[number])
    return [one for place, one in enumerate(every) if place != number and (str(one) != own or place < number)]


def _covers(wide: zenoh.KeyExpr, narrow: zenoh.KeyExpr) -> bool:
    """Whether one has all topics of another; those that ROS hides are there only where they are named."""
    return wide.includes(narrow) and (is_hidden(str(wide)) or not is_hidden(str(narrow)))
