"""Numbers and texts of a C3D file as bytes, in the order of the processor that wrote it."""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hbm.spelling import printable

BLOCK_BYTES: Final = 512
BYTE_ORDERS: Final = {84: "intel", 85: "dec", 86: "sgi"}
"""Processor type in the parameter section -> order of bytes."""


def floats(data: bytes, byte_order: str) -> NDArray[np.floating]:
    """Decode 4-byte floating point numbers of any of the three byte orders.

    Notes
    -----
    A DEC (VAX F) number is an IEEE number with its two 16-bit halves exchanged, times four; with an
    exponent of zero it is zero, whatever its other bits.
    """
    with np.errstate(invalid="ignore"):
        if byte_order != "dec":
            return np.frombuffer(data, ">f4" if byte_order == "sgi" else "<f4").astype(np.float32)
        swapped = np.frombuffer(data, "<u2").reshape(-1, 2)[:, ::-1].copy()
        numbers = swapped.view("<f4")[:, 0] / np.float32(4)
        numbers[(swapped[:, 1] & 0x7F80) == 0] = 0
        return numbers


def float_bytes(values: ArrayLike, byte_order: str) -> bytes:
    """Encode 4-byte floating point numbers; `floats` decodes them.

    Raises
    ------
    ValueError
        A number is too large for the format.
    """
    values = np.asarray(values, float).ravel()
    with np.errstate(over="ignore"):
        numbers = (values * 4 if byte_order == "dec" else values).astype("<f4")
    if (np.isinf(numbers) & np.isfinite(values)).any():
        raise ValueError("a number is too large for the 4 bytes that a C3D file has for it")
    if byte_order == "dec":
        numbers[np.abs(numbers) < np.finfo(np.float32).tiny] = 0  # there is no negative zero
        return numbers.view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return numbers.astype(">f4" if byte_order == "sgi" else "<f4").tobytes()


def integer_type(byte_order: str, *, signed: bool = True) -> np.dtype:
    """Give the type of 2-byte integers in a byte order."""
    return np.dtype((">" if byte_order == "sgi" else "<") + ("i2" if signed else "u2"))


def decoded_text(data: bytes) -> str:
    """Decode a text, which ends at its first zero, printable and without spaces around it."""
    return printable(data.decode("utf-8", "replace").split("\0", 1)[0].strip())
