"""What a robot's nodes say to the outside, by their contracts: the least that its machine has to be allowed."""

from robo.launch.check import ends_of
from robo.launch.plan import ProcessPlan
from robo.launch.resolve import Resolution
from robo.wire import names
from robo.wire.keys import SNAPSHOTS_TOPIC, SYSTEM_TOPICS


def rights_of(resolution: Resolution) -> tuple[dict[str, tuple[str, ...]], list[str]]:
    """The keys that a manifest's nodes publish, subscribe and serve.

    Returns:
        The keys by `publish`, `subscribe` and `serve`; and the full names of those processes that do not say what they
        do, as commands without `publishes`: what they need has to be allowed by hand.
    """
    publish: set[str] = set()
    subscribe: set[str] = set()
    serve: set[str] = set()
    silent = []
    for end in ends_of(resolution):
        (publish if end.kind == "pub" else subscribe).add(end.key)
    for process in resolution.plan.processes:
        contract = resolution.contracts.get(process.full_name)
        if contract is None:
            if process.service is not None or not (process.publishes or process.subscribes):
                silent.append(process.full_name)
            continue
        publish |= {names.join(process.namespace, topic) for topic in (*SYSTEM_TOPICS, SNAPSHOTS_TOPIC)}
        serve |= {_key(process, end.service) for end in contract.services}
        serve.add(_key(process, "~/parameters/**"))
        for action in contract.actions:
            part = names.join(_key(process, action.action), "_action/**")
            serve.add(part)
            publish.add(part)
        if contract.managed:
            serve.add(_key(process, "~/**"))
    return {
        "publish": tuple(sorted(publish)), "subscribe": tuple(sorted(subscribe)), "serve": tuple(sorted(serve)),
    }, silent  # fmt: skip


def _key(process: ProcessPlan, name: str) -> str:
    wild = name.endswith("/**")
    plain = name.removesuffix("/**")
    key = names.resolve(plain, namespace=process.namespace, node=process.name, remappings=process.remap)
    return f"{key}/**" if wild else key
