"""A run played live in meshcat, whose server is a thread of this process, on the loopback only."""

from __future__ import annotations

import contextlib
import math
import threading
import time
import warnings
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError, PinflexError
from pinflex.results.result import Result
from pinflex.viewer.export.pictures import magnified
from pinflex.viewer.links import skin, triangles
from pinflex.viewer.scene import build_scene

FPS = 12  # a browser digests no more of the flexible links, and meshcat does not slow us down
_TRIANGLES = 1200  # of a bent mesh, which is sent anew every time
_GREY, _BASE = 0x758297, 0x9AA5B5


def require_meshcat() -> None:
    """Raise if meshcat is not there (pip install --no-deps): pages need nothing of it."""
    if find_spec("meshcat") is None:
        raise PinflexError(
            "live: meshcat is not installed. Install it (pip install meshcat), or "
            "write a page with pinflex.view: it needs nothing else."
        )


class Live:
    """Plays a result in meshcat until it is closed; nothing is left behind.

    with Live(result) as live:
        print(live.url)  # open it in a browser
        live.play(seconds=10)
    """

    def __init__(
        self,
        result: Result,
        field: str = "von_mises",
        scale: float | str = "auto",
        meshes: Sequence[str | Path] | None = (),
    ):
        """Start the server and draw the first instant."""
        require_meshcat()
        self.scene = build_scene(result, scale=scale, meshes=meshes)
        self.field = field if any(f["key"] == field for f in self.scene["fields"]) else ""
        least = 0.008 * self.scene["size"]
        links = self.scene["links"]
        self._skins = [skin(link, self.field, least, _TRIANGLES) for link in links]
        self._bridge = Bridge()
        self._window = Window(self._bridge.zmq_url)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of pyzmq, in meshcat's import
            import meshcat
        self._viewer: Any = meshcat.Visualizer(window=self._window)
        self.url = self._bridge.url
        self._viewer["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
        self._viewer["/Background"].set_property("bottom_color", [0.885, 0.91, 0.945])
        self._viewer["/Axes"].set_property("visible", False)
        self._bodies()
        # meshcat's camera looks at the origin from 3 m and cannot be moved from here
        self._viewer["robot"].set_transform(_fit(self.scene))
        self._viewer["/Grid"].set_property("visible", False)
        self.show(float(self.scene["t"][0]))

    def show(self, t: float) -> None:
        """Draw the instant kept that is nearest to t [s]."""
        from matplotlib import colormaps
        from meshcat import geometry

        scene, mag = self.scene, self.scene["scale"]
        k, top = int(np.argmin(np.abs(scene["t"] - t))), self._top()
        for n, (link, own) in enumerate(zip(scene["links"], self._skins, strict=True)):
            share = np.clip(np.abs(own.values[k]) / top, 0, 1)[own.shown]
            colours = colormaps["viridis"](share)[:, :3]
            shape = geometry.TriangularMeshGeometry(own.at(link, k, mag), own.faces, colours)
            material = geometry.MeshPhongMaterial(vertexColors=True)
            self._viewer[f"robot/link_{n}"].set_object(shape, material)
        for n, body in enumerate(scene["bodies"]):
            moved = np.vstack([magnified(body, k, mag), [0.0, 0.0, 0.0, 1.0]])
            self._viewer[f"robot/body_{n}"].set_transform(moved.astype(float))

    def play(self, seconds: float, speed: float | None = None) -> None:
        """Play the run over and over for some seconds; speed 1 is real time, default 6 s a pass."""
        t = self.scene["t"]
        span = float(t[-1] - t[0]) or 1.0
        speed = span / 6.0 if speed is None else speed
        start = time.monotonic()
        while (past := time.monotonic() - start) < seconds:
            self.show(float(t[0]) + (past * speed) % span)
            time.sleep(max(0.0, 1.0 / FPS - (time.monotonic() - start - past)))

    def close(self) -> None:
        """Stop the server."""
        self._window.zmq_socket.close(linger=0)
        self._bridge.close()

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _top(self) -> float:
        return max((float(np.abs(s.values).max()) for s in self._skins), default=0.0) or 1.0

    def _bodies(self) -> None:
        from meshcat import geometry

        for n, body in enumerate(self.scene["bodies"]):
            colour = _BASE if body["base"] else _GREY
            here = self._viewer[f"robot/body_{n}"]
            if body["mesh"]:
                shape = geometry.TriangularMeshGeometry(*triangles(body["mesh"]))
                here.set_object(shape, geometry.MeshPhongMaterial(color=colour, flatShading=True))
            else:
                _sticks(here, body, geometry.MeshPhongMaterial(color=colour))


def _sticks(here: Any, body: dict[str, Any], material: Any) -> None:
    """Draw joints as balls, and rods between them."""
    from meshcat import geometry

    points = body["points"]
    for i, point in enumerate(points):
        here[f"joint_{i}"].set_object(geometry.Sphere(body["radius"]), material)
        here[f"joint_{i}"].set_transform(_shifted(np.eye(3), np.array(point)))
    edges = [[points[k - 1], points[k]] for k in range(len(points))] if body["plate"] else []
    for i, (a, b) in enumerate([] if body["base"] else [*body["rods"], *edges]):
        start, way = np.array(a), np.array(b) - np.array(a)
        shape = geometry.Cylinder(float(np.linalg.norm(way)), 0.8 * body["radius"])
        here[f"rod_{i}"].set_object(shape, material)
        here[f"rod_{i}"].set_transform(_shifted(_towards(way), start + way / 2))


def _fit(scene: dict[str, Any]) -> Array:
    """Moves the robot's middle to the origin, turns its broad side to the camera, on +x, scales."""
    points = [link["rigid"][0].reshape(-1, 3) for link in scene["links"]]
    for body in scene["bodies"]:
        pose = magnified(body, 0, 0.0)
        points.append(np.array(body["points"]).reshape(-1, 3) @ pose[:, :3].T + pose[:, 3])
    cloud = np.concatenate(points)
    middle = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    x, y = np.linalg.svd(cloud[:, :2] - middle[:2])[2][0]  # its longest extent, seen from above
    turn = 5.0 / float(scene["size"]) * np.array([[y, -x, 0], [x, y, 0], [0, 0, 1]])
    return _shifted(turn, -turn @ middle)


def _shifted(rotation: Array, shift: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, shift
    return out


def _towards(way: Array) -> Array:
    """A rotation that takes y, the axis of meshcat's cylinder, to a direction."""
    y = way / max(float(np.linalg.norm(way)), 1e-300)
    x = np.cross(y, np.eye(3)[np.argmin(np.abs(y))])
    x /= np.linalg.norm(x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


# One page on the loopback interface, for a browser that may not read files.
#
# Only this machine can connect, and only under its own name: a request that names another host (a
# web site whose name was made to point here) is refused.

HOST = "127.0.0.1"


class Server(ThreadingHTTPServer):
    """Serves one page at /; `with Server(page) as server: server.serve_forever()`."""

    daemon_threads = True  # an open connection does not hold up the end

    def __init__(self, page: Path, port: int = 0) -> None:
        self.body = page.read_bytes()
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or error
            raise DescriptionError(
                f"view: port {port} cannot be used ({reason}). Choose another one from 1024 to "
                "65535, or none: a free one is found."
            ) from error

    @property
    def url(self) -> str:
        """Address to open."""
        return f"http://{HOST}:{self.server_address[1]}/"


def page_until_interrupted(page: Path, port: int) -> None:
    """Serve a page until Ctrl-C; the address is printed."""
    with Server(page, port) as server, contextlib.suppress(KeyboardInterrupt):
        print(f"{server.url} (only from this machine; Ctrl-C ends it)", flush=True)
        server.serve_forever()


def live_until_interrupted(
    result: Result, field: str, scale: float | str, meshes: Sequence[str | Path]
) -> None:
    """Play a run in meshcat until Ctrl-C; the address is printed."""
    with Live(result, field, scale, meshes) as live, contextlib.suppress(KeyboardInterrupt):
        print(f"{live.url} (only from this machine; Ctrl-C ends it)", flush=True)
        live.play(seconds=math.inf)


class _Handler(BaseHTTPRequestHandler):
    server: Server
    server_version, sys_version = "pinflex", ""
    timeout = 30  # [s] a connection that says nothing

    def do_GET(self) -> None:
        """The page, and nothing else."""
        self._answer(with_body=True)

    def do_HEAD(self) -> None:
        """As GET, without the page."""
        self._answer(with_body=False)

    def _answer(self, with_body: bool) -> None:
        port = self.server.server_address[1]
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self.send_error(403, "this page is for this machine only")
            return
        if self.path.partition("?")[0] != "/":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.body)))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Frame-Options", "DENY")
        self.end_headers()
        if with_body:
            self.wfile.write(self.server.body)

    def log_message(self, *unused: object) -> None:
        """Say nothing: the output belongs to the command."""


