"""`robo service install|remove|status`: robots that systemd runs."""

import re
from collections.abc import Iterator
from pathlib import Path

from robo.cli.json_text import document
from robo.cli.launch.service_request import ServiceRequest
from robo.cli.launch.systemd import Made, make, settings_folder, unit_folder
from robo.cli.printing import note, print_line, print_table, write_file
from robo.errors import SystemdError, UsageError
from robo.export.systemd import stamp
from robo.export.systemd.unit import environment_file, unit_name
from robo.machine.systemd import Systemd
from robo.text.files import read_text
from robo.wire import names

_ROBOT = re.compile(r"--robot-name[= ](\S+)")


def install(request: ServiceRequest, *, force: bool, dry_run: bool) -> None:
    """Let systemd run a robot from the next boot on. What is there already stays as it is.

    Raises:
        ManifestError: the manifest has mistakes.
        SystemdError: there is no systemd, or it refuses.
        UsageError: the words make no sense, or a unit was changed by somebody.
    """
    by_user = request.by_user
    made = make(request, by_user=by_user, verb="robo service install")
    unit = unit_folder(by_user=by_user) / made.service.unit
    variables = settings_folder(by_user=by_user) / environment_file(made.service.robot)
    there = _text_of(unit)
    if there is not None and there != made.text:
        _check_own(unit, there, force=force)
    for text in made.notes:
        note(text)
    if dry_run:
        what = "is there already, as it should be" if there == made.text else "would be written"
        print_line(f"{unit} {what}; nothing is done")
        if there != made.text:
            print(made.text, end="")
        return
    systemd = Systemd(by_user=by_user)
    if there == made.text:
        print_line(f"{unit} is there already, as it should be")
    else:
        _write(made.text, unit, 0o644)
        print_line(f"{'wrote' if there is None else 'replaced'} {unit}")
    if _text_of(variables) is None:
        _write(made.variables, variables, 0o600)
        print_line(f"wrote {variables}, for variables of the manifest")
    systemd.reload()
    systemd.enable(made.service.unit)
    print_line(f"enabled {made.service.unit}: {_when(by_user=by_user)}")
    _tell_next(made, systemd, by_user=by_user)


def remove(robot: str, *, by_user: bool, force: bool, dry_run: bool) -> None:
    """Let systemd run a robot no more. Where it does not, nothing is done.

    Raises:
        SystemdError: there is no systemd, or it refuses.
        UsageError: the unit was changed by somebody, or is not robo's.
    """
    name = unit_name(names.normalize_namespace(robot))
    unit = unit_folder(by_user=by_user) / name
    there = _text_of(unit)
    if there is None:
        elsewhere = unit_folder(by_user=not by_user) / name
        hint = f"; {elsewhere} is there: --{'system' if by_user else 'user'}" if elsewhere.exists() else ""
        print_line(f"there is no {unit}: nothing is to be done{hint}")
        return
    _check_own(unit, there, force=force)
    if dry_run:
        print_line(f"{unit} would be stopped, disabled and removed; nothing is done")
        return
    systemd = Systemd(by_user=by_user)
    systemd.disable(name)
    try:
        unit.unlink()
    except OSError as error:
        raise UsageError(f"{unit} cannot be removed: {error.strerror}") from None
    systemd.reload()
    print_line(f"stopped and removed {unit}")
    variables = settings_folder(by_user=by_user) / environment_file(names.normalize_namespace(robot))
    if variables.exists():
        print_line(f"{variables} is left, with what you have written there")


