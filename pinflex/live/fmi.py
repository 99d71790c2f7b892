"""modelDescription.xml of an FMU: FMI 2.0 or 3.0, co-simulation."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from pinflex.live.outputs import Signal
from pinflex.text import brief

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
