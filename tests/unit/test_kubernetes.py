"""What a manifest becomes in Kubernetes."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from robo.cli.launch.export import export_kubernetes
from robo.errors import UsageError
from robo.export.kubernetes import containers
from robo.export.kubernetes import folder as kubernetes
from robo.export.kubernetes.folder import Exported, Wishes
from robo.export.kubernetes.variables import Variables
from robo.export.placeholders import Placeholders
from robo.export.profiles import profiles_of
from robo.launch.plan import LimitsPlan
from tests.pod_security import complaints

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "launch" / "robot.yaml"
POD = Wishes("robo:1.2")
SECURED = Wishes("robo:1.2", connect=("tls/site.example:7447",), security="r1-keys")
DEPLOYMENTS = Wishes("robo:1.2", "deployments", ("tcp/10.0.0.7:7448",))
NAME = re.compile(r"[a-z0-9]([-a-z0-9]{0,61}[a-z0-9])?")


def exported(file: Path, wishes: Wishes = POD, robot: str | None = None, **given: object) -> Exported:
    return kubernetes.export(profiles_of(file, given, robot), wishes, folder=Path.cwd(), made_by="a test")


def objects_of(found: Exported) -> Iterator[dict[str, Any]]:
    for text in found.objects:
        yield from yaml.safe_load_all(text)


def pods_of(found: Exported) -> dict[str, dict[str, Any]]:
    """The specs of pods, by the name of what makes them."""
    return {
        one["metadata"]["name"]: one["spec"]["template"]["spec"]
        for one in objects_of(found)
        if "replicas" in one.get("spec", {})
    }


def containers_of(found: Exported) -> dict[str, dict[str, Any]]:
    return {
        container["name"]: container
        for pod in pods_of(found).values()
        for container in (*pod.get("initContainers", []), *pod["containers"])
    }


def environment_of(container: dict[str, Any]) -> dict[str, Any]:
    return {one["name"]: one.get("value") for one in container["env"]}


def of_nodes(*nodes: str) -> Path:
    """A manifest with nodes, each a line, in the robot's namespace."""
    file = Path("mine.yaml")
    lines = "".join(f"      {node}\n" for node in nodes)
    file.write_text(f"groups:\n  all:\n    namespace: ${{robot_name}}\n    nodes:\n{lines}")
    return file


@pytest.fixture
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


FORMS = pytest.mark.parametrize("wishes", [POD, SECURED, DEPLOYMENTS], ids=["pod", "secured", "deployments"])


@FORMS
def test_pods_are_admitted_where_only_those_are_that_may_do_nothing(wishes: Wishes) -> None:
    found = exported(ROBOT, wishes, dashboard=True)
    pods = pods_of(found)
    assert len(pods) == (8 if wishes is DEPLOYMENTS else 1)
    assert [complaints(pod) for pod in pods.values()] == [[]] * len(pods)
    (namespace,) = (one for one in objects_of(found) if one["kind"] == "Namespace")
    assert namespace["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"
    assert {one["metadata"].get("namespace") for one in objects_of(found)} == {None, namespace["metadata"]["name"]}


def test_with_security_others_come_by_tls_and_keys_are_a_secrets() -> None:
    found = exported(ROBOT, SECURED, robot="r1")
    (pod,) = pods_of(found).values()
    keys, router = pod["initContainers"]
    assert (keys["name"], router["name"], router["restartPolicy"]) == ("keys", "router", "Always")
    assert "restartPolicy" not in keys, "the router waits until they are there"
    words = " ".join(router["args"])
    assert "--listen unixsock-stream/run/robo/router.sock" in words.replace("//", "/")
    assert "--listen tls/0.0.0.0:7447 --connect tls/site.example:7447" in words
    assert "tcp/" not in words
    where = environment_of(router)["ROBO_SECURITY"]
    assert where.startswith(next(m["mountPath"] for m in router["volumeMounts"] if m["name"] == "keys"))
    with_keys = [one["name"] for one in containers_of(found).values() if "keys" in str(one.get("volumeMounts"))]
    assert with_keys == ["keys", "router"], "nodes have no keys"
    volumes = {one["name"]: one for one in pod["volumes"]}
    assert volumes["secret"]["secret"]["secretName"] == "r1-keys"
    assert volumes["keys"]["emptyDir"]["medium"] == "Memory"
    assert "PRIVATE" not in "".join(found.files.values())


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"form": "deployments"}, "--security goes with one pod"),
        ({"connect": ("tcp/10.0.0.7:7448",)}, "tcp/10.0.0.7:7448 is in the clear"),
        ({"security": "R1 keys"}, "say the name of a Secret"),
    ],
)
def test_what_would_be_in_the_clear_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        exported(ROBOT, SECURED._replace(**changes), robot="r1")