def status(robot: str | None, *, by_user: bool | None, json: bool) -> None:
    """Print how the robots are that systemd runs.

    Args:
        robot: one; all where None.
        by_user: those of the user's own service manager, or of the machine's; both where None.
        json: as JSON.

    Raises:
        SystemdError: there is no systemd, or it refuses.
        UsageError: there is no such robot.
    """
    found = []
    for own in (False, True) if by_user is None else (by_user,):
        systemd = Systemd(by_user=own)
        found += [
            {**_row(file, text, systemd), "manager": "user" if own else "system"}
            for file, text in _units(unit_folder(by_user=own))
            if robot is None or file.name == unit_name(names.normalize_namespace(robot))
        ]
    if robot is not None and not found:
        raise UsageError(
            f"systemd runs no robot {robot} here; `robo service install --robot-name {robot}` changes that"
        )
    if json:
        print(document(found))
        return
    if not found:
        note("systemd runs no robot here; `robo service install` changes that")
        return
    head = ("ROBOT", "MANAGER", "UNIT", "ENABLED", "STATE", "RESTARTS", "PID", "STATUS")
    rows = [
        (
            str(one["robot"]),
            str(one["manager"]),
            f"{one['unit']}{' (changed)' if one['changed'] else ''}",
            str(one["enabled"]),
            str(one["state"]),
            str(one["restarts"]),
            str(one["pid"] or "-"),
            str(one["status"]),
        )
        for one in found
    ]
    print_table([head, *rows])


def _row(file: Path, text: str, systemd: Systemd) -> dict[str, object]:
    state = systemd.state(file.name)
    named = _ROBOT.search(text)
    active, sub, result = state.get("ActiveState", ""), state.get("SubState", ""), state.get("Result", "success")
    why = f", {result}" if result not in ("success", "") else ""
    return {
        "robot": named[1] if named is not None else "",
        "unit": file.name,
        "file": str(file),
        "changed": not stamp.is_unchanged(text),
        "enabled": state.get("UnitFileState", ""),
        "state": f"{active} ({sub}{why})",
        "since": state.get("ActiveEnterTimestamp", ""),
        "restarts": int(state.get("NRestarts") or 0),
        "pid": int(state.get("MainPID") or 0),
        "status": state.get("StatusText", ""),
    }


def _units(folder: Path) -> Iterator[tuple[Path, str]]:
    for file in sorted(folder.glob("robo-*.service")):
        text = _text_of(file)
        if text is not None and stamp.is_own(text):
            yield file, text


def _text_of(file: Path) -> str | None:
    return read_text(file) if file.exists() else None


def _check_own(unit: Path, text: str, *, force: bool) -> None:
    """Refuse to touch what somebody else has written."""
    if force or stamp.is_unchanged(text):
        return
    if not stamp.is_own(text):
        raise UsageError(
            f"{unit} is not robo's: somebody else has written it; --force takes it for robo's all the same"
        )
    raise UsageError(
        f"{unit} was changed since robo has written it; --force drops the changes. "
        f"Settings that are to stay belong into a drop-in: systemctl edit {unit.name}"
    )


def _write(text: str, file: Path, mode: int) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if not file.exists():
            file.touch(mode=mode)
            file.chmod(mode)  # whatever the mask of whoever installs it is
    except OSError as error:
        hint = "; with --system it takes root: sudo" if isinstance(error, PermissionError) else ""
        raise UsageError(f"{file} cannot be written: {error.strerror}{hint}") from None
    write_file(text, file)


def _when(*, by_user: bool) -> str:
    return "it starts with your first session" if by_user else "it starts with the machine"


def _tell_next(made: Made, systemd: Systemd, *, by_user: bool) -> None:
    unit, robot = made.service.unit, made.service.robot
    try:
        runs = systemd.state(unit).get("ActiveState") in ("active", "activating", "reloading")
    except SystemdError:
        runs = False
    print_line("next:")
    print_line(
        f"  {systemd.shown} {'restart' if runs else 'start'} {unit}{'   # it runs as it was before' if runs else ''}"
    )
    print_line(f"  robo service status --robot-name {robot}{' --user' if by_user else ' --system'}")
    if by_user:
        print_line("  loginctl enable-linger   # it starts with the machine, and goes on when you log out")
