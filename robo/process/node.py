"""`python -m robo.process.node SERVICE …`: the process of a node, by the name of its service.

A supervisor puts the finished spec into the environment, and into the arguments only what helps
whoever reads the process list. Otherwise the arguments are those of the node's command line.
"""

import faulthandler
import os
import signal
import sys

from robo.process import lean
from robo.text.readable import readable


def main() -> None:
    """Run the node, and exit with its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # until the node handles it: no traceback of half a start
    faulthandler.enable()  # a supervisor that ends a node that hangs asks it first where it is
    lean.import_msgspec()
    import msgspec

    from robo.environment import SPEC_VARIABLE
    from robo.errors import RoboError
    from robo.node.loading import load_node_class
    from robo.process.runner import report, run, run_spec
    from robo.process.spec import NodeSpec

    service, *arguments = sys.argv[1:]
    given = os.environ.get(SPEC_VARIABLE)
    try:
        node_class = load_node_class(service)
        spec = msgspec.json.decode(given, type=readable(NodeSpec)) if given else NodeSpec()
        if spec.service != service:  # run by hand, or by a command of a launch
            run(node_class, arguments)
        del os.environ[SPEC_VARIABLE]  # not for what the node starts
        code = run_spec(node_class, spec)
    except RoboError as error:
        code = report(error)
    sys.exit(code)


if __name__ == "__main__":
    main()
