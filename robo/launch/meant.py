"""Which nodes of a plan, and which of their parameters, words mean that name them. Pure."""

from collections.abc import Collection, Iterable

from robo.errors import UsageError
from robo.launch.plan import Plan, ProcessPlan
from robo.text.suggestions import suggest


def nodes_meant(plan: Plan, words: Collection[str]) -> list[ProcessPlan]:
    """The nodes that words mean: names, full names, services, groups.

    Raises:
        UsageError: a word means none, several that are no group, or a command.
    """
    meant: list[ProcessPlan] = []
    for word in words:
        fitting = [one for one in plan.processes if _is_meant(one, word)]
        if len(fitting) > 1:
            where = ", ".join(one.full_name for one in fitting)
            raise UsageError(f"{word} means several nodes: {where}; name one by its full name")
        group = [one for one in plan.processes if word in one.group.split("/") and one.service is not None]
        if not fitting and not group:
            known = [one.name for one in plan.processes]
            raise UsageError(f"{plan.manifest} has no node {word}; {suggest(word, known)}")
        for one in fitting or group:
            if one.service is None:
                raise UsageError(f"{one.full_name} is a command; only nodes in Python can be replayed")
            if one not in meant:
                meant.append(one)
    return meant


def parameters_at(lefts: Iterable[str], name: str, full_name: str) -> dict[str, str]:
    """Of words `NODE.PARAMETER` those that mean a node, by it the parameter.

    Args:
        lefts: the words.
        name: the node's.
        full_name: with its namespace, from a leading slash on.
    """
    found: dict[str, str] = {}
    for left in lefts:
        for node in (full_name, full_name.strip("/"), name):
            if node and left.startswith(f"{node}."):
                found[left] = left.removeprefix(f"{node}.")
                break
    return found


def _is_meant(process: ProcessPlan, word: str) -> bool:
    if word in (process.name, process.full_name, process.full_name[1:]):
        return True
    (module, _, class_), (own, _, own_class) = word.partition(":"), (process.service or "").partition(":")
    return module == own and (class_ == own_class or not (class_ and own_class))
