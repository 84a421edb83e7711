"""What a running viewer shows: its views, its faults, the colours of its picture."""

import base64
import io
import re
import time
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

PATIENCE_S = 180
"""A browser that draws in software beside other work starts its page in 8 to more than 60 s."""
HARMLESS = re.compile("rasterizer|Docker")

needs_vulkan = pytest.mark.skipif(
    not (find_library("vulkan") and [*Path("/usr/share/vulkan/icd.d").glob("*.json")]),
    reason="no Vulkan driver (apt-get install mesa-vulkan-drivers libvulkan1)",
)


def settled(viewer, views, seconds=1.0):
    """Wait until so many views are drawn, and some seconds more; give the viewer's state."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        state = viewer.get_state()
        if len([one for one in state.views if one.visible]) >= views:
            time.sleep(seconds)
            return viewer.get_state()
        time.sleep(0.1)
    raise TimeoutError(f"the viewer shows {state.views}")


def moments(viewer):
    """Timeline and time that each recording is shown at."""
    return [(one.current_timeline, one.current_time) for one in viewer.get_state().recordings]


def wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not (met := condition()):
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.05)
    return met


def picture_with(viewer, *colours, least=50):
    """Give a picture of a viewer once so many of its pixels have each of the colours."""

    def seen():
        picture = viewer.take_screenshot(max_size=1600)
        shown = all(count_pixels(picture, colour) > least for colour in colours)
        return picture if shown else None

    return wait_for(seen)


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


@dataclass(frozen=True)
class Page:
    """What the viewer in a browser says that it shows."""

    active: str
    timeline: str
    time: int
    playing: int
    views: frozenset[str]


STATE = "btoa(String.fromCharCode(...(window.viewer ?? window._handle).viewer_state()))"
PAUSED, FOLLOWING = 1, 3


def page_state(browser):
    """Give the state of the viewer in a browser; None while it shows no recording over time."""
    try:
        state = _fields(base64.b64decode(browser.evaluate(STATE)))
        active = state[2][0].decode()
        (shown,) = (one for one in map(_fields, state[3]) if one[1][0].decode() == active)
        moment = _fields(shown[3][0])
        return Page(
            active=active,
            timeline=_fields(moment[1][0])[1][0].decode(),
            time=_fields(moment[3][0]).get(1, [0])[0],
            playing=shown[5][0],
            views=frozenset(_fields(view).get(3, [b""])[0].decode() for view in state[5]),
        )
    except (AssertionError, KeyError):
        return None


def settled_page(browser, seconds=2.0):
    """Wait until a recording is shown in a browser, and some seconds more; give the state."""
    _first_state(browser)
    time.sleep(seconds)
    return _first_state(browser)


def _first_state(browser):
    deadline = time.monotonic() + PATIENCE_S
    while (state := page_state(browser)) is None:
        assert time.monotonic() < deadline, "the page shows no recording"
        time.sleep(0.5)
    return state


def _fields(message):
    """Give a message of Protocol Buffers as field number -> values: whole numbers or bytes."""
    found, at = {}, 0

    def number():
        nonlocal at
        value = shift = 0
        while True:
            value |= (message[at] & 127) << shift
            shift, at = shift + 7, at + 1
            if message[at - 1] < 128:
                return value

    while at < len(message):
        field, kind = divmod(number(), 8)
        if kind == 0:
            value = number()
        else:
            size = number() if kind == 2 else {1: 8, 5: 4}[kind]
            value, at = message[at : at + size], at + size
        found.setdefault(field, []).append(value)
    return found
