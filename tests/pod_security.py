"""What the level `restricted` of Kubernetes' Pod Security demands of a pod, in the words of its admission."""

from collections.abc import Iterator
from typing import Any

VOLUMES = {
    "configMap", "csi", "downwardAPI", "emptyDir", "ephemeral", "image", "persistentVolumeClaim", "projected", "secret",
}  # fmt: skip


def complaints(pod: dict[str, Any]) -> list[str]:
    """What is wrong with the spec of a pod; nothing where it is admitted."""
    return list(_complaints(pod))


def _complaints(pod: dict[str, Any]) -> Iterator[str]:
    own = pod.get("securityContext", {})
    for what in ("hostNetwork", "hostPID", "hostIPC"):
        if pod.get(what):
            yield f"host namespaces ({what}=true)"
    for volume in pod.get("volumes", []):
        if not VOLUMES & volume.keys():
            yield f"restricted volume types ({volume['name']})"
    if own.get("sysctls"):
        yield "forbidden sysctls"
    for container in (*pod.get("initContainers", []), *pod["containers"]):
        name, context = container["name"], container.get("securityContext", {})
        if context.get("allowPrivilegeEscalation") is not False:
            yield f"allowPrivilegeEscalation != false ({name})"
        capabilities = context.get("capabilities", {})
        if "ALL" not in capabilities.get("drop", []) or set(capabilities.get("add", [])) - {"NET_BIND_SERVICE"}:
            yield f"unrestricted capabilities ({name})"
        if not context.get("runAsNonRoot", own.get("runAsNonRoot")):
            yield f"runAsNonRoot != true ({name})"
        if context.get("runAsUser", own.get("runAsUser")) == 0:
            yield f"runAsUser=0 ({name})"
        profile = context.get("seccompProfile", own.get("seccompProfile", {})).get("type")
        if profile not in ("RuntimeDefault", "Localhost"):
            yield f"seccompProfile ({name})"
        if context.get("privileged"):
            yield f"privileged ({name})"
        if any("hostPort" in port for port in container.get("ports", [])):
            yield f"hostPort ({name})"
        for kind in ("startupProbe", "livenessProbe", "readinessProbe"):
            for how in ("httpGet", "tcpSocket"):
                if "host" in container.get(kind, {}).get(how, {}):
                    yield f"probe host ({name})"
