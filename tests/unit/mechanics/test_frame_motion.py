"""Position, velocity and acceleration of a reported frame, against a point on two circles."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pinflex as pf
from tests.scenes import Body, load

ONE, TWO, UP = 0.4, 0.25, 0.07  # [m]


def test_a_frame_beside_its_joint_moves_on_two_circles(tmp_path: Path) -> None:
    """p = a e(s) + b e(s + r) + c n(s + r) and its derivatives, e and n the turning axes."""
    link = {"mass": 1.0, "inertia": (1e-3, 1e-2, 1e-2)}
    bodies = (
        Body("one", "base", "revolute", **link),  # type: ignore[arg-type]
        Body("two", "one", "revolute", xyz=(ONE, 0, 0), **link),  # type: ignore[arg-type]
        Body("tip", "two", xyz=(TWO, UP, 0)),
    )
    robot = load(tmp_path, bodies, "gravity: [0, 0, 0]\nframes: [tip]\n")
    run = pf.solve(
        robot,
        pf.quintic(joints={"one_joint": 2.0, "two_joint": -3.0}, duration=0.5),
        level="rigid",
        samples=21,
    )
    (s, ds, dds), (r, dr, ddr) = (
        (j.position, j.velocity, j.acceleration)
        for j in (run.joint("one_joint"), run.joint("two_joint"))
    )

    def turned(z: complex, a, da, dda) -> list[np.ndarray]:  # type: ignore[no-untyped-def]
        """z exp(i a) and its two derivatives."""
        x = z * np.exp(1j * a)
        return [x, 1j * da * x, (1j * dda - da**2) * x]

    parts = turned(ONE, s, ds, dds), turned(TWO + 1j * UP, s + r, ds + dr, dds + ddr)
    frame = run.frame("tip")
    for z, found in zip(
        map(sum, zip(*parts, strict=True)),
        (frame.position, frame.velocity, frame.acceleration),
        strict=True,
    ):
        size = float(np.abs(z).max())
        np.testing.assert_allclose(found[:, 0], np.real(z), atol=1e-12 * size)
        np.testing.assert_allclose(found[:, 1], np.imag(z), atol=1e-12 * size)
