"""The kernels as one C file: casadi's code with a vector of frames for every number.

casadi writes each kernel as straight-line C for one frame. Here its text is rewritten so that every
number becomes a vector with one SIMD lane per frame (``simd.h``). The rewriting relies on what
casadi's code looks like, so every compiled library is compared with casadi's virtual machine before
it is used (`hbm.kernels.library`).
"""

import os
import re
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import casadi as ca

from hbm.coordinates import MOVING, N_Q
from hbm.kernels import skeleton
from hbm.kernels.kernel import CONSTANT_INPUTS, casadi_function, kernel_sizes

C_FILES: Final = ("simd.h", "descent.c")
"""What is written by hand: before and after the kernels."""

MAX_BLOCK_LINES: Final = 500
"""Compilers work on one block of code at a time and take much longer than in proportion to its
length: LLVM a minute for a whole kernel, four seconds for blocks of this length."""

LOOP: Final = """
EXPORT void {name}_frames(long long frames, const double *const *in, double *const *out) {{
  static const int size_in[] = {{{size_in}}}, constant[] = {{{constant}}};
  static const int size_out[] = {{{size_out}}};
  simd workspace[{workspace}];
  evaluate_frames({name}, frames, {inputs}, size_in, constant, {outputs}, size_out, in, out,
                  workspace);
}}
"""


def write_source(folder: Path) -> Path:
    """Write the kernels and the loops over frames as one C file, and give the file."""
    header, descent = (read_c_file(name) for name in C_FILES)
    parts = [header, _array_sizes()]
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
    source = folder / "skeleton.c"
    source.write_text("\n".join([*parts, descent]), encoding="utf-8")
    return source


def read_c_file(name: str) -> str:
    """Give the text of one of the `C_FILES`."""
    return files("hbm.kernels").joinpath(name).read_text("utf-8")


def _array_sizes() -> str:
    sizes = {
        "N_Q": N_Q,
        "MOVING": len(MOVING),
        "SUMS": skeleton.N_SUMS,
        "GEOMETRY": skeleton.N_GEOMETRY,
    }
    return "enum { " + ", ".join(f"{name} = {size}" for name, size in sizes.items()) + " };\n"


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
