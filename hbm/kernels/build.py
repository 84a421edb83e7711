"""The kernels as one C file, and whether a library compiled from it is right: while installing.

casadi writes each kernel as straight-line C for one frame. Here its text is rewritten so that every
number becomes a vector with one SIMD lane per frame (``simd.h``). The rewriting relies on what
casadi's code looks like, so a compiled library is compared with casadi's virtual machine.
"""

import os
import re
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

from hbm.coordinates import MOVING, N_Q
from hbm.kernels.kernel import CONSTANT_INPUTS, N_GEOMETRY, N_SUMS, Kernel, kernel_sizes
from hbm.kernels.native import FOLDER, compiled_kernels, interpreted_kernels, sources_digest
from hbm.kernels.skeleton import casadi_function
from hbm.spatial import Array

MAX_BLOCK_LINES: Final = 500
"""Compilers work on one block of code at a time and take much longer than in proportion to its
length: LLVM a minute for a whole kernel, four seconds for blocks of this length."""

MAX_DIFFERENCE: Final = 1e-9
"""Largest difference of compiled and interpreted kernels, as a share of a kernel's largest output:
far above rounding (1e-13), far below what a wrong operation would cause."""

TEST_FRAMES: Final = 35
"""Random poses that are compared: several full blocks of SIMD lanes and a part of one."""

TEST_DAMPING: Final = 1e4
"""Added to the Hessian of random marker sums: without it the matrix may be nearly singular, and its
solution mostly rounding."""

LOOP: Final = """
EXPORT void {name}_frames(long long frames, const double *const *in, double *const *out) {{
  static const int size_in[] = {{{size_in}}}, constant[] = {{{constant}}};
  static const int size_out[] = {{{size_out}}};
  simd workspace[{workspace}];
  evaluate_frames({name}, frames, {inputs}, size_in, constant, {outputs}, size_out, in, out,
                  workspace);
}}
"""

CONSTANTS: Final = """
EXPORT const char sources_digest[] = "{digest}";
enum {{ N_Q = {n_q}, MOVING = {moving}, SUMS = {sums}, GEOMETRY = {geometry} }};
"""


def write_source(folder: Path) -> Path:
    """Write the kernels and the loops over frames as one C file, and give the file.

    The compiler has to state ``LANES``, the frames that are evaluated at once.
    """
    header, descent = ((FOLDER / name).read_text("utf-8") for name in ("simd.h", "descent.c"))
    constants = CONSTANTS.format(
        digest=sources_digest(),
        n_q=N_Q,
        moving=len(MOVING),
        sums=N_SUMS,
        geometry=N_GEOMETRY,
    )
    parts = [header, constants]
    for name, constant in CONSTANT_INPUTS.items():
        size_in, size_out = kernel_sizes(name)
        parts += [
            simd_source(casadi_function(name), folder),
            LOOP.format(
                name=name,
                size_in=", ".join(map(str, size_in)),
                constant=", ".join(str(int(i in constant)) for i in range(len(size_in))),
                size_out=", ".join(map(str, size_out)),
                workspace=sum(size_in) + sum(size_out),
                inputs=len(size_in),
                outputs=len(size_out),
            ),
        ]
    source = folder / "kernels.c"
    source.write_text("\n".join([*parts, descent]), encoding="utf-8")
    return source


def simd_source(function: Any, folder: Path) -> str:
    """Give a casadi function as C that evaluates one frame in each SIMD lane.

    Empty jumps end the blocks (see `MAX_BLOCK_LINES`).
    """
    name = function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    generator.generate(f"{folder}{os.sep}")
    text = (folder / f"{name}.c").read_text()
    body = re.search(r"^static int casadi_f\d+\(.*?^}\n", text, re.MULTILINE | re.DOTALL)
    if body is None:
        raise OSError(f"the C that casadi {ca.CasadiMeta.version()} writes has an unknown form")
    lines = re.sub(r"casadi_f\d+\(", f"{name}(", body.group(), count=1)
    lines = re.sub(r"arg\[\d+\]\? (arg\[\d+\]\[\d+\]) : 0", r"\1", lines)
    lines = re.sub(r"^(  a\d+)=(-?[0-9.e+-]+);", r"\1=broadcast(\2);", lines, flags=re.MULTILINE)
    lines = re.sub(r"\b(?:casadi_)?(sin|cos|fabs|fmax)\(", r"simd_\1(", lines)
    lines = lines.replace("casadi_real", "simd").replace("casadi_int", "long long")
    steps = re.split(r"(?<=;\n)(?=  a\d+=)", lines)
    starts = range(0, len(steps), MAX_BLOCK_LINES)
    blocks = ["".join(steps[at : at + MAX_BLOCK_LINES]) for at in starts]
    jumps = (f'  __asm__ goto ("" : : : : block_{k}); block_{k}:;\n' for k in range(1, len(blocks)))
    return blocks[0] + "".join(a + b for a, b in zip(jumps, blocks[1:], strict=True))


def disagreement(library: Path) -> str:
    """Say which kernel of a library differs from the virtual machine by how much; "" if none."""
    compiled, interpreted = compiled_kernels(library), interpreted_kernels("")
    random = np.random.default_rng(0)
    for name in CONSTANT_INPUTS:
        kernel: Kernel = getattr(interpreted, name)
        inputs = random_inputs(name, kernel, random)
        pairs = zip(getattr(compiled, name)(*inputs), kernel(*inputs), strict=True)
        worst = max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)
        if not worst <= MAX_DIFFERENCE:
            return f"{name} by {worst:.2g} of its largest number"
    return ""


def random_inputs(
    name: str, kernel: Kernel, random: np.random.Generator, frames: int = TEST_FRAMES
) -> list[Array]:
    """Give normally distributed inputs for a kernel, all of the order of 1."""
    inputs = [
        random.normal(size=n if i in kernel.constant_inputs else (frames, n))
        for i, n in enumerate(kernel.sizes_in)
    ]
    if name == "newton_step":
        damping = 4
        inputs[damping] += TEST_DAMPING
    return inputs
