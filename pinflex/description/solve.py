"""The block `solve` of a description, and the same options given to `pf.solve` in Python."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from pinflex import registered
from pinflex.description.reading import schema
from pinflex.errors import DescriptionError, nearest
from pinflex.text import frozen

LEVELS = ("rigid", "quasistatic", "ked", "coupled")
ASKED = ("torque", "deflection", "platform")
TOLERANCES = (1e-9, 0.1)  # least and largest tol; a scene may have a higher floor: a run finds it
KED_TERMS = ("full", "structural")
DRIVES = ("prescribed", "torque")
STARTS = ("auto", "straight", "static")
Speeds = tuple[tuple[str, tuple[float | None, ...]], ...]  # by name of a joint or link


@dataclass(frozen=True)
class Integrator:
    """An integrator that a scene can name.

    Attributes:
        name: Value of the key `integrator`.
        keys: Further keys of `solve` that have a meaning for it; a function takes them by name.
        only: The one level that it serves; None: every level that marches in time.
        method: An `AlphaScheme`, a `Collocation` (coupled, with tol) or a function (ked); None: of
            the march itself.
    """

    name: str
    keys: tuple[str, ...] = ()
    only: str | None = None
    method: Any = None


INTEGRATORS: dict[str, Integrator] = {
    row.name: row
    for row in (
        Integrator("generalized_alpha", ("rho_inf",)),
        Integrator("newmark", ("newmark",)),
        Integrator("hht", ("rho_inf",)),
        Integrator("radau", only="coupled"),
    )
}


def register_integrator(integrator: Integrator) -> None:
    """Add an integrator; from then on `integrator: NAME` is read and solved.

    Raises:
        DescriptionError: The name is taken, or there is no method.
    """
    where = f"integrator {integrator.name}"
    if integrator.name in INTEGRATORS:
        raise DescriptionError(f"{where}: there is one of that name. Choose another.")
    if integrator.method is None:
        raise DescriptionError(f"{where}: no method. Give a scheme, a tableau or a function.")
    INTEGRATORS[integrator.name] = integrator
    registered.note(register_integrator, integrator.name, integrator)


def _newmark(value: object, where: str) -> tuple[float, float]:
    gamma, beta = schema.numbers(value, where, 2, low=0)
    if gamma > 1 or not 0 < beta <= 1:
        raise DescriptionError(
            f"{where}: gamma = {gamma:g}, beta = {beta:g} are out of range. "
            "Allowed: 0 <= gamma <= 1 and 0 < beta <= 1; only gamma >= 1/2 can be stable."
        )
    return gamma, beta


def _speeds(value: object, where: str) -> Speeds:
    """Names with a speed, or a list of them; null leaves a component open."""
    found = []
    for name, item in schema.mapping(value, where).items():
        place = schema.at(where, name)
        entries = item.tolist() if isinstance(item, np.ndarray | np.generic) else item
        values = entries if isinstance(entries, list | tuple) else [entries]
        numbers = (None if x is None else schema.number(x, place, of="speed") for x in values)
        found.append((str(name), tuple(numbers)))
    return tuple(found)


def _word(value: object, where: str, words: Collection[str]) -> Any:
    """A word; in Python also an object (scheme, run, states), which the level looks at."""
    if not isinstance(value, str | int | float | list | dict):
        return value
    return schema.choice(value, where, words)


@frozen
class SolveSpec:
    """What to compute.

    Attributes:
        level: rigid, quasistatic, ked or coupled.
        until: End time [s]; None: the duration of the motion.
        dt: Time step [s]; None: chosen from the motion and the frequencies.
        samples: Number of instants to report; None: every step.
        tol: Error of time integration that torques, platform and deflections may have, relative to
            their largest deviation; steps follow from it. None: steps of dt.
        asked: Which of torque, deflection and platform tol is about; empty: all.
        integrator: generalized_alpha, newmark or hht; at level coupled also radau, with tol; or one
            that is registered. None: radau where a tol is asked for and it can, else
            generalized_alpha. In Python also an `AlphaScheme`, a `Collocation` (coupled, with tol)
            or a function (ked).
        rho_inf: Spectral radius at infinity [-], 0 to 1; None: the integrator's own.
        newmark: (gamma, beta) [-] of the integrator newmark; None: (1/2, 1/4).
        ked: Terms of level ked: full, or structural (M, the beams' K and the damping alone, the
            classical method).
        drive: prescribed (the motors follow the motion) or torque (they push).
        kp: Position gain of the torque drive [N m/rad | N/m].
        kd: Speed gain of the torque drive [N m s/rad | N s/m].
        start: straight (undeformed), static (in equilibrium), or auto (static where something
            acts and an equilibrium exists). In Python also, for level coupled, a run or
            (run, time [s]): from its state then; or (y, v): coordinates and velocities.
        start_speeds: Speeds at the start of joints without a prescribed motion [rad/s | m/s], and
            velocities of links' origins in the world [m/s]; level coupled.
    """

    level: str = schema.word("coupled", LEVELS)
    until: float | None = schema.real(None, "time", above=0)
    dt: float | None = schema.real(None, "time", above=0)
    samples: int | None = schema.whole(None, 2)
    tol: float | None = schema.real(None, low=TOLERANCES[0], high=TOLERANCES[1])
    asked: tuple[str, ...] = schema.words(ASKED, "output")
    integrator: Any = schema.key(
        None, partial(_word, words=INTEGRATORS), form=lambda: {"enum": [*INTEGRATORS]}
    )
    rho_inf: float | None = schema.real(None, low=0, high=1)
    newmark: tuple[float, float] | None = schema.key(None, _newmark, form=schema.LIST)
    ked: str = schema.word("full", KED_TERMS)
    drive: str = schema.word("prescribed", DRIVES)
    kp: float = schema.real(0.0, "stiffness", low=0)
    kd: float = schema.real(0.0, "damping", low=0)
    start: Any = schema.key("auto", partial(_word, words=STARTS), form={"enum": [*STARTS]})
    start_speeds: Speeds = schema.key((), _speeds, form={"type": "object"})

    @property
    def _named(self) -> Integrator | None:
        return INTEGRATORS.get(self.integrator) if isinstance(self.integrator, str) else None

    @property
    def method(self) -> Any:
        """The integrator given as a value or registered by its name; else its name, or None."""
        row = self._named
        return self.integrator if row is None or row.method is None else row.method

    @property
    def method_options(self) -> dict[str, Any]:
        """The keys of the named integrator that are written, by name."""
        values = {key: getattr(self, key) for key in (self._named.keys if self._named else ())}
        return {key: value for key, value in values.items() if value is not None}

    @property
    def only(self) -> str | None:
        """The one level that the named integrator serves, if it is one."""
        return self._named.only if self._named else None

    @property
    def by_steps(self) -> str:
        """Name of the integrator of equal steps."""
        given = self.integrator
        if given is None or isinstance(given, str):
            return given or "generalized_alpha"
        return str(getattr(given, "name", getattr(given, "__name__", type(given).__name__)))


KEYS = schema.keys(SolveSpec)


def read_solve(value: object, where: str) -> SolveSpec:
    """The block `solve`; a key without effect is an error."""
    block = schema.Block(value, where, KEYS)
    spec = _spec(SolveSpec(), block)
    if spec.until is not None and spec.dt is not None and spec.dt > spec.until:
        raise block.error(
            "dt",
            f"{spec.dt:g} s is longer than the run, until = {spec.until:g} s. Make it smaller.",
        )
    if {"tol", "dt"} <= block.keys():
        raise block.error("tol", "dt follows from it. Remove one of them.")
    _require_effect(spec, block)
    return spec


def _require_effect(spec: SolveSpec, block: schema.Block) -> None:
    """Raise where a written key has no effect beside the level, integrator or drive."""
    if spec.only == "ked" and spec.level != "ked":
        raise block.error(
            "integrator",
            f"{spec.integrator} is for linear systems: level ked only. Write `level: ked`, or "
            "integrator: generalized_alpha.",
        )
    if "ked" in block and spec.level != "ked":
        raise block.error("ked", "only for `level: ked`. Add it, or remove this.")
    used = INTEGRATORS[spec.by_steps].keys
    for key in (key for row in INTEGRATORS.values() for key in row.keys):
        if key in block and key not in used:
            raise block.error(
                key, f"has no meaning for the integrator {spec.by_steps}. Remove one of them."
            )
    if spec.drive != "torque":
        block.only(("kp", "kd"), "only for `drive: torque`. Add it, or remove this.")


def with_options(spec: SolveSpec, options: Mapping[str, Any]) -> SolveSpec:
    """The block of a scene with options of `pf.solve` in place of its own, checked as in a file."""
    given = _given(options)
    if given.get("level", spec.level) not in LEVELS:  # of `auto`, `pf.solve` makes one of them
        shown = schema.shown(given["level"])
        hint = nearest(str(given["level"])[:80], (*LEVELS, "auto"))
        raise DescriptionError(f"solve.level: {shown} is not known.{hint}")
    if {"tol", "dt"} <= given.keys():
        raise DescriptionError("solve: dt and tol: one follows from the other. Give one of them.")
    # One asked for here takes the place of the other in the YAML.
    if "tol" in given:
        spec = replace(spec, dt=None)
    elif "dt" in given:
        spec = replace(spec, tol=None)
    spec = _spec(spec, given)
    if spec.only == "ked" and spec.level == "coupled":
        raise DescriptionError(
            f"solve.integrator: {spec.integrator} is for linear systems: level ked only. "
            'Take level="ked", or integrator="generalized_alpha".'
        )
    if "rho_inf" in given and spec.integrator == "newmark":
        raise DescriptionError(
            "solve.rho_inf: has no meaning for the integrator newmark, which this scene names. "
            'Add integrator="generalized_alpha".'
        )
    return spec


def _given(options: Mapping[str, Any]) -> schema.Block:
    """The options that say something, in Python's own types; an unknown one is an error."""
    for key in options:
        if key not in KEYS:
            raise DescriptionError(f"solve: {key}: no such option.{nearest(key, sorted(KEYS))}")
    plain = {k: v.item() if isinstance(v, np.generic) else v for k, v in options.items()}
    return schema.Block(plain, "solve", KEYS, before="solve.")


def _spec(spec: SolveSpec, block: schema.Block) -> SolveSpec:
    """The spec with the written keys read into it; Newmark's coefficients name their integrator."""
    values = block.read()
    if "newmark" in values:
        values.setdefault("integrator", "newmark")
    return replace(spec, **values)
