"""A run played live in meshcat: its server is a thread of this process, on the loopback only.

    with Live(result) as live:
        print(live.url)              # open it in a browser
        live.play(seconds=10)

meshcat's own server runs in a process of its own, listens on every interface and accepts any host
name; here it is a daemon thread that ends with the program, listens on 127.0.0.1, and refuses a
request that names another host.
"""

from __future__ import annotations

import threading
import time
import warnings
from types import TracebackType
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.bent import FIELDS
from pinflex.errors import PinflexError
from pinflex.lines import magnified
from pinflex.result import Result
from pinflex.scene import build_scene

HOSTS = ("127.0.0.1", "localhost")
FPS = 12  # a browser digests no more of the flexible links, and meshcat does not slow us down
_SIDES = 10  # of a link's outline
_START = 5.0  # [s] for the server to come up
_GREY, _BASE = 0x758297, 0x9AA5B5


class Live:
    """Plays a result in meshcat until it is closed; nothing is left behind."""

    def __init__(self, result: Result, field: str = "von_mises", scale: float | str = "auto"):
        """Start the server and draw the first instant.

        Args:
            result: The run.
            field: Colour of the flexible links: a stress, or displacement.
            scale: Magnification of displacements about the rigid pose, or "auto".
        """
        self.scene = build_scene(result, scale=scale, meshes=None)
        self.field = field if any(f["key"] == field for f in self.scene["fields"]) else ""
        self._bridge = _Thread()
        self._window = _Window(self._bridge.zmq_url)
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
        scale = 5.0 / float(self.scene["size"])
        fit = _shifted(scale * np.eye(3), -scale * _middle(self.scene))
        self._viewer["robot"].set_transform(fit)
        self._viewer["/Grid"].set_property("visible", False)
        self.show(float(self.scene["t"][0]))

    def show(self, t: float) -> None:
        """Draw the instant kept that is nearest to t [s]."""
        from meshcat import geometry

        scene, mag, least = self.scene, self.scene["scale"], 0.008 * self.scene["size"]
        k = int(np.argmin(np.abs(scene["t"] - t)))
        for n, link in enumerate(scene["links"]):
            points, faces, colours = _tube(link, k, mag, self.field, self._top(), least)
            shape = geometry.TriangularMeshGeometry(points, faces, colours)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _top(self) -> float:
        values = [link["fields"][self.field] for link in self.scene["links"] if self._stress()]
        if not values:
            values = [np.linalg.norm(link["disp"], axis=2) for link in self.scene["links"]]
        return max((float(np.abs(v).max()) for v in values), default=0.0) or 1.0

    def _stress(self) -> bool:
        return self.field in FIELDS and self.field != "displacement"

    def _bodies(self) -> None:
        from meshcat import geometry

        for n, body in enumerate(self.scene["bodies"]):
            material = geometry.MeshPhongMaterial(color=_BASE if body["base"] else _GREY)
            here = self._viewer[f"robot/body_{n}"]
            for i, point in enumerate(body["points"]):
                here[f"joint_{i}"].set_object(geometry.Sphere(body["radius"]), material)
                here[f"joint_{i}"].set_transform(_shifted(np.eye(3), np.array(point)))
            rods = [] if body["base"] else list(body["rods"])
            if body["plate"] and not body["base"]:
                corners = body["points"]
                rods += [[corners[i - 1], corners[i]] for i in range(len(corners))]
            for i, (a, b) in enumerate(rods):
                start, way = np.array(a), np.array(b) - np.array(a)
                shape = geometry.Cylinder(float(np.linalg.norm(way)), 0.8 * body["radius"])
                here[f"rod_{i}"].set_object(shape, material)
                turned = _shifted(_towards(way), start + way / 2)
                here[f"rod_{i}"].set_transform(turned)


