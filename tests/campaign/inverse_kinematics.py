"""Random bodies, poses and marker subsets: our optimum beside SciPy's best of five starts.

``python -m tests.campaign.inverse_kinematics [COUNT]`` prints how often each outcome occurred.
SciPy minimises the same sum of squares, priors on what markers do not determine included, but with
marker positions and Jacobians by Pinocchio.
"""

import argparse
from collections import Counter
from dataclasses import dataclass
from multiprocessing import Pool
from typing import Final, Literal

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from hbm.body import Body, build_body
from hbm.coordinates import INDEX, N_Q, SIDES
from hbm.ik.continuity import BALL_JOINTS
from hbm.ik.problem import Problem
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.poses import marker_positions
from hbm.spatial import Array
from tests.hbm.motions import TRANSLATIONS, any_pose
from tests.synthetic import T_POSE_MM

MAX_RELATIVE_EXCESS: Final = 1e-6
ROUNDING_M2: Final = 1e-15
"""By how much a cost may be above SciPy's and count as equal."""
STARTS_RAD: Final = (0.0, 0.0, 0.3, 0.6, 1.0)
"""Random distance of SciPy's starts from the true pose; the second has limbs in neutral."""
MEDIAL: Final = ("MEK", "MM", "MEE")
SUBSETS: Final = {"MW": 0.2, "DELT": 0.2, "FRM": 0.2, "MT5": 0.15}
"""Marker of both sides -> how often a laboratory does not use it."""

Outcome = Literal["equal", "lower than SciPy", "higher than SciPy", "lost", "SciPy lost"]


@dataclass(frozen=True)
class Case:
    """A body, the pose it was in, and its measured markers, (K, 3) [m], NaN where missing."""

    seed: int
    body: Body
    pose: Array
    measured: Array


def random_case(seed: int) -> Case:
    """Draw a person, a calibration pose, the markers in use, a pose, noise and gaps.

    Half of the bodies are wrong, as in a laboratory: built from the calibration pose without medial
    markers or with bent elbows, while the markers are those of the true one.
    """
    rng = np.random.default_rng(seed)
    person = _body(_person(rng), tuple(T_POSE_MM))
    names = _used(rng, person.markers)
    calibration = marker_positions(person, _calibration_pose(rng))[0]
    calibration += rng.normal(scale=0.001, size=calibration.shape)
    own = [person.markers.index(name) for name in names]
    body = _body(calibration[own], names)
    pose = any_pose(rng, 1).q
    walker = person if rng.random() < 0.5 else body
    measured = marker_positions(walker, pose)[0][[walker.markers.index(n) for n in body.markers]]
    measured += rng.choice([0, 0.001, 0.003, 0.005, 0.01, 0.02]) * rng.normal(size=measured.shape)
    measured[rng.random(len(measured)) < rng.choice([0, 0, 0.05, 0.1, 0.25])] = np.nan
    return Case(seed, body, pose[0], measured)


def outcome(case: Case) -> Outcome:
    """Compare our optimum with SciPy's."""
    found, theirs = solve_ik(case.body, _markers(case)), least_cost(case)
    if theirs is None:
        return "SciPy lost"
    if not found.converged[0]:
        return "lost"
    ours = float(np.nansum(found.marker_error**2) + _prior_cost(case, found.q[0]))
    if ours > theirs * (1 + MAX_RELATIVE_EXCESS) + ROUNDING_M2:
        return "higher than SciPy"
    return (
        "lower than SciPy" if theirs > ours * (1 + MAX_RELATIVE_EXCESS) + ROUNDING_M2 else "equal"
    )


def least_cost(case: Case) -> float | None:
    """Give the lowest sum of squares that SciPy reaches [m²]; None where it never converges."""
    rng = np.random.default_rng(case.seed + 10**9)
    costs = []
    distances, jacobian = _distances(case)
    for k, spread in enumerate(STARTS_RAD):
        start = case.pose + np.where(TRANSLATIONS, 0, spread * rng.normal(size=N_Q))
        start[6:] *= k != 1
        answer = least_squares(
            distances, start, jacobian, xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=300
        )
        costs += [2 * answer.cost] if answer.success else []
    return min(costs, default=None)


def _markers(case: Case) -> Markers:
    return Markers(np.zeros(1), case.body.markers, case.measured[None])


