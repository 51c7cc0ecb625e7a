"""The page in a browser, as a node of the robot."""

import threading
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
from msgspec import Meta, field

import robo
from robo import READ_ONLY, Health, Node, check
from robo.errors import RoboError, RunError

if TYPE_CHECKING:
    from tempfile import TemporaryDirectory

    from robo.dashboard.place import Settings
    from robo.dashboard.server import Dashboard as Server

_START = 10.0
"""How long the page may take to be there, s."""
_END = 5.0
"""How long pages may take to be told that it ends, s."""


class Dashboard(Node):
    """Serve the page by which people see and drive the robots of this network, as `robo dashboard` does.

    It drives by `cmd_vel_dashboard`, an input of the robot's mux. At another address than this machine's own who opens
    it needs a token; where no file has any they are made up, and kept in a file that this user alone may read: the log
    says which. No token stands in the log, which everybody reads who may look.
    """

    class Parameters(robo.Parameters):
        """Where the page is, and who is let in."""

        host: Annotated[
            str, Meta(description="the address where it is; 0.0.0.0 for all of this machine"), READ_ONLY
        ] = "127.0.0.1"
        port: Annotated[int, Meta(ge=0, le=65535, description="0 for any that is free"), READ_ONLY] = 8080
        token_file: Annotated[
            str, Meta(description="a line with the token to drive, and one with that to look"), READ_ONLY
        ] = ""
        names: Annotated[
            list[str], Meta(description="by which the page may be called, such as r1.local"), READ_ONLY
        ] = field(default_factory=list)

    parameters: Parameters

    _thread: threading.Thread | None = None
    _kept: "TemporaryDirectory[str] | None" = None
    """Where the tokens are when nothing else of this node is kept anywhere."""

    def on_start(self) -> None:
        """Serve the page from now on."""
        # Here, since it brings along what no other node needs.
        import asyncio

        from robo.dashboard.place import Settings
        from robo.dashboard.server import Dashboard as Server

        p = self.parameters
        file, key = self._secrets()
        settings = msgspec.structs.replace(Settings.of(p.host, p.port, file, p.names), key=key)
        server = Server(self.session, settings)
        self._loop = asyncio.new_event_loop()
        self._over = asyncio.Event()
        self._begun = threading.Event()
        self._problem: Exception | None = None
        self._thread = threading.Thread(target=self._serve, args=(server, settings), name="dashboard", daemon=True)
        self._thread.start()
        self._begun.wait(_START)
        if isinstance(self._problem, RoboError):
            raise self._problem
        if self._problem is not None or not self._begun.is_set():
            raise RunError(f"{self.full_name}: the page is not there: {self._problem or 'it takes too long'}")

    def on_stop(self) -> None:
        """Have robots stand that pages drive, and serve no more."""
        if self._thread is None:
            return
        with suppress(RuntimeError):  # it has ended by itself
            self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(_END)
        if self._kept is not None:
            self._kept.cleanup()

    def _secrets(self) -> tuple[Path | None, str]:
        """The file with the tokens, None where none are asked for; and the key for what browsers remember."""
        import secrets
        import tempfile

        from robo.web.access import Tokens, is_loopback, keep_secret

        given = Path(self.parameters.token_file) if self.parameters.token_file else None
        if given is None and is_loopback(self.parameters.host):
            return None, ""
        folder = self.memory.folder
        if not folder:
            self._kept = tempfile.TemporaryDirectory(prefix="robo-dashboard-")
            folder = self._kept.name
        stem = self.full_name.strip("/").replace("/", "%")
        if given is None:
            given = Path(folder, f"{stem}.tokens")
            Tokens.kept(given)
        self._file = given
        return given, keep_secret(Path(folder, f"{stem}.key"), secrets.token_urlsafe(32))

    @check("page")
    def is_served(self) -> Health:
        """Whether the page can be opened."""
        if self._thread is None or self._thread.is_alive():
            return Health.ok()
        return Health.error(f"the page is gone: {self._problem}")

    def _serve(self, server: "Server", settings: "Settings") -> None:
        def ready(port: int) -> None:
            self.logger.info("the dashboard is at %s", settings.place(port))
            if settings.tokens.drive:
                words = "its tokens, a line to drive and one to look, are in %s: open the address with ?token=… once"
                self.logger.info(words, self._file)
            self._begun.set()

        try:
            self._loop.run_until_complete(server.serve(ready, self._over))
        except Exception as error:
            self._problem = error
            if self._begun.is_set():  # else told by who started it
                self.logger.error("the page is gone; the node ends", exception=error)
                self.shutdown(1)
        finally:
            self._begun.set()
            self._loop.close()


if __name__ == "__main__":
    robo.run(Dashboard)
