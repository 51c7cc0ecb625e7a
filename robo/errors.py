"""What can go wrong, one class for each situation a caller may want to tell apart.

    RoboError
    ├── InvalidName           a node, topic or namespace name that breaks the rules
    ├── ParameterError        a value that a node's parameters refuse
    ├── ParameterFileError    a parameter file that cannot be read or understood
    ├── UnreadableFile        a file that somebody named and that is missing, too large or no file at all
    ├── ContractError         a node class that does not say clearly what it does
    ├── EngineError           a container engine that cannot be reached, or refuses
    ├── SystemdError          systemd is not there, or refuses
    ├── NetworkError          the Zenoh network cannot be reached or opened
    │   └── ReadOnly          a robot is another user's, and others only look at it
    ├── SecurityError         keys, certificates or rules that are missing, too open, or do not fit each other
    │   ├── PolicyError       a policy with mistakes, or what cannot be said in one
    │   └── NotLetIn          a router that refuses the name with which it is dialled
    ├── LifecycleError        a managed node that cannot go through a transition, or did not come to active
    │   └── NotActive         a managed node was called while it was not active
    ├── ServiceError          a service's handler raised, or its answer cannot be read
    │   └── ServiceTimeout    a service did not answer in time, or nobody serves it
    ├── ActionError           an action refuses a goal, or a goal has not succeeded
    │   └── ActionTimeout     a goal, or what was asked of its server, took longer than granted
    ├── TransformError        a transform that cannot be looked up, or that no buffer takes
    │   ├── InvalidTransform  numbers that are no rigid transform, or names that are none of frames
    │   ├── FrameLoop         a frame that would be its own ancestor
    │   ├── UnknownFrame      a frame that nobody has said anything of
    │   ├── FramesNotConnected  frames of which each is there, and nothing leads from one to the other
    │   ├── NoTransformData   frames of which no data have come, or none since their history was cleared
    │   └── ExtrapolationError  a time at which a link of the chain is not known
    │       ├── TooOld        it is before the link's history begins
    │       └── InTheFuture   it is after the link's newest data
    ├── MessageError          data that are no message of the type that was asked for
    ├── InterfaceError        definitions of ROS's types that cannot be read, or that robo cannot have
    ├── BagError              a recording that cannot be found, read or written
    │   ├── DamagedBag        a file that is cut, or whose bytes make no sense
    │   └── DiskFull          a recording that has ended for want of room
    ├── FlightRecorderError   a flight recorder that a robot does not have, or has already, or that could not write
    ├── TopicNotFound         nobody publishes or subscribes a topic of this name
    ├── TopicTaken            somebody publishes already what a tool was asked to publish
    ├── ManifestError         a launch manifest with mistakes
    ├── NodeNotFound          no node of this name runs
    ├── NodeUnreachable       a node runs and does not answer
    ├── CreateError           a package, node or message that cannot be made, for what is there already
    ├── RunError              a run that is not there, or could not do what it was asked to
    └── UsageError            a command line that makes no sense

Each message tells what is wrong, where, and what to do. A user's own mistake is one of these and
never a traceback.
"""

from typing import Any


class RoboError(Exception):
    """Base of every error that robo raises on purpose."""


class InvalidName(RoboError, ValueError):
    """A node, topic or namespace name breaks the rules."""


class ParameterError(RoboError, ValueError):
    """One or more values do not fit a node's parameters; the message has a line for each."""


class ParameterFileError(RoboError):
    """A parameter file is missing or has mistakes; the message has a line for each."""


class UnreadableFile(RoboError):
    """A file that somebody named cannot be read; the message says why and not which."""

    def __init__(self, text: str, *, missing: bool = False) -> None:
        super().__init__(text)
        self.missing = missing
        """Whether there is nothing of its name."""


class ContractError(RoboError, TypeError):
    """A node class does not say clearly what it publishes, subscribes or how it is tuned."""


class EngineError(RoboError):
    """A container engine cannot be reached, or refuses what it was asked to do."""


class NotKept(RoboError, OSError):
    """What a node wants to know when it is started again cannot be written."""


class SystemdError(RoboError):
    """There is no systemd on this machine, or it refuses what it is asked to do."""


class NetworkError(RoboError, ConnectionError):
    """The Zenoh network cannot be reached or opened."""


class ReadOnly(NetworkError):
    """A robot is another user's, who lets others look at it and no more."""


class SecurityError(RoboError):
    """Keys, certificates or rules are missing, open to others, or do not fit each other; nothing is opened then."""


class PolicyError(SecurityError):
    """A policy has mistakes, a line for each, or cannot say what was asked of it."""


