"""How a function becomes a verb: its options, its examples, and how errors end it."""

import functools
import inspect
import os
import re
import sys
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import typer

from robo.cli.options import Connect, RobotName, Security, Timeout
from robo.cli.reach import Reach
from robo.cli.tree import Section, Verb
from robo.errors import InvalidName, ManifestError, RoboError, UsageError
from robo.process.endings import raised_by_signals
from robo.text.brief import brief_lines

F = TypeVar("F", bound=Callable[..., int | None])


def verb(parent: typer.Typer, name: str, *examples: str, **settings: Any) -> Callable[[F], F]:
    """Make a function a verb. Its docstring is the help; what it returns is the exit code, None being 0.

    A parameter that is a `Reach` stands for the options --robot-name, --connect and --timeout; one of them that the
    function declares itself stays its own. One that is another NamedTuple stands for an option for each of its fields.

    Args:
        parent: a section, or a group.
        name: of the verb.
        examples: command lines, below the help.
        settings: more for typer.
    """

    def register(function: F) -> F:
        signature = inspect.signature(function, eval_str=True)
        bundles = [_Bundle.of(parameter, signature.parameters) for parameter in signature.parameters.values()]

        @functools.wraps(function)
        def run(**options: Any) -> None:
            with errors():
                code = function(**{bundle.name: bundle.taken_from(options) for bundle in bundles})
            raise typer.Exit(code or 0)

        parameters = [one for bundle in sorted(bundles, key=lambda bundle: bundle.shared) for one in bundle.options]
        run.__signature__ = signature.replace(parameters=parameters, return_annotation=None)  # type: ignore[attr-defined]
        run.__annotations__ = {option.name: option.annotation for option in parameters}
        epilog = "\b\nExamples:\n" + "\n".join(f"  {line}" for line in examples) if examples else None
        about = re.split("[,:;.]", inspect.cleandoc(function.__doc__ or ""))[0]
        settings.setdefault("short_help", f"{about}.")
        parent.command(name, cls=Verb, epilog=epilog, **settings)(run)
        if isinstance(parent, Section):
            parent.names.append(name)
        return function

    return register


class _Bundle(NamedTuple):
    """One parameter of a function, and the options that it stands for."""

    name: str
    make: Callable[..., object] | None
    """Makes its value of those of the options, by their names; None where it is an option itself."""
    options: Sequence[inspect.Parameter]
    shared: bool = False
    """Whether all verbs have them: in help they stand below a verb's own."""

    @classmethod
    def of(cls, parameter: inspect.Parameter, beside: Mapping[str, inspect.Parameter]) -> "_Bundle":
        kind = parameter.annotation
        if kind is Reach:
            every = {"robot_name": RobotName, "connect": Connect, "security": Security, "timeout": Timeout}
            options = [_option(name, annotation) for name, annotation in every.items() if name not in beside]
            return cls(parameter.name, _reach, options, shared=True)
        if isinstance(kind, type) and issubclass(kind, tuple):
            defaults: Mapping[str, object] = getattr(kind, "_field_defaults", {})
            fields = typing.get_type_hints(kind, include_extras=True).items()
            return cls(
                parameter.name,
                kind,
                [_option(name, a, defaults.get(name, inspect.Parameter.empty)) for name, a in fields],
            )
        return cls(parameter.name, None, [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)])

    def taken_from(self, options: Mapping[str, object]) -> object:
        """The parameter's value."""
        values = {option.name: options[option.name] for option in self.options}
        return values[self.name] if self.make is None else self.make(**values)


def _reach(security: str | None = None, **options: Any) -> Reach:
    """What the options say of the network; it holds for the process as a whole who it is there."""
    from robo.cli.secured import secure

    secure(security)
    return Reach.of(**options)


def _option(name: str, annotation: object, default: object = None) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=default)


@contextmanager
def errors() -> Iterator[None]:
    """Show a mistake as a message, and leave quietly on Ctrl-C and when the reader of a pipe is gone."""
    try:
        with raised_by_signals():
            yield
    except RoboError as error:
        print(_described(error), file=sys.stderr)
        words = isinstance(error, (UsageError, InvalidName)) or (
            isinstance(error, ManifestError) and error.of_command_line
        )
        raise typer.Exit(2 if words else 1) from None
    except KeyboardInterrupt:
        raise typer.Exit(130) from None
    except BrokenPipeError:
        # What Python would still flush at exit has no reader either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def _described(error: RoboError) -> str:
    """An error for people; the mistakes of a manifest each with their line."""
    if not isinstance(error, ManifestError) or not hasattr(error, "faults"):
        return f"error: {brief_lines(str(error))}"
    from robo.launch.faults import as_text

    count = "1 mistake" if len(error.faults) == 1 else f"{len(error.faults)} mistakes"
    return f"{as_text(error.faults)}\n{count}; nothing is started"
