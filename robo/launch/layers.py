"""What one place says of a process, with every `${name}` filled in: a group around it, the node itself, an override.

Whoever reads on sees plain values with their places; a value that cannot be worked out is Broken, and is complained of
once somebody needs it.
"""

from collections.abc import Sequence

import msgspec

from robo.launch.forms import beside_manifest
from robo.launch.language import Written, fill, keys_of
from robo.launch.manifest import Need, NodeEntry, ParameterSource, Settings, Variable
from robo.launch.plan import ProcessPlan
from robo.launch.substitution import Complain, Scope
from robo.text.tree import Entry, Items, Map, Position, Scalar, Tree


class Layer(msgspec.Struct, frozen=True, kw_only=True):
    """What one place says. Layers come from the outermost group to the last override; the later one holds."""

    plain: Written
    params: Sequence[ParameterSource]
    """Of those whose condition holds."""
    remap: Sequence[Entry]
    env: Sequence[Variable]
    """Of those whose condition holds."""
    namespace: Scalar | None
    position: Position
    of_group: bool
    """Whether it is said of all that is in a group."""
    needs: Sequence[Need] | None = None
    publishes: Sequence[Entry] = ()
    subscribes: Sequence[Entry] = ()


def layer_of(settings: Settings, scope: Scope, complain: Complain) -> Layer:
    """A group, a node or an override as a layer; its own condition has been looked at before."""
    found = Layer(
        plain=fill(keys_of(ProcessPlan), settings.plain, scope),
        params=[_source(source, scope) for source in settings.params if scope.holds(source, complain)],
        remap=_entries(settings.remap, scope),
        env=[_variable(variable, scope) for variable in settings.env if scope.holds(variable, complain)],
        namespace=_scalar(settings.namespace, scope) if settings.namespace is not None else None,
        position=settings.position,
        of_group=not isinstance(settings, NodeEntry),
    )
    if not isinstance(settings, NodeEntry):
        return found
    needs = settings.needs
    return msgspec.structs.replace(
        found,
        needs=[Need(_scalar(need.node, scope), need.until) for need in needs] if needs is not None else None,
        publishes=_entries(settings.publishes, scope),
        subscribes=_entries(settings.subscribes, scope),
    )


def _source(source: ParameterSource, scope: Scope) -> ParameterSource:
    file, values = source.file, source.values
    return ParameterSource(
        file=Scalar(beside_manifest(scope, file), file.position) if file is not None else None,
        values=Map(_entries(values.entries, scope), values.position) if values is not None else None,
    )


def _variable(variable: Variable, scope: Scope) -> Variable:
    return Variable(name=variable.name, value=_scalar(variable.value, scope), position=variable.position)


def _scalar(scalar: Scalar, scope: Scope) -> Scalar:
    return Scalar(scope.raw(scalar), scalar.position)


def _entries(entries: Sequence[Entry], scope: Scope) -> tuple[Entry, ...]:
    return tuple(entry._replace(value=_tree(entry.value, scope)) for entry in entries)


def _tree(tree: Tree, scope: Scope) -> Tree:
    """A value of a parameter. Its use decides the type of a word from outside; in a list YAML does."""
    if isinstance(tree, Scalar):
        return _scalar(tree, scope)
    if isinstance(tree, Items):
        return Scalar(scope.plain(tree), tree.position)
    return Map(_entries(tree.entries, scope), tree.position)