def test_a_pod_that_may_do_more_is_complained_of() -> None:
    """The rules themselves: each is broken once."""
    pod = next(iter(pods_of(exported(ROBOT)).values()))
    broken: list[tuple[str, Any]] = [
        ("hostNetwork", lambda p: p.update(hostNetwork=True)),
        ("volume", lambda p: p["volumes"].append({"name": "disk", "hostPath": {"path": "/"}})),
        ("Escalation", lambda p: p["containers"][0]["securityContext"].pop("allowPrivilegeEscalation")),
        ("capabilities", lambda p: p["initContainers"][0]["securityContext"]["capabilities"].update(add=["NET_ADMIN"])),
        ("runAsNonRoot", lambda p: p["securityContext"].pop("runAsNonRoot")),
        ("runAsUser=0", lambda p: p["containers"][1]["securityContext"].update(runAsUser=0)),
        ("seccompProfile", lambda p: p["securityContext"].pop("seccompProfile")),
        ("hostPort", lambda p: p["initContainers"][0]["ports"][0].update(hostPort=7447)),
    ]
    for word, change in broken:
        copy = json.loads(json.dumps(pod))
        change(copy)
        assert any(word in one for one in complaints(copy)), word


@FORMS
def test_all_that_is_referred_to_is_there(wishes: Wishes) -> None:
    found = exported(ROBOT, wishes, dashboard=True)
    maps = {one["metadata"]["name"]: one["data"] for one in objects_of(found) if one["kind"] == "ConfigMap"}
    names = set()
    for one in objects_of(found):
        name = one["metadata"]["name"]
        assert NAME.fullmatch(name)
        assert (one["kind"], name) not in names
        names.add((one["kind"], name))
        if "template" in (spec := one.get("spec", {})):
            labels = spec["template"]["metadata"]["labels"]
            assert spec["selector"]["matchLabels"].items() <= labels.items()
    for pod in pods_of(found).values():
        volumes = {volume["name"]: volume for volume in pod["volumes"]}
        for container in (*pod.get("initContainers", []), *pod["containers"]):
            assert NAME.fullmatch(container["name"])
            assert {mount["name"] for mount in container["volumeMounts"]} <= volumes.keys()
            for variable in container["env"]:
                if "valueFrom" in variable:
                    reference = variable["valueFrom"]["configMapKeyRef"]
                    assert reference["key"] in maps[reference["name"]]
        for volume in volumes.values():
            for item in volume.get("configMap", {}).get("items", []):
                assert item["key"] in maps["files"]


def test_nodes_of_a_pod_meet_by_sockets_and_start_after_the_router() -> None:
    (pod,) = pods_of(exported(ROBOT)).values()
    (router,) = pod["initContainers"]
    assert router["restartPolicy"] == "Always"
    assert "unixsock-stream//run/robo/router.sock" in router["args"]
    assert router["startupProbe"]["exec"]["command"] == ["robo", "health"]
    assert {port["containerPort"] for port in router["ports"]} == {7447}
    volumes = {volume["name"]: volume.get("emptyDir") for volume in pod["volumes"]}
    assert volumes["run"]["medium"] == volumes["shared-memory"]["medium"] == "Memory"
    for container in pod["containers"]:
        environment = environment_of(container)
        assert environment["ROBO_CONNECT"] == "unixsock-stream//run/robo/router.sock"
        assert environment["ROBO_LISTEN"] == f"unixsock-stream//run/robo/{container['name']}.sock"
        assert (environment["ROBO_MODE"], environment["ROBO_SHM"]) == ("peer", "on")


