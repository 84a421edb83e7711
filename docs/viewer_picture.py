"""Make ``viewer.png``, the first picture of the README, from the recording of ``hbm demo``.

``python docs/viewer_picture.py demo/results/viewer/sub01_sway.rrd``. Needs a Vulkan driver, such as
that of ``apt install mesa-vulkan-drivers libvulkan1``, but no screen.
"""

import io
import sys
import time
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

from pipeline.viewer.serve import viewer_binary

PORT = 9877
START_TIMEOUT_S = 60.0
DRAWING_S = 3.0
"""Time for the software renderer to draw; the viewer does not report when it has finished."""
SHOWN_S = 20.24
"""Within the first sway of the simulated trial, where the residual as measured is largest."""
ZOOM_STEPS = 3
"""Steps of 10 %, so that text stays legible at the width of a README."""
EMPTY_TOP = 0.044
"""Share of the height that stays empty where the top panel was."""
WIDTH_PX = 1600
COLOURS = 256
"""Of the palette: enough for the scene's shading, and a file below 400 kB."""


def main(recording: Path) -> None:
    """Open the recording without a screen, and save what the viewer shows."""
    viewer = ViewerClient.spawn(
        headless=True, port=PORT, hide_welcome_screen=True, executable_path=viewer_binary()
    )
    try:
        viewer.open(str(recording))
        deadline = time.monotonic() + START_TIMEOUT_S
        while not any(view.visible for view in viewer.get_state().views):
            if time.monotonic() > deadline:
                raise TimeoutError("the viewer shows nothing")
            time.sleep(0.5)
        time.sleep(DRAWING_S)
        for command in ["ui.toggle_top_panel", *["ui.zoom_in_ui"] * ZOOM_STEPS]:
            viewer.run_command(command)
        viewer.set_time("time", duration=SHOWN_S, play_state="paused")
        time.sleep(DRAWING_S)
        picture = Image.open(io.BytesIO(viewer.take_screenshot())).convert("RGB")
    finally:
        viewer.quit()
    picture = picture.crop((0, round(EMPTY_TOP * picture.height), *picture.size))
    height_px = round(picture.height * WIDTH_PX / picture.width)
    picture = picture.resize((WIDTH_PX, height_px), Image.Resampling.LANCZOS)
    path = Path(__file__).with_name("viewer.png")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
