"""Every ROBO_ variable: what it says, who sets it, who reads it."""

# -- set by people, and by what starts containers ----------------------------------------------------------------------

CONNECT_VARIABLE = "ROBO_CONNECT"
"""Zenoh endpoints to dial, joined by commas. Also set by the supervisor for what it starts; read by all that joins."""

LISTEN_VARIABLE = "ROBO_LISTEN"
"""Zenoh endpoints to listen on, joined by commas. Read by all that joins the network; tools listen nowhere."""

MEETING_VARIABLE = "ROBO_MEETING"
"""The folder in which what one user runs on a machine meets, of mode 0700; by default `/tmp/robo-UID`. Read by all that
joins the network without being told an endpoint."""
SECURITY_VARIABLE = "ROBO_SECURITY"
"""The folder of a name's key and certificate: all that leaves the machine goes by TLS. Read by all that joins the
network; the nodes of a robot, which do not leave it, do not get it."""

MODE_VARIABLE = "ROBO_MODE"
"""How a node that nobody has launched joins the network: router, peer or client. Also set in exported Compose files."""

NAMESPACE_VARIABLE = "ROBO_NAMESPACE"
"""The namespace of a node's names where nothing else says one. Also set by the supervisor for what it starts."""

SHARED_MEMORY_VARIABLE = "ROBO_SHM"
"""`off`: large messages travel over sockets, between nodes of one machine too. Read by all that joins the network."""

LOG_LEVEL_VARIABLE = "ROBO_LOG_LEVEL"
"""What nodes print at least. Also set by the supervisor; read by nodes."""

LOG_FOLDER_VARIABLE = "ROBO_LOG_DIR"
"""Where all runs are kept. Read by the supervisor and by `robo logs`."""

LOG_LIMIT_VARIABLE = "ROBO_LOG_LIMIT"
"""How many megabytes all log files of a user may take. Read by the supervisor."""

LOG_RUN_LIMIT_VARIABLE = "ROBO_LOG_RUN_LIMIT"
"""How many megabytes the log files of one run may take. Read by the supervisor."""

MESSAGES_VARIABLE = "ROBO_MESSAGES"
"""Modules that define message types, joined by commas. Read by tools."""

MEMORY_VARIABLE = "ROBO_MEMORY"
"""The folder for what nodes keep, where no launch says one: in containers. Read by nodes."""

IMAGE_VARIABLE = "ROBO_IMAGE"
"""What containers are made of. Read by Compose, in an exported file."""

PORT_VARIABLE = "ROBO_PORT"
"""Where an exported robot is reached on its host. Read by Compose, in an exported file."""

# -- set by robo for its own processes ---------------------------------------------------------------------------------

SPEC_VARIABLE = "ROBO_NODE"
"""A node's `NodeSpec` as JSON. Set by the supervisor and in an exported Compose file; read by the node's process."""

RUN_VARIABLE = "ROBO_RUN"
"""Every process of a launch carries its run's id in its environment, which children inherit. Set by the supervisor;
read by whoever looks for what a run has left behind."""

OWNER_VARIABLE = "ROBO_OWNER"
"""The full name of the process of a launch that this one is, or was started by. Set by the supervisor; read where
something is left behind."""

SUPERVISED_VARIABLE = "ROBO_SUPERVISED"
"""Set by the supervisor for what it starts: lines on stderr bear no time and no colour, for it adds both, and a node
waits as long for the run's router as the supervisor does."""

HEARTBEAT_VARIABLE = "ROBO_HEARTBEAT"
"""`FD:PERIOD`: a socket, and the time from one beat to the next, s. Set by the supervisor; read by a node's process."""

WATCH_VARIABLE = "ROBO_WATCH"
"""Set by the supervisor where it wants to know a node's source files. Read by a node's process."""

NETWORK_VARIABLE = "ROBO_ROUTER"
"""A `Network` as JSON. Set by the supervisor; read by its router."""

NOTIFY_VARIABLE = "ROBO_NOTIFY"
"""The descriptor on which a run in the background tells its starter, line by line, how far it has come. Set by
`robo up -d`; read by the run."""

KILL_TEST_VARIABLE = "ROBO_KILL_TEST"
"""Marks what `robo doctor --kill-test` starts, so that it finds what has outlived its supervisor."""
