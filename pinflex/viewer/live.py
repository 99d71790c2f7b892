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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of pyzmq, in meshcat's import
            import meshcat
        self._window = Window()
        self._viewer: Any = meshcat.Visualizer(window=self._window)
        self.url = self._window.url
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
        self._window.close()

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


# meshcat's page and what it draws, from a thread of this process, on the loopback only.
#
# meshcat's own server runs in a process of its own, listens on every interface and accepts any host
# name; here it is a daemon thread that ends with the program, listens on 127.0.0.1, and refuses a
# request that names another host.

HOSTS = ("127.0.0.1", "localhost")
_START = 5.0  # [s] for the server to come up


class Window:
    """What meshcat's Visualizer sends to: the server of its page, with all that is drawn so far."""

    def __init__(self) -> None:
        self.url = ""
        self._pages: set[Any] = set()
        self._drawn: dict[tuple[str, ...], bytes] = {}  # the last of each, for pages opened later
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

    def send(self, command: Any) -> None:
        """One command, to every page that is open."""
        import umsgpack  # type: ignore[import-not-found,import-untyped,unused-ignore]

        data = command.lower()
        key = data["type"], data["path"], data.get("property", "")
        self._loop.add_callback(self._pass_on, key, umsgpack.packb(data))

    def _pass_on(self, key: tuple[str, ...], packed: bytes) -> None:
        self._drawn[key] = packed
        for page in self._pages:
            page.draw(packed)

    def _run(self, ready: threading.Event) -> None:
        try:
            from tornado.ioloop import IOLoop

            self._loop = IOLoop()
            server = self._server()
        except BaseException as error:  # told by the thread that waits
            self._failure = error
            return
        finally:
            ready.set()
        self._loop.start()
        server.stop()
        self._loop.close(all_fds=True)

    def close(self) -> None:
        """Stop the loop and wait for its thread."""
        self._loop.add_callback(self._loop.stop)
        self._thread.join(_START)

    def _server(self) -> Any:
        import meshcat
        from tornado import netutil, web, websocket
        from tornado.httpserver import HTTPServer

        def refuse(handler: web.RequestHandler) -> None:
            if handler.request.host_name not in HOSTS:
                raise web.HTTPError(403)

        class Files(web.StaticFileHandler):
            def prepare(self) -> None:
                refuse(self)

        pages, drawn = self._pages, self._drawn

        class Page(websocket.WebSocketHandler):
            def prepare(self) -> None:
                refuse(self)

            def open(self, *path: str, **query: str) -> None:
                pages.add(self)
                for packed in drawn.values():
                    self.draw(packed)

            def draw(self, packed: bytes) -> None:
                """A page that was closed while it loaded is left out, and ends nothing."""
                with contextlib.suppress(websocket.WebSocketClosedError):
                    sent = self.write_message(packed, binary=True)
                    sent.add_done_callback(lambda done: done.cancelled() or done.exception())

            def on_message(self, message: str | bytes) -> None:
                """A page has nothing to say."""

            def on_close(self) -> None:
                pages.discard(self)

        viewer = Path(meshcat.__file__).parent / "viewer" / "dist"
        files = {"path": str(viewer), "default_filename": "index.html"}
        application = web.Application(
            [(r"/static/(.*)", Files, files), (r"/", Page)], log_function=lambda handler: None
        )
        server = HTTPServer(application)
        sockets = netutil.bind_sockets(0, HOST)
        server.add_sockets(sockets)
        self.url = f"http://{HOST}:{sockets[0].getsockname()[1]}/static/"
        return server
