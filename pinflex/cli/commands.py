"""The commands: what each says of itself, its options, and the module that does it."""

from __future__ import annotations

from functools import partial

from pinflex.cli.options import (
    MODEL,
    PAYLOAD,
    POSE,
    PRELOAD,
    TABLE,
    VERBOSE,
    Command,
    count,
    flag,
    names,
    number,
    option,
    parameter,
    port,
    pose,
    positive,
    repeated,
    samples,
    small_length,
    stress,
)

SUMMARIES = {  # in the order of the help
    "check": "how pinflex reads a model: freedoms, loops, masses, sag, warnings",
    "modes": "natural frequencies and mode shapes at a pose",
    "advise": "the level, links, planes, modes and tolerance that a scene needs",
    "command": "the motor motion with which the platform follows its path",
    "move": "the shortest motion that keeps limits and leaves the platform still",
    "shapers": "input shapers for the motion: the time they cost, the ringing they leave",
    "frf": "frequency response from a motor or force to motors and platform",
    "solve": "one run at one level",
    "compare": "rigid against flexible: shaking, torques, stress, the level that suffices",
    "sweep": "many cases of a scene in one table",
    "map": "natural frequencies and platform stiffness over poses",
    "sensitivity": "the effect of one per cent more of a parameter on outputs, in per cent",
    "design": "the numbers that minimise an output while others keep their limits",
    "fit": "the numbers that explain measured frequencies, responses or histories",
    "bench": "time against error on a scene",
    "export": "the robot as an FMU, or as C sources",
    "view": "an animation of a saved run",
    "verify": "published benchmarks on this machine",
    "import": "write a YAML for a robot in another format",
    "new": "write a YAML to start from, for a URDF",
    "schema": "the JSON Schema of a YAML file, for editors",
    "completion": "a script with which a shell completes commands, options and models",
}
SHELLS = ("bash", "zsh")
_file = partial(option, metavar="FILE")