def _prior(case: Case) -> Array:
    """Give the weights of the priors about neutral, (46,)."""
    return Problem(case.body, _markers(case)).prior


def _prior_cost(case: Case, q: Array) -> float:
    """Give what the priors cost in those coordinates of a pose, of all equivalent, that cost least.

    Angles that are continuous in time are not always those.
    """
    prior, angle = _prior(case), np.where(TRANSLATIONS, q, _within_half_turn(q))
    cost = prior * angle**2
    for i in BALL_JOINTS:
        joint = slice(i, i + 3)
        other = prior[joint] * _within_half_turn(angle[joint] * [1, -1, 1] + np.pi) ** 2
        if other.sum() < cost[joint].sum():
            cost[joint] = other
    return float(cost.sum())


def _within_half_turn(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _distances(case: Case):
    """Give SciPy's function and Jacobian: markers on the model minus measured, then priors."""
    pull = np.sqrt(_prior(case))
    model = case.body.model
    data = model.createData()
    seen = np.flatnonzero(np.isfinite(case.measured[:, 0]))
    frames = [model.getFrameId(case.body.markers[k]) for k in seen]

    def distances(q):
        pin.framesForwardKinematics(model, data, q)
        shown = np.concatenate([data.oMf[f].translation for f in frames])
        return np.concatenate([shown - case.measured[seen].ravel(), pull * q])

    def jacobian(q):
        pin.computeJointJacobians(model, data, q)
        in_lab = pin.LOCAL_WORLD_ALIGNED
        of_markers = [pin.getFrameJacobian(model, data, f, in_lab)[:3] for f in frames]
        return np.concatenate([*of_markers, np.diag(pull)])

    return distances, jacobian


def _person(rng) -> Array:
    size = rng.uniform(0.75, 1.15) * rng.uniform(0.93, 1.07, 3)
    points = np.array(list(T_POSE_MM.values())) / 1000
    return points * size + rng.normal(scale=0.008, size=points.shape)


def _body(pose: Array, names: tuple[str, ...]) -> Body:
    still = Markers(np.arange(2) / 100, names, np.tile(pose, (2, 1, 1)))
    return build_body(still, mass=70.0, sex="male", marker_set="hbm2")


def _used(rng, names: tuple[str, ...]) -> tuple[str, ...]:
    """Leave out medial markers and others, on both sides, as laboratories do."""
    medial = rng.choice(["used", "at knees alone", "not used"])
    unused = set() if medial == "used" else {*MEDIAL} - ({"MEK"} if medial[0] == "a" else set())
    unused |= {marker for marker, share in SUBSETS.items() if rng.random() < share}
    return tuple(name for name in names if name[1:] not in unused)


def _calibration_pose(rng) -> Array:
    """A T-pose, arms hanging, or elbows bent, never exactly."""
    kind = rng.choice(["T", "hanging", "bent"])
    q = rng.normal(scale=0.03, size=(1, N_Q)) * ~TRANSLATIONS
    q[:, 2] = 0.95
    for side in SIDES.values():
        arm = {"ShoulderAbduction": 90.0}
        if kind != "T":
            arm = {
                "ShoulderAbduction": rng.uniform(5, 45),
                "ShoulderInternalRotation": rng.uniform(-20, 60),
                "ElbowFlexion": rng.uniform(2, 15) if kind == "hanging" else rng.uniform(5, 95),
                "ForeArmPronation": rng.uniform(0, 120),
            }
        for name, degrees in arm.items():
            q[:, INDEX[side + name]] += np.radians(degrees)
    return q


def _of_seed(seed: int) -> tuple[int, Outcome]:
    return seed, outcome(random_case(seed))


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.campaign.inverse_kinematics", description=__doc__
    )
    parser.add_argument("count", nargs="?", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    counts: Counter[Outcome] = Counter()
    with Pool(given.jobs) as pool:
        seeds = range(given.first, given.first + given.count)
        for seed, found in pool.imap_unordered(_of_seed, seeds, chunksize=20):
            counts[found] += 1
            if found in ("higher than SciPy", "lost"):
                print(f"seed {seed}: {found}", flush=True)
    print(f"{given.count} cases: " + ", ".join(f"{n} {k}" for k, n in counts.most_common()))


if __name__ == "__main__":
    main()
