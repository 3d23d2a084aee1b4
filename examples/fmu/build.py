"""Builds an FMU from a model in C: python3 build.py; needs a C compiler (cc, or what CC names) and nothing else.

thermal.c becomes thermal.fmu, of FMI 3.0; with `--fmi 2`, of FMI 2.0.
"""

import argparse
import ctypes
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).parent
DESCRIPTIONS = {
    2: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{{{name}}}" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
{variables}
  </ModelVariables>
  <ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
""",
    3: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{{{name}}}">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
  <ModelVariables>
    <Float64 name="time" valueReference="{time}" causality="independent" variability="continuous"/>
{variables}
  </ModelVariables>
  <ModelStructure>{unknowns}</ModelStructure>
</fmiModelDescription>
""",
}
VARIABILITY = {"parameter": "fixed", "input": "continuous", "output": "continuous"}


def build(source, out, fmi=3):
    """Compile the model in `source` into the FMU `out`."""
    name = Path(source).stem
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{name}{'.dylib' if sys.platform == 'darwin' else '.so'}"
        sources = [str(source), str(HERE / f"fmi{fmi}.c")]
        options = ["-std=gnu11", "-O2", "-shared", "-fPIC", f"-I{HERE}", "-o", str(library)]
        subprocess.run([os.environ.get("CC", "cc"), *options, *sources, "-lm"], check=True)
        text = ctypes.c_char_p.in_dll(ctypes.CDLL(str(library)), "model_variables").value.decode()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", description(name, text, fmi))
            archive.write(library, f"binaries/{platform_name(fmi)}/{library.name}")


def description(name, text, fmi):
    variables = [line.split() for line in text.splitlines()]
    lines = [variable(fmi, number, *parts) for number, parts in enumerate(variables)]
    outputs = [number for number, parts in enumerate(variables) if parts[1] == "output"]
    if fmi == 2:
        unknowns = "".join(f'<Unknown index="{number + 1}"/>' for number in outputs)
    else:  # all outputs stand before all initial unknowns
        kinds = ("Output", "InitialUnknown")
        unknowns = "".join(f'<{kind} valueReference="{number}"/>' for kind in kinds for number in outputs)
    return DESCRIPTIONS[fmi].format(name=name, variables="\n".join(lines), unknowns=unknowns, time=len(variables))


def variable(fmi, number, name, causality, start):
    shared = f'name="{name}" valueReference="{number}" causality="{causality}" variability="{VARIABILITY[causality]}"'
    given = ' initial="calculated"' if causality == "output" else ""
    start = "" if causality == "output" else f' start="{start}"'
    if fmi == 2:
        return f"    <ScalarVariable {shared}{given}><Real{start}/></ScalarVariable>"
    return f"    <Float64 {shared}{given}{start}/>"


def platform_name(fmi):
    """The folder of the binaries, as each version of the standard calls it."""
    system = "darwin" if sys.platform == "darwin" else "linux"
    if fmi == 2:
        return f"{system}64"
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-{system}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fmi", type=int, choices=(2, 3), default=3)
    chosen = parser.parse_args()
    build(HERE / "thermal.c", HERE / "thermal.fmu", chosen.fmi)
    print(f"wrote {HERE / 'thermal.fmu'}")
