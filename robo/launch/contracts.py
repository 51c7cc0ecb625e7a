"""What the node classes of a plan promise, and whether they take their parameters.

Node classes are imported in a process of their own, so that what they import stays out of the
supervisor's memory, and a module that crashes is a message.
"""

import os
import pickle
import sys
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from robo.errors import ContractError
from robo.launch.substitution import Word, settled
from robo.node.contract_data import ContractData


class Question(msgspec.Struct, frozen=True):
    """A node class, and values for its parameters; those it does not have are passed over."""

    service: str
    values: dict[str, object]


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a question."""

    error: str | None = None
    """Why there is no contract."""
    contract: ContractData | None = None
    mistakes: dict[str, str] = {}
    """By name, why a value is refused."""
    lacking: tuple[str, ...] = ()
    """What the class says that this machine does not have for it, a sentence each."""


def typed(value: object, parameter_type: str | None) -> object:
    """A parameter's value: what comes from outside of YAML stays text where the parameter is text."""
    return str(value) if isinstance(value, Word) and parameter_type == "str" else settled(value)


def examine(questions: Sequence[Question]) -> list[Answer]:
    """Answer questions in this process."""
    loaded: dict[str, Any] = {}
    return [_answer(asked, loaded) for asked in questions]


def examine_apart(questions: Sequence[Question]) -> list[Answer]:
    """Answer questions in a process of their own, where that is cheap and safe.

    A process with several threads must not be forked; there the answers are worked out in place.
    """
    if not questions:
        return []
    if not hasattr(os, "fork") or _threads() > 1:
        return examine(questions)
    answered = _in_child(lambda: pickle.dumps(examine(questions)))
    if answered is not None:
        answers: list[Answer] = pickle.loads(answered)  # written by this very program
        return answers
    if len(questions) == 1:
        return [Answer(error=f"service {questions[0].service!r} cannot be imported: it ends the process")]
    # One of them takes the process with it; asked one by one, the others answer.
    return [answer for asked in questions for answer in examine_apart([asked])]


def _threads() -> int:
    """The threads of this process, those of libraries too."""
    if sys.platform != "linux":
        import psutil

        return psutil.Process().num_threads()
    return len(os.listdir("/proc/self/task"))


def _in_child(work: Callable[[], bytes]) -> bytes | None:
    reader, writer = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            os.dup2(2, 1)  # what a module prints is no output of this command
            with os.fdopen(writer, "wb") as out:
                out.write(work())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as result:
        answered = result.read()
    os.waitpid(child, 0)
    return answered or None


def _answer(asked: Question, loaded: dict[str, Any]) -> Answer:
    from robo.node.contract_text import contract_data
    from robo.node.loading import load_node_class
    from robo.parameters import model as parameters
    from robo.parameters.shape import declared_as

    if asked.service not in loaded:
        try:
            node_class = load_node_class(asked.service)
            loaded[asked.service] = (node_class, contract_data(node_class))
        except (ContractError, SystemExit) as error:
            loaded[asked.service] = str(error) or "it ends the process"
        except Exception as error:  # what a user has written may raise anything while its contract is made
            from robo.text.import_errors import explained

            loaded[asked.service] = f"service {asked.service!r} cannot be used: {explained(error)}"
    if isinstance(loaded[asked.service], str):
        return Answer(error=loaded[asked.service])
    node_class, contract = loaded[asked.service]
    types = contract.parameter_types
    values = {
        name: typed(value, types[known])
        for name, value in asked.values.items()
        if (known := declared_as(name, types)) is not None
    }
    mistakes = parameters.mistakes(node_class.Parameters, values, contract.name)
    if mistakes:
        return Answer(contract=contract, mistakes=mistakes)
    try:
        lacking = tuple(node_class.lacking(parameters.build(node_class.Parameters, values, contract.name)))
    except Exception as error:  # likewise
        from robo.text.import_errors import explained

        return Answer(error=f"service {asked.service!r} cannot say what it lacks: {explained(error)}")
    return Answer(contract=contract, lacking=lacking)
