"""A manifest as a service of systemd: from the words of a command line to its files."""

import getpass
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, get_args

import robo
from robo.cli.launch.service_request import ServiceRequest
from robo.cli.launch.words import manifest_file, split_words
from robo.cli.options import words_of
from robo.cli.printing import note, write_file
from robo.cli.secured import keys_of_robot
from robo.errors import UsageError
from robo.export.systemd import access, devices, stamp, unit
from robo.launch import resolve
from robo.launch.faults import ManifestFaults
from robo.launch.plan import Plan
from robo.launch.resolve import Resolution
from robo.supervisor.needs import stop_limit
from robo.supervisor.stopping import LAST_RESORT

DYNAMIC = "dynamic"
_HOW: tuple[unit.Restart, ...] = get_args(unit.Restart)


class Made(NamedTuple):
    """What has become of a request."""

    service: unit.Service
    text: str
    """Of the unit, with its mark."""
    variables: str
    """Of the file with variables."""
    notes: list[str]
    """What to know of it."""


def make(request: ServiceRequest, *, by_user: bool, verb: str) -> Made:
    """A service of a manifest.

    Args:
        request: what is wanted.
        by_user: whether it is for a user's own service manager.
        verb: the words that make it, for its first lines.

    Raises:
        ManifestError: the manifest has mistakes.
        SecurityError: the robot's keys are not there.
        UsageError: the words make no sense.
    """
    restart = next((one for one in _HOW if one == request.restart), None)
    if restart is None and request.restart is not None:
        raise UsageError(f"--restart {request.restart}: say {', '.join(_HOW[:-1])} or {_HOW[-1]}")
    name, groups, given = split_words(request.words or ())
    file = manifest_file(name).resolve()
    variables = _Variables()
    found = resolve.resolve(file, given, robot=request.robot_name, groups=groups, environment=variables.value)
    if found.problems:
        raise ManifestFaults(found.problems)
    keys = keys_of_robot(request.security, found.plan.robot)
    needed = _needed(found, file) + ([keys] if keys is not None else [])
    run_as = _run_as(request, needed, by_user=by_user)
    who = access.STRANGER if run_as is None else access.reader(run_as)
    plan = found.plan
    there = access.found_devices(request.device or ())
    allowed = devices.devices(request.device or (), there, access.group_names())
    values = [word for word in request.words or () if word != name]
    service = unit.Service(
        robot=plan.robot,
        description=f"Robot {plan.robot}" + (f": {plan.description}" if plan.description else ""),
        made_by=shlex.join([*verb.split(), *_same(request, plan.robot)]),
        program=(sys.executable, "-m", "robo", "up", str(file), *values, *_options(request, plan.robot, keys)),
        folder=str(Path.cwd()),
        processes=plan.processes,
        needed=tuple(map(str, needed)),
        stop=stop_limit({one.full_name: one for one in plan.processes}) + LAST_RESORT + 1.0,
        by_user=by_user,
        run_as=None if by_user else run_as,
        in_home=any(map(access.in_a_home, needed)),
        devices=allowed,
        python_path=os.environ.get("PYTHONPATH", ""),
        jit=request.jit,
        restart=restart,
    )
    notes = _notes(service, request, plan, variables)
    if not by_user:
        notes += _unreadable(needed, who, run_as)
    return Made(service, stamp.stamped(unit.unit_text(service)), variables.text(plan.robot), notes)


def export_systemd(request: ServiceRequest, output: Path | None) -> None:
    """Print the unit of a robot, or write it and the file with its variables into a folder.

    Raises:
        RoboError: as for `make`; or a file cannot be written.
    """
    made = make(request, by_user=request.by_user, verb="robo export systemd")
    for text in made.notes:
        note(text)
    if output is None:
        sys.stdout.write(made.text)
        return
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"the folder {output} cannot be made: {error.strerror}") from None
    write_file(made.text, output / made.service.unit)
    settings = output / Path(unit.environment_file(made.service.robot)).name
    if settings.exists():
        note(f"{settings} is left as it is")
    else:
        write_file(made.variables, settings)
        settings.chmod(0o600)
    place = unit_folder(by_user=made.service.by_user)
    note(f"{output / made.service.unit} is for {place}; `robo service install` puts it there")


def unit_folder(*, by_user: bool) -> Path:
    """Where systemd looks for units that people make."""
    if by_user:
        return settings_folder(by_user=True) / "systemd" / "user"
    return Path("/etc/systemd/system")