def test_processes_by_themselves_reach_the_router_by_its_service() -> None:
    found = exported(ROBOT, DEPLOYMENTS)
    containers = containers_of(found)
    assert containers["router"]["args"][-2:] == ["--connect", "tcp/10.0.0.7:7448"]
    for name, container in containers.items():
        if name != "router":
            assert environment_of(container)["ROBO_CONNECT"] == "tcp/router:7447"
            assert environment_of(container)["ROBO_MODE"] == "client"
    (policy,) = (one for one in objects_of(found) if one["kind"] == "NetworkPolicy")
    ports = [{port["port"] for port in rule["ports"]} for rule in policy["spec"]["egress"]]
    assert ports == [{7447}, {53, 5353}, {7448}]
    kinds = {one["spec"]["strategy"]["type"] for one in objects_of(found) if one["kind"] == "Deployment"}
    assert kinds == {"Recreate"}, "two of a process never run at once"


def test_an_overlay_makes_a_robot_of_its_own() -> None:
    found = exported(ROBOT)
    overlay = yaml.safe_load(found.files["overlays/example/kustomization.yaml"])
    base = yaml.safe_load(found.files["base/kustomization.yaml"])
    assert {f"base/{path}" for path in base["resources"]} == found.files.keys() - {
        "base/kustomization.yaml",
        "overlays/example/kustomization.yaml",
    }
    assert overlay["images"] == [{"name": "robo", "newTag": "1.2"}]
    ((patch,),) = (yaml.safe_load(one["patch"]) for one in overlay["patches"])
    (settings,) = (one for one in objects_of(found) if one["metadata"]["name"] == "settings")
    assert patch["path"] == "/data/ROBOT_NAME"
    assert settings["data"]["ROBOT_NAME"] == "my_robot"


def test_a_name_that_is_said_is_no_variable() -> None:
    found = exported(ROBOT, robot="r1")
    assert "ROBOT_NAME" not in "".join(found.files.values())
    assert "r1" in pods_of(found)
    assert "patches" not in yaml.safe_load(found.files["overlays/example/kustomization.yaml"])


@pytest.mark.usefixtures("_in_a_folder")
def test_variables_of_the_manifest_are_settings_or_secrets() -> None:
    manifest = of_nodes(
        'web: {run: [sleep, "${env:PORT:-a}"], env: {TOKEN: "${env:TOKEN}", HOME_OF: "${env:WHERE}$x"}}',
    )
    found = exported(manifest, POD._replace(secrets=frozenset({"TOKEN"})))
    container = containers_of(found)["web"]
    by_name = {one["name"]: one for one in container["env"]}
    assert container["args"] == ["sleep", "$(PORT)"]
    assert by_name["HOME_OF"]["value"] == "$(WHERE)$$x"
    assert [one["name"] for one in container["env"]].index("WHERE") < list(by_name).index("HOME_OF")
    (settings,) = (one for one in objects_of(found) if one["metadata"]["name"] == "settings")
    assert settings["data"] == {"PORT": "a", "ROBOT_NAME": "my_robot"}
    assert found.unknown == ["WHERE"]
    assert found.secret == ["TOKEN"]
    assert by_name["TOKEN"]["valueFrom"] == {"secretKeyRef": {"name": "settings", "key": "TOKEN"}}
    assert len(by_name) == len(container["env"]), "no name stands twice: some appliers refuse that, others lose both"


@pytest.mark.usefixtures("_in_a_folder")
def test_a_secret_stands_nowhere() -> None:
    manifest = of_nodes('web: {run: [serve, "${env:PIN:-1234}"]}')
    profiles = profiles_of(manifest, {}, None, ["PIN"])
    found = kubernetes.export(profiles, POD._replace(secrets=frozenset({"PIN"})), folder=Path.cwd(), made_by="a test")
    assert "1234" not in "".join(found.files.values())
    assert containers_of(found)["web"]["args"] == ["serve", "$(PIN)"]
    with pytest.raises(UsageError, match=r"PIM.*asks for .*PIN"):
        kubernetes.export(profiles, POD._replace(secrets=frozenset({"PIM"})), folder=Path.cwd(), made_by="a test")


@pytest.mark.usefixtures("_in_a_folder")
def test_one_name_for_two_things_is_refused() -> None:
    with pytest.raises(UsageError, match="MODE"):
        exported(of_nodes('web: {run: [serve, "${env:MODE:-a}"], env: {MODE: b}}'))


@pytest.mark.usefixtures("_in_a_folder")
def test_words_that_others_read_otherwise_are_quoted() -> None:
    words = ["y", "N", "1e3", "0x1F", "+.5e1", "1_000", "1.", "on", "null", "~", "0o17", "12:30:45"]
    found = exported(of_nodes(f"web: {{run: {json.dumps(['serve', *words])}}}"), Wishes("robo:1234e56"))
    texts = "".join(found.files.values())
    assert containers_of(found)["web"]["args"] == ["serve", *words]
    for word in (*words, "1234e56"):
        assert re.search(rf"""(- |: )['"]{re.escape(word)}['"]\n""", texts), word


