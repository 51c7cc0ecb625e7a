"""`robo security`: who may do what on a network."""

from pathlib import Path
from typing import Annotated

import typer

from robo.cli import completion
from robo.cli.options import Connect, Json
from robo.cli.tree import group
from robo.cli.verb import verb
from robo.security.certificates import DAYS
from robo.security.rights import Right, Role

verbs = group()

Folder = Annotated[
    Path,
    typer.Option("--keystore", metavar="DIR", help="The keystore."),
]
CaKey = Annotated[
    Path | None,
    typer.Option("--ca-key", metavar="FILE", help="The CA's key, where it is kept elsewhere.", show_default=False),
]
Days = Annotated[float, typer.Option("--days", metavar="N", help="For how long it is valid.", min=0.0)]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="NAME", help="A name or an address by which it is dialled.", show_default=False),
]
Name = Annotated[str, typer.Argument(metavar="NAME", help="A machine or a person.", show_default=False)]
Whom = Annotated[str, typer.Argument(metavar="ROLE|NAME", help="Whom it is about.", show_default=False)]
KEYSTORE = Path("security")


@verb(verbs, "init", "robo security init", "robo security init --keystore site/security --name site_ca")
def init(
    folder: Folder = KEYSTORE,
    ca_key: CaKey = None,
    name: Annotated[str, typer.Option("--name", metavar="NAME", help="What the CA is called.")] = "robo",
) -> None:
    """Make a keystore: a CA of its own, a policy and nothing else.

    The CA's key signs all certificates: keep private/ on one machine that is no robot, or elsewhere (--ca-key).
    """
    from robo.cli.views.security import make

    make(folder, ca_key, name)


@verb(
    verbs,
    "add",
    "robo security add r3 --as robot",
    "robo security add site2 --as router --host site2.example --host 10.0.0.1",
    "robo security add bob --as operator --days 7",
)
def add(
    name: Name,
    role: Annotated[Role, typer.Option("--as", metavar="ROLE", help="robot, router, operator or viewer.")],
    folder: Folder = KEYSTORE,
    ca_key: CaKey = None,
    days: Days = DAYS,
    hosts: Hosts = None,
) -> None:
    """Give a machine or a person a key and a certificate, and a place in the policy."""
    from robo.cli.views.security import add as add_name

    add_name(folder, ca_key, name, role, hosts or (), days)


@verb(verbs, "list", "robo security list", "robo security list --json | jq '.[] | select(.days_left < 7)'")
def list_names(folder: Folder = KEYSTORE, json: Json = False) -> int:
    """List the names of a keystore: their roles, how long they are valid, and what is wrong with them.

    Exit code: 0 all is well, 1 something is not, as a certificate with less than 7 days left.
    """
    from robo.cli.views.security import print_names

    return print_names(folder, json=json)


@verb(verbs, "renew", "robo security renew r1", "robo security renew", "robo security renew site --host site.example")
def renew(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME...]", help="By default those with less than half of it left.", show_default=False
        ),
    ] = None,
    folder: Folder = KEYSTORE,
    ca_key: CaKey = None,
    days: Days = DAYS,
    hosts: Hosts = None,
) -> None:
    """Make certificates anew, for the keys that there are, and the rules of all routers from the policy.

    A router that runs takes them over within a second: whoever is linked to it is back after some hundredths of one.
    """
    from robo.cli.views.security import renew as renew_names

    renew_names(folder, ca_key, names or (), hosts or (), days)


@verb(verbs, "revoke", "robo security revoke eve")
def revoke(name: Name, folder: Folder = KEYSTORE) -> None:
    """Take a name out of the policy: routers let it do nothing any more, however long its certificate is valid.

    A router that uses this keystore obeys within a second; another one once it has its new rules (`bundle`).
    """
    from robo.cli.views.security import revoke as revoke_name

    revoke_name(folder, name)


@verb(
    verbs,
    "allow",
    "robo security allow viewer call '*/map_server/save'",
    "robo security allow r1 publish fleet/positions",
    "robo security allow r1 --from robot.yaml",
)
def allow(
    whom: Whom,
    right: Annotated[
        Right | None,
        typer.Argument(metavar="[RIGHT]", help="publish, subscribe, call, serve, list or command.", show_default=False),
    ] = None,
    key: Annotated[
        str | None,
        typer.Argument(metavar="[KEY]", help="Topics or services; robots for list and command.", show_default=False),
    ] = None,
    folder: Folder = KEYSTORE,
    manifest: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="MANIFEST",
            help="Of a robot: only what the contracts of this manifest's nodes say.",
            show_default=False,
            autocompletion=completion.manifests,
        ),
    ] = None,
) -> None:
    """Allow a role or a name something more.

    With --from a robot's machine may publish, subscribe and serve to the outside just what its nodes declare, in place
    of all below its name. Nodes that are added later need it again.
    """
    from robo.cli.views import security

    if manifest is not None:
        security.narrow(folder, whom, manifest, right)
    else:
        security.change(folder, whom, right, key, allow=True)


@verb(
    verbs, "deny", "robo security deny viewer subscribe '*/camera/**'", "robo security deny r1 publish fleet/positions"
)
def deny(
    whom: Whom,
    right: Annotated[Right, typer.Argument(metavar="RIGHT", help="As for allow.", show_default=False)],
    key: Annotated[str, typer.Argument(metavar="KEY", help="As for allow.", show_default=False)],
    folder: Folder = KEYSTORE,
) -> None:
    """Deny a role or a name something, or take back what was allowed in the same words."""
    from robo.cli.views.security import change

    change(folder, whom, right, key, allow=False)


@verb(
    verbs,
    "explain",
    "robo security explain r1 publish r1/odom",
    "robo security explain eve publish r1/cmd_vel || echo refused",
    "robo security explain ann command r1 --json",
)
def explain(
    name: Name,
    right: Annotated[Right, typer.Argument(metavar="RIGHT", help="As for allow.", show_default=False)],
    key: Annotated[str, typer.Argument(metavar="KEY", help="As for allow.", show_default=False)],
    folder: Folder = KEYSTORE,
    json: Json = False,
) -> int:
    """Tell whether a name may do something, and by which line of the policy; no router is asked.

    Exit code: 0 it may, 1 it may not.
    """
    from robo.cli.views.security import print_verdict

    return print_verdict(folder, name, right, key, json=json)


@verb(
    verbs,
    "check",
    "robo security check",
    "robo security check --json",
    short_help="Check keys, certificates, policy and rules.",
)
def check(
    folder: Annotated[
        Path,
        typer.Option("--keystore", metavar="DIR", help="The keystore, or the folder of one name."),
    ] = KEYSTORE,
    connect: Connect = None,
    json: Json = False,
) -> int:
    """Check files, modes, dates, names and pairs, whether rules are those of the policy, and with --connect a link.

    Exit code: 0 all is well, 1 something has to be mended.
    """
    from robo.cli.views.security import examine

    return examine(folder, connect or (), json=json)


@verb(verbs, "bundle", "robo security bundle r1 -o r1.tar", "robo security bundle r1 -o - | tar -t")
def bundle(
    name: Name,
    out: Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Where to; - for stdout.")],
    folder: Folder = KEYSTORE,
) -> None:
    """Pack what goes to one machine: its key, its certificate, the CA's certificate, its rules. No key of others.

    `tar -xf FILE` there makes a folder NAME, which --security or ROBO_SECURITY names. Carry it as you would a key.
    """
    from robo.cli.views.security import pack

    pack(folder, name, out)