# meshcat's server as a thread of this process, on the loopback only.
#
# meshcat's own server runs in a process of its own, listens on every interface and accepts any host
# name; here it is a daemon thread that ends with the program, listens on 127.0.0.1, and refuses a
# request that names another host.

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
            Meshcat.listener = tornado.httpserver.HTTPServer(self, **more)
            Meshcat.listener.add_sockets(sockets)
            Meshcat.port = sockets[0].getsockname()[1]
            return Meshcat.listener

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

    class Meshcat(zmqserver.ZMQWebSocketBridge):  # type: ignore[misc]
        listener: Any = None
        port = 0

        def setup_zmq(self, url: str) -> Any:
            """On any free port, and without a word; `url` is the first that meshcat would try."""
            socket, stream, _ = super().setup_zmq("tcp://127.0.0.1:*")
            return socket, stream, socket.getsockopt(zmq.LAST_ENDPOINT).decode()

        def make_app(self) -> Any:
            files = {"path": zmqserver.VIEWER_ROOT, "default_filename": zmqserver.VIEWER_HTML}
            return App([(r"/static/(.*)", Files, files), (r"/", Socket, {"bridge": self})])

    server = Meshcat(port=0)
    server.web_url = f"http://127.0.0.1:{Meshcat.port}/static/"
    return server
