"""Objects of Kubernetes as plain data: workloads, a service, maps of files, what may talk to whom."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from robo.errors import UnreadableFile, UsageError
from robo.export.kubernetes.variables import SETTINGS
from robo.text.files import read_bytes
from robo.wire.network import PORT

Object = dict[str, Any]

_MOST_FILES = 900_000
"""Of all files together, bytes: an object may have 1 MiB."""
_USER = 1000
"""The image's own."""


def namespace(name: str) -> Object:
    """The namespace of a robot, in which only pods run that may do nothing they need not."""
    level = {f"pod-security.kubernetes.io/{what}": "restricted" for what in ("enforce", "audit", "warn")}
    return {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name, "labels": level}}


def settings(values: Mapping[str, str]) -> Object:
    """What variables are."""
    return {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": SETTINGS}, "data": dict(values)}


def files(sources: Mapping[str, Path]) -> Object:
    """The files that containers read.

    Args:
        sources: by key, where each is now.

    Raises:
        UsageError: one cannot be read, or together they are too large.
    """
    found: Object = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "files"}}
    size = 0
    for key, path in sources.items():
        try:
            data = read_bytes(path, _MOST_FILES)
        except UnreadableFile as error:
            raise UsageError(f"{path} cannot go along: {error}; have it in the image") from None
        size += len(data)
        try:
            found.setdefault("data", {})[key] = data.decode("utf-8")
        except UnicodeDecodeError:
            found.setdefault("binaryData", {})[key] = base64.b64encode(data).decode()
    if size > _MOST_FILES:
        raise UsageError(
            f"the files that nodes read have {size:,} bytes, and at most {_MOST_FILES:,} go along: "
            "have the large ones in the image"
        )
    return found


def service(robot: str) -> Object:
    """By which others reach the router, and `kubectl port-forward` as well."""
    return {
        "apiVersion": "v1",
        "kind": "Service",
        "metadata": {"name": "router", "labels": _labels(robot, "router")},
        "spec": {
            "selector": _selector(robot, "router"),
            "ports": [{"name": "zenoh", "port": PORT, "targetPort": "zenoh"}],
        },
    }


def network_policy(dialled: Sequence[int], served: Sequence[int]) -> Object:
    """Pods of the namespace talk to each other's routers, and to nobody else but the name server.

    Args:
        dialled: ports of other networks that the router dials.
        served: ports beside the router's that may be reached from the namespace.
    """
    own: Object = {"podSelector": {}}
    ports = [{"protocol": "TCP", "port": port} for port in (PORT, *served)]
    # OpenShift's name server has a port of its own, and that of a node an address that is no pod's.
    dns = [{"protocol": protocol, "port": port} for port in (53, 5353) for protocol in ("UDP", "TCP")]
    servers: list[Object] = [{"namespaceSelector": {}}, {"ipBlock": {"cidr": "169.254.0.0/16"}}]
    egress: list[Object] = [{"to": [own], "ports": ports}, {"to": servers, "ports": dns}]
    if dialled:
        egress.append({"ports": [{"protocol": "TCP", "port": port} for port in dict.fromkeys(dialled)]})
    return {
        "apiVersion": "networking.k8s.io/v1",
        "kind": "NetworkPolicy",
        "metadata": {"name": "within-the-robot"},
        "spec": {
            "podSelector": {},
            "policyTypes": ["Ingress", "Egress"],
            "ingress": [{"from": [own], "ports": ports}],
            "egress": egress,
        },
    }


def stateful_set(name: str, robot: str, pod: Object) -> Object:
    """One pod, which is replaced only when it is gone: two of a robot never drive at once."""
    return {
        "apiVersion": "apps/v1",
        "kind": "StatefulSet",
        "metadata": {"name": name, "labels": _labels(robot, "router")},
        "spec": {
            "replicas": 1,
            "serviceName": "router",
            # Else a pod that cannot start would never be replaced by one that can (kubernetes#67250).
            "podManagementPolicy": "Parallel",
            "selector": {"matchLabels": _selector(robot, "router")},
            "template": _template(robot, "router", pod),
        },
    }


def deployment(name: str, robot: str, pod: Object) -> Object:
    """One process by itself; the old one ends before the new one begins."""
    return {
        "apiVersion": "apps/v1",
        "kind": "Deployment",
        "metadata": {"name": name, "labels": _labels(robot, name)},
        "spec": {
            "replicas": 1,
            "strategy": {"type": "Recreate"},
            "selector": {"matchLabels": _selector(robot, name)},
            "template": _template(robot, name, pod),
        },
    }


def pod(containers: Sequence[Object], volumes: Sequence[Object], grace: int, init: Sequence[Object] = ()) -> Object:
    """What a pod runs, as a user that may do nothing, with a file system that it cannot write.

    Args:
        containers: its own.
        volumes: that they mount.
        grace: how long it has to end, s.
        init: containers that start before the others, and stay.
    """
    return {
        "automountServiceAccountToken": False,
        "enableServiceLinks": False,  # else every service becomes variables
        "terminationGracePeriodSeconds": grace,
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": _USER,
            "runAsGroup": _USER,
            "fsGroup": _USER,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        **({"initContainers": list(init)} if init else {}),
        "containers": list(containers),
        "volumes": list(volumes),
    }


def checksum(objects: Sequence[Object]) -> str:
    """Of what pods read, so that they are replaced when it changes."""
    return hashlib.sha256(json.dumps(objects, sort_keys=True).encode()).hexdigest()[:16]


def _selector(robot: str, component: str) -> dict[str, str]:
    return {"app.kubernetes.io/instance": robot, "app.kubernetes.io/component": component}


def _labels(robot: str, component: str) -> dict[str, str]:
    own = {"app.kubernetes.io/name": "robo", "app.kubernetes.io/part-of": robot, "app.kubernetes.io/managed-by": "robo"}
    return own | _selector(robot, component)


def _template(robot: str, component: str, pod: Object) -> Object:
    return {"metadata": {"labels": _labels(robot, component)}, "spec": pod}
