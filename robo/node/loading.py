"""From the name of a service to its node class: `package.module` or `package.module:Class`."""

import importlib
import os
import sys
from types import ModuleType

from robo.errors import ContractError
from robo.node.contract import check_constructor
from robo.node.node import Node
from robo.text.suggestions import MOST_LISTED, closest, suggest

_BASES = Node.__module__
"""The module whose node class is no node yet."""
SHIPPED = "robo_services"
"""The package of the nodes that ship."""


def load_node_class(service: str) -> type[Node]:
    """Import the module of a service and find its node class.

    A module without `:Class` must define exactly one node class.

    Raises:
        ContractError: the module or the class is not there, or cannot be imported; says what comes close.
    """
    module_name, _, class_name = service.partition(":")
    if module_name.endswith(".py"):
        raise ContractError(f"service {service!r} is a file; write its module, {_spelt_as_module(module_name)}")
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)  # services of the folder one works in need no installation
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not (module_name + ".").startswith(error.name + "."):
            from robo.text.import_errors import place_of

            where = f" ({place})" if (place := place_of(error)) is not None else ""
            raise ContractError(
                f"service {service!r} needs the module {error.name!r}, which is not installed{where}"
            ) from None
        raise ContractError(f"there is no service {service!r}{_similar(module_name)}") from None
    except Exception as error:  # a user's module may raise anything while it is imported
        from robo.text.import_errors import explained

        raise ContractError(f"service {service!r} cannot be imported: {explained(error)}") from error
    classes = node_classes(module)
    if class_name:
        if class_name in classes:
            return _checked(classes[class_name])
        raise ContractError(f"module {module_name} has no node class {class_name!r}{_among(classes)}")
    if len(classes) == 1:
        return _checked(next(iter(classes.values())))
    if not classes:
        held = _modules_of(module_name)
        instead = f"it has {', '.join(held[:MOST_LISTED])}" if held else "a node is a subclass of robo.Node"
        raise ContractError(f"module {module_name} defines no node class; {instead}")
    raise ContractError(
        f"module {module_name} defines several node classes; write one of {_options(module_name, classes)}"
    )


def node_classes(module: ModuleType) -> dict[str, type[Node]]:
    """The node classes that a module defines itself, by name."""
    return {
        name: member
        for name, member in vars(module).items()
        if isinstance(member, type) and issubclass(member, Node) and member.__module__ == module.__name__ != _BASES
    }


def _spelt_as_module(path: str) -> str:
    return os.path.normpath(path).removesuffix(".py").replace(os.sep, ".").lstrip(".")


def _checked(node_class: type[Node]) -> type[Node]:
    check_constructor(node_class)
    return node_class


def _options(module: str, classes: dict[str, type[Node]]) -> str:
    return ", ".join(f"{module}:{name}" for name in classes)


def _among(classes: dict[str, type[Node]]) -> str:
    return f"; it has {', '.join(classes)}" if classes else "; it has none"


def _similar(module_name: str) -> str:
    package, _, _ = module_name.rpartition(".")
    if not package:
        import pkgutil  # only mistakes need it

        here = [m.name for m in pkgutil.iter_modules([os.getcwd()])]
        shipped = {name.rpartition(".")[2]: name for name in _modules_of(SHIPPED)}
        close = closest(module_name, [*here, *shipped])
        if close is None:
            return "; write package.module or package.module:Class"
        return f"; did you mean {close if close in here else shipped[close]}?"
    known = _modules_of(package)
    return f"; {suggest(module_name, known, f'{package} has')}" if known else "; write package.module"


def _modules_of(package: str) -> list[str]:
    """The full names of the modules in a package; none where it is no package."""
    import importlib.util
    import pkgutil

    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return []
    folders = spec.submodule_search_locations if spec is not None else None
    return [f"{package}.{module.name}" for module in pkgutil.iter_modules(folders)] if folders else []
