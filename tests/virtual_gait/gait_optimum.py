"""The gait nearest to the norms that a body's equations of motion allow: for `fit_gait` only.

Half a cycle of a symmetric gait is optimised in its Fourier coefficients: joint angles stay near
the norms, the stance foot rolls over the belt without slipping, the swing foot clears it, and the
ground wrench that follows from the equations of motion has a centre of pressure that passes along
the stance foot and a vertical force with two peaks.
"""

from dataclasses import dataclass
from typing import Any, Final

import casadi as ca
import numpy as np

from hbm.coordinates import COORDINATES, INDEX, N_Q, TREE
from hbm.kernels import skeleton
from hbm.spatial import GRAVITY_MPS2, Array, rotation_about
from pipeline.virtual_lab.machine.platform import smooth_step
from pipeline.virtual_lab.person.gait import GAIT, LEFT, OUTWARD, orientation, roll_over, rolled
from pipeline.virtual_lab.person.subject import VirtualSubject
from tests.validation.true_body import true_body

LANDING: Final = 0.97, 1.0
"""Phases of the gait cycle between which the floor gradually begins to hold a foot; assumed."""
NODES: Final = 50
"""Phases of the half cycle at which the gait is held to its target."""
ODD: Final = (
    *("PelvisY", "PelvisYaw", "PelvisRightRoll", "TrunkRightBend", "TrunkLeftTwist"),
    *("HeadRightBend", "HeadLeftTwist"),
)
"""Coordinates of the trunk that change sign from one half cycle to the next."""
TOLERANCE: Final = {
    "foot_m": 0.0015,
    "clearance_m": 0.006,
    "cop_forward_m": 0.006,
    "cop_left_m": 0.004,
    "cop_shift_m": 0.01,
    "free_moment_nm": 6.0,
    "knee_rad": 0.02,
    "lean_rad": 0.03,
    "vertical_bw": 0.03,
    "horizontal_bw": 0.07,
}
"""Deviations that cost as much as one standard deviation of a norm; chosen."""
CLEARANCE_M: Final = 0.012
"""Height below which a swinging sole costs."""
MIN_KNEE_RAD: Final = 0.1
"""Knee flexion below which it costs: with straighter legs the hip's place is nearly undetermined.
"""
BALL_HALF_WIDTH_M: Final = 0.04
"""Sideways place of the two points of the ball by which a sole is held."""
NORM_WEIGHT: Final = 0.7
"""Weight of the norms against all other terms; chosen."""
ROUGHNESS_WEIGHT: Final = 0.1
ROUGHNESS_HARMONIC: Final = 4.0
TRUNK_ROUGHNESS: Final = 3.0
"""Weight that keeps high harmonics small, growing with the cube of the harmonic from 4 on, and its
factor for pelvis, trunk and head; chosen."""
START_FOOTHOLD_M: Final = (0.3, 0.07, 0.0)
"""First guess of the foothold: forward, outward, and shift of the centre of pressure."""
ITERATIONS: Final = 20
STEP_SHARE: Final = 0.6
"""Share of a full Gauss-Newton step: full steps oscillate about the optimum without end."""
Symbol = Any


def load_share(phase: Array) -> Array:
    """Give the share of body weight on a foot at phases of its own gait cycle, (T,)."""
    overlap = GAIT.stance - 0.5
    cycle = phase % 1
    return np.asarray(smooth_step(cycle / overlap) - smooth_step((cycle - 0.5) / overlap))


def floor_contact(phase: Array) -> Array:
    """Give how firmly the floor holds a foot at phases of its own gait cycle, (T,), 0 to 1."""
    cycle = phase % 1
    released, landed = (smooth_step((cycle - a) / (b - a)) for a, b in (GAIT.leaving, LANDING))
    return np.asarray(1 - released + landed)


@dataclass(frozen=True, slots=True)
class Target:
    """What the gait should be near to.

    Attributes
    ----------
    speed_mps, stride_s
        Belt speed and duration of the gait cycle.
    joints, sd
        Coordinates of the norms over the half cycle, (NODES, 46), and standard deviations, (46,).
    pitch, heading
        Foot pitch and inward heading of the right and left foot, (2, NODES) each [rad].
    vertical
        Vertical force in body weights, (NODES,).
    slope
        How steeply the belt rises forward [rad].
    """

    speed_mps: float
    stride_s: float
    joints: Array
    sd: Array
    pitch: Array
    heading: Array
    vertical: Array
    slope: float = 0.0