@pytest.mark.parametrize(
    ("image", "said"),
    [
        ("robo", {"name": "robo", "newTag": "latest"}),
        ("host:5000/robo", {"name": "host:5000/robo", "newTag": "latest"}),
        ("host:5000/robo:1.2", {"name": "host:5000/robo", "newTag": "1.2"}),
        ("robo@sha256:aaaa", {"name": "robo", "digest": "sha256:aaaa"}),
    ],
)
def test_an_overlay_says_which_image(image: str, said: dict[str, str]) -> None:
    found = exported(ROBOT, Wishes(image))
    assert yaml.safe_load(found.files["overlays/example/kustomization.yaml"])["images"] == [said]


@pytest.mark.usefixtures("_in_a_folder")
def test_what_tells_of_the_start_kills_no_node_later() -> None:
    manifest = of_nodes(
        "base: {service: robo_services.diff_drive_sim, ready: {probe: [test, -e, /tmp/there], port: 8080}}",
        "web: {run: [serve], ready: {port: 8080}}",
    )
    containers = containers_of(exported(manifest))
    assert "test -e /tmp/there" in containers["base"]["startupProbe"]["exec"]["command"][-1]
    assert "robo health" in containers["base"]["livenessProbe"]["exec"]["command"][-1]
    assert "8080" not in str(containers["base"]["livenessProbe"])
    assert "livenessProbe" not in containers["web"]


@pytest.mark.parametrize("robot", ["settings", "namespace", "kustomization"])
def test_a_robot_may_be_called_as_a_file(robot: str) -> None:
    kinds = [one["kind"] for one in objects_of(exported(ROBOT, robot=robot))]
    assert sorted(kinds) == ["ConfigMap", "ConfigMap", "Namespace", "NetworkPolicy", "Service", "StatefulSet"]


@pytest.mark.usefixtures("_in_a_folder")
def test_no_two_containers_are_called_alike() -> None:
    names = ("a", "A", "a_2", "a_2_2", "x" * 90, "x" * 91)
    found = containers_of(exported(of_nodes(*(f"{name}: {{run: [serve]}}" for name in names))))
    assert len(found) == len(names) + 1
    assert all(NAME.fullmatch(name) and len(name) <= 52 for name in found)


@pytest.mark.usefixtures("_in_a_folder")
def test_nothing_is_filled_in_where_a_command_runs() -> None:
    web = containers_of(exported(of_nodes("web: {run: [serve], cwd: /opt/b$c}")))["web"]
    assert web["workingDir"] == "/opt/b$c"
    with pytest.raises(UsageError, match="cwd"):
        exported(of_nodes('web: {run: [serve], cwd: "/opt/${env:X:-x}"}'))


def test_a_probe_has_a_shell_fill_in_what_kubernetes_does_not() -> None:
    names = Placeholders()
    variables = Variables(names, frozenset())
    word = names.word("WHO", "it's")
    assert variables.probe([["robo", "health"]]) == ["robo", "health"]
    assert variables.probe([[variables.shown("cost: 5$ (five)")]]) == ["cost: 5$ (five)"]
    words = [sys.executable, "-c", "import sys; print(sys.argv[1:])", variables.shown(f"/{word}/a b$(c)'")]
    command = variables.probe([["test", "-n", variables.shown(word)], words])
    done = subprocess.run(command, capture_output=True, text=True, env={"WHO": "it's; me"}, check=True, timeout=30)
    assert done.stdout.strip() == repr(["/it's; me/a b$(c)'"])


