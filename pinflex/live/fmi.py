"""modelDescription.xml of an FMU: FMI 2.0 or 3.0, co-simulation."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Slot
from pinflex.results.quantities import joint_unit
from pinflex.text import brief

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


@dataclass(frozen=True)
class Outputs:
    """Tables of `Model` in source/robot.h, and the names of what they tell, in its order.

    Attributes:
        signals: Torque, position and speed of motors, pose of frames, deflection of tips, stress of
            beams.
        frame_node, frame_place: Nodes of frames, and [R | p] in them, shapes (k,), (k, 12).
        tip_at, tip_n, tip_curved: Of tips: first coordinate in y, number, whether with G.
        tip_rows: Phi (3, n) and G (3, n, n) of each, in a row.
        beam_at, beam_n, beam_fibres: Of beams: first coordinate, number, points of the rim.
        beam_rows: E u', -E v'', -E w'' at stations (3, n), one after the other.
        beam_rim: y, z of the points of the rim, one after the other.
        carried: What is carried, as a parameter, or None.
    """

    __repr__ = brief

    signals: tuple[Signal, ...]
    frame_node: IntArray
    frame_place: Array
    tip_at: IntArray
    tip_n: IntArray
    tip_curved: IntArray
    tip_rows: Array
    beam_at: IntArray
    beam_n: IntArray
    beam_fibres: IntArray
    beam_rows: Array
    beam_rim: Array
    carried: Carried | None


@dataclass(frozen=True)
class Carried:
    """A mass that a frame carries.

    Attributes:
        frame: Its name. mass: At first, kg. node: Of the tree of the kernel.
        place: Its centre in the axes of the node, m. inertia: About it, of a kg, (3, 3), m^2.
    """

    frame: str
    mass: float
    node: int
    place: Array
    inertia: Array


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
    signals = _of_motors(mechanism, ("torque", "position", "velocity"))
    places, nodes = [], []
    for name in mechanism.description.reported:
        head = "platform" if name == platform else f"frame {name}"
        for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
            what = "origin" if k < 3 else "rotation vector"
            signals.append(
                Signal(f"{head} {axis}", "m" if k < 3 else "rad", f"{what} of {name}, {axis[-1]}")
            )
        here = system.expansion.frames[name]
        nodes.append(int(system.node_of_joints[here.joint]))
        place = here.placement
        places.append(np.column_stack([place.rotation, place.translation]).ravel())
    at, n, curved, rows = [], [], [], [np.zeros(0)]
    for slot in _whole(mechanism):
        Phi, G = slot.body.rows(slot.body.length)
        at.append(int(system.rigid.nq) + slot.eta.start)
        n.append(slot.body.n)
        curved.append(int(G is not None))
        rows += [Phi[:3].ravel()] + ([] if G is None else [G[:3].ravel()])
        signals += [
            Signal(f"deflection {slot.link} {d}", "m", f"of the end of {slot.link}, along its {a}")
            for d, a in zip("uvw", "xyz", strict=True)
        ]
    beams = _beams(mechanism)
    signals += [
        Signal(f"stress {link}", "Pa", f"largest normal stress of {link}, by its strains")
        for link in dict.fromkeys(beams[0])
    ]
    return Outputs(
        tuple(signals), np.array(nodes, dtype=np.intp),
        np.array(places).reshape(-1, 12), np.array(at, dtype=np.intp),
        np.array(n, dtype=np.intp), np.array(curved, dtype=np.intp), np.concatenate(rows),
        *beams[1:], _carried(mechanism),
    )  # fmt: skip


def _whole(mechanism: Mechanism) -> list[Slot]:
    """Beams of one body: the end of one in segments is off a root that is not its own."""
    slots, parts = mechanism.loose.expansion.slots, mechanism.parts
    return [x for x in slots if len(parts[x.link].bodies) == 1 and x.body.solid is None]


def _beams(mechanism: Mechanism) -> tuple[list[str], IntArray, IntArray, IntArray, Array, Array]:
    """Links of one beam each, and the tables of their stress."""
    names, at, n, fibres, rows, rims = [], [], [], [], [np.zeros(0)], [np.zeros(0)]
    for slot in _whole(mechanism):
        part = mechanism.parts[slot.link]
        x = np.linspace(0.0, slot.body.length, STATIONS)
        fields, none = slot.body.fields(x), np.zeros((STATIONS, slot.body.n))
        E, section = part.spec.material.E, part.spec.section
        each = (("axial", E), ("curvature_v", -E), ("curvature_w", -E))
        stacked = np.stack([factor * fields.get(key, none) for key, factor in each], axis=1)
        names.append(slot.link)
        at.append(int(mechanism.loose.rigid.nq) + slot.eta.start)
        n.append(slot.body.n)
        fibres.append(len(section.fibres))
        rows.append(stacked.ravel())
        rims.append(np.array(section.fibres, dtype=np.float64).ravel())
    lists = (np.array(x, dtype=np.intp) for x in (at, n, fibres))
    return names, *lists, np.concatenate(rows), np.concatenate(rims)  # type: ignore[return-value]


def _carried(mechanism: Mechanism) -> Carried | None:
    """What the YAML says is carried, or nothing yet, at the platform."""
    system, payload = mechanism.loose, mechanism.description.payload
    frame = mechanism.description.platform if payload is None else payload.frame
    place = None if frame is None else system.expansion.frames.get(frame)
    if frame is None or place is None:
        return None
    node = int(system.node_of_joints[place.joint])
    if node < 0:
        return None
    R, p = place.placement.rotation, place.placement.translation
    if payload is None or payload.mass <= 0.0:
        return Carried(frame, 0.0, node, p, np.zeros((3, 3)))
    inertia = R @ payload.tensor @ R.T / payload.mass
    return Carried(frame, payload.mass, node, p + R @ np.array(payload.centre), inertia)


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


@dataclass(frozen=True)
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

    __repr__ = brief

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
