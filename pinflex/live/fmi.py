"""modelDescription.xml of an FMU: FMI 2.0 or 3.0, co-simulation."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Slot
from pinflex.results.quantities import joint_unit
from pinflex.text import frozen

# What a robot without Python tells and is told: names, units and the tables behind them.

STATIONS = 9  # of a beam, where its stress is looked at: as in source/robot.h


@dataclass(frozen=True)
class Signal:
    """A number that goes in or out.

    Attributes:
        name: As in the table of a result. unit: SI. meaning: In words.
    """

    name: str
    unit: str
    meaning: str


@frozen
class Outputs:
    """What a robot tells, in the order of `Model` in source/robot.h, and the tables behind it.

    Attributes:
        signals: Torque, position and speed of motors, pose of frames, deflection of tips, stress of
            beams.
        tables, numbers: Arrays and numbers of `Model`, by field.
        carried: The frame that carries a mass, which is a parameter, and that mass at first [kg].
    """

    signals: tuple[Signal, ...]
    tables: dict[str, npt.NDArray[Any]]
    numbers: dict[str, float]
    carried: tuple[str, float] | None


def commands(mechanism: Mechanism, pushed: bool) -> tuple[Signal, ...]:
    """What a step is given: torques of the motors, or their motion."""
    kinds = ("torque",) if pushed else ("position", "velocity", "acceleration")
    return tuple(_of_motors(mechanism, kinds, "command ", " at the end of a step"))


def _of_motors(
    mechanism: Mechanism, kinds: Sequence[str], head: str = "", tail: str = ""
) -> list[Signal]:
    """Quantities of the motors, kind by kind."""
    return [
        Signal(
            f"{head}{kind} {name}", _motor_unit(mechanism, kind, name), f"{kind} of {name}{tail}"
        )
        for kind in kinds
        for name in mechanism.motors
    ]


def outputs_of(mechanism: Mechanism) -> Outputs:
    """What is told of a mechanism."""
    system, platform = mechanism.loose, mechanism.description.platform
    names, beams = mechanism.description.reported, _whole(mechanism)
    signals = _of_motors(mechanism, ("torque", "position", "velocity"))
    for name in names:
        head = "platform" if name == platform else f"frame {name}"
        for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            what = "origin" if k < 3 else "rotation vector"
            signals.append(
                Signal(f"{head} {axis}", "m" if k < 3 else "rad", f"{what} of {name}, {axis[-1]}")
            )
    signals += [
        Signal(f"deflection {x.link} {d}", "m", f"of the end of {x.link}, along its {a}")
        for x in beams
        for d, a in zip("uvw", "xyz", strict=True)
    ]
    signals += [
        Signal(f"stress {x.link}", "Pa", f"largest normal stress of {x.link}, by its strains")
        for x in beams
    ]
    frames = [system.expansion.frames[name] for name in names]
    places = [np.column_stack([x.placement.rotation, x.placement.translation]) for x in frames]
    tips = [x.body.rows(x.body.length) for x in beams]
    rows = [part[:3].ravel() for tip in tips for part in tip if part is not None]
    rims = [np.array(mechanism.parts[x.link].spec.section.fibres, np.float64) for x in beams]
    at = _whole_numbers(int(system.rigid.nq) + x.eta.start for x in beams)
    n = _whole_numbers(x.body.n for x in beams)
    carried, carrier, place = _carried(mechanism)
    tables = {
        "frame_node": _whole_numbers(system.node_of_joints[x.joint] for x in frames),
        "frame_place": np.array(places).reshape(-1, 12),
        "tip_at": at, "tip_n": n, "tip_curved": _whole_numbers(G is not None for _, G in tips),
        "tip_rows": _in_a_row(rows), "beam_at": at, "beam_n": n,
        "beam_fibres": _whole_numbers(map(len, rims)),
        "beam_rows": _in_a_row([_strains(mechanism, x) for x in beams]),
        "beam_rim": _in_a_row(rims), **place,
    }  # fmt: skip
    counts = {"frames": len(frames), "tips": len(beams), "beams": len(beams)}
    return Outputs(tuple(signals), tables, counts | carrier, carried)


def _whole_numbers(values: Iterable[int]) -> IntArray:
    return np.array([*values], dtype=np.intp)


def _in_a_row(parts: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros(0), *(x.ravel() for x in parts)])


def _whole(mechanism: Mechanism) -> list[Slot]:
    """Beams of one body: the end of one in segments is off a root that is not its own."""
    slots, parts = mechanism.loose.expansion.slots, mechanism.parts
    return [x for x in slots if len(parts[x.link].bodies) == 1 and x.body.solid is None]


def _strains(mechanism: Mechanism, slot: Slot) -> Array:
    """E u', -E v'' and -E w'' at stations by the coordinates of a beam, shape (stations, 3, n)."""
    E = mechanism.parts[slot.link].spec.material.E
    fields = slot.body.fields(np.linspace(0.0, slot.body.length, STATIONS))
    none = np.zeros((STATIONS, slot.body.n))
    each = (("axial", E), ("curvature_v", -E), ("curvature_w", -E))
    return np.stack([factor * fields.get(key, none) for key, factor in each], axis=1)