class _Window:
    """What meshcat's Visualizer sends to; its own one opens two sockets and prints."""

    def __init__(self, zmq_url: str) -> None:
        import zmq

        self.zmq_socket: Any = zmq.Context.instance().socket(zmq.REQ)
        for option in (zmq.RCVTIMEO, zmq.SNDTIMEO):  # a dead server must not hang the program
            self.zmq_socket.setsockopt(option, round(1000 * _START))
        self.zmq_socket.connect(zmq_url)

    def send(self, command: Any) -> None:
        import umsgpack  # type: ignore[import-not-found,import-untyped,unused-ignore]

        data = command.lower()
        kind, path = data["type"].encode("utf-8"), data["path"].encode("utf-8")
        self.zmq_socket.send_multipart([kind, path, umsgpack.packb(data)])
        self.zmq_socket.recv()


class _Thread:
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
            bridge = _bridge()
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
        self._loop.add_callback(self._loop.stop)
        self._thread.join(_START)


def _bridge() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        import tornado.web
        from meshcat.servers import zmqserver

    class App(tornado.web.Application):
        def listen(  # type: ignore[override]
            self, port: int, address: str = "127.0.0.1", **more: Any
        ) -> Any:
            Bridge.listener = super().listen(port, address=address, **more)
            return Bridge.listener

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

    class Files(zmqserver.StaticFileHandlerNoCache):  # type: ignore[misc]
        def prepare(self) -> None:
            refuse(self)

    class Bridge(zmqserver.ZMQWebSocketBridge):  # type: ignore[misc]
        listener: Any = None

        def make_app(self) -> Any:
            files = {"path": zmqserver.VIEWER_ROOT, "default_filename": zmqserver.VIEWER_HTML}
            return App([(r"/static/(.*)", Files, files), (r"/", Socket, {"bridge": self})])

    return Bridge()


def _tube(
    link: dict[str, Any], k: int, mag: float, field: str, top: float, least: float
) -> tuple[Array, Any, Array]:
    """Vertices, faces and colours of a flexible link at instant k, at least so thick [m]."""
    from matplotlib import colormaps

    share = ((link["x"] - link["x"][0]) / (link["x"][-1] - link["x"][0]))[:, None]
    rigid = link["rigid"][k]
    if len(rigid) == 2:  # a straight one is kept by its ends
        rigid = rigid[0] * (1 - share) + rigid[1] * share
    centre = rigid + mag * link["disp"][k]
    along = np.gradient(centre, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    y = link["y_rigid"][k] + mag * link["y_disp"][k]
    y -= along * np.sum(along * y, axis=1, keepdims=True)
    y /= np.maximum(np.linalg.norm(y, axis=1, keepdims=True), 1e-300)
    z = np.cross(along, y)
    outline = np.array(link["outline"])
    if len(outline) > 2 * _SIDES:
        outline = outline[np.linspace(0, len(outline), 2 * _SIDES, endpoint=False).astype(int)]
    extent = np.maximum(np.ptp(outline, axis=0), 1e-9)
    outline = outline * np.maximum(1.0, least / extent)
    m, n = len(centre), len(outline)
    points = centre[:, None] + outline[:, :1] * y[:, None] + outline[:, 1:] * z[:, None]
    i, j = np.meshgrid(np.arange(m - 1), np.arange(n), indexing="ij")
    a, b = (i * n + j).ravel(), (i * n + (j + 1) % n).ravel()
    faces = np.concatenate([np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)])
    fields = link["fields"]
    value = np.abs(fields[field][k]) if field in fields else np.linalg.norm(link["disp"][k], axis=1)
    colours = np.repeat(colormaps["viridis"](np.clip(value / top, 0, 1))[:, :3], n, axis=0)
    return points.reshape(-1, 3), faces.astype(np.uint32), colours


def _middle(scene: dict[str, Any]) -> Array:
    """Centre of the rigid robot at its first instant [m]."""
    points = [link["rigid"][0].reshape(-1, 3) for link in scene["links"]]
    for body in scene["bodies"]:
        pose = magnified(body, 0, 0.0)
        points.append(np.array(body["points"]).reshape(-1, 3) @ pose[:, :3].T + pose[:, 3])
    cloud = np.concatenate(points)
    return np.asarray((cloud.min(axis=0) + cloud.max(axis=0)) / 2)


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