def nodes() -> Array:
    """Give the phases of the right gait cycle at which the gait is held to its target."""
    return (np.arange(NODES) + 0.5) / NODES / 2


def columns(harmonics: int) -> list[tuple[str, int, int]]:
    """List the unknowns: coordinate, harmonic, 0 for cosine or 1 for sine.

    The left side repeats the right half a cycle later; the trunk is odd or even in half cycles.
    """
    listed = []
    for name in (*COORDINATES[:12], *(c for c in COORDINATES if c.startswith("R"))):
        trunk = not name.startswith("R")
        first, step = (1 if name in ODD else 0, 2) if trunk else (0, 1)
        for k in range(first, harmonics + 1, step):
            if (name, k) != ("PelvisX", 0):
                listed += [(name, k, part) for part in ((0, 1) if k else (0,))]
    return listed


def design(phase: Array, unknowns: list[tuple[str, int, int]], stride_s: float) -> Array:
    """Give the matrices from unknowns to coordinates and two derivatives, (T, 3 · 46, C)."""
    out = np.zeros((len(phase), 3, N_Q, len(unknowns)))
    for j, (name, k, part) in enumerate(unknowns):
        for side in ("R", "L") if name.startswith("R") else ("",):
            i = INDEX[side + name[1:] if side else name]
            angle = 2 * np.pi * k * (phase + (0.5 if side == "L" else 0.0))
            rate = 2 * np.pi * k / stride_s
            for d in range(3):
                shifted = angle - part * np.pi / 2 + d * np.pi / 2
                out[:, d, i, j] = rate**d * np.cos(shifted)
    return out.reshape(len(phase), 3 * N_Q, len(unknowns))


def optimise(subject: VirtualSubject, target: Target, harmonics: int) -> dict[str, Array]:
    """Find the gait nearest to a target.

    Parameters
    ----------
    subject
        Who walks.
    target
        What it should be near to.
    harmonics
        Highest harmonic of the gait cycle.

    Returns
    -------
    dict[str, Array]
        Coordinate of trunk and right side -> cosines and sines, (harmonics + 1, 2) [rad, m]; and
        "foothold": how far ahead and aside of the pelvis the ankle is at initial contact [m].

    Notes
    -----
    Gauss–Newton on weighted least squares, the derivatives of every node from casadi.
    """
    unknowns = columns(harmonics)
    node, data = _node(subject, target)
    matrices = design(nodes(), unknowns, target.stride_s)
    count = len(unknowns)
    names = [u[0] for u in unknowns]
    unit = np.array([0.01 if TREE[INDEX[n]].translates else np.radians(1.0) for n in names])
    trunk = np.array([TRUNK_ROUGHNESS if n in COORDINATES[:12] else 1.0 for n in names])
    order = np.array([u[1] for u in unknowns]) / ROUGHNESS_HARMONIC
    rough = ROUGHNESS_WEIGHT * order**3 / unit * trunk

    x = np.zeros(count + 3)
    flat = matrices[:, :N_Q].reshape(-1, count)
    x[:count] = np.linalg.lstsq(flat, target.joints.ravel(), rcond=None)[0]
    x[count:] = START_FOOTHOLD_M
    for _ in range(ITERATIONS):
        residuals, jacobians = (
            [rough * x[:count]],
            [np.hstack([np.diag(rough), np.zeros((count, 3))])],
        )
        for matrix, given in zip(matrices, data, strict=True):
            value, slope = node(np.concatenate([matrix @ x[:count], x[count:]]), given)
            slope = np.array(slope)
            residuals.append(np.array(value).ravel())
            jacobians.append(np.hstack([slope[:, : 3 * N_Q] @ matrix, slope[:, 3 * N_Q :]]))
        step = np.linalg.lstsq(np.vstack(jacobians), -np.concatenate(residuals), rcond=None)[0]
        x += STEP_SHARE * step
    found = {name: np.zeros((harmonics + 1, 2)) for name in dict.fromkeys(names)}
    for (name, k, part), value in zip(unknowns, x, strict=False):
        found[name][k, part] = value
    return found | {"foothold": x[count:]}


