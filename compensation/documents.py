"""Calibrations as JSON texts that name their format and its version."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from hbm.spelling import printable, shown


def write_document(of: str, version: int, **parts: Any) -> str:
    """Write the parts of a calibration of something as JSON text; arrays become lists."""
    document = {"format": f"hbm-residuals {of} calibration", "version": version} | parts
    return json.dumps(
        document, indent=1, ensure_ascii=False, allow_nan=False, default=np.ndarray.tolist
    )


def read_document(text: str, of: str, versions: Sequence[int], again: str) -> dict[str, Any]:
    """Read the parts that `write_document` wrote, and their version.

    A ValueError, which ends with how to make it `again`, where the text is not JSON, of another
    format, or of none of the versions.
    """
    name, format_name = f"{of} calibration", f"hbm-residuals {of} calibration"
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"the {name} is not JSON: {printable(str(error))}; {again}") from error
    if not isinstance(document, dict) or document.get("format") != format_name:
        raise ValueError(f"the text is no {name}: its format should be {format_name!r}; {again}")
    version = document.get("version")
    if version not in versions:
        readable = " and ".join(map(str, versions))
        raise ValueError(
            f"the {name} has version {shown(version)}, this program reads {readable}; {again}"
        )
    return document


def damaged(of: str, error: Exception, again: str) -> ValueError:
    """Give the error of a document whose parts do not make a calibration."""
    # a reason names what the file holds, which may be long
    reason = printable(str(error))[:300]
    return ValueError(f"the {of} calibration is damaged: {reason}; {again}")
