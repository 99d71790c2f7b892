"""The modal summary of a flexible body: mass, centre, inertia, frequencies, participation.

What a modal file of a multibody program says of a body, in SI units, for beams and solids alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pinflex.bodies.basis import FlexibleBody
from pinflex.bodies.moments import CROSS
from pinflex.linalg import eigh

UNITS = {
    "mass": "kg",
    "centre": "m",
    "inertia": "kg m^2",
    "frequencies": "Hz",
    "effective_mass": "kg",
    "effective_inertia": "kg m^2",
    "participation": "kg^0.5 | kg^0.5 m",
}


def modal_data(body: FlexibleBody) -> dict[str, Any]:
    """Plain numbers of a body, by name; `UNITS` says their units.

    Frame: x along the span from its start. Modes are those of the body held at its root and free
    elsewhere; the participation of mode k in a rigid motion r is f_k = phi_k' M r with
    phi_k' M phi_k = 1, and f_k^2 the mass (or, about the root, the inertia) that moves with it.

    Returns:
        mass; centre (3,); inertia about the centre (3, 3); frequencies (n,); participation (n, 6)
        and effective_mass (n, 3), effective_inertia (n, 3) for x, y, z; coordinates, points,
        inertia_error.
    """
    m, p = body.mass, body.points
    total = float(m.sum())
    centre = m @ p / total
    arm = p - centre
    second = arm.T @ (m[:, None] * arm)
    inertia = np.trace(second) * np.eye(3) - second
    if body.inertia is not None:
        inertia += np.diag(body.inertia.sum(axis=0))
    inertia[0, 0] += float(body.It.sum())
    M = body.M
    if np.linalg.eigvalsh(M)[0] <= 0.0:
        M = M + 1e-12 * np.trace(M) * np.eye(body.n)
    squares, V = eigh(body.K, M)
    rigid = np.concatenate(
        [np.tile(np.eye(3), (len(m), 1, 1)), np.einsum("acb,ib->ica", CROSS, p)], 2
    )
    share = np.einsum("i,ick,icr->kr", m, body.Phi, rigid)
    share[:, 3] += body.It @ body.Phi_t
    share = V.T @ share
    return {
        "mass": total,
        "centre": centre,
        "inertia": inertia,
        "frequencies": np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi),
        "participation": share,
        "effective_mass": share[:, :3] ** 2,
        "effective_inertia": share[:, 3:] ** 2,
        "coordinates": np.array(body.labels),
        "points": len(m),
        "inertia_error": 0.0 if body.solid is None else body.solid.inertia_error,
    }


def summary(body: FlexibleBody, count: int = 12) -> str:
    """Modal summary as text."""
    data = modal_data(body)
    I = data["inertia"]  # noqa: E741 - the symbol of the quantity
    near = np.where(np.abs(data["centre"]) < 1e-12 * body.length, 0.0, data["centre"])
    I = np.where(np.abs(I) < 1e-12 * np.trace(I), 0.0, I)  # noqa: E741
    centre = ", ".join(f"{x:.6g}" for x in near)
    lines = [
        "Modal summary (SI: kg, m, s; frame: x along the span from its start)",
        f"  mass             {data['mass']:.9g} kg",
        f"  centre           ({centre}) m",
        f"  inertia, centre  xx {I[0, 0]:.6g}, yy {I[1, 1]:.6g}, zz {I[2, 2]:.6g} kg m^2",
        f"                   xy {I[0, 1]:.3g}, yz {I[1, 2]:.3g}, zx {I[2, 0]:.3g} kg m^2",
        f"  coordinates      {body.n}, inertia on {data['points']} points",
    ]
    if body.solid is not None:
        held = "  ".join(f"{f:.5g}" for f in body.solid.held_frequencies)
        names = ", ".join([body.solid.held[0], *(node.name for node in body.solid.nodes)])
        order = "with" if body.second_order else "without"
        lines += [
            f"  interfaces       {names} (the first is held); {order} second-order rows",
            f"  point inertia    largest error {data['inertia_error']:.2g} of a modal mass; mass, "
            "centre, inertia exact",
            f"  all held         {held} Hz",
        ]
    lines.append(
        "  held at its root: frequency, share of the mass x y z, of the inertia about the root"
    )
    whole = np.array([data["mass"]] * 3)
    p, m = body.points, body.mass
    turn = np.array([float(m @ (np.sum(p**2, axis=1) - p[:, a] ** 2)) for a in range(3)])
    turn[0] += float(body.It.sum())
    turn = np.where(turn > 0.0, turn, np.inf)
    for k in range(min(count, body.n)):
        shares = [*(data["effective_mass"][k] / whole), *(data["effective_inertia"][k] / turn)]
        text = " ".join(f"{100 * x:6.2f}" for x in shares)
        lines.append(f"  {k + 1:3d} {data['frequencies'][k]:12.5g} Hz  {text} %")
    return "\n".join(lines)


def save(body: FlexibleBody, path: str | Path) -> Path:
    """Write the modal data, with units, K, M and D (in the coordinates of the body), as a .npz."""
    path = Path(path)
    data = modal_data(body)
    arrays = {key: np.asarray(value) for key, value in data.items()}
    units = np.array([f"{key}: {unit}" for key, unit in UNITS.items()])
    arrays |= {"K": body.K, "M": body.M, "D": body.D, "units": units}
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]
    return path if path.suffix == ".npz" else path.with_name(path.name + ".npz")