def settings_folder(*, by_user: bool) -> Path:
    """What systemd calls `%E`."""
    if by_user:
        return Path(os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config"))
    return Path("/etc")


class _Variables:
    """The variables that a manifest asks for, with what they are here."""

    def __init__(self) -> None:
        self._asked: dict[str, str | None] = {}

    def value(self, variable: str, default: str | None) -> str | None:
        """What a variable is: one that nobody has said is none's mistake yet, for the file is to say it."""
        self._asked.setdefault(variable, default)
        return os.environ.get(variable, default if default is not None else "unset")

    @property
    def lacking(self) -> list[str]:
        """Those that somebody has to say."""
        return sorted(name for name, default in self._asked.items() if default is None)

    def text(self, robot: str) -> str:
        """A file that says them. What they are here is not in it: some of them may be secret."""
        lines = [f"# Variables of the robot {robot}, a line each: NAME=value"]
        lines += [f"#{name}={default or ''}" for name, default in sorted(self._asked.items())]
        return "\n".join(lines) + "\n"


def _options(request: ServiceRequest, robot: str, keys: Path | None) -> list[str]:
    words = ["--robot-name", robot, *(["--security", str(keys)] if keys is not None else [])]
    for option, values in (("--connect", request.connect), ("--listen", request.listen)):
        words += [word for value in values or () for word in (option, value)]
    return words


def _same(request: ServiceRequest, robot: str) -> list[str]:
    """The words of the command line that ask for the same."""
    return [*(request.words or ()), *words_of(request._replace(robot_name=robot))]


def _needed(found: Resolution, file: Path) -> list[Path]:
    """The files and folders that it reads, each once."""
    own = Path(robo.__file__).parent
    more = [Path(entry) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    files = [Path(sys.executable), own, file, *map(Path, found.plan.files), Path.cwd(), *more]
    return list(dict.fromkeys(path.absolute() for path in files))


def _run_as(request: ServiceRequest, needed: Sequence[Path], *, by_user: bool) -> str | None:
    """Who it runs as; None for one that systemd makes up.

    Where nobody says it: whoever asks, or has asked root to, because it works for them by hand; for root itself nobody
    of this machine, unless something that it needs is in a home.
    """
    if by_user:
        if request.run_as is not None:
            raise UsageError("--run-as goes with --system: your own service manager runs everything as you")
        return getpass.getuser()
    if request.run_as is not None:
        return None if request.run_as == DYNAMIC else request.run_as
    asking = os.environ.get("SUDO_USER") or getpass.getuser()
    if asking != "root":
        return asking
    return "root" if any(map(access.in_a_home, needed)) else None


def _notes(service: unit.Service, request: ServiceRequest, plan: Plan, variables: _Variables) -> list[str]:
    notes = []
    if variables.lacking:
        where = settings_folder(by_user=service.by_user)
        notes.append(f"say what {', '.join(variables.lacking)} is, in {where / unit.environment_file(service.robot)}")
    texts = [str(value) for one in plan.processes for value in one.parameters.values()]
    texts += [word for one in plan.processes for word in (*one.run, *one.args)]
    absent = [name for name in devices.named_in(texts) if name not in (request.device or ())]
    if absent and service.by_user:
        notes.append(f"it uses {', '.join(absent)}: you have to be in the group of each")
    elif absent and not request.device:
        options = " ".join(f"--device {name}" for name in absent)
        notes.append(f"it names {', '.join(absent)}, which it may not use; say {options}")
    if service.by_user and request.device:
        notes.append("your own service manager grants no devices: --device means nothing there")
    if service.run_as == "root":
        notes.append("it runs as root, since what it needs is in a home; --run-as USER says who else")
    if service.restarts == "no" and request.restart is None:
        notes.append(
            "no node is started again by its policy, so neither is the run; --restart on-failure says otherwise"
        )
    return notes


def _unreadable(needed: Sequence[Path], who: access.Reader, run_as: str | None) -> list[str]:
    called = run_as or "the user that systemd makes up"
    notes = []
    for path in needed:
        place = access.hindered(path, who)
        if place is not None:
            notes.append(f"{called} may not read {path}" + (f", because of {place}" if place != path.resolve() else ""))
        elif run_as is None and access.in_a_home(path):
            notes.append(f"{called} sees no homes, and {path} is in one: say --run-as, or have it elsewhere, as /opt")
    return notes
