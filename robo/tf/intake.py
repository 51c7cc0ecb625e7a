"""What is done with a transform that a buffer cannot just add to its link.

That is the first one of a frame, one out of order, one with another parent or source than before, the first ones of a
clock that was set back, and what is no transform.
"""

from robo.errors import InvalidTransform, TransformError
from robo.tf import faults
from robo.tf.check import checked
from robo.tf.history import History, Late, Link, Said, pack
from robo.tf.notes import Kind, Notes
from robo.tf.tree import Tree
from robo_messages import TransformStamped
from robo_messages.std import NANOSECONDS

MOST_FRAMES = 10_000
"""Of more frames a buffer takes nothing: somebody makes up names."""

IN_TURN = 3
"""So often what was said before has to come back until it is told: one that comes late does it twice."""


class Intake:
    """Puts transforms into a tree. Its caller holds the buffer's lock."""

    def __init__(self, tree: Tree, notes: Notes, duration: int) -> None:
        self._tree = tree
        self._notes = notes
        self._duration = duration
        self._span = duration * 5 // 4  # so that a history is not copied for each sample
        self.set_back = 0
        """How often a link's clock was set back."""

    def admit(self, message: TransformStamped, *, static: bool, source: str) -> None:
        """Take a transform.

        Raises:
            InvalidTransform: its names or numbers are none of a transform; says which, and whose it is.
            FrameLoop: its child would stand in itself.
        """
        parent, child = message.header.frame_id.lstrip("/"), message.child_frame_id.lstrip("/")  # as tf2 does
        ns = message.header.stamp.to_nanoseconds()
        try:
            values = checked(message, parent, child, ns)
            link = self._tree.links.get(child)
            frames = self._tree.frames
            if len(frames) >= MOST_FRAMES and not (parent in frames and child in frames):
                raise InvalidTransform(f"there are {MOST_FRAMES:,} frames, and a buffer takes no more")
            if static:
                self._begin(link, Link.fixed(parent, child, source, ns, values), ns)
            elif link is None or link.static:
                said = Said(ns, parent, source, pack(*values))
                self._begin(link, Link(parent, child, source, _history_of(said)), ns)
            else:
                self._add(link, Said(ns, parent, source, pack(*values)))
        except TransformError as error:
            which = f"{faults.link_name(parent, child)}{faults.said_by(source)}"
            raise type(error)(f"{which} is refused: {error}") from None

    def note_refused(self, error: TransformError, message: TransformStamped) -> None:
        """Remember what was refused."""
        self._notes.add("refused", message.child_frame_id, str(error), message.header.stamp.to_nanoseconds())

    def clear(self) -> None:
        """Forget the history of each link that moves."""
        for link in [link for link in self._tree.links.values() if not link.static]:
            self._tree.put(link.successor(link.parent, History.empty()))

    def _begin(self, before: Link | None, link: Link, ns: int) -> None:
        """Let a link begin, or go on as another kind of link, or with another static transform."""
        if before is None or before.parent != link.parent:
            self._tree.refuse_loop(link.parent, link.child)
        if before is not None:
            self._note_turns(before, link.parent, link.source, ns)
            if before.static and link.static:
                if before.parent == link.parent and before.history.bracket == link.history.bracket:
                    before.stamp = link.stamp
                    return
            else:
                self._note_kind(link, ns)
            link.former, link.turns = before.former, before.turns
        link.open(self._span)
        self._tree.put(link)

    def _add(self, link: Link, said: Said) -> None:
        """Put a sample into a link that moves."""
        history = link.history
        newest = history.stamps[-1] if history.stamps else said.ns
        if said.ns < newest - self._duration:
            first = self._first_after_set_back(link, said, newest)
            if first is None:
                return
            history, newest = _history_of(first), first.ns
            link = self._settled(link, first.parent, history)
        elif history.has(said.ns, said.sample) and history.parent_at(said.ns, link.parent) == said.parent:
            link.source = said.source
            return
        parent = said.parent if said.ns >= newest else link.parent
        if parent != link.parent:
            self._tree.refuse_loop(parent, link.child)
        self._note_turns(link, said.parent, said.source, said.ns)
        if history.stamps and said.ns - history.stamps[0] > self._span:
            history = history.since(said.ns - self._duration)
        self._settled(link, parent, history.merged(said.ns, said.sample, said.parent, link.parent))

    def _settled(self, link: Link, parent: str, history: History) -> Link:
        """A link with its newest parent and its history."""
        if link.is_plain and (history.parents is not None or parent != link.parent):
            link = link.successor(parent, history)  # who follows a chain through the one that was may go on with that
            self._tree.put(link)
        else:
            self._tree.change(link, parent, history)
        link.open(self._span)
        return link

    def _first_after_set_back(self, link: Link, said: Said, newest: int) -> Said | None:
        """What a history begins with, where a sample that is too old shows that a clock was set back; else None.

        It does where the one before was as old, and the stamps go on. Of another source than before it takes a second:
        two that publish one frame with clocks that differ do not clear its history again and again.
        """
        late = link.late
        goes_on = (
            late is not None
            and late.newest == newest
            and late.last.source == said.source
            and late.last.parent == said.parent
            and late.last.ns < said.ns <= late.last.ns + self._duration
        )
        which = f"{faults.link_name(said.parent, link.child)}{faults.said_by(said.source)}"
        before = faults.seconds(newest - said.ns)
        if late is not None and goes_on and (said.source == link.source or said.ns - late.begin >= NANOSECONDS):
            self._tree.refuse_loop(said.parent, link.child)
            link.late = None
            self.set_back += 1
            text = f"the clock of {which} was set back by {before}: its history was cleared"
            self._notes.add("set_back", link.child, text, said.ns)
            return late.last
        link.late = Late(late.begin if late is not None and goes_on else said.ns, said, newest)
        stamp, kept = faults.seconds(said.ns), faults.seconds(self._duration)
        text = f"{which} of {stamp} is left out: it is {before} older than the newest, and {kept} are kept"
        self._notes.add("left_out", link.child, text, said.ns)
        return None

    def _note_kind(self, link: Link, ns: int) -> None:
        """Remember that a frame was static before and moves now, or the other way round."""
        kind: Kind = "now_static" if link.static else "now_moving"
        was = "moved, and is static" if link.static else "was static, and moves"
        which = faults.link_name(link.parent, link.child)
        text = f"{which} {was} now{faults.said_by(link.source)}: publish a frame on tf or on tf_static, not on both"
        self._notes.add(kind, link.child, text, ns)

    def _note_turns(self, link: Link, parent: str, source: str, ns: int) -> None:
        """Remember who has said a link last, and tell where two do so in turn."""
        said, before = (parent, source), (link.parent, link.source)
        if said == before:
            return
        if said != link.former:
            link.turns = 0
        elif (turns := link.turns + 1) < IN_TURN:
            link.turns = turns
        elif parent != link.parent:
            places = " and ".join(f"{faults.name(one)}{faults.said_by(by)}" for one, by in sorted((said, before)))
            text = f"{faults.name(link.child)} has two parents in turn, {places}: a frame has one"
            self._notes.add("two_parents", link.child, text, ns)
        else:
            two = " and ".join(faults.name(by) for by in sorted((source, link.source)))
            text = f"{faults.link_name(parent, link.child)} is published by {two} in turn: one of them has to stop"
            self._notes.add("two_sources", link.child, text, ns)
        link.former, link.source = before, source


def _history_of(said: Said) -> History:
    return History.empty().merged(said.ns, said.sample, said.parent, said.parent)
