"""meshcat's server as a thread of this process, on the loopback only.

meshcat's own server runs in a process of its own, listens on every interface and accepts any host
name; here it is a daemon thread that ends with the program, listens on 127.0.0.1, and refuses a
request that names another host.
"""

from __future__ import annotations

import threading
import warnings
from typing import Any

from pinflex.errors import PinflexError

HOSTS = ("127.0.0.1", "localhost")
_START = 5.0  # [s] for the server to come up


class Window:
    """Window that meshcat's Visualizer sends to; its own one opens two sockets and prints."""

    def __init__(self, zmq_url: str) -> None:
        import zmq

        self.zmq_socket: Any = zmq.Context.instance().socket(zmq.REQ)
        for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):  # a dead server must not hang the program
            self.zmq_socket.setsockopt(option, round(1000 * _START))
        self.zmq_socket.connect(zmq_url)

    def send(self, command: Any) -> None:
        """One command, answered."""
        import umsgpack  # type: ignore[import-not-found,import-untyped,unused-ignore]

        data = command.lower()
        kind, path = data["type"].encode("utf-8"), data["path"].encode("utf-8")
        self.zmq_socket.send_multipart([kind, path, umsgpack.packb(data)])
        self.zmq_socket.recv()


class Bridge:
    """meshcat's bridge on an event loop of its own thread."""

    def __init__(self) -> None:
        self.zmq_url = self.url = ""
        self._loop: Any = None
        self._failure: BaseException | None = None
        ready = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(ready,), daemon=True)
        self._thread.start()
        if not ready.wait(_START) or self._failure is not None:
            raise PinflexError(
                f"live: the server did not start ({self._failure or f'{_START:g} s'}). Write a "
                "page with pinflex.view instead; it needs no server."
            ) from self._failure

    def _run(self, ready: threading.Event) -> None:
        import asyncio

        try:
            asyncio.set_event_loop(asyncio.new_event_loop())
            bridge = _server()
            self.zmq_url, self.url, self._loop = bridge.zmq_url, bridge.web_url, bridge.ioloop
        except BaseException as error:  # told by the thread that waits
            self._failure = error
            return
        finally:
            ready.set()
        self._loop.start()
        bridge.listener.stop()
        bridge.zmq_socket.close(linger=0)
        self._loop.close(all_fds=True)

    def close(self) -> None:
        """Stop the loop and wait for its thread."""
        self._loop.add_callback(self._loop.stop)
        self._thread.join(_START)


def _server() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import tornado.httpserver
        import tornado.netutil
        import tornado.web
        import tornado.websocket
        import zmq
        from meshcat.servers import zmqserver

    class App(tornado.web.Application):
        def listen(  # type: ignore[override]
            self, port: int, address: str = "127.0.0.1", **more: Any
        ) -> Any:
            sockets = tornado.netutil.bind_sockets(port, address)
            Server.listener = tornado.httpserver.HTTPServer(self, **more)
            Server.listener.add_sockets(sockets)
            Server.port = sockets[0].getsockname()[1]
            return Server.listener

        def log_request(self, handler: Any) -> None:
            """Say nothing: the output belongs to the program."""

    def refuse(handler: Any) -> None:
        if handler.request.host_name not in HOSTS:
            raise tornado.web.HTTPError(403)

    class Socket(zmqserver.WebSocketHandler):  # type: ignore[misc]
        def prepare(self) -> None:
            refuse(self)

        def open(self) -> None:  # without the line that meshcat prints
            self.bridge.websocket_pool.add(self)
            self.bridge.send_scene(self)

        def on_close(self) -> None:
            self.bridge.websocket_pool.discard(self)

        def write_message(self, message: Any, binary: bool = False) -> Any:
            """A page that was closed while it loaded is left out; to raise would end the server."""
            try:
                sent = super().write_message(message, binary=binary)
                sent.add_done_callback(lambda done: done.cancelled() or done.exception())
                return sent
            except tornado.websocket.WebSocketClosedError:
                # later: who sends goes through the pool now
                self.bridge.ioloop.add_callback(self.bridge.websocket_pool.discard, self)
                return None

    class Files(zmqserver.StaticFileHandlerNoCache):  # type: ignore[misc]
        def prepare(self) -> None:
            refuse(self)

    class Server(zmqserver.ZMQWebSocketBridge):  # type: ignore[misc]
        listener: Any = None
        port = 0

        def setup_zmq(self, url: str) -> Any:
            """On any free port, and without a word; `url` is the first that meshcat would try."""
            socket, stream, _ = super().setup_zmq("tcp://127.0.0.1:*")
            return socket, stream, socket.getsockopt(zmq.LAST_ENDPOINT).decode()

        def make_app(self) -> Any:
            files = {"path": zmqserver.VIEWER_ROOT, "default_filename": zmqserver.VIEWER_HTML}
            return App([(r"/static/(.*)", Files, files), (r"/", Socket, {"bridge": self})])

    server = Server(port=0)
    server.web_url = f"http://127.0.0.1:{Server.port}/static/"
    return server
