"""What the shapes and colours of the scene mean, in Markdown."""

from typing import Final

from pipeline.viewer.scene import GROUND_SCALE, MIN_ERROR_LINE_M, RESIDUAL_SCALES

LEGEND: Final = f"""# Legend
| arrow | plates as measured | compensated |
|---|---|---|
| ground reaction, at the centre of pressure | vermilion | blue |
| residual force, at the pelvis | vermilion | blue |
| residual moment, at the pelvis | orange | sky blue |

Arrows: {GROUND_SCALE}, {RESIDUAL_SCALES}.

| shape | meaning |
|---|---|
| green points | markers as measured |
| yellow points | the same markers on the model, after filtering |
| purple lines | between the two where they are more than {MIN_ERROR_LINE_M * 1000:.0f} mm apart |
| triads | axes of segments and lab: x red, y green, z blue |
| warm, cool, grey | right, left, middle of the body |
| grey rectangles | force plates, on the platform |

Forces and moments act on the subject. **Arrows** are in lab axes: x forward, y left, z up. \
**Curves and tables** are in the reported axes: x forward, y right, z up. Residual moments are \
about mid-hip. A foot with less than the contact threshold of vertical force has no arrow; a frame \
that could not be solved has no body.
"""