CHECK = Command(
    ("vibration", "run_check"),
    """
Prints the mobility, loops with their rank and redundant rows, sigma_min, masses of beams and of the
URDF, the planes in which links bend and why, the static sag of the platform, holding torques, the
first natural frequencies, and warnings.""",
    "pinflex check 3rrs\n  pinflex check arm/arm.yaml --set gravity.2=-1.62",
    (
        "count",
        flag("--write-home", "write the closed pose into the YAML as `home`; all other lines stay"),
    ),
    "check",
)
MODES = Command(
    ("vibration", "run_modes"),
    """
By default linearises about the static equilibrium under gravity, with the motors locked.""",
    "pinflex modes 3rrs --preload none\n"
    "  pinflex modes 3rrr --pose motor_1=1.7,motor_2=3.5 --view modes.html",
    (
        "count",
        PRELOAD,
        parameter("free_motors", help="let the motors swing"),
        POSE,
        option(
            "--spin", type=pose, default={}, metavar="MOTOR=SPEED,...",
            help="about a steady motion from home: speeds of motors in rad/s or m/s, the others "
            "rest",
        ),
        option(
            "--at", type=number, metavar="TIME",
            help="about the motion of the YAML at a time in s, as if it stayed as it is then",
        ),
        option("--view", metavar="FILE.html", help="write the shapes as a page for a browser"),
        option(
            "--map", metavar="FILE.png",
            help="write a figure of the frequencies along the motion (.png, .pdf, .svg)",
        ),
    ),
    "modes",
)  # fmt: skip
ADVISE = Command(
    ("vibration", "run_advise"),
    """
Measures along the motion, by cheap linear runs of a richer model (every plane, stretch, twist, one
more mode), what each level and each thing left out costs, and proposes the least that keeps the
errors within a tolerance, with an error bar on each output. Errors are relative to the largest
value; of the platform, to its largest deviation from the rigid motion. A short coupled run holds
them to the full equations. A torque alone often needs no flexible link: ask for what you need. The
last lines say what weakens the advice. `pinflex solve MODEL --level auto` follows it as far as the
level and the step.""",
    "pinflex advise race_r1 --asked torque --tol 0.03\n  pinflex advise 3rrs --tol 1e-2 --json",
    ("tol", parameter("band", type=small_length), "asked", VERBOSE, "until"),
    "advise",
)
COMMAND = Command(
    ("motions", "run_command"),
    """
Finds the motor motion that makes the platform, not the motors, follow the motion of the YAML
although links and joints deform, and writes it for a controller. Level exact inverts the whole
motion at once; quasistatic is cheaper and suffices where vibrations are fast against the motion.
--verify runs level coupled with this command and with the rigid one, and reports both errors.""",
    "pinflex command delta -o command.csv --verify",
    (
        _file(
            "-o", "--output",
            help="write t, motor motion and torques: .csv, or a JointTrajectory: .yaml, .json",
        ),
        option(
            "--rate", type=positive, metavar="HZ",
            help="rate of the rows of -o, such as 1000 (default: the instants of the solution)",
        ),
        parameter(
            "level", choices=("rigid", "quasistatic", "exact"),
            help="rigid, quasistatic or exact (default)",
        ),
        "tol",
        parameter("before", help="rest ahead of the motion [s]; default: from the dynamics"),
        parameter("after", help="rest after it [s]; default: from the dynamics"),
        "instants",
        parameter(
            "limited", "--beyond-limits", action="store_false",
            help="do not refuse what the URDF limits forbid",
        ),
        flag("--verify", "run level coupled with it and with the rigid one"),
        _file("--plot", help="with --verify: a figure of both (.png, .pdf, .svg)"),
        flag(
            "--off",
            "platform error and residual swing with payload, stiffness and friction 5 %% off",
        ),
        option("--view", metavar="FILE.html", help="with --verify: a page that plays both"),
    ),
    "command",
)  # fmt: skip
MOVE = Command(
    ("motions", "run_move"),
    """
Finds the shortest motion, from rest to rest, that keeps speed, acceleration, jerk, torque, stress
and path limits (of URDF, drives or options) and leaves the platform within a distance of its
resting place from the end on. Linear programmes about coupled runs of the flexible robot propose
motions until the runs themselves keep all limits. --like takes the limits of a quintic of that
duration (six times its jerk); with --robust the same motion must leave a heavier and a lighter
robot just as still; --baselines adds the usual profiles and shapers for comparison; --off shows
the effect of payload, stiffness and friction 5 % off. With --robot, MODEL is a trajectory instead
(CSV, or a JointTrajectory as YAML or JSON): the command runs the same path as fast as the limits of
the rigid robot allow, with --shaper shaped.""",
    "pinflex move delta --to x=0.305 --to y=0 --to z=0 --like 0.3 --settle 50um",
    (
        repeated("--to", "NAME=VALUE,...", "displacements of motors or the platform: SI, mm, deg"),
        option("--robot", metavar="ROBOT", help="retime the trajectory MODEL for this robot"),
        option("--shaper", choices=("zv", "zvd", "ei"), help="shape what --robot retimes"),
        parameter(
            "settle", type=small_length, metavar="X",
            help="distance from rest that counts as still, such as 50um",
        ),
        *(
            option(f"--{name}", type=type_, metavar="X", help=text)
            for name, text, type_ in (
                ("speed", "speed of what moves, m/s or rad/s", positive),
                ("acceleration", "its acceleration, SI", positive),
                ("jerk", "its jerk, SI (default: six times a quintic's)", positive),
                ("torque", "torque of every motor, N m or N (default: the URDF's)", positive),
                ("stress", "von Mises stress of every flexible link, such as 120MPa", stress),
                ("path", "how far the platform may be off its path, such as 1mm", small_length),
            )
        ),
        option("--like", type=positive, metavar="S", help="take the limits of a quintic this long"),
        repeated("--robust", "NAME=SHARE", "payload=20%%, stiffness=10%% or friction=20%%"),
        parameter(
            "intervals", type=count, metavar="N", help="intervals of constant jerk (default 40)"
        ),
        flag("--baselines", "add the usual motions for comparison"),
        flag("--off", "add a table of robots whose numbers are 5 %% off"),
        _file("--plot", help="a figure (.png, .pdf, .svg)"),
        _file("--page", help="a page (.html) on which it races the usual motions"),
        _file(
            "-o", "--output",
            help="write motor positions, velocities, accelerations; .yaml or .json: a "
            "JointTrajectory",
        ),
        option("--rate", type=positive, metavar="HZ", help="rate of its rows (default 1000)"),
    ),
    "fastest",
)  # fmt: skip
SHAPERS = Command(
    ("vibration", "run_shapers"),
    """
Finds the modes (motors locked) that the motion of the YAML excites. For ZV, ZVD and EI shapers at
their frequencies it shows how much longer the motion takes, and what share of the vibration remains
if the frequencies are up to 20 % off. `shaper: zvd` in the motion applies one.""",
    "pinflex shapers delta\n  pinflex solve delta --set motion.shaper=zvd",
    (
        option(
            "--modes", type=count, default=None, metavar="N",
            help="how many modes to cancel, those within 5 %% count once (default: up to 3 that "
            "leave more than 1 %% of what the loudest does)",
        ),
    ),
)  # fmt: skip
FRF = Command(
    ("vibration", "run_frf"),
    """
Linearises about the static equilibrium. The zeros show what feedback can do: a collocated pair
has its zeros left of the axis or on it (minimum phase) and can be damped; a zero right of it
limits the bandwidth. --measured draws a measured response (CSV: frequency, OUTPUT.magnitude,
OUTPUT.phase [deg]; or a record: t, INPUT, OUTPUT) beside it, with coherence and agreement.""",
    "pinflex frf delta -o frf.png\n"
    "  pinflex frf ur5 --input tool0.z --outputs tool0.z.acceleration --motors acceleration",
    (
        parameter("source", "--input", metavar="NAME",
                  help="a motor, or a force FRAME.x ... FRAME.rz (default: the first motor)"),
        parameter(
            "outputs", metavar="NAME,...",
            help="a joint or FRAME.AXIS, each with .velocity or .acceleration as wanted "
            "(default: the input's own motion, and the platform)",
        ),
        parameter(
            "motors", choices=("torque", "acceleration"), metavar=None,
            help="torque: motors are free (default); acceleration: they are prescribed",
        ),
        POSE,
        *(
            option(
                f"--{name}", type=positive, metavar="HZ", dest=f"{text}_frequency",
                help=f"{text} frequency in Hz (default: about the first six modes)",
            )
            for name, text in (("from", "first"), ("to", "last"))
        ),
        parameter("measured", metavar="FILE.csv", help="a measured response or record"),
        _file("-o", "--output", help="write a figure (.png, .pdf, .svg) or .csv"),
    ),
    "frequency_response",
)  # fmt: skip
SOLVE = Command(
    ("runs", "run_solve"),
    """
The levels, from cheapest to most faithful, are rigid, quasistatic, ked (linear vibration) and
coupled (everything). A run that stops early is saved up to its last good step.""",
    "pinflex solve 3rrr --level coupled --dt 1e-4 -o run.npz\n"
    "  pinflex solve arm.yaml --set flexible.*.section.thickness=1e-3 --csv run.csv",
    (
        "level",
        "until",
        ("dt", "tol"),
        (
            parameter("samples", type=samples, metavar="N"),
            option(
                "--rate", type=positive, metavar="HZ", help="instants per second, not --samples"
            ),
        ),
        parameter(
            "resume", metavar="RUN.npz", help="go on with a stopped or shorter run, to --until"
        ),
        option("-o", "--output", metavar="RUN.npz", help="save the run"),
        option(
            "--checkpoint", type=positive, metavar="S",
            help="save the run to -o every S seconds; --resume goes on with it",
        ),
        option("--csv", metavar="FILE.csv", help="save the main columns as a table"),
    ),
    "solve",
)  # fmt: skip
COMPARE = Command(
    ("runs", "run_compare"),
    """
Solves the scene rigid and flexible. Prints how far and how long the platform shakes, how far rigid
torques are off, the stresses, and the simplest level that suffices; writes tables, figures, the
runs and an animation. If one level cannot be solved, the others still are.""",
    "pinflex compare delta\n  pinflex compare arm.yaml -o out --levels ked,coupled --band 10um",
    (
        parameter(
            "folder", "-o", "--output", metavar="DIR", help="folder (default NAME-compare)"
        ),
        parameter("levels", help="beside rigid: quasistatic, ked, coupled (default all)"),
        parameter("band", type=small_length),
        "tol",
        "errors",
        flag(
            "--interactive",
            "sliders in the animation: level coupled runs anew in the browser, offline",
        ),
        VERBOSE,
    ),
    "compare",
)  # fmt: skip
SWEEP = Command(
    ("cases", "run_sweep"),
    """
Solves the scene for every combination of the values given. Values are a:b:n (n from a to b),
a:b:n:log (by equal factors) or v,w,... A case that fails gets a row with the reason. FILE.journal
records each case as it ends: if the command is stopped or killed, the same command continues from
there. Once all cases are solved it deletes the journal.""",
    "pinflex sweep ur5 --set flexible.*.section.wall=2e-3:5e-3:7 \\\n"
    "      --set motion.duration=0.4,0.6 --level quasistatic --out sweep.csv",
    (
        MODEL,
        repeated(
            "--set", "KEY=VALUES",
            "values of a key of the YAML, which may have globs; may be repeated",
        ),
        PAYLOAD,
        parameter("paired", "--zip", help="pair the values instead of combining them all"),
        parameter("level", help="rigid, quasistatic, ked or coupled (default: the YAML's)"),
        parameter(
            "outputs", type=names, metavar="A,B,...",
            help="torque, deviation, stress, frequency, cost, validity (default all)",
        ),
        option(
            "--random", type=count, metavar="N",
            help="random designs instead of combinations, at most N: quantiles and Sobol indices",
        ),
        repeated(
            "--normal", "KEY=MEAN:STD", "with --random: normal; or KEY=2%% about its value"
        ),
        repeated("--uniform", "KEY=A:B", "with --random: between A and B; or KEY=2%%"),
        option("--seed", type=int, default=1, help="of the random numbers (default 1)"),
        _file("--plot", help="with --random: histograms and shares, .png"),
        *TABLE,
    ),
    "sweep",
    (),
)  # fmt: skip
MAP = Command(
    ("cases", "run_map"),
    """
Grids are displacements from home: of the platform's x, y, z [m], rz, ry, rx [rad], or of motors.
Coordinates that are not named stay as at home. A frequency's column follows one mode shape from
pose to pose. The 6x6 stiffness is that of the platform in world axes, motors
locked: K_xx (others held) and 1/C_xx (others free); rigid where nothing gives way.""",
    "pinflex map 3rrr --grid x=-.05:.05:9 --grid y=-.05:.05:9 --out map.csv --plot map.png",
    (
        repeated("--grid", "COORDINATE=A:B:N", "values of a coordinate; may be repeated"),
        parameter("instants", help="poses of the motion, evenly in time, instead of a grid"),
        "count",
        PRELOAD,
        "free_motors",
        option(
            "--play", nargs="?", const="", metavar="CLEARANCE",
            help="instead, where the platform can be without motors moving: the clearance of loops "
            "and the backlash of drives, or this clearance (50um) in every pin and ball",
        ),
        option("--plot", metavar="FILE.png", help="write a figure (.png, .pdf, .svg)"),
        *TABLE,
    ),
    "pose_map",
)  # fmt: skip
SENSITIVITY = Command(
    ("designs", "run_sensitivity"),
    """
Differentiates outputs by numbers of the YAML: frequencies, mass, sag, stiffness, and the peaks of a
run. Links that the YAML writes in one block are one parameter.""",
    "pinflex sensitivity delta --by 'flexible.*.section.*' --of frequency.1 --of mass",
    (
        repeated("--by", "KEY", "key of a number in the YAML, may have globs; repeatable"),
        repeated(
            "--of", "OUTPUT",
            "frequency.N, mass, sag, stiffness.AXIS, deviation.peak, torque.peak|rms[.MOTOR], "
            "stress.peak, stress.yield; may be repeated",
        ),
        "level",
        _file("--plot", help="write a tornado chart, .png or .pdf"),
    ),
    "sensitivities",
)  # fmt: skip
DESIGN = Command(
    ("designs", "run_design"),
    """
Varies numbers of the YAML between bounds. Limits are OUTPUT < NUMBER or OUTPUT > NUMBER, where
NUMBER*base is a share of the first design and NUMBER*yield one of the strength. With -o every
design is kept in FILE.journal: stopped or killed, the same command goes on from there.""",
    "pinflex design delta --minimise mass --vary 'flexible.*.section.wall=0.6e-3:4e-3' \\\n"
    "      --keep 'frequency.1 > base' --keep 'deviation.peak < base' -o lighter.yaml",
    (
        option("--minimise", "--minimize", required=True, metavar="OUTPUT", help="such as mass"),
        option("--against", metavar="OUTPUT", help="a second aim: designs between the two"),
        repeated("--vary", "KEY=LOW:HIGH", "number of the YAML, may have globs; repeatable"),
        repeated("--keep", "LIMIT", "such as 'frequency.1 > 12'; may be repeated"),
        repeated(
            "--choose", "KEY=V,W,...|FILE.csv",
            "values to choose from, or rows of a catalogue whose columns are keys below KEY",
        ),
        parameter("level", help="of the runs outputs need (default quasistatic)"),
        parameter("starts", help="searches (2)"),
        "jobs",
        _file("-o", "--output", help="write the YAML of the best design"),
        _file("--plot", help="write how the search went, .png or .pdf"),
    ),
    "design",
)  # fmt: skip
FIT = Command(
    ("designs", "run_fit"),
    """
MEASURED is a CSV with a line of column names:
  frequency, std, mode, FRAME.x ...                natural frequencies [Hz] at home, motors locked;
                                                   shapes say which mode is which
  frequency, OUTPUT/INPUT.real, OUTPUT/INPUT.imag  frequency responses
  t, joint.NAME, torque.NAME, FRAME.x ...          time histories
or a universal file (.uff, .unv) of frequency responses. NAME.std is a standard deviation.""",
    "pinflex fit ur5 hammer.csv --vary 'flexible.*.material.E' -o fitted.yaml --plot fit.png",
    (
        option("measured", metavar="MEASURED", help="CSV or universal file"),
        repeated(
            "--vary", "KEY[=LOW:HIGH]",
            "number of the YAML, may have globs; repeatable (bounds: a tenth to ten times)",
        ),
        repeated(
            "--prior", "KEY~SHARE",
            "how well the number is known as given, such as 5%%; repeatable",
        ),
        parameter("shape_std", type=float),
        "level",
        "dt",
        "simultaneous",
        repeated("--node", "N=FRAME", "frame of a node of a universal file; repeatable"),
        _file("-o", "--output", help="write the fitted YAML"),
        _file("--plot", help="write measured against fitted, .png or .pdf"),
    ),
    "fit",
)  # fmt: skip
BENCH = Command(
    ("bench", "run_bench"),
    """
Solves the scene by every level, by more and fewer internal modes, by several integrators and steps,
and compares time and error with a converged solution that it refines until two runs agree.
With --worst it takes single steps of the robot in the loop (pf.Simulator) along its motion and
back, and prints their cost: median, high quantiles and maximum, in thread CPU time.""",
    "pinflex bench 3rrs -o out\n  pinflex bench ur5 --worst --dt 2.5e-4",
    (
        option("model", nargs="?", metavar="MODEL", help="YAML file, its folder, or a name"),
        repeated("--set", "KEY=VALUE", "change the YAML; may be repeated"),
        option("-o", "--output", metavar="DIR", help="write table, numbers and figure there"),
        VERBOSE,
        flag("--worst", "the cost of single steps in the loop"),
        option(
            "--steps", type=int, metavar="N", help="number of steps of --worst (default: 1000000)"
        ),
        option(
            "--dt", type=positive, metavar="S", help="step of --worst in s (default: 1e-3)"
        ),
    ),
    shared=(),
)  # fmt: skip
EXPORT = Command(
    ("motions", "run_export"),
    """
Writes the robot in equal steps, with its tables and its start, as an FMU (FMI 2.0 or 3.0,
co-simulation) or as C sources with a main: the steps are those of pf.Simulator, without Python.
What moves the motors comes from outside. Variables have the names and units of the table of a
run.""",
    "pinflex export ur5 --fmu ur5.fmu\n  pinflex export delta --c delta_c --inputs motion",
    (
        option("--fmu", metavar="FILE.fmu", help="write an FMU"),
        option("--c", metavar="DIR", help="write C sources"),
        option("--dt", type=positive, default=1e-3, metavar="S", help="step (1e-3 s)"),
        option(
            "--inputs", choices=("torque", "motion"), default="torque",
            help="what moves the motors: their torque (default), or position, speed and "
            "acceleration",
        ),
        option(
            "--every", type=count, metavar="N",
            help="steps between two tangents at the most (default: one where iterations are slow)",
        ),
        parameter(
            "platforms", metavar="NAME,...",
            help="linux64, win64, darwin64, and with --fmi 3 linux-arm, darwin-arm: made by the "
            "pip package ziglang (default: this machine)",
        ),
        option(
            "--fmi", type=int, choices=(2, 3), default=2,
            help="version of the standard (default: 2)",
        ),
        POSE,
    ),
    "export_fmu",
)  # fmt: skip
VIEW = Command(
    ("runs", "run_view"),
    """
Writes one page that plays in any browser, offline, and opens it. Several runs of one robot share
the page, which switches, overlays and subtracts them; the last is shown first.

With --live-page and a model in place of runs the page has sliders (payload, speed of the move,
damping) and solves the scene again in the browser at every move of one.""",
    "pinflex view run.npz --field bending --scale 20\n"
    "  pinflex view run.npz --png worst --gif\n"
    "  pinflex view delta-compare/*.npz\n"
    "  pinflex view delta --live-page delta.html",
    (
        option(
            "runs", metavar="RUN.npz", nargs="+",
            help="from `pinflex solve -o` or `pinflex compare`; with --live-page a MODEL",
        ),
        option("-o", "--output", metavar="FILE.html", help="default: beside the run"),
        option(
            "--field", default="von_mises", metavar="NAME",
            help="colour: von_mises, bending, axial, shear or displacement",
        ),
        option("--scale", default="auto", metavar="X", help="magnification (default auto)"),
        option(
            "--limit", type=positive, metavar="X", help="read runs of up to X times 2 GB"
        ),
        option("--rigid", metavar="RUN.npz", help="rigid run to compare with"),
        repeated("--meshes", "DIR", "folder with the URDF's meshes; may be repeated"),
        option(
            "--live-page", metavar="FILE.html",
            help="write a page that solves MODEL again as sliders move (pip install "
            "'pinflex[page]')",
        ),
        repeated(
            "--set", "KEY=VALUE", "with --live-page: change the YAML; may be repeated"
        ),
        flag("--no-open", "only write the page"),
        option("--png", metavar="T", help="also a picture at T s, or at the worst instant"),
        flag("--gif", "also a film as .gif"),
        flag("--mp4", "also a film as .mp4 (needs ffmpeg)"),
        option(
            "--serve", nargs="?", const=0, type=port, metavar="PORT",
            help="serve the page to this machine only, until Ctrl-C (default: a free port)",
        ),
        flag("--live", "play in meshcat, this machine only, until Ctrl-C"),
    ),
    shared=(),
)  # fmt: skip
VERIFY = Command(
    ("bench", "run_verify"),
    """
Runs beams, rotating beams, closed loops and large deflection against published or exact references
and prints measured, reference, error and limit; takes about two minutes, with --long more.""",
    "pinflex verify\n  pinflex verify A02 Princeton -o verify.html",
    (
        option("cases", nargs="*", metavar="CASE", help="parts of case names (default all)"),
        flag("--long", "also cases that take minutes"),
        option("-o", "--output", metavar="FILE.html", help="write a page with plots"),
    ),
    shared=(),
)
IMPORT = Command(
    ("files", "run_import"),
    """
SOURCE is a URDF, an MJCF (MuJoCo), an SDF, a xacro, the robot.yaml of Gepetto's parallel robots,
or example-robot-data:NAME. The YAML lists joints and motors, the loops of the file with their
closed home pose, and what is not taken over from it. In comments it proposes loops that the file
leaves open and flexible links with guessed sections. It loads as it is.""",
    "pinflex import cassie.xml -o cassie.yaml\n  pinflex import robot.urdf --flexible shin",
    (
        option("source", metavar="SOURCE", help="the robot's file"),
        _file("-o", "--out", "--output", help="the YAML (default: NAME.yaml beside it)"),
        repeated("--flexible", "LINK", "let this link bend, with a guessed section"),
        repeated("--arg", "NAME=VALUE", "argument of a xacro; may be repeated"),
        flag("--force", "replace FILE if it is there"),
    ),
    shared=(),
)
NEW = Command(IMPORT.run, IMPORT.text, "pinflex new robot.urdf", IMPORT.options, shared=())
SCHEMA = Command(
    ("files", "run_schema"),
    """
An editor that knows YAML schemas completes keys and words and marks what is none: write
`# yaml-language-server: $schema=pinflex.schema.json` in the first line of a YAML.""",
    "pinflex schema -o pinflex.schema.json",
    (_file("-o", "--out", "--output", help="write it there"),),
    shared=(),
)
COMPLETION = Command(
    ("files", "run_completion"),
    """
Needs the package shtab: pip install "pinflex[completion]". The line of the example stays where it
stands in ~/.bashrc (zsh: with `zsh` in ~/.zshrc, behind compinit).""",
    'eval "$(pinflex completion bash)"',
    (option("shell", choices=SHELLS, metavar="SHELL", help=" or ".join(SHELLS)),),
    shared=(),
)

COMMANDS = dict(zip(SUMMARIES, (
    CHECK, MODES, ADVISE, COMMAND, MOVE, SHAPERS, FRF, SOLVE, COMPARE, SWEEP, MAP, SENSITIVITY,
    DESIGN, FIT, BENCH, EXPORT, VIEW, VERIFY, IMPORT, NEW, SCHEMA, COMPLETION,
), strict=True))  # fmt: skip
