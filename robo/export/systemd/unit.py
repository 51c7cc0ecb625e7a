"""The text of a unit that runs a robot: when it starts, what it may do, when it is started again. Pure.

What it may do is as little as a robot needs: `systemd-analyze security` takes its exposure for 2.0 at most. A user's
own service manager has no rights to give away, so a user's unit has the part of it that works without.
"""

import math
from collections.abc import Collection
from typing import Literal, NamedTuple

from robo.export.systemd import words
from robo.export.systemd.devices import Devices
from robo.launch.plan import ProcessPlan

Restart = Literal["no", "on-failure", "always"]

WATCHDOG = 10
"""A supervisor that says nothing for so long is killed, s."""
START = 60
"""How long a start may be silent, s: while it goes on, the run asks for more time by itself."""
_RESTART = 2
_TRIES, _WINDOW = 5, 300
"""So many starts within a time, s, and then it is left alone."""
_OWN_MEMORY = 512 << 20
"""What a supervisor, a router and the template of nodes may take beside them, bytes."""
_OWN_CPU = 1.0


class Service(NamedTuple):
    """What is to be run, and how."""

    robot: str
    description: str
    made_by: str
    """The command that makes the unit."""
    program: tuple[str, ...]
    """The words that run it."""
    folder: str
    """Where."""
    processes: tuple[ProcessPlan, ...]
    """What it runs."""
    needed: tuple[str, ...]
    """The files that it reads, for people."""
    stop: float
    """How long its end may take, s."""
    by_user: bool
    """Whether it is for a user's own service manager."""
    run_as: str | None
    """The user that it runs as; None for one that systemd makes up."""
    in_home: bool
    """Whether it needs something that is in somebody's home."""
    devices: Devices
    python_path: str = ""
    jit: bool = False
    """Whether nodes make machine code while they run."""
    restart: Restart | None = None
    """Whether it is started again; None as its manifest has it."""

    @property
    def unit(self) -> str:
        """What systemd calls it."""
        return unit_name(self.robot)

    @property
    def place(self) -> str:
        """Its folders below those of the system."""
        return place(self.robot)

    @property
    def restarts(self) -> Restart:
        """Whether the run as a whole is started again.

        Where no process of the manifest is, nothing begins again by itself: an arm does not, for example.
        """
        if self.restart is not None:
            return self.restart
        return "on-failure" if any(one.restart.policy != "never" for one in self.processes) else "no"


def unit_name(robot: str) -> str:
    """What the service of a robot is called."""
    return f"robo-{robot.replace('/', '-')}.service"


def place(robot: str) -> str:
    """The folder of a robot below those of the system."""
    return f"robo/{robot.replace('/', '-')}"


def environment_file(robot: str) -> str:
    """The file with a robot's variables, below systemd's folder of settings."""
    return f"{place(robot)}.env"


def unit_text(service: Service) -> str:
    """The text of a unit."""
    sections = (
        ("Unit", _unit(service)),
        ("Service", [*_run(service), *_ends(service), *_may(service)]),
        ("Install", ["WantedBy=default.target" if service.by_user else "WantedBy=multi-user.target"]),
    )
    parts = ["\n".join([f"[{name}]", *lines]) for name, lines in sections]
    return "\n".join([*_about(service), "", "\n\n".join(parts), ""])


def _about(service: Service) -> list[str]:
    who = "whoever installs it" if service.by_user else service.run_as or "a user that systemd makes up (DynamicUser)"
    groups = f", in the groups {', '.join(service.devices.groups)}" if service.devices.groups else ""
    lines = [f"Made by: {service.made_by}", f"Runs as: {who}{groups}"]
    lines += [f"Needs: {file}" for file in service.needed]
    lines += [f"Needs: {device}, at its start" for device in service.devices.alone]
    lines += [f"Reads, if it is there: {'~/.config' if service.by_user else '/etc'}/{environment_file(service.robot)}"]
    return [f"# {' '.join(line.split())}" for line in lines]


def _unit(service: Service) -> list[str]:
    after = "time-sync.target network-online.target"
    return [
        f"Description={words.path(' '.join(service.description.split()))}",
        *([] if service.by_user else ["Wants=network-online.target", f"After={after}"]),
        f"StartLimitIntervalSec={_WINDOW}",
        f"StartLimitBurst={_TRIES}",
    ]


