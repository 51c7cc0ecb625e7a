"""`robo action`: what an action takes, sending goals, canceling and following them."""

import time
from collections.abc import Sequence
from contextlib import ExitStack

import zenoh

from robo.cli.connection import connect_to_robot, see_that_it_obeys
from robo.cli.printing import note, print_json, print_line
from robo.cli.reach import Reach
from robo.cli.views.service import data_of, shape, type_and_data
from robo.errors import ActionError, ActionTimeout, UsageError
from robo.process.endings import raised_by_signals
from robo.tools import actions, offers, replies
from robo.wire.goals import id_text, state_of
from robo.wire.keys import action_key
from robo_messages.action import GoalStatusArray, parts_of

_OVER = 2.0
"""How long a goal that is canceled has to end, s."""


def print_type(name: str, reach: Reach) -> None:
    """Print the type of an action."""
    wanted = reach.key(name)
    with connect_to_robot(reach) as session:
        print_line(offers.find_action(session, wanted, reach.timeout).type)


def print_info(name: str, reach: Reach, *, json: bool) -> None:
    """Print who executes an action, who sends goals, and its types."""
    wanted = reach.key(name)
    with connect_to_robot(reach) as session:
        found = offers.find_action(session, wanted, reach.timeout)
    parts = dict(zip(("goal", "result", "feedback"), parts_of(found.type), strict=True))
    if json:
        print_json({"key": found.key, "type": found.type, "servers": found.servers, "clients": found.clients, **parts})
        return
    print_line(f"{found.key}  {found.type}")
    print_line(f"  executed by {', '.join(found.servers)}")
    if found.clients:
        print_line(f"  goals from  {', '.join(found.clients)}")
    for label, type_name in parts.items():
        print_line(f"  {label:8}    {shape(type_name)}")


def send_goal(
    name: str, words: Sequence[str], reach: Reach, *, feedback: bool, wait: bool, timeout: float | None, json: bool
) -> int:
    """Send a goal and print its feedback and its result.

    Args:
        name: the action's.
        words: the goal, its type before it or not; both may be left out.
        reach: where it is.
        feedback: print what is told meanwhile.
        wait: wait for the result.
        timeout: cancel the goal after so long, s; None for as long as it takes.
        json: print JSON.

    Returns:
        0 where it has succeeded, else 1.

    Raises:
        UsageError: the goal is no map, or the type is not the action's.
        MessageError: it is not one of the action's type.
        ActionError: the server refuses it, or goes away.
    """
    wanted = reach.key(name)
    type_name, text = type_and_data(words, "a goal", "{order: 5}")
    with connect_to_robot(reach) as session, ExitStack() as following:
        found = offers.find_action(session, wanted, reach.timeout)
        if type_name not in (None, found.type):
            raise UsageError(f"{found.key} is a {found.type}, not a {type_name}; its type need not be said")
        see_that_it_obeys(session, reach, found.key)
        goal = data_of(parts_of(found.type)[0], text, "a goal")
        sending = actions.Sending(session, found, reach.timeout)
        goal_id = id_text(sending.id)
        if feedback:
            following.callback(sending.follow(lambda told: _print(json, "feedback", told)))
        sending.send(goal)
        if not wait:
            print_json({"goal_id": goal_id}) if json else print_line(goal_id)
            return 0
        if not json:
            note(f"goal {goal_id} is under way; Ctrl-C cancels it")
        try:
            with raised_by_signals():
                outcome = sending.wait(timeout)
        except (KeyboardInterrupt, ActionTimeout) as error:
            try:
                actions.cancel(session, found.key, goal_id, reach.timeout)
            except ActionError as refused:  # it may just have ended
                note(str(refused))
            else:
                if isinstance(error, ActionTimeout):
                    note(f"{error}: canceled")
            outcome = sending.wait(_OVER)
    # What was told on the way is printed by now.
    if json:
        print_json(outcome)
    else:
        _print(json, "result", outcome.result)
        note(f"{outcome.status.lower()}{': ' if outcome.message else ''}{outcome.message}")
    return 0 if outcome.status == "SUCCEEDED" else 1


def cancel(name: str, goal: str | None, reach: Reach, *, json: bool) -> int:
    """Cancel a goal, or all, and print which.

    Returns:
        1 where there is none.

    Raises:
        ActionError: the goal is not known, has ended, or cannot be canceled.
    """
    wanted = reach.key(name)
    with connect_to_robot(reach) as session:
        found = offers.find_action(session, wanted, reach.timeout)
        see_that_it_obeys(session, reach, found.key)
        canceling = actions.cancel(session, found.key, goal, reach.timeout)
    if json:
        print_json({"canceling": canceling})
    elif not canceling:
        note(f"no goal of {found.key} is under way")
    for one in canceling if not json else ():
        print_line(f"canceling {one}")
    return 0 if canceling else 1


def echo(name: str, reach: Reach, *, json: bool) -> None:
    """Print the feedback and the states of all goals until Ctrl-C."""
    wanted = reach.key(name)
    told: dict[str, int] = {}

    def on_feedback(sample: zenoh.Sample) -> None:
        message = replies.read(sample, actions.Told)
        if message is not None:
            _print_of(json, id_text(message.goal_id.uuid), "feedback", message.feedback)

    def on_status(sample: zenoh.Sample) -> None:
        message = replies.read(sample, GoalStatusArray)
        for one in message.status_list if message is not None else ():
            goal_id = id_text(one.goal_info.goal_id.uuid)
            if told.get(goal_id) != one.status:
                told[goal_id] = one.status
                _print_of(json, goal_id, "status", state_of(one.status).name)

    with connect_to_robot(reach) as session, ExitStack() as over:
        found = offers.find_action(session, wanted, reach.timeout)
        heard = {action_key(found.key, "feedback"): on_feedback, action_key(found.key, "status"): on_status}
        for key, take in heard.items():
            over.callback(session.declare_subscriber(key, take).undeclare)
        note(f"listening to {found.key}; Ctrl-C ends it")
        while True:
            time.sleep(1.0)


def _print(json: bool, label: str, value: object) -> None:
    if json:
        print_json({label: value})
    elif isinstance(value, dict):
        for name, one in value.items():
            print_line(f"{label} {name}: {one}")


def _print_of(json: bool, goal_id: str, label: str, value: object) -> None:
    if json:
        print_json({"goal_id": goal_id, label: value})
    else:
        print_line(f"{goal_id}  {label}  {value}")
