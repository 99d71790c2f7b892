"""pinflex: rigid-flexible multibody dynamics on Pinocchio, from a URDF and one small YAML.

    import pinflex as pf

    robot = pf.load("3rrr")
    rigid = pf.solve(robot, level="rigid")
    flexible = pf.solve(robot, level="coupled")
    print(flexible.deviation_from(rigid, "platform").max())

Quantities are SI, angles radians, arrays time-first. Notation: q rigid coordinates, eta elastic
ones, y = (q, eta), lam closure multipliers.

Where the code is; each package imports only those above it:

    description   what the files say: URDF and YAML, checked and frozen
    results       what a run leaves behind, by name: arrays, views, comparison; no Pinocchio
    bodies        a flexible link as stations on few coordinates: beams, modes, reduced solids
    kernel        the equations compiled: C code, its build, its tables; arrays only
    mechanics     the mechanism as equations: load, expanded model, closures, loads, dynamics
    actuation     what moves it: motors, the nominal motion, prescribed and controlled torques
    integrators   steps in time: schemes, Newton, Radau, error control; the raw states of a run
    levels        rigid, quasistatic, ked, coupled; where a run starts; linear vibration
    recovery      from states to named quantities: poses, forces, stresses, validity
    solver        one call to a run: level, step or tolerance; going on
    live          one step at a time: the simulator in the loop, its sensors, C sources, FMU
    advice        which level, links, planes, modes and tolerance a scene needs; error bars
    inversion     motor motions that the flexible robot's platform follows; linear models
    quickest      the fastest motion that keeps limits and does not shake; what it is measured by
    viewer        a result as a page, pictures, films and figures; reads `results` alone
    browser       a page that solves its scene again: the kernel as WebAssembly, sliders
    studies       many runs of one scene: sweep, map of poses, work and precision; the check
    variation     derivatives, best parameters, scatter, and a fit to measurements
    lab           published cases that `pinflex verify` measures
    cli           the commands: what each says of itself, its options, and what it does

Beside them stand arrays, boundary, doors, errors, linalg, names, progress, registered,
report, rotations, text, threads and writing, which import none of these; `doors` calls by name
what a package further down does, such as the figure of a result. Names are imported when first
used, so that a page from a saved run needs no Pinocchio.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pinflex.advice.advise import advise
    from pinflex.advice.reduced_models import Advice
    from pinflex.advice.solve import LEVELS, solve
    from pinflex.browser.page import live_page
    from pinflex.description.blocks.control import (
        Control,
        Deflection,
        Effort,
        Travel,
        Voltage,
        digital_pid,
        pid,
    )
    from pinflex.description.motions.motion import (
        Motion,
        circle,
        cycloid,
        formula,
        harmonic,
        hold,
        nonic,
        quintic,
        ruckig,
        sampled,
        scurve,
        spin_up,
        trajectory,
        trapezoid,
    )
    from pinflex.description.motions.trajectory import adept, moves
    from pinflex.errors import (
        AssemblyError,
        ConvergenceError,
        DescriptionError,
        MotionError,
        PinflexError,
        SceneError,
        SingularityError,
    )
    from pinflex.integrators.collocation import generalized_alpha, hht, newmark
    from pinflex.inversion.command import Command, command
    from pinflex.inversion.linear_model import LinearModel, linearise
    from pinflex.inversion.verify import track
    from pinflex.levels.modes import Modes, modes
    from pinflex.levels.quasistatic import (
        Equilibrium,
        UnstableWarning,
        static_equilibrium,
    )
    from pinflex.levels.rigid import inverse_dynamics
    from pinflex.levels.ringing import ringing
    from pinflex.levels.start import linear_statics
    from pinflex.live.export import export_c, export_fmu
    from pinflex.live.sensors import Encoder, Imu, StrainGauge
    from pinflex.live.simulator import Simulator
    from pinflex.mechanics.mechanism import Mechanism, load
    from pinflex.quickest.fastest import Fastest, fastest
    from pinflex.quickest.retime import Retimed, retime
    from pinflex.results.comparison import comparison
    from pinflex.results.result import Result
    from pinflex.solver.solve import recompute
    from pinflex.studies.checking.check import Check, check
    from pinflex.studies.frequency_response import FrequencyResponse, frequency_response
    from pinflex.studies.margins import Margins, margins
    from pinflex.studies.play import play, play_map
    from pinflex.studies.pose import platform_compliance
    from pinflex.studies.pose_map import pose_map
    from pinflex.studies.study import Study, compare
    from pinflex.studies.sweep import batch, sweep
    from pinflex.variation.design import Design
    from pinflex.variation.fit import Fit, fit
    from pinflex.variation.optimise import design, pareto
    from pinflex.variation.scatter import Scatter, scatter
    from pinflex.variation.sensitivity import Sensitivities, sensitivities
    from pinflex.viewer.view import view

__all__ = [
    "LEVELS",
    "Advice",
    "AssemblyError",
    "Check",
    "Command",
    "Control",
    "ConvergenceError",
    "Deflection",
    "DescriptionError",
    "Design",
    "Effort",
    "Encoder",
    "Equilibrium",
    "Fastest",
    "Fit",
    "FrequencyResponse",
    "Imu",
    "LinearModel",
    "Margins",
    "Mechanism",
    "Modes",
    "Motion",
    "MotionError",
    "PinflexError",
    "Result",
    "Retimed",
    "Scatter",
    "SceneError",
    "Sensitivities",
    "Simulator",
    "SingularityError",
    "StrainGauge",
    "Study",
    "Travel",
    "UnstableWarning",
    "Voltage",
    "adept",
    "advise",
    "batch",
    "check",
    "circle",
    "command",
    "compare",
    "comparison",
    "cycloid",
    "design",
    "digital_pid",
    "export_c",
    "export_fmu",
    "fastest",
    "fit",
    "formula",
    "frequency_response",
    "generalized_alpha",
    "harmonic",
    "hht",
    "hold",
    "inverse_dynamics",
    "linear_statics",
    "linearise",
    "live_page",
    "load",
    "margins",
    "modes",
    "moves",
    "newmark",
    "nonic",
    "pareto",
    "pid",
    "platform_compliance",
    "play",
    "play_map",
    "pose_map",
    "quintic",
    "recompute",
    "retime",
    "ringing",
    "ruckig",
    "sampled",
    "scatter",
    "scurve",
    "sensitivities",
    "solve",
    "spin_up",
    "static_equilibrium",
    "sweep",
    "track",
    "trajectory",
    "trapezoid",
    "view",
]

_HOME = {
    "description.blocks.control": (
        "Control",
        "Deflection",
        "Effort",
        "Travel",
        "Voltage",
        "digital_pid",
        "pid",
    ),
    "description.motions.motion": (
        "Motion",
        "circle",
        "cycloid",
        "formula",
        "harmonic",
        "hold",
        "nonic",
        "quintic",
        "ruckig",
        "sampled",
        "scurve",
        "spin_up",
        "trajectory",
        "trapezoid",
    ),
    "description.motions.trajectory": (
        "adept",
        "moves",
    ),
    "errors": (
        "AssemblyError",
        "ConvergenceError",
        "DescriptionError",
        "MotionError",
        "PinflexError",
        "SceneError",
        "SingularityError",
    ),
    "integrators.collocation": (
        "generalized_alpha",
        "hht",
        "newmark",
    ),
    "inversion.command": (
        "Command",
        "command",
    ),
    "inversion.linear_model": (
        "LinearModel",
        "linearise",
    ),
    "inversion.verify": ("track",),
    "levels.modes": (
        "Modes",
        "modes",
    ),
    "levels.quasistatic": (
        "Equilibrium",
        "UnstableWarning",
        "static_equilibrium",
    ),
    "levels.rigid": ("inverse_dynamics",),
    "levels.ringing": ("ringing",),
    "levels.start": ("linear_statics",),
    "live.export": (
        "export_c",
        "export_fmu",
    ),
    "live.sensors": (
        "Encoder",
        "Imu",
        "StrainGauge",
    ),
    "live.simulator": ("Simulator",),
    "mechanics.mechanism": (
        "Mechanism",
        "load",
    ),
    "quickest.fastest": (
        "Fastest",
        "fastest",
    ),
    "quickest.retime": (
        "Retimed",
        "retime",
    ),
    "results.comparison": ("comparison",),
    "results.result": ("Result",),
    "advice.advise": ("advise",),
    "advice.reduced_models": ("Advice",),
    "advice.solve": (
        "LEVELS",
        "solve",
    ),
    "variation.design": ("Design",),
    "variation.fit": (
        "Fit",
        "fit",
    ),
    "variation.optimise": (
        "design",
        "pareto",
    ),
    "variation.scatter": (
        "Scatter",
        "scatter",
    ),
    "variation.sensitivity": (
        "Sensitivities",
        "sensitivities",
    ),
    "studies.checking.check": (
        "Check",
        "check",
    ),
    "studies.study": (
        "Study",
        "compare",
    ),
    "studies.frequency_response": (
        "FrequencyResponse",
        "frequency_response",
    ),
    "studies.sweep": (
        "batch",
        "sweep",
    ),
    "studies.margins": (
        "Margins",
        "margins",
    ),
    "studies.play": (
        "play",
        "play_map",
    ),
    "studies.pose_map": ("pose_map",),
    "studies.pose": ("platform_compliance",),
    "solver.solve": ("recompute",),
    "viewer.view": ("view",),
    "browser.page": ("live_page",),
}
# Words of other toolkits, and what is called so here.
_MEANT = {
    "animate": "view",
    "bode": "frequency_response",
    "eig": "modes",
    "eigenmodes": "modes",
    "frf": "frequency_response",
    "integrate": "solve",
    "linearize": "linearise",
    "load_urdf": "load",
    "map": "pose_map",
    "modal": "modes",
    "monte_carlo": "scatter",
    "natural_frequencies": "modes",
    "optimise": "design",
    "optimize": "design",
    "read": "load",
    "run": "solve",
    "sensitivity": "sensitivities",
    "show": "view",
    "simulate": "solve",
    "state_space": "linearise",
    "stiffness": "platform_compliance",
}
_MODULE = {name: f"pinflex.{module}" for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first used (PEP 562)."""
    if name == "__version__":
        return import_module("pinflex.recovery.meta").version()
    if name not in _MODULE:
        said = f"module 'pinflex' has no attribute {name!r}.{_nearest(name)}"
        raise AttributeError(said, name=name, obj=None)  # else Python adds a guess of its own
    value = globals()[name] = getattr(import_module(_MODULE[name]), name)
    return value


def _nearest(name: str) -> str:
    """The public name that a guess means, in a sentence; "" for what Python itself looks up."""
    from difflib import get_close_matches

    if name.startswith("_"):
        return ""
    found = [_MEANT[name]] if name in _MEANT else get_close_matches(name, __all__, 1, 0.7)
    return "".join(f" Did you mean pf.{one}?" for one in found)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