def _node(subject: VirtualSubject, target: Target) -> tuple[Symbol, Array]:
    """Give the residuals and their Jacobian at one node as a function, and the nodes' data.

    Unknowns: q, v, a (3 · 46), and the foothold: forward, outward, shift of the centre of
    pressure along the feet.
    """
    body, weight = true_body(subject), subject.person.mass_kg * GRAVITY_MPS2
    soles = {side: subject.soles[side] for side in ("right", "left")}
    phase = {"right": nodes(), "left": nodes() + 0.5}
    data = [target.joints, target.vertical[:, None], load_share(phase["right"])[:, None]]
    tilt = rotation_about(LEFT, -target.slope)
    unknown = ca.SX.sym("unknown", 3 * N_Q + 3)
    q, v, a = (unknown[k * N_Q : (k + 1) * N_Q] for k in range(3))
    ahead, aside, shift = (unknown[3 * N_Q + k] for k in range(3))
    given = ca.SX.sym("given", N_Q + 2 + 2 * 12)
    pose = skeleton.Pose(q, ca.SX(ca.DM(body.geometry)))
    _, wrench, _ = skeleton.newton_euler()(
        q, v, a, ca.DM(body.geometry), ca.DM(body.inertia_vector)
    )

    terms = [NORM_WEIGHT / 2 * (q - given[:N_Q]) / ca.DM(target.sd)]
    knees = ca.vertcat(*(q[INDEX[side + "KneeFlexion"]] for side in "RL"))
    terms.append(ca.fmax(0, MIN_KNEE_RAD - knees) / TOLERANCE["knee_rad"])
    upright = [INDEX["PelvisForwardPitch"], INDEX["TrunkFlexion"]]
    terms.append(ca.sum1((q - given[:N_Q])[upright]) / TOLERANCE["lean_rad"])
    pressure = ca.SX.zeros(2)
    for n, (side, sole) in enumerate(soles.items()):
        cycle, out = phase[side] % 1, OUTWARD[side]
        pitch, heading = target.pitch[n], -out * target.heading[n]
        since = target.stride_s * (cycle - (cycle > LANDING[0]))
        travelled = np.column_stack([target.speed_mps * since, 0 * cycle, 0 * cycle])
        origin = rolled(sole, pitch, heading) - travelled
        aside_m = BALL_HALF_WIDTH_M
        points = np.array([[sole.heel, 0, 0], [sole.ball, aside_m, 0], [sole.ball, -aside_m, 0]])
        placed = origin[:, None] + np.einsum("tij,kj->tki", orientation(pitch, heading), points)
        along = sole.heel + (sole.toe - sole.heel) * roll_over(cycle)
        on_sole = along[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        contact = floor_contact(cycle)
        data += [placed.reshape(NODES, 9), on_sole - travelled[:, :2], contact[:, None]]
        own = given[N_Q + 2 + 12 * n : N_Q + 2 + 12 * (n + 1)]
        base = ca.vertcat(ahead, out * aside, 0)
        for k, point in enumerate((points - sole.origin) @ sole.rotation):
            place = tilt.T @ (pose.o[sole.segment] + pose.R[sole.segment] @ ca.DM(point))
            terms.append(own[11] * (place - base - own[3 * k : 3 * k + 3]) / TOLERANCE["foot_m"])
            low = ca.fmax(0, CLEARANCE_M - place[2]) / TOLERANCE["clearance_m"]
            terms.append((1 - own[11]) * low)
        share = given[N_Q + 1] if side == "right" else 1 - given[N_Q + 1]
        pressure += share * (base[:2] + own[9:11] + ca.vertcat(shift, 0))

    on_belt = tilt.T @ wrench[:3], tilt.T @ wrench[3:]
    force, moment = on_belt
    under = tilt @ ca.vertcat(pressure, 0)
    center = sum(
        part.mass * (pose.o[s] + pose.R[s] @ ca.DM(np.array(part.center)))
        for s, part in body.rigid_bodies.items()
    ) / sum(part.mass for part in body.segments.values())
    to_center = center - under
    shear = wrench[:2] - wrench[2] * to_center[:2] / to_center[2]
    terms += [
        shift / TOLERANCE["cop_shift_m"],
        (moment[0] - pressure[1] * force[2]) / (weight * TOLERANCE["cop_left_m"]),
        (moment[1] + pressure[0] * force[2]) / (weight * TOLERANCE["cop_forward_m"]),
        (moment[2] - pressure[0] * force[1] + pressure[1] * force[0]) / TOLERANCE["free_moment_nm"],
        (wrench[2] / weight - given[N_Q]) / TOLERANCE["vertical_bw"],
        shear / (weight * TOLERANCE["horizontal_bw"]),
    ]
    residual = ca.vertcat(*terms)
    function = ca.Function("node", [unknown, given], [residual, ca.jacobian(residual, unknown)])
    return function, np.hstack(data)