def _carried(
    mechanism: Mechanism,
) -> tuple[tuple[str, float] | None, dict[str, float], dict[str, Array]]:
    """What the YAML says is carried, or nothing yet, at the platform; its numbers and tables."""
    system, payload = mechanism.loose, mechanism.description.payload
    frame = mechanism.description.platform if payload is None else payload.frame
    at = None if frame is None else system.expansion.frames.get(frame)
    node = -1 if at is None else int(system.node_of_joints[at.joint])
    if frame is None or at is None or node < 0:
        return None, {"payload_node": -1, "payload_mass": 0.0}, {}
    mass, centre, inertia = 0.0, at.placement.translation, np.zeros((3, 3))
    if payload is not None and payload.mass > 0.0:
        R, mass = at.placement.rotation, payload.mass
        centre, inertia = centre + R @ np.array(payload.centre), R @ payload.tensor @ R.T / mass
    numbers = {"payload_node": node, "payload_mass": mass}
    return (frame, mass), numbers, {"payload_place": centre, "payload_inertia": inertia}


def _motor_unit(mechanism: Mechanism, kind: str, motor: str) -> str:
    """Unit of a quantity of a motor: m and N where it slides."""
    slides = mechanism.joints[motor].kind == "prismatic"
    keys = {"position": "joint/q", "velocity": "joint/v", "acceleration": "joint/a"}
    return joint_unit(keys.get(kind, kind), slides)


# Units by name, with the exponents of SI base units.
_UNITS = {
    "N m": 'kg="1" m="2" s="-2"', "N": 'kg="1" m="1" s="-2"', "rad": 'rad="1"', "m": 'm="1"',
    "rad/s": 'rad="1" s="-1"', "m/s": 'm="1" s="-1"', "rad/s^2": 'rad="1" s="-2"',
    "m/s^2": 'm="1" s="-2"', "Pa": 'kg="1" m="-1" s="-2"', "kg": 'kg="1"', "s": 's="1"',
}  # fmt: skip
_INPUT = 'causality="input" variability="continuous"'
_OUTPUT = 'causality="output" variability="continuous" initial="calculated"'
_TIME = Signal("time", "s", "time")
_LONGEST = 100  # characters of an identifier: file names have an end


