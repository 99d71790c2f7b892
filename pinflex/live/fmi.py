"""modelDescription.xml of an FMU: FMI 2.0, co-simulation."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from pinflex.live.outputs import Signal
from pinflex.text import brief

# Units by name, with the exponents of SI base units.
_UNITS = {
    "N m": 'kg="1" m="2" s="-2"', "N": 'kg="1" m="1" s="-2"', "rad": 'rad="1"', "m": 'm="1"',
    "rad/s": 'rad="1" s="-1"', "m/s": 'm="1" s="-1"', "rad/s^2": 'rad="1" s="-2"',
    "m/s^2": 'm="1" s="-2"',
}  # fmt: skip
_LONGEST = 100  # characters of an identifier: file names have an end


@dataclass(frozen=True)
class Description:
    """What an FMU says of itself.

    Attributes:
        name: Of the model. dt: Step [s].
        inputs, starts: What a step is given, and the values at the start.
        outputs: What it tells.
        tables: Text of model.c, of which the identity is made.
    """

    __repr__ = brief

    name: str
    dt: float
    inputs: Sequence[Signal]
    starts: Sequence[float]
    outputs: Sequence[Signal]
    tables: str

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
        first = len(self.inputs)
        last = first + len(self.outputs)
        damping = Signal("damping", "", "factor on the damping of joints and links, set at first")
        variables = [
            _variable(k, one, 'causality="input" variability="continuous"', float(start))
            for k, (one, start) in enumerate(zip(self.inputs, self.starts, strict=True))
        ]
        variables += [
            _variable(k, one, 'causality="output" variability="continuous" initial="calculated"')
            for k, one in enumerate(self.outputs, first)
        ]
        fixed = 'causality="parameter" variability="fixed" initial="exact"'
        variables.append(_variable(last, damping, fixed, 1.0))
        units = sorted({one.unit for one in (*self.inputs, *self.outputs)})
        unknowns = "".join(f'      <Unknown index="{k + 1}"/>\n' for k in range(first, last))
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(self.name)} guid="{self.guid}"
  generationTool="pinflex" variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{self.identifier}" canHandleVariableCommunicationStepSize="true"
    canGetAndSetFMUstate="true" canNotUseMemoryManagementFunctions="true"/>
  <UnitDefinitions>
{"".join(_unit(name) for name in units)}  </UnitDefinitions>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="{self.dt!r}"/>
  <ModelVariables>
{"".join(variables)}  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}    </Outputs>
    <InitialUnknowns>
{unknowns}    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _unit(name: str) -> str:
    return f"    <Unit name={quoteattr(name)}><BaseUnit {_UNITS[name]}/></Unit>\n"


def _variable(reference: int, one: Signal, role: str, start: float | None = None) -> str:
    unit = f" unit={quoteattr(one.unit)}" if one.unit else ""
    begins = "" if start is None else f' start="{start!r}"'
    return (
        f'    <ScalarVariable name={quoteattr(one.name)} valueReference="{reference}"\n'
        f"      description={quoteattr(one.meaning)} {role}>\n"
        f"      <Real{unit}{begins}/></ScalarVariable>\n"
    )
