"""The race scenes R1 to R4: what is compared, and which settings either side may choose from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

Overrides = tuple[str, ...]
Peer = dict[str, object]


@dataclass(frozen=True)
class Race:
    """A scene with the error to reach.

    Attributes:
        key: R1 to R4. model: Shipped model. about: One line.
        limits: Error to reach, by output.
        target: Ratio of peer time to pinflex time aimed at: tuned by hand, and by tol.
        asked: What `tol` is about.
        models: Overrides of the models pinflex may take.
        reference: Overrides of the reference, by radau of resolution `finest`.
        checks: Runs that it has to agree with: name, overrides, method, its value.
        peer: Settings the peer may take, fine steps last; each is tried with `peer_steps`.
        peer_finest: The peer, refined: what both agree to is the same physics.
        always: Overrides that make the shipped model the one that is raced.
    """

    key: str
    model: str
    about: str
    limits: dict[str, float]
    target: tuple[float, float]
    asked: tuple[str, ...]
    models: tuple[Overrides, ...]
    reference: Overrides
    finest: float
    checks: tuple[tuple[str, Overrides, str, float], ...]
    peer: tuple[Peer, ...] = ()
    peer_steps: tuple[int, ...] = ()
    peer_finest: Peer | None = None
    always: Overrides = ()


def _links(axial: bool, internal: int, segments: int = 1) -> Overrides:
    stretch = f"flexible.*.axial={str(axial).lower()}"
    cut = (f"flexible.*.segments={segments}",) if segments > 1 else ()
    return (stretch, *cut, f"flexible.*.basis.internal={internal}")


def _rod(segments: int, internal: int) -> Overrides:
    basis = f"flexible.rod.basis={{kind: craig_bampton, internal: {internal}}}"
    return (basis, f"flexible.rod.segments={segments}")


def _offers(**choices: tuple[object, ...]) -> tuple[Peer, ...]:
    """Every combination of settings that the peer may take."""
    return tuple(dict(zip(choices, picked, strict=True)) for picked in product(*choices.values()))


RACES = {
    "R1": Race(
        "R1",
        "race_r1",
        "planar 3-RRR, undamped",
        {"torque": 1e-2},
        (130.0, 60.0),
        ("torque",),
        (_links(False, 0), _links(False, 1), _links(True, 0), _links(True, 1), _links(True, 2)),
        _links(True, 6),
        1e-6,
        (
            ("resolution 1e-4", _links(True, 6), "careful", 1e-4),
            ("two segments, 4 modes each", _links(True, 4, 2), "careful", 1e-6),
            ("generalized-alpha, dt 5 us", _links(True, 6), "alpha", 5e-6),
        ),
        _offers(elements=(2, 3, 4, 6), atol=(1e-4, 1e-5), rtol=(1e-8, 1e-5)),
        (400, 800, 1200, 1600, 2000, 2800, 4000, 4800, 8000, 16000),
        {"elements": 8, "steps": 32000, "atol": 1e-6},
    ),
    "R2": Race(
        "R2",
        "race_r2",
        "spatial 3-RRS under gravity, damped",
        {"position": 2e-3, "rotation": 2e-3, "torque": 2e-3},
        (300.0, 120.0),
        ("torque", "platform"),
        (_links(False, 0), _links(False, 1)),
        _links(False, 1, 2),
        1e-5,
        (
            ("resolution 1e-4", _links(False, 1, 2), "careful", 1e-4),
            ("one body a link, 3 modes", _links(False, 3), "careful", 1e-5),
            ("generalized-alpha, dt 25 us", _links(False, 1, 2), "alpha", 2.5e-5),
        ),
        _offers(
            stretch=(False, True), elements=(2, 3, 4), atol=(2e-4, 1e-4, 1e-5), rtol=(1e-8, 1e-6)
        ),
        (800, 1200, 1600, 2400, 2800, 3200),
        {"elements": 4, "steps": 6400, "atol": 1e-6},
    ),
    "R3": Race(
        "R3",
        "race_r3",
        "slider-crank with an elastic rod, undamped",
        {"middle": 1e-3},
        (35.0, 18.0),
        ("deflection",),
        tuple(_rod(s, n) for s, n in ((2, 1), (2, 2), (3, 1), (3, 2))),
        _rod(4, 2),
        1e-6,
        (
            ("resolution 1e-5", _rod(4, 2), "careful", 1e-5),
            ("6 segments, 1 mode each", _rod(6, 1), "careful", 1e-5),
            ("generalized-alpha, dt 5 us", _rod(3, 2), "alpha", 5e-6),
        ),
        _offers(
            elements=(2, 4, 6),  # an even number: the middle of the rod is compared
            atol=(1e-3, 1e-4, 1e-5),
            rtol=(1e-8, 1e-4),
            full=(True, False),
        ),
        (400, 800, 1200, 1600, 2000, 2800, 4000, 4800, 8000, 16000),
        {"elements": 16, "steps": 64000, "atol": 1e-7, "full": True},
        # Large deflection and no extra inertia, as in the peer; it starts with the stretch that
        # its own inertia gives it, as the test set's does.
        (
            "joints.pin.rotor_inertia=0",
            "solve.start=static",
            "flexible.rod.second_order=true",
        ),
    ),
    "R4": Race(
        "R4",
        "spinning_beam",
        "spin-up of a beam",
        {"transverse": 1e-3, "axial": 1e-3, "torque": 1e-3},
        (130.0, 50.0),
        ("torque", "platform"),
        tuple(_links(True, n, s) for s, n in ((2, 1), (3, 0), (3, 1), (4, 0))),
        _links(True, 1, 8),
        1e-7,
        (
            ("resolution 1e-6", _links(True, 1, 8), "careful", 1e-6),
            ("6 segments", _links(True, 1, 6), "careful", 1e-7),
            ("generalized-alpha, dt 1.25 ms", _links(True, 1, 8), "alpha", 1.25e-3),
        ),
        _offers(elements=(3, 4, 5, 6, 8), atol=(1e-4, 1e-5), rtol=(1e-8, 1e-4), full=(True, False)),
        (1200, 1600, 2000, 2400, 2800, 3200, 4000, 4800, 6000, 8000),
        {"elements": 16, "steps": 16000, "atol": 1e-6, "full": True},
    ),
}