@frozen
class Description:
    """What an FMU says of itself.

    Attributes:
        name: Of the model. dt: Step [s].
        inputs, starts: What a step is given, and the values at the start.
        outputs: What it tells.
        parameters: What is set at first, with the values that they have.
        tables: Text of model.c, of which the identity is made.
        version: Of the standard, 2 or 3.
    """

    name: str
    dt: float
    inputs: Sequence[Signal]
    starts: Sequence[float]
    outputs: Sequence[Signal]
    parameters: Sequence[tuple[Signal, float]]
    tables: str
    version: int = 2

    @property
    def identifier(self) -> str:
        """Name of the library: letters that C takes."""
        word = re.sub(r"[^0-9A-Za-z_]", "_", self.name)[:_LONGEST]
        return word if word[:1].isalpha() else f"robot_{word}"

    @property
    def guid(self) -> str:
        """The same for the same model, another one for another."""
        return "{" + hashlib.sha256((self.name + self.tables).encode()).hexdigest()[:32] + "}"

    def identity(self) -> str:
        """A line of C: what the library looks for when it is instantiated."""
        return f'const char robot_guid[] = "{self.guid}";\n'

    def xml(self) -> str:
        """The file."""
        return self._second() if self.version == 2 else self._third()

    def _variables(self, write: Callable[..., str]) -> str:
        """Inputs, outputs and parameters, by their numbers."""
        fixed = 'causality="parameter" variability="fixed" initial="exact"'
        given = [
            *((x, _INPUT, float(v)) for x, v in zip(self.inputs, self.starts, strict=True)),
            *((x, _OUTPUT, None) for x in self.outputs),
            *((x, fixed, value) for x, value in self.parameters),
        ]
        return "".join(write(k, *one) for k, one in enumerate(given))

    @property
    def _units(self) -> str:
        every = (*self.inputs, *self.outputs, *(x for x, _ in self.parameters), _TIME)
        return "".join(_unit(name) for name in sorted({one.unit for one in every} - {""}))

    @property
    def _told(self) -> range:
        """Numbers of the outputs."""
        return range(len(self.inputs), len(self.inputs) + len(self.outputs))

    def _second(self) -> str:
        unknowns = "".join(f'      <Unknown index="{k + 1}"/>\n' for k in self._told)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(self.name)} guid="{self.guid}"
  generationTool="pinflex" variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{self.identifier}" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUstate="true" canNotUseMemoryManagementFunctions="true"
    providesDirectionalDerivative="true"/>
  <UnitDefinitions>
{self._units}  </UnitDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="{self.dt!r}"/>
  <ModelVariables>
{self._variables(_scalar)}  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}    </Outputs>
    <InitialUnknowns>
{unknowns}    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""

    def _third(self) -> str:
        time = self._told.stop + len(self.parameters)
        role = 'causality="independent" variability="continuous"'
        kinds = ("Output", "InitialUnknown")
        unknowns = "".join(
            f'    <{kind} valueReference="{k}"/>\n' for kind in kinds for k in self._told
        )
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(self.name)}
  instantiationToken="{self.guid}" generationTool="pinflex" variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{self.identifier}" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUState="true" providesDirectionalDerivatives="true"
    fixedInternalStepSize="{self.dt!r}"/>
  <UnitDefinitions>
{self._units}  </UnitDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="{self.dt!r}"/>
  <ModelVariables>
{self._variables(_number)}{_number(time, _TIME, role)}  </ModelVariables>
  <ModelStructure>
{unknowns}  </ModelStructure>
</fmiModelDescription>
"""


def _unit(name: str) -> str:
    return f"    <Unit name={quoteattr(name)}><BaseUnit {_UNITS[name]}/></Unit>\n"


def _scalar(reference: int, one: Signal, role: str, start: float | None = None) -> str:
    """A variable of FMI 2.0."""
    return (
        f'    <ScalarVariable name={quoteattr(one.name)} valueReference="{reference}"\n'
        f"      description={quoteattr(one.meaning)} {role}>\n"
        f"      <Real{_has(one, start)}/></ScalarVariable>\n"
    )


def _number(reference: int, one: Signal, role: str, start: float | None = None) -> str:
    """A variable of FMI 3.0."""
    return (
        f'    <Float64 name={quoteattr(one.name)} valueReference="{reference}"\n'
        f"      description={quoteattr(one.meaning)} {role}{_has(one, start)}/>\n"
    )


def _has(one: Signal, start: float | None) -> str:
    unit = f" unit={quoteattr(one.unit)}" if one.unit else ""
    return unit + ("" if start is None else f' start="{start!r}"')
