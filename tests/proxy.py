"""A link that can be cut: what stands between two ends passes on what they say, or holds it and says nothing."""

import selectors
import socket
import threading


class Proxy:
    """Listens on loopback and passes on to another port, until it is cut: then all that is said waits, as over radio.

    Neither end is told of the cut, and what it has said comes late, after the link is there again.
    """

    def __init__(self, port: int) -> None:
        """
        Args:
            port: on loopback, of whom it passes everything on to.
        """
        self._to = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._passes, self._over = threading.Event(), threading.Event()
        self._passes.set()
        self._peers: dict[socket.socket, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def cut(self) -> None:
        """Pass on nothing from now on."""
        self._passes.clear()

    def mend(self) -> None:
        """Pass on what has waited, and what comes."""
        self._passes.set()

    def close(self) -> None:
        self._over.set()
        self._passes.set()
        self._thread.join(20)
        for one in (*self._peers, self._listener):
            one.close()
        self._selector.close()

    def _run(self) -> None:
        while not self._over.is_set():
            if not self._passes.wait(0.5):
                continue
            for key, _ in self._selector.select(0.1):
                found = key.fileobj
                assert isinstance(found, socket.socket)
                if not self._passes.is_set():
                    break
                if found is self._listener:
                    self._connect()
                elif found in self._peers:
                    self._pass_on(found)

    def _connect(self) -> None:
        near, _ = self._listener.accept()
        try:
            far = socket.create_connection(("127.0.0.1", self._to))
        except OSError:
            near.close()
            return
        for one, other in ((near, far), (far, near)):
            self._peers[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _pass_on(self, end: socket.socket) -> None:
        try:
            data = end.recv(65_536)
            if data:
                self._peers[end].sendall(data)
                return
        except OSError:
            pass  # it is gone, and takes the other end along
        for one in (end, self._peers[end]):
            self._selector.unregister(one)
            one.close()
            del self._peers[one]
