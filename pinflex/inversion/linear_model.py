"""linearise(): a state-space model of the mechanism about a balanced pose, for control design.

On the closures y = N z + W theta, with theta the motor positions where their acceleration is the
input (W: what follows them rigidly); where motor torque is the input, N spans their motion too:

    N' M (N z'' + W u) + N' C (N z' + W theta') + N' K (N z + W theta) = N' f

In unit-mass modes of (N' K N, N' M N) this is x' = A x + B u, out = C x + D u. Modes that are left
out, and coordinates without mass, follow statically: their compliance is in D.

Source: Craig, Kurdila (2006), Fundamentals of Structural Dynamics, ch. 9 and 15 (mode displacement
with residual flexibility); Gawronski (2004), Advanced Structural Dynamics, ch. 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig, matrix_balance

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.errors import DescriptionError, nearest
from pinflex.levels.quasistatic import rest
from pinflex.linalg import condensed, null_space
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.mechanics.model.tree import sliding
from pinflex.results.quantities import joint_unit
from pinflex.threads import one_blas_thread

AXES = ("x", "y", "z", "rx", "ry", "rz")
RATES = ("", "velocity", "acceleration")
INPUTS = ("torque", "acceleration")

_FINITE = 1e-8  # of the inverse of the largest rate: a zero beyond is at infinity
_RIGID = 1e-6  # of the highest frequency: below it a mode is one of the rigid body


@dataclass(frozen=True, repr=False)
class LinearModel:
    """x' = A x + B u, out = C x + D u about a balanced pose.

    Attributes:
        A, B, C, D: Matrices. states, inputs, outputs: Names, with units in brackets.
        y: Pose that was linearised about, shape (nq,).
        frequencies: Of the undamped modes kept [Hz]; 0 for rigid motion.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    y: Array
    frequencies: Array

    def __repr__(self) -> str:
        rigid = float(np.max(self.frequencies, initial=0.0)) * _RIGID
        first = ", ".join(f"{f:.4g}" for f in self.frequencies[self.frequencies > rigid][:4])
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<LinearModel {sizes}; modes {first} ... Hz>"

    @property
    def poles(self) -> Array:
        """Eigenvalues of A [1/s], slowest first."""
        found = np.linalg.eigvals(self.A)
        return np.asarray(found[np.argsort(np.abs(found))])

    def zeros(self) -> Array:
        """Transmission zeros [1/s] of a model with as many inputs as outputs, slowest first.

        In the left half plane and on the axis feedback from these outputs can damp what these
        inputs excite (minimum phase); one in the right half plane limits its bandwidth.
        """
        n, m = self.B.shape
        if m != len(self.C):
            raise DescriptionError(
                f"zeros: {m} inputs and {len(self.C)} outputs. Take a model with as many of each."
            )
        S, fastest = _even(np.block([[self.A, self.B], [self.C, self.D]]), n)
        E = np.zeros_like(S)
        E[:n, :n] = np.eye(n)
        alpha, beta = eig(S, E, right=False, homogeneous_eigvals=True)
        finite = np.abs(beta) * fastest > _FINITE * np.abs(alpha)
        found = alpha[finite] / beta[finite]
        return np.asarray(found[np.argsort(np.abs(found))])

    def response(self, frequencies: Array) -> Array:
        """Frequency response at frequencies [Hz], shape (nf, outputs, inputs), complex."""
        unit = np.eye(len(self.A))
        s = 2j * np.pi * np.atleast_1d(np.asarray(frequencies, float))
        found = [self.C @ np.linalg.solve(x * unit - self.A, self.B) + self.D for x in s]
        return np.array(found)

    def to_scipy(self) -> Any:
        """As scipy.signal.StateSpace."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """As control.StateSpace with names; needs python-control."""
        try:
            import control
        except ImportError as error:
            raise DescriptionError(
                "to_control: python-control is not installed. pip install control, or take "
                "to_scipy()."
            ) from error
        plain = [
            [name.split(" [")[0].replace(".", "_") for name in names]  # it forbids dots
            for names in (self.inputs, self.outputs)
        ]
        return control.ss(self.A, self.B, self.C, self.D, inputs=plain[0], outputs=plain[1])


@public
@takes_model
@one_blas_thread()
def linearise(
    mechanism: Mechanism,
    q: Array | None = None,
    *,
    motors: str = "torque",
    forces: Sequence[str] = (),
    outputs: Sequence[str] = (),
    modes: int | None = None,
) -> LinearModel:
    """Linear model of the closed mechanism about its static equilibrium.

    Args:
        mechanism: Mechanism.
        q: Rigid pose, default home; the links are balanced there under gravity and loads.
        motors: Input of the motors: "torque" (they are free to move) or "acceleration".
        forces: Further inputs, "FRAME.x" ... "FRAME.z" (force, N, world axes) and "FRAME.rx" ...
            (moment, N m).
        outputs: "FRAME.x" ... "FRAME.rz" (small displacement or rotation, world axes), a joint by
            name, each with ".velocity" or ".acceleration" as wanted, or "LINK.curvature_v@X" and
            "LINK.curvature_w@X" (1/m at x = X m of a flexible link). Default: the platform's six,
            and the motors' positions.
        modes: How many modes to keep beside rigid motion, the rest following statically; default
            all.
    Returns:
        The model.
    Raises:
        DescriptionError: An unknown input or output.
        ConvergenceError: No static equilibrium.
    """
    if motors not in INPUTS:
        raise DescriptionError(f"motors: {motors}.{nearest(motors, INPUTS)}")
    driven = motors == "acceleration"
    about = Balanced.of(mechanism, q)
    F, inputs = _inputs(mechanism, about.dynamics, about.y, driven, forces)
    wanted = tuple(outputs) or _usual_outputs(mechanism)
    H, order = _output_rows(mechanism, about.dynamics, about.y, wanted)
    slides = sliding(mechanism.rigid.rigid)
    A, B, C, D, frequencies = about.state_space(driven, F, H, order, modes)
    nt = len(about.dynamics.system.motors) if driven else 0
    states = [f"mode {k + 1}" for k in range(len(A) // 2 - nt)]
    states += [f"{m} position" for m in mechanism.motors][:nt]
    return LinearModel(
        A, B, C, D, tuple(states + [f"{s}'" for s in states]), inputs,
        tuple(f"{text} [{_unit(text, slides)}]" for text in wanted), about.y, frequencies,
    )  # fmt: skip


@dataclass(frozen=True)
class Balanced:
    """A mechanism at its static equilibrium in a pose, and its tangent there."""

    dynamics: Equations
    y: Array
    M: Array
    C: Array
    K: Array
    J: Array

    @classmethod
    def of(cls, mechanism: Mechanism, q: Array | None) -> Balanced:
        """Balanced in a rigid pose, default home."""
        dynamics = Equations(mechanism.flexible.sliding)
        found = rest(mechanism, q, dynamics=Equations(mechanism.flexible))
        still = np.zeros(dynamics.system.nv)
        tangent = dynamics.tangent(found.y, still, still, found.lam, 0.0)
        return cls(dynamics, found.y, *tangent)

    def state_space(
        self, driven: bool, F: Array, H: Array, order: Array, modes: int | None = None
    ) -> tuple[Array, Array, Array, Array, Array]:
        """A, B, C, D and the frequencies of the modes kept [Hz].

        Args:
            driven: Whether the motors' accelerations are the first inputs; else motors are free.
            F: Forces of the (other) inputs, (nv, k). H, order: Outputs by velocity rows, (k, nv),
                and whether each is a position, a velocity or an acceleration (0, 1, 2).
            modes: How many to keep beside rigid motion.
        """
        system, M, C, K, J = self.dynamics.system, self.M, self.C, self.K, self.J
        free = system.free if driven else system.unheld
        N = np.zeros((system.nv, len(free)))
        N[free] = np.eye(len(free))
        N = N @ null_space(J[:, free])
        W = np.zeros((system.nv, 0))
        if driven:
            W = _followers(system.nv, system.motors, free, J)
        P, compliance, frequencies = _kept(N, K, M, modes)

        A, B = _state_matrices(P, W, (M, C, K), F)
        n, nt = P.shape[1], W.shape[1]
        still = np.zeros((system.nv, n + nt))
        by_x = np.hstack([np.hstack([P, W]) - compliance @ K @ W @ np.eye(n + nt)[n:], still])
        by_u = np.hstack([-compliance @ M @ W, compliance @ F])
        C_out, D_out = np.zeros((len(H), len(A))), np.zeros((len(H), B.shape[1]))
        for rate in range(len(RATES)):  # position, velocity, acceleration
            at = order == rate
            C_out[at], D_out[at] = H[at] @ by_x, H[at] @ by_u
            by_x, by_u = by_x @ A, by_x @ B
        return A, B, C_out, D_out, frequencies


def _even(S: Array, n: int) -> tuple[Array, float]:
    """S = [[A, B], [C, D]] of n states in units that leave its zeros; its largest rate [1/s].

    A holds ones and squares of frequencies, 1e16 of a light link: QZ errs by the round-off of the
    largest entry, and slow zeros hang on less. Balanced, A holds rates. Units of inputs and outputs
    are free: B and C become as large as A, so that zeros do not hang on those units, and
    then all is balanced, since what an input moves may be small in one state and large in another.
    """
    unit = np.diag(matrix_balance(S[:n, :n], permute=False)[1])
    S = S.copy()
    S[:n] /= unit[:, None]
    S[:, :n] *= unit
    S = np.array(matrix_balance(_as_large(S, n), permute=False)[0])
    return _as_large(S, n), float(np.max(np.abs(S[:n, :n]), initial=0.0)) or 1.0


def _as_large(S: Array, n: int) -> Array:
    """Each input's column and then each output's row scaled to the largest entry of A."""
    fastest = float(np.max(np.abs(S[:n, :n]), initial=0.0)) or 1.0
    S = S.copy()
    for part in (S[:, n:], S[n:].T):
        size = np.max(np.abs(part), axis=0, initial=0.0)
        part *= fastest / np.where(size > 0.0, size, fastest)
    return S


def _state_matrices(
    P: Array, W: Array, matrices: tuple[Array, Array, Array], F: Array
) -> tuple[Array, Array]:
    """A and B of x = (p, theta, p', theta'): modes P, motors prescribed along W, their rates.

    Inputs are the accelerations of those motors, then forces F; `matrices` are M, C and K.
    """
    M, C, K = matrices
    n, nt = P.shape[1], W.shape[1]
    T, size = np.hstack([P, W]), n + nt
    A, B = np.zeros((2 * size, 2 * size)), np.zeros((2 * size, nt + F.shape[1]))
    A[:size, size:] = np.eye(size)
    A[size : size + n, :size], A[size : size + n, size:] = -P.T @ K @ T, -P.T @ C @ T
    B[size : size + n, :nt], B[size : size + n, nt:] = -P.T @ M @ W, P.T @ F
    B[size + n :, :nt] = np.eye(nt)
    return A, B


def _inputs(
    mechanism: Mechanism, dynamics: Equations, y: Array, driven: bool, forces: Sequence[str]
) -> tuple[Array, tuple[str, ...]]:
    """Generalised forces of unit inputs, (nv, inputs), without driven motors; names of all."""
    system, slides = mechanism.flexible, sliding(mechanism.rigid.rigid)
    key = "joint/a" if driven else "torque"
    push = np.eye(system.nv)[:, [] if driven else system.motors]
    rows = [_frame_row(mechanism, dynamics, y, text)[:, None] for text in forces]
    names = [f"{name} [{joint_unit(key, name in slides)}]" for name in mechanism.motors]
    names += [f"{text} [{'N m' if '.r' in text else 'N'}]" for text in forces]
    return np.hstack([push, *rows]), tuple(names)


def _kept(N: Array, K: Array, M: Array, modes: int | None) -> tuple[Array, Array, Array]:
    """Modes kept (nv, n), compliance of the others (nv, nv), frequencies of those kept [Hz]."""
    heavy, compliance, omega2 = condensed(N.T @ K @ N, N.T @ M @ N)
    order = np.argsort(omega2)
    heavy, omega2 = heavy[:, order], omega2[order]
    many = len(omega2)
    if modes is not None:
        rigid = int(np.sum(omega2 < 1e-9 * max(float(np.max(omega2)), 1e-300)))
        many = min(rigid + modes, many)
        left = heavy[:, many:]
        compliance = compliance + (left / omega2[many:]) @ left.T
    frequencies = np.sqrt(np.maximum(omega2[:many], 0.0)) / (2.0 * np.pi)
    return N @ heavy[:, :many], N @ compliance @ N.T, frequencies


def _followers(nv: int, motors: Any, free: Any, J: Array) -> Array:
    """Motion of every coordinate that follows the motors on the closures, shape (nv, nm)."""
    W = np.zeros((nv, len(motors)))
    W[motors] = np.eye(len(motors))
    if len(J):
        W[free] = -np.linalg.lstsq(J[:, free], J[:, motors], rcond=1e-12)[0]
    return W


def _usual_outputs(mechanism: Mechanism) -> tuple[str, ...]:
    frame = mechanism.description.platform
    platform = () if frame is None else tuple(f"{frame}.{axis}" for axis in AXES)
    return (*platform, *mechanism.motors)


def _split(text: str) -> tuple[str, int]:
    name, _, last = text.rpartition(".")
    return (name, RATES.index(last)) if name and last in RATES[1:] else (text, 0)


def _unit(text: str, slides: set[str]) -> str:
    name, rate = _split(text)
    if "@" in name:
        return "1/m"
    turns = name.rpartition(".")[2][0] == "r" if "." in name else name not in slides
    return ("rad" if turns else "m") + ("", "/s", "/s^2")[rate]


def _frame_row(mechanism: Mechanism, dynamics: Equations, y: Array, text: str) -> Array:
    """How a frame's point or rotation moves with the coordinates, shape (nv,)."""
    name, _, axis = text.rpartition(".")
    if axis not in AXES or not name:
        raise DescriptionError(
            f"{text}: write FRAME.AXIS with one of the axes {', '.join(AXES)}, or a joint's name."
        )
    here = mechanism.frame(name)
    return np.asarray(frame_jacobian(dynamics, y, here)[AXES.index(axis)])


