"""What can be said of processes once all are known: names, needs, parameters, and which are to be started."""

from collections.abc import Collection, Sequence
from pathlib import Path

import msgspec

from robo.launch import contracts, needs, sharing, values
from robo.launch.arguments import COMMAND_LINE
from robo.launch.contracts import Answer
from robo.launch.draft import Draft
from robo.launch.find import manifest_meant
from robo.launch.plan import ProcessPlan
from robo.launch.substitution import Complain
from robo.launch.unfold import Unfolding
from robo.launch.values import Assignment, NodeFacts
from robo.node.contract_data import ContractData
from robo.text.brief import shown
from robo.text.suggestions import suggest
from robo.text.tree import Position, Problem


class Settlement(msgspec.Struct, frozen=True, kw_only=True):
    """The processes of a launch."""

    drafts: Sequence[Draft]
    """All, each of another name."""
    processes: Sequence[ProcessPlan]
    """Those that are to be started."""
    contracts: dict[str, ContractData]
    """By full name, what a node's class promises, where that is known."""
    lacking: dict[str, tuple[str, ...]]
    """By full name, what a node needs and this machine does not have, a sentence each."""
    loose: list[Problem]
    """What is said and reaches nobody."""


def settle(
    unfolded: Unfolding, file: Path, groups: Collection[str], assignments: Sequence[Assignment], host: str | None
) -> Settlement:
    """The processes of what a manifest unfolds to.

    Args:
        unfolded: has the drafts of all processes, and takes the mistakes.
        file: the manifest.
        groups: start only these; all where empty.
        assignments: values of parameters that come before all others.
        host: start only what runs on this host; all where None.
    """
    complain = unfolded.complain
    drafts = _unique(unfolded.drafts, complain)
    _check_groups(groups, unfolded.groups, file, complain)
    _check_host(host, file, drafts, complain)
    sharing.check_together([(draft.plan, draft.position) for draft in drafts], complain)
    waiting = [needs.Dependent(d.plan.full_name, d.plan.namespace, d.needs) for d in drafts]
    by_key: dict[tuple[str, str], list[str]] = {}
    for draft in drafts:
        by_key.setdefault((draft.plan.namespace, draft.key), []).append(draft.plan.full_name)
    needed = needs.resolve(waiting, by_key, unfolded.left_out, complain)
    values.assign(assignments, [(d.plan.name, d.plan.full_name, d.mentions) for d in drafts], unfolded.problems)
    answers = _ask(drafts, complain)
    loose: list[Problem] = []
    checked = [NodeFacts(d.plan.full_name, d.mentions, answers.get(d.plan.full_name)) for d in drafts]
    settings = values.check(checked, unfolded.problems, loose)
    qualities = {topic.key: topic.qos for topic in unfolded.topics if topic.qos is not None}
    processes = [
        msgspec.structs.replace(draft.plan, settings=own, needs=needed[draft.plan.full_name], qos=qualities)
        for draft, own in zip(drafts, settings, strict=True)
    ]
    return Settlement(
        drafts=drafts,
        processes=_chosen(sharing.with_shared_limits(processes), groups, host),
        contracts={name: answer.contract for name, answer in answers.items() if answer.contract is not None},
        lacking={name: answer.lacking for name, answer in answers.items() if answer.lacking},
        loose=loose,
    )


def _unique(drafts: Sequence[Draft], complain: Complain) -> list[Draft]:
    """The drafts without those whose name is taken."""
    kept: dict[str, Draft] = {}
    for draft in drafts:
        first = kept.setdefault(draft.plan.full_name, draft)
        if first is not draft:
            again = first.position == draft.position
            hint = "; put ${index} into its name or namespace" if again else ""
            complain(draft.position, f"node {draft.plan.full_name} is already in {first.position}{hint}")
    return list(kept.values())


def _check_host(host: str | None, file: Path, drafts: Sequence[Draft], complain: Complain) -> None:
    """Where a robot has several hosts, every process says on which it runs."""
    known = list(dict.fromkeys(name for draft in drafts for name in draft.plan.hosts))
    if host is not None and host not in known:
        complain(Position(str(file), 1, 1), f"there is no host {shown(host)} in it; {suggest(host, known)}")
    for draft in drafts if known else ():
        if not draft.plan.hosts:
            text = f"{draft.plan.full_name} is on no host, and others are: say hosts: {known[0]} in its group"
            complain(draft.position, text)


def _check_groups(wanted: Collection[str], groups: Sequence[str], file: Path, complain: Complain) -> None:
    for name in wanted:
        if not any(_in_group(path, name) for path in groups):
            meant = manifest_meant(name)
            instead = f"did you mean {meant}?" if meant is not None else suggest(name, groups, "it has")
            complain(COMMAND_LINE, f"{file.name} has no group {shown(name)}; {instead}")


def _ask(drafts: Sequence[Draft], complain: Complain) -> dict[str, Answer]:
    """What the node classes say, by the full names of their nodes."""
    services = [draft for draft in drafts if draft.plan.service is not None]
    questions = [contracts.Question(str(d.plan.service), values.as_question(d.mentions)) for d in services]
    answers = dict(zip([d.plan.full_name for d in services], contracts.examine_apart(questions), strict=True))
    for draft in services:
        error = answers[draft.plan.full_name].error
        if error is not None:
            complain(draft.service_at, error)
    return answers


def _chosen(processes: Sequence[ProcessPlan], groups: Collection[str], host: str | None) -> list[ProcessPlan]:
    """The processes of some groups, of one host; they do not wait for what nobody of this launch starts."""
    of_groups = [p for p in processes if not groups or any(_in_group(p.group, name) for name in groups)]
    kept = {p.full_name for p in of_groups}
    chosen = [p for p in of_groups if host is None or host in p.hosts]
    return [msgspec.structs.replace(p, needs={n: until for n, until in p.needs.items() if n in kept}) for p in chosen]


def _in_group(path: str, name: str) -> bool:
    """Whether a group is meant by a name: the whole path, or one or more parts of it."""
    return f"/{name.strip('/')}/" in f"/{path}/"
