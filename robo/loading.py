"""From the name of a service to its node class: `package.module` or `package.module:Class`."""

import importlib
import os
import sys

from robo.errors import ContractError
from robo.node import Node
from robo.suggestions import hint, suggest


def load_node_class(service: str) -> type[Node]:
    """Import the module of a service and find its node class.

    A module without `:Class` must define exactly one node class.

    Raises:
        ContractError: the module or the class is not there, or cannot be imported; says what comes close.
    """
    module_name, _, class_name = service.partition(":")
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)  # services of the folder one works in need no installation
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not (module_name + ".").startswith(error.name + "."):
            raise ContractError(
                f"service {service!r} needs the module {error.name!r}, which is not installed"
            ) from None
        raise ContractError(f"there is no service {service!r}{_similar(module_name)}") from None
    except (ImportError, SyntaxError, ValueError) as error:
        raise ContractError(f"service {service!r} cannot be imported: {error}") from error
    classes = {
        name: member
        for name, member in vars(module).items()
        if isinstance(member, type) and issubclass(member, Node) and member.__module__ == module.__name__
    }
    if class_name:
        if class_name in classes:
            return classes[class_name]
        raise ContractError(f"module {module_name} has no node class {class_name!r}{_among(classes)}")
    if len(classes) == 1:
        return next(iter(classes.values()))
    if not classes:
        raise ContractError(f"module {module_name} defines no node class; a node is a subclass of robo.Node")
    raise ContractError(
        f"module {module_name} defines several node classes; write one of {_options(module_name, classes)}"
    )


def _options(module: str, classes: dict[str, type[Node]]) -> str:
    return ", ".join(f"{module}:{name}" for name in classes)


def _among(classes: dict[str, type[Node]]) -> str:
    return f"; it has {', '.join(classes)}" if classes else "; it has none"


def _similar(module_name: str) -> str:
    # only mistakes need these
    import importlib.util
    import pkgutil

    package, _, _ = module_name.rpartition(".")
    if not package:
        here = [m.name for m in pkgutil.iter_modules([os.getcwd()])]
        return hint(module_name, here, "; write package.module or package.module:Class")
    try:
        spec = importlib.util.find_spec(package)
    except ImportError:
        spec = None
    if spec is None or spec.submodule_search_locations is None:
        return "; write package.module or package.module:Class"
    known = [f"{package}.{m.name}" for m in pkgutil.iter_modules(spec.submodule_search_locations)]
    return f"; {suggest(module_name, known, f'{package} has')}"