def _run(service: Service) -> list[str]:
    where = service.place
    lines = [
        "Type=notify",
        "NotifyAccess=main",
        f"ExecStart={words.command(service.program)}",
        f"WorkingDirectory={words.path(service.folder)}",
        f"EnvironmentFile=-%E/{words.path(environment_file(service.robot))}",
        f"Environment=TMPDIR=%t/{where} PYTHONDONTWRITEBYTECODE=1",
        f"RuntimeDirectory={where}",
        "RuntimeDirectoryMode=0700",
        "UMask=0077",
    ]
    if service.python_path:
        lines.append(f"Environment={words.quoted(f'PYTHONPATH={service.python_path}')}")
    if not service.by_user:
        lines += [
            f"Environment=ROBO_LOG_DIR=%L/{where}",
            f"StateDirectory={where}",
            f"LogsDirectory={where}",
            *(
                [f"User={service.run_as}"]
                if service.run_as is not None
                else ["DynamicUser=yes", f"Environment=HOME=%S/{where}"]
            ),
        ]
        if service.devices.groups:
            lines.append(f"SupplementaryGroups={' '.join(service.devices.groups)}")
    return lines


def _ends(service: Service) -> list[str]:
    return [
        f"TimeoutStartSec={START}",
        f"WatchdogSec={WATCHDOG}",
        f"Restart={service.restarts}",
        f"RestartSec={_RESTART}",
        "RestartPreventExitStatus=2",  # words of the command line that make no sense do not get better
        "KillMode=mixed",
        f"TimeoutStopSec={math.ceil(service.stop)}",
        "Delegate=yes",
        "OOMPolicy=continue",
        "TasksMax=4096",
        *_totals(service.processes),
    ]


def _totals(processes: Collection[ProcessPlan]) -> list[str]:
    """What all of it may use, where each process has its limit."""
    each = {one.process or one.full_name: one.limits for one in processes}
    lines = []
    memory = [limits.memory for limits in each.values() if limits.memory is not None]
    if each and len(memory) == len(each):
        lines.append(f"MemoryMax={math.ceil((sum(memory) + _OWN_MEMORY) / (1 << 20))}M")
    cpu = [limits.cpu for limits in each.values() if limits.cpu is not None]
    if each and len(cpu) == len(each):
        lines.append(f"CPUQuota={math.ceil(100 * (sum(cpu) + _OWN_CPU))}%")
    return lines


def _may(service: Service) -> list[str]:
    """What it may do: nothing but what a robot needs."""
    scheduled = any(one.priority is not None or one.cpus for one in service.processes)
    least = min((one.priority for one in service.processes if one.priority is not None), default=0)
    shared = [
        "NoNewPrivileges=yes",
        "RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6",
        "RestrictNamespaces=yes",
        "RestrictRealtime=yes",
        "RestrictSUIDSGID=yes",
        "LockPersonality=yes",
        *([] if service.jit else ["MemoryDenyWriteExecute=yes"]),
        "SystemCallArchitectures=native",
        "SystemCallFilter=@system-service",
        f"SystemCallFilter=~@privileged{'' if scheduled else ' @resources'}",
        "SystemCallErrorNumber=EPERM",
    ]
    if service.by_user:
        return shared
    if service.devices.rules:
        devices = ["DevicePolicy=closed", *(f"DeviceAllow={rule}" for rule in service.devices.rules)]
    else:
        devices = ["PrivateDevices=yes"]
    return [
        "ProtectSystem=strict",
        "ProtectHome=read-only" if service.in_home else "ProtectHome=yes",
        # A user's robots and tools meet there; a user that systemd makes up has neither.
        "PrivateTmp=yes" if service.run_as is None else "ReadWritePaths=/tmp",
        "PrivateMounts=yes",
        *devices,
        "PrivateUsers=yes",
        "ProtectProc=invisible",
        "ProcSubset=pid",
        "ProtectClock=yes",
        "ProtectHostname=yes",
        "ProtectKernelLogs=yes",
        "ProtectKernelModules=yes",
        "ProtectKernelTunables=yes",
        "CapabilityBoundingSet=",
        *([f"LimitNICE={least}"] if least < 0 else []),
        *shared,
    ]
