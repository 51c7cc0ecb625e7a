"""Managed nodes: ROS 2's `LifecycleNode`. A plain node imports nothing of this."""

from typing import ClassVar, cast

import msgspec

from robo.node.life import Life
from robo.node.lifecycle import LifecycleState, TransitionCallbackReturn
from robo.node.managed_life import ManagedLife
from robo.node.node import Node
from robo.wire.reports import NodeStatus


class LifecycleNode(Node):
    """A node that comes to its work through ROS 2's states: unconfigured, inactive, active, finalized.

        class Camera(LifecycleNode):
            def on_configure(self) -> None:
                self.device = open_camera()

            def on_cleanup(self) -> None:
                self.device.close()

    Only while it is active it publishes, and its callbacks run. A hook that returns nothing has succeeded; one
    that raises has gone wrong, and `on_error` is called. `on_start` and `on_stop` stay the beginning and the end of
    the node itself.
    """

    IS_MANAGED: ClassVar[bool] = True
    _LIFE: ClassVar[type[Life]] = ManagedLife

    def on_configure(self) -> TransitionCallbackReturn | None:
        """Get ready: read parameters, open the device, take the memory."""
        return None

    def on_activate(self) -> TransitionCallbackReturn | None:
        """Begin to work. Publishers send from here on."""
        return None

    def on_deactivate(self) -> TransitionCallbackReturn | None:
        """Cease to work: let the robot stand. Publishers send for the last time."""
        return None

    def on_cleanup(self) -> TransitionCallbackReturn | None:
        """Undo what `on_configure` has done."""
        return None

    def on_shutdown(self) -> TransitionCallbackReturn | None:
        """Make an end. From active, `on_deactivate` and `on_cleanup` are not called first."""
        return None

    def on_error(self) -> TransitionCallbackReturn | None:
        """Tidy up after a hook that went wrong: SUCCESS says that all is as it was before `on_configure`.

        One that is not overridden says FAILURE: nobody knows how things stand, and the node is finalized.
        """
        return TransitionCallbackReturn.FAILURE

    @property
    def lifecycle_state(self) -> LifecycleState:
        """The present state."""
        return self._managed.lifecycle.state if self._life is not None else LifecycleState.UNCONFIGURED

    @property
    def state_before(self) -> LifecycleState:
        """The primary state in which the present transition, or the last one, began; for `on_error`, `on_shutdown`."""
        return self._managed.lifecycle.before if self._life is not None else LifecycleState.UNKNOWN

    def change_state(self, transition: str) -> TransitionCallbackReturn:
        """Go through a transition, in turn with the callbacks.

        Args:
            transition: `configure`, `activate`, `deactivate`, `cleanup` or `shutdown`.

        Returns:
            How its hook went. After an ERROR `on_error` has been called.

        Raises:
            LifecycleError: there is no such transition in the present state; says which there are.
            RuntimeError: the node has not started.
        """
        return self._started().change(transition)

    def check_transition(self, transition: str) -> None:
        """See whether a transition is possible now.

        Raises:
            LifecycleError: it is not; says which ones are.
            RuntimeError: the node has not started.
        """
        self._started().lifecycle.find(transition)

    @property
    def status(self) -> NodeStatus:
        """Counters of this node, and its state."""
        return msgspec.structs.replace(super().status, lifecycle=self.lifecycle_state.label)

    def _started(self) -> ManagedLife:
        if self._life is None or self._life.is_over:
            raise RuntimeError(f"{self.full_name} has not started; use it as `with node:` or call start()")
        return self._managed

    @property
    def _managed(self) -> ManagedLife:
        return cast(ManagedLife, self._life)