@pytest.mark.usefixtures("_in_a_folder")
def test_files_come_along_and_what_is_too_large_is_told() -> None:
    Path("gains.yaml").write_text("/**:\n  ros__parameters: {wheel_base: 0.3}\n")
    manifest = of_nodes("base: {service: robo_services.diff_drive_sim, params: gains.yaml}")
    found = exported(manifest)
    (files,) = (one for one in objects_of(found) if one["metadata"]["name"] == "files")
    (key,) = files["data"]
    assert files["data"][key] == Path("gains.yaml").read_text()
    (pod,) = pods_of(found).values()
    (volume,) = (one for one in pod["volumes"] if "configMap" in one)
    assert volume["configMap"]["items"] == [{"key": key, "path": "gains.yaml"}]
    assert "/etc/robo/gains.yaml" in containers_of(found)["base"]["args"]
    before = re.findall("robo/settings: (.*)", "".join(found.objects))
    Path("gains.yaml").write_text("/**:\n  ros__parameters: {wheel_base: 0.4}\n")
    after = re.findall("robo/settings: (.*)", "".join(exported(manifest).objects))
    assert before != after, "pods are replaced when what they read has changed"
    Path("map.bin").write_bytes(bytes(950_000))
    with pytest.raises(UsageError, match=r"map\.bin cannot go along.*at most"):
        exported(of_nodes("show: {run: [cat, map.bin]}"))


@pytest.mark.usefixtures("_in_a_folder")
def test_what_has_no_word_is_told() -> None:
    manifest = of_nodes(
        "a: {service: robo_services.diff_drive_sim, restart: never, required: true, stop: TERM, ready: {log: up}, "
        "priority: 5}",
        "b: {service: robo_services.position_tracker, needs: {a: ready}}",
    )
    assert exported(manifest).left_out == [
        "a: restart: never, required, stop: TERM, ready: log, priority",
        "b: restart: never, needs: a ready",
    ]


@pytest.mark.parametrize(
    ("limits", "resources"),
    [
        (LimitsPlan(), {"requests": {"cpu": "50m", "memory": "64Mi"}, "limits": {"memory": "256Mi"}}),
        (
            LimitsPlan(memory=1 << 30, cpu=0.5),
            {"requests": {"cpu": "50m", "memory": "64Mi"}, "limits": {"memory": "1024Mi", "cpu": "500m"}},
        ),
        (
            LimitsPlan(memory=(1 << 20) + 1, cpu=0.0625),
            {"requests": {"cpu": "50m", "memory": "1048577"}, "limits": {"memory": "1048577", "cpu": "62m"}},
        ),
    ],
)
def test_limits_are_those_of_the_container(limits: LimitsPlan, resources: object) -> None:
    assert containers.resources(limits) == resources


def test_several_robots_are_exported_one_by_one() -> None:
    with pytest.raises(UsageError, match="2 robots"):
        exported(ROOT / "launch" / "docker.yaml", second_robot=True)


def test_it_is_written_as_a_folder_and_the_same_each_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export_kubernetes([str(ROBOT)], POD, robot=None, output=tmp_path / "k8s")
    written = {str(path.relative_to(tmp_path / "k8s")): path.read_text() for path in (tmp_path / "k8s").rglob("*.yaml")}
    assert set(written) >= {"base/kustomization.yaml", "base/workload.yaml", "overlays/example/kustomization.yaml"}
    assert "kubectl apply -k" in capsys.readouterr().err
    export_kubernetes([str(ROBOT)], POD, robot=None, output=tmp_path / "k8s")
    assert {path: (tmp_path / "k8s" / path).read_text() for path in written} == written
    export_kubernetes([str(ROBOT)], POD, robot=None, output=None)
    printed = list(yaml.safe_load_all(capsys.readouterr().out))
    assert {one["kind"] for one in printed} == {"Namespace", "ConfigMap", "NetworkPolicy", "Service", "StatefulSet"}


@pytest.mark.parametrize("version", ["1.29", "1.33", "1.37"])
@FORMS
def test_schemas_of_kubernetes_know_every_field(wishes: Wishes, version: str) -> None:
    validate = pytest.importorskip("kubernetes_validate", reason="pip install kubernetes-validate: schemas, 108 MB")
    for one in objects_of(exported(ROBOT, wishes, dashboard=True)):
        validate.validate(one, version, strict=True)


def test_kustomize_builds_the_overlay(tmp_path: Path) -> None:
    kubectl = shutil.which("kubectl")
    if kubectl is None:
        pytest.skip("kubectl is not installed")
    for path, text in exported(ROBOT).files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    command = [kubectl, "kustomize", str(tmp_path / "overlays" / "example")]
    built = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    objects = {one["kind"] + " " + one["metadata"]["name"]: one for one in yaml.safe_load_all(built)}
    assert objects["ConfigMap settings"]["data"]["ROBOT_NAME"] == "example"
    assert "Namespace robot-example" in objects
    assert {one["metadata"].get("namespace") for one in objects.values()} == {None, "robot-example"}
