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
    bodies        a flexible link as stations on few coordinates: beams, modes, reduced solids
    mechanics     the mechanism as equations: load, expanded model, closures, loads, dynamics
    actuation     what moves it: motors, the nominal motion, prescribed and controlled torques
    levels        rigid, quasistatic, ked, coupled; their steps in time; linear vibration
    results       what a run leaves behind, and what is recovered from it: forces, stresses
    solver        one call to a result: level, step or tolerance; going on; advice
    viewer        a result as a page, pictures, films and figures
    studies       many runs of one scene: comparison, sweep, map of poses; the check of a model
    benchmarks    published cases, work and precision, the race
    cli           the commands, whose arguments `__main__` reads

Beside them stand errors, arrays, text, threads and writing, which import none of these.
"""

from pinflex.description.control import Control, Deflection, Effort, Travel, Voltage, pid
from pinflex.description.motion import (
    Motion,
    circle,
    cycloid,
    formula,
    harmonic,
    hold,
    quintic,
    sampled,
    spin_up,
    trapezoid,
)
from pinflex.errors import (
    AssemblyError,
    ConvergenceError,
    DescriptionError,
    MotionError,
    PinflexError,
    SceneError,
    SingularityError,
)
from pinflex.levels.integrators import generalized_alpha, hht, newmark
from pinflex.levels.modes import Modes, modes
from pinflex.levels.quasistatic import (
    Equilibrium,
    UnstableWarning,
    linear_statics,
    static_equilibrium,
)
from pinflex.levels.rigid import inverse_dynamics
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.results.comparison import comparison
from pinflex.results.result import Result
from pinflex.solver.advise import Advice, advise
from pinflex.solver.solve import LEVELS, solve
from pinflex.studies.pose_map import pose_map
from pinflex.studies.stiffness import platform_compliance
from pinflex.studies.sweep import sweep
from pinflex.viewer.view import view

__all__ = [
    "LEVELS",
    "Advice",
    "AssemblyError",
    "Control",
    "ConvergenceError",
    "Deflection",
    "DescriptionError",
    "Effort",
    "Equilibrium",
    "Mechanism",
    "Modes",
    "Motion",
    "MotionError",
    "PinflexError",
    "Result",
    "SceneError",
    "SingularityError",
    "Travel",
    "UnstableWarning",
    "Voltage",
    "advise",
    "circle",
    "comparison",
    "cycloid",
    "formula",
    "generalized_alpha",
    "harmonic",
    "hht",
    "hold",
    "inverse_dynamics",
    "linear_statics",
    "load",
    "modes",
    "newmark",
    "pid",
    "platform_compliance",
    "pose_map",
    "quintic",
    "sampled",
    "solve",
    "spin_up",
    "static_equilibrium",
    "sweep",
    "trapezoid",
    "view",
]
