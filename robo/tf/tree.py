"""The tree of frames: who stands in whom, now and at other times, and the chains of links between two frames."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from robo.errors import FrameLoop, FramesNotConnected
from robo.tf import faults
from robo.tf.history import History, Link
from robo.tf.screw import Bracket, followed, relative
from robo.tf.transform import Transform3, of_values

MOST_CHAINS = 10_000
"""Of so many pairs of frames the chains are kept; then they are looked for anew."""


class Way(NamedTuple):
    """The links from one frame to another."""

    up: list[Link]
    """From the source to the frame that both stand in."""
    down: list[Link]
    """From the target to that frame."""

    @property
    def links(self) -> list[Link]:
        """All of them."""
        return [*self.up, *self.down]

    @property
    def moving(self) -> list[Link]:
        """Those that are not static.

        Raises:
            NoTransformData: one of them has no history.
        """
        found = [link for link in self.links if not link.static]
        for link in found:
            if not link.history.stamps:
                raise faults.no_data(link)
        return found


class Chain:
    """What a lookup between two frames follows, found once; static links that follow each other are one."""

    __slots__ = ("_down", "_last", "_moving", "_tree", "_up")

    def __init__(self, tree: "Tree", way: Way) -> None:
        self._tree = tree
        self._last: tuple[int, int, Transform3] | None = None
        """The last answer, with its time and the number of the tree's changes before it. For what has one stamp, such
        as all that was seen in one picture, the same is asked many times."""
        self._up = _merged(way.up)
        self._down = _merged(way.down)
        self._moving = tuple(way.moving)

    def newest(self) -> int:
        """The newest time at which all of its links are known, ns; any time will do where none moves."""
        newest = None
        for link in self._moving:
            stamp = link.history.stamps[-1]
            if newest is None or stamp < newest:
                newest = stamp
        return newest or 0

    def at(self, ns: int) -> Transform3 | None:
        """The transform at a time; None where a link does not know it then."""
        changes = self._tree.changes
        last = self._last
        if last is not None and last[0] == ns and last[1] == changes:
            return last[2]
        up, down = _brackets(self._up, ns), _brackets(self._down, ns)
        if up is None or down is None:
            return None
        found = of_values(relative(followed(down, ns), followed(up, ns)) if down else followed(up, ns))
        self._last = ns, changes, found
        return found


def _brackets(links: Iterable[Link], ns: int) -> list[Bracket] | None:
    found = []
    for link in links:
        history = link.history
        bracket = history.bracket
        if bracket is None or not bracket[0] < ns < bracket[1]:
            bracket = history.bracket_at(ns)
            if bracket is None:
                return None
        found.append(bracket)
    return found


def _merged(links: Sequence[Link]) -> tuple[Link, ...]:
    """A chain of links in which each run of static ones is a single one."""
    found: list[Link] = []
    for link in links:
        if link.static and found and found[-1].static:
            both = _brackets((found[-1], link), 0)
            assert both is not None
            link = Link.fixed(link.parent, found[-1].child, "", 0, followed(both, 0))
            found.pop()
        found.append(link)
    return tuple(found)


class Tree:
    """All links. Who changes something, or asks for more than `chains`, holds the buffer's lock."""

    def __init__(self) -> None:
        self.links: dict[str, Link] = {}
        """By their children."""
        self.frames: dict[str, None] = {}
        """Every frame that was ever named, in the order in which they were."""
        self.chains: dict[tuple[str, str], Chain] = {}
        """By target and source. It is replaced when the tree changes. Whoever has got a chain before may still follow
        it: its links are those of then, for one that gets another parent is another link."""
        self.changes = 0
        """How often something changed but by one sample more at an end: what was found before may be wrong then."""

    def put(self, link: Link) -> None:
        """Let a link stand for its child."""
        self.links[link.child] = link
        self.frames |= {link.parent: None, link.child: None}
        self.chains = {}
        self.changes += 1

    def change(self, link: Link, parent: str, history: History) -> None:
        """Give a link another history, and another parent where no chain follows it."""
        link.parent, link.history = parent, history
        self.frames.setdefault(parent)
        self.changes += 1  # after the change: who has looked before it keeps what was found under the number before

    def refuse_loop(self, parent: str, child: str) -> None:
        """Look whether a child may stand in a parent, by the newest samples.

        Raises:
            FrameLoop: the parent stands in the child.
        """
        above = [parent]
        while (link := self.links.get(above[-1])) is not None and above[-1] != child:
            above.append(link.parent)
        if above[-1] == child:
            raise FrameLoop(faults.loop_text(child, above))

    def newest(self, target: str, source: str) -> int | None:
        """The newest time at which all links between two frames are known, ns; None where none of them moves.

        Raises:
            FramesNotConnected, NoTransformData: there is none.
        """
        way = self.way(target, source)
        if way is None:
            raise self._not_connected(target, source)
        return min((link.history.stamps[-1] for link in way.moving), default=None)

    def search(self, target: str, source: str, wanted: int | None, duration: int) -> Transform3:
        """The transform from one frame to another, with what is to be said where there is none.

        Args:
            target: the frame that coordinates are wanted in.
            source: the frame that they are in.
            wanted: when, ns; None is the newest time.
            duration: how long histories are, ns.

        Raises:
            TransformError: as `Buffer.lookup`.
        """
        ns = wanted if wanted is not None else self.newest(target, source) or 0
        way = now = self.way(target, source)
        if way is not None and all(link.is_plain for link in way.links):
            chain = Chain(self, way)
            if len(self.chains) >= MOST_CHAINS:
                self.chains = {}
            self.chains[target, source] = chain
        else:  # a link has had several parents: those of that time count
            way = self.way(target, source, ns)
            if way is None:
                raise self._not_connected(target, source)
            chain = Chain(self, way)
        found = chain.at(ns)
        if found is None:
            asked = way if wanted is not None or now is None else now
            raise faults.not_known_at(asked.moving, ns, newest=wanted is None, duration=duration)
        return found

    def way(self, target: str, source: str, ns: int | None = None) -> Way | None:
        """How one frame is reached from another, by the newest parents or by those at a time; None for two trees.

        Raises:
            FrameLoop: at that time there was a loop.
        """
        up = self._above(source, ns)
        down = self._above(target, ns)
        ancestors = {frame: index for index, (frame, _) in enumerate(up)}
        for index, (frame, _) in enumerate(down):
            if frame in ancestors:
                above = (part[:count] for part, count in ((up, ancestors[frame]), (down, index)))
                return Way(*([link for _, link in part if link is not None] for part in above))
        return None

    def _not_connected(self, target: str, source: str) -> FramesNotConnected:
        roots = (self._above(frame, None)[-1][0] for frame in (target, source))
        return faults.not_connected(target, source, *roots)

    def _above(self, frame: str, ns: int | None) -> list[tuple[str, Link | None]]:
        """A frame and all above it, each with the link to its parent."""
        found: dict[str, Link | None] = {}
        while (link := self.links.get(frame)) is not None:
            if frame in found:  # each parent was right at its time, but they come from samples that lie apart
                raise FrameLoop(faults.loop_text(frame, list(found), ns))
            found[frame] = link
            frame = link.parent if ns is None else link.history.parent_at(ns, link.parent)
        found[frame] = None
        return list(found.items())