def _output_rows(
    mechanism: Mechanism, dynamics: Equations, y: Array, wanted: Sequence[str]
) -> tuple[Array, Array]:
    """Rows of positions by velocity rows, shape (outputs, nv), and the order of each's rate."""
    rows, order = [], []
    for text in wanted:
        name, rate = _split(text)
        order.append(rate)
        if name in mechanism.coordinates:
            row = np.zeros(mechanism.flexible.nv)
            row[mechanism.coordinates.index(name)] = 1.0
        elif "@" in name:
            row = _curvature(mechanism, name)
        else:
            row = _frame_row(mechanism, dynamics, y, name)
        rows.append(row)
    return np.array(rows), np.array(order, dtype=int)


def _curvature(mechanism: Mechanism, text: str) -> Array:
    """Curvature of a flexible link's axis by velocity rows, shape (nv,)."""
    name, _, place = text.partition("@")
    link, _, what = name.rpartition(".")
    slots = [s for s in mechanism.flexible.expansion.slots if s.link == link]
    if not slots or what not in ("curvature_v", "curvature_w"):
        raise DescriptionError(
            f"{text}: write LINK.curvature_v@X or LINK.curvature_w@X with a flexible link."
            f"{nearest(link, mechanism.parts)}"
        )
    x = float(place)
    slot = next((s for s in slots if x <= s.offset + s.body.length * (1 + 1e-9)), slots[-1])
    row = np.zeros(mechanism.flexible.nv)
    start = int(mechanism.rigid.nv) + slot.eta.start
    fields = slot.body.fields(np.array([x - slot.offset]))
    row[start : start + slot.body.n] = fields[what][0]
    return row
