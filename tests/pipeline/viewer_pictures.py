"""What a running viewer shows: its views, its faults, the colours of its picture."""

import io
import re
import time

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

PATIENCE_S = 30
HARMLESS = re.compile("rasterizer|Docker")


def settled(viewer, views):
    """Wait until so many views are drawn, and give the viewer's state."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        state = viewer.get_state()
        if len([one for one in state.views if one.visible]) >= views:
            time.sleep(1)
            return viewer.get_state()
        time.sleep(0.2)
    raise TimeoutError(f"the viewer shows {state.views}")


def assert_no_fault(viewer):
    assert not [(one.name, one.reports) for one in viewer.get_state().views if one.reports]
    logged = [entry for entry in viewer.get_logs() if entry.level in ("WARN", "ERROR")]
    assert not [entry.message for entry in logged if not HARMLESS.search(entry.message)]


def count_pixels(picture, colour):
    """Count pixels of a colour, whatever the light."""
    rgb = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), float).reshape(-1, 3)
    bright = rgb[rgb.max(axis=1) > 60]
    wanted = np.array(to_rgb(colour))
    cosine = bright @ wanted / np.linalg.norm(bright, axis=1) / np.linalg.norm(wanted)
    return np.count_nonzero(cosine > 0.999)
