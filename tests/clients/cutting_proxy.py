"""A TCP proxy that cuts its connections when a test says so."""

from __future__ import annotations

import contextlib
import socket
import threading


class CuttingProxy:
    """Forwards connections to a server and can cut them all.

    Attributes:
        port: where it listens on 127.0.0.1.
        cut_after_bytes: cuts a connection once so many bytes have gone through it in either direction; None: never.
        cuts: connections cut so far.
    """

    def __init__(self, target_port: int) -> None:
        """Forwards to 127.0.0.1:target_port."""
        self._target = ("127.0.0.1", target_port)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.cut_after_bytes: int | None = None
        self.most_cuts = 0
        self.cuts = 0
        self._lock = threading.Lock()
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Takes no more connections."""
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
            except OSError:
                return
            connection = _Connection(self, client, server)
            threading.Thread(target=connection.pump, args=(client, server), daemon=True).start()
            threading.Thread(target=connection.pump, args=(server, client), daemon=True).start()

    def take_cut(self) -> bool:
        """True when the connection that asks is to be cut."""
        with self._lock:
            if self.cuts >= self.most_cuts:
                return False
            self.cuts += 1
            return True


class _Connection:
    def __init__(self, proxy: CuttingProxy, *ends: socket.socket) -> None:
        self._proxy = proxy
        self._ends = ends
        self._bytes = 0

    def pump(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(16384):
                sink.sendall(data)
                self._bytes += len(data)
                limit = self._proxy.cut_after_bytes
                if limit is not None and self._bytes > limit and self._proxy.take_cut():
                    break
        except OSError:
            pass
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