class NotLetIn(SecurityError):
    """A router refuses the name with which it is dialled; the message says why."""


class LifecycleError(RoboError):
    """A managed node cannot go through a transition in its present state, or did not come to active."""


class NotActive(LifecycleError):
    """A managed node was called while it was not active."""


class ServiceError(RoboError):
    """A service's handler raised, or its answer cannot be read."""

    def __init__(self, text: str, kind: str = "", message: str = "") -> None:
        super().__init__(text)
        self.kind = kind
        """The name of the handler's exception class, if it raised."""
        self.message = message
        """The handler's own message."""


class ServiceTimeout(ServiceError, TimeoutError):
    """A service did not answer in time, or nobody serves it."""


class ActionError(RoboError):
    """An action's server refuses a goal, the goal was canceled or aborted, or its server has gone."""

    def __init__(self, text: str, status: int = 0, result: Any = None) -> None:
        super().__init__(text)
        self.status = status
        """How the goal has ended, a `GoalState`: CANCELED or ABORTED; UNKNOWN where there is none, or nobody knows."""
        self.result = result
        """The result of a goal that has ended, as far as its handler came."""


class ActionTimeout(ActionError, TimeoutError):
    """A goal has no result in time, or its server does not answer."""


class TransformError(RoboError):
    """A transform cannot be looked up, or no buffer takes it."""


class InvalidTransform(TransformError, ValueError):
    """Numbers are no rigid transform, or a name is none of a frame."""


class FrameLoop(TransformError, ValueError):
    """A frame would be its own ancestor."""


class UnknownFrame(TransformError, LookupError):
    """Nobody has said anything of a frame of this name."""


class FramesNotConnected(TransformError, LookupError):
    """Both frames are there, in two trees that nothing connects."""


class NoTransformData(TransformError, LookupError):
    """Frames have no data: none has come at all, or none of a link since its history was cleared."""


class ExtrapolationError(TransformError):
    """The transform was asked for at a time at which a link of its chain is not known."""

    def __init__(self, text: str, parent: str = "", child: str = "", wanted: int = 0, limit: int = 0) -> None:
        super().__init__(text)
        self.parent = parent
        """The parent frame of the link."""
        self.child = child
        """Its child frame."""
        self.wanted = wanted
        """The time that was asked for, ns."""
        self.limit = limit
        """The end of what the link knows that is nearest to it, ns."""


class TooOld(ExtrapolationError):
    """The time is before the history of a link begins."""


class InTheFuture(ExtrapolationError):
    """The time is after the newest data of a link: they may still come."""


class MessageError(RoboError, ValueError):
    """Data that are no message of the type that was asked for; a line for each mistake."""


class InterfaceError(RoboError):
    """Definitions of ROS's types cannot be read, or robo cannot have them; a line for each mistake."""


class BagError(RoboError):
    """A recording cannot be found, read or written; the message names the file."""

    def __init__(self, text: str, path: str = "", offset: int | None = None) -> None:
        """`text` says what is wrong; of `path` and `offset` comes where."""
        place = f"{path}, byte {offset:,}: " if offset is not None else f"{path}: " if path else ""
        super().__init__(f"{place}{text}")
        self.reason = text
        """Without where."""
        self.path = path
        """Of the file; empty where it is none in particular."""
        self.offset = offset
        """Where in the file, bytes from its beginning; None where it is no place in particular."""


class DamagedBag(BagError):
    """A file of a recording is cut, or its bytes make no sense."""

    def __init__(self, text: str, path: str = "", offset: int | None = None, *, cut: bool = False) -> None:
        super().__init__(text, path, offset)
        self.cut = cut
        """Whether it only ends too early, as after a power cut."""


class DiskFull(BagError):
    """A recording has ended, whole, because the disk has less room than it is to leave."""


class FlightRecorderError(RoboError):
    """A robot has no flight recorder, or has one already, or it could not write what it was asked for."""


class TopicNotFound(RoboError, LookupError):
    """Nobody publishes or subscribes a topic of this name."""


class TopicTaken(RoboError):
    """Somebody publishes a topic already, and two publishers would fight."""


class ManifestError(RoboError):
    """A launch manifest has mistakes; the message has them all, each with its position."""

    of_command_line = False
    """Whether nothing but words of the command line is at fault."""


class NodeNotFound(RoboError, LookupError):
    """No node of this name runs, or several do."""


class NodeUnreachable(RoboError, TimeoutError):
    """A node runs and does not answer."""


class RunError(RoboError):
    """A run is not there, or could not do what it was asked to."""


class CreateError(RoboError):
    """A package, node or message cannot be made for what is there already; the message has a line for each reason."""


class UsageError(RoboError):
    """A command line makes no sense."""
