r"""The skeleton in symbols: sweeps up and down one tree give every kernel of the package.

All vectors are in lab axes about the lab origin, so nothing is transformed between segments: what
a joint carries is a plain sum over what lies beyond it.

**Pose.** From root to tip, coordinate :math:`i` with axis :math:`\hat a_i` rotates (or translates)
its frame: :math:`o_i = o_p + R_p b_i`, :math:`R_i = R_p \exp(q_i [\hat a_i])`. A unit of
:math:`\dot q_i` moves a point :math:`r` beyond the joint at :math:`\omega_i \times r + v_i`, with
:math:`\omega_i = R_p \hat a_i,\ v_i = o_i \times \omega_i` (rotation) or
:math:`\omega_i = 0,\ v_i = R_p \hat a_i` (translation).

**Markers.** Minimise :math:`\tfrac12 \sum_k w_k |e_k|^2`, :math:`e_k = r_k - m_k`, where marker
:math:`k` sits at :math:`p_k` in its segment and was measured at :math:`m_k`. As
:math:`r_k = o + R p_k`, a segment's markers enter only through the sums
:math:`\sum w,\ \sum w p,\ \sum w p p^T,\ \sum w m,\ \sum w m p^T,\ \sum w m^T m`
(see `N_SUMS`), however many there are. With the tree sums beyond joint :math:`l`

.. math::
   n=\sum w,\quad h=\sum w r,\quad K=\sum w r r^T,\quad E=\sum w e,\quad P=\sum w r e^T

the gradient is a joint torque, :math:`g_j = \omega_j \cdot \sum w\, r\times e + v_j \cdot E`, and
the Gauss–Newton matrix is the mass matrix of a skeleton whose only masses are the :math:`w_k`:
for :math:`j` at or before :math:`l`

.. math::
   H_{jl} = \omega_j\cdot N_l + v_j\cdot F_l,\qquad
   F_l = \omega_l\times h + n v_l,\qquad
   N_l = (\mathrm{tr}K - K)\,\omega_l + h\times v_l .

The curvature of the joints completes it to the exact Hessian: a rotation of :math:`j` rotates the
velocity that :math:`l` gives, which adds to :math:`N_l` the vector
:math:`(B - \mathrm{tr}B)\,\omega_l`, :math:`B = P - o_l E^T` (rotation), or
:math:`\hat a_l \times E` (translation).

**Solution.** :math:`H = L^T D L` from tip to root has no fill-in (Featherstone 2005, Int J Robot
Res 24:487): a coordinate has non-zero entries only with its own ancestors.

**Dynamics.** Newton–Euler on the same tree: velocities and accelerations outward, forces
:math:`m(a_c - g)` and moments inward, :math:`\tau_j = \omega_j\cdot M_j + v_j\cdot F_j`.

Sources: Lu and O'Connor 1999 (J Biomech 32:129) for the problem, Featherstone 2008 (Rigid Body
Dynamics Algorithms) for the recursions.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca

from hbm.coordinates import (
    LAST_Q,
    MOVING,
    N_Q,
    RIGID_BODIES,
    SUBJECT_AXES,
    SUBJECT_OFFSETS,
    TREE,
    support,
)
from hbm.kernels.kernel import N_GEOMETRY, N_INERTIA, N_SUMS
from hbm.spatial import GRAVITY_MPS2

SX = Any  # casadi.SX: the package ships no types


def _rotation(axis: SX, angle: SX) -> SX:
    """Give the rotation about a unit axis (Rodrigues)."""
    cross = ca.skew(axis)
    return ca.SX.eye(3) + ca.sin(angle) * cross + (1 - ca.cos(angle)) * (cross @ cross)


def _symmetric(six: SX) -> SX:
    """Give the symmetric matrix of xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = ca.vertsplit(six)
    return ca.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


class Pose:
    """The tree at given coordinates: frames of all that moves, motion of all joints.

    ``R[s], o[s]`` is the frame of ``s``, in `MOVING`; ``w[i], v[i]`` the motion of coordinate ``i``
    per unit of its rate, ``axis[i]`` its axis and ``origin[i]`` a point on it, all in the lab.
    """

    def __init__(self, q: SX, geometry: SX) -> None:
        columns = ca.horzsplit(ca.reshape(geometry, 3, -1))
        offset = dict(zip(SUBJECT_OFFSETS, columns, strict=False))
        own_axis = dict(zip(SUBJECT_AXES, columns[len(SUBJECT_OFFSETS) :], strict=True))
        frame = {-1: (ca.SX.eye(3), ca.SX(3, 1))}
        self.w, self.v, self.axis, self.origin = [], [], [], []
        for i, c in enumerate(TREE):
            R, o = frame[c.parent]
            if i in offset:
                o = o + R @ offset[i]
            local = own_axis[i] if c.axis is None else ca.sparsify(ca.SX(list(c.axis)))
            axis = R @ local
            self.axis.append(axis)
            if c.translates:
                self.w.append(ca.SX(3, 1))
                self.v.append(axis)
                o = o + axis * q[i]
            else:
                self.w.append(axis)
                self.v.append(ca.cross(o, axis))
                R = R @ _rotation(local, q[i])
            self.origin.append(o)
            frame[i] = R, o
        self.R = {s: frame[LAST_Q[s]][0] for s in MOVING}
        self.o = {s: frame[LAST_Q[s]][1] for s in MOVING}


def _sum_beyond(per_segment: dict[str, list[SX]], zero: Callable[[], list[SX]]) -> list[list[SX]]:
    """Sum the segments' quantities over all segments beyond each coordinate, tip to root."""
    beyond = [zero() for _ in TREE]
    for i in reversed(range(N_Q)):
        c = TREE[i]
        if i == LAST_Q[c.segment] and c.segment in per_segment:
            beyond[i] = [a + b for a, b in zip(beyond[i], per_segment[c.segment], strict=True)]
        if c.parent >= 0:
            parent = beyond[c.parent]
            beyond[c.parent] = [a + b for a, b in zip(parent, beyond[i], strict=True)]
    return beyond


def newton_step() -> SX:
    """Build one Newton step of the inverse kinematics.

    Returns
    -------
    casadi.Function
        ``(q, sums, prior, reference, damping, curvature, geometry) -> (step, report)``.
        ``sums`` are the marker sums (23 per segment, see `N_SUMS`); ``prior`` (46) is the weight of
        each coordinate's squared distance from ``reference`` (46) [m² or m²/rad² per unit marker
        weight]; ``damping`` is added to the diagonal; ``curvature`` is 1 for Newton, 0 for
        Gauss–Newton. ``report`` is the cost at ``q``, the gradient's largest entry, the slope of
        the cost along the step (gradient · step), and the 46 pivots of the factorisation.
    """
    q, geometry = ca.SX.sym("q", N_Q), ca.SX.sym("geometry", N_GEOMETRY)
    sums = ca.SX.sym("sums", N_SUMS * len(MOVING))
    prior, reference = ca.SX.sym("prior", N_Q), ca.SX.sym("reference", N_Q)
    damping, curvature = ca.SX.sym("damping"), ca.SX.sym("curvature")
    pose = Pose(q, geometry)

    cost, of_segment = ca.dot(prior, (q - reference) ** 2), {}
    for s, terms in zip(MOVING, ca.vertsplit(sums, N_SUMS), strict=True):
        R, o = pose.R[s], pose.o[s]
        n, p, pp, m = terms[0], terms[1:4], _symmetric(terms[4:10]), terms[10:13]
        mp, mm = ca.reshape(terms[13:22], 3, 3), terms[22]
        Rp = R @ p
        h = Rp + n * o
        K = R @ pp @ R.T + Rp @ o.T + o @ h.T
        rm = R @ mp.T + o @ m.T
        cost += ca.trace(K) - 2 * ca.trace(rm) + mm
        of_segment[s] = [n, h, K, h - m, K - rm]

    def zero() -> list[SX]:
        return [ca.SX(1, 1), ca.SX(3, 1), ca.SX(3, 3), ca.SX(3, 1), ca.SX(3, 3)]

    eye = ca.SX.eye(3)
    H: dict[tuple[int, int], SX] = {}
    g = []
    for i, (n, h, K, E, P) in enumerate(_sum_beyond(of_segment, zero)):
        w, v = pose.w[i], pose.v[i]
        torque = ca.vertcat(P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0])
        g.append(ca.dot(w, torque) + ca.dot(v, E) + prior[i] * (q[i] - reference[i]))
        F = ca.cross(w, h) + n * v
        N = (ca.trace(K) * eye - K) @ w + ca.cross(h, v)
        if TREE[i].translates:
            N += curvature * ca.cross(pose.axis[i], E)
        else:
            B = P - pose.origin[i] @ E.T
            N += curvature * (B @ w - ca.trace(B) * w)
        for j in support(i):
            H[i, j] = ca.dot(pose.w[j], N) + ca.dot(pose.v[j], F)
        H[i, i] += prior[i] + damping

    step, square = solve_tree(H, [-x for x in g])
    gradient = ca.mmax(ca.fabs(ca.vertcat(*g)))
    report = ca.vertcat(cost / 2, gradient, -square, *(H[i, i] for i in range(N_Q)))
    return ca.Function(
        "newton_step",
        [q, sums, prior, reference, damping, curvature, geometry],
        [ca.vertcat(*step), report],
    )


def solve_tree(H: dict[tuple[int, int], SX], x: list[SX]) -> tuple[list[SX], SX]:
    """Solve ``H y = x`` for a matrix with a tree's pattern, by ``H = Lᵀ D L`` from tip to root.

    ``H[i, j]`` holds the entries for ``j`` in `support` of ``i``; on return it holds the factors,
    with the pivots on its diagonal. Gives ``y`` and ``x · y``.
    """
    x, product = list(x), 0
    for k in reversed(range(N_Q)):
        ancestors, inverse = support(k)[1:], 1 / H[k, k]
        for i in ancestors:
            factor = H[k, i] * inverse
            for j in support(i):
                H[i, j] -= factor * H[k, j]
            H[k, i] = factor
        for i in ancestors:
            x[i] -= H[k, i] * x[k]
    for k in range(N_Q):
        scaled = x[k] * (1 / H[k, k])
        product += x[k] * scaled
        x[k] = scaled - sum(H[k, i] * x[i] for i in support(k)[1:])
    return x, product


def segment_poses() -> SX:
    """Build the forward kinematics.

    Returns
    -------
    casadi.Function
        ``(q, geometry) -> poses``: per segment its rotation, column by column, and origin (12).
    """
    q, geometry = ca.SX.sym("q", N_Q), ca.SX.sym("geometry", N_GEOMETRY)
    pose = Pose(q, geometry)
    poses = [ca.vertcat(ca.vec(pose.R[s]), pose.o[s]) for s in MOVING]
    return ca.Function("segment_poses", [q, geometry], [ca.densify(ca.vertcat(*poses))])


def newton_euler() -> SX:
    """Build the inverse dynamics of the body in free space.

    Returns
    -------
    casadi.Function
        ``(q, v, a, geometry, inertia) -> (tau, wrench, motion)``. ``inertia`` is 10 numbers per
        segment with mass (see `N_INERTIA`), in its own frame; ``tau`` (46) [N, N·m]; ``wrench`` (6)
        is the total action that the motion needs from the surroundings, in lab axes about the lab
        origin; ``motion`` (6 per coordinate, v before w) is its motion per unit rate, so that a
        wrench ``(F, M)`` on a segment reduces the force of each coordinate that carries the segment
        by ``v·F + w·M``.
    """
    q, qd, qdd = (ca.SX.sym(name, N_Q) for name in ("q", "v", "a"))
    geometry = ca.SX.sym("geometry", N_GEOMETRY)
    inertia = ca.SX.sym("inertia", N_INERTIA * len(RIGID_BODIES))
    pose = Pose(q, geometry)

    ground = ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1), ca.sparsify(ca.SX([0, 0, GRAVITY_MPS2]))
    motion: dict[int, tuple[SX, SX, SX, SX]] = {-1: ground}
    for i, joint in enumerate(TREE):
        w, v, alpha, a = motion[joint.parent]
        dw, dv = pose.w[i] * qd[i], pose.v[i] * qd[i]
        alpha = alpha + pose.w[i] * qdd[i] + ca.cross(w, dw)
        a = a + pose.v[i] * qdd[i] + ca.cross(w, dv) + ca.cross(v, dw)
        motion[i] = w + dw, v + dv, alpha, a

    of_segment = {}
    for s, inertial in zip(RIGID_BODIES, ca.vertsplit(inertia, N_INERTIA), strict=True):
        R, (w, v, alpha, a) = pose.R[s], motion[LAST_Q[s]]
        c = pose.o[s] + R @ inertial[1:4]
        I = R @ _symmetric(inertial[4:10]) @ R.T  # noqa: E741
        F = inertial[0] * (a + ca.cross(alpha, c) + ca.cross(w, v + ca.cross(w, c)))
        of_segment[s] = [F, ca.cross(c, F) + I @ alpha + ca.cross(w, I @ w)]

    beyond = _sum_beyond(of_segment, lambda: [ca.SX(3, 1), ca.SX(3, 1)])
    tau = [ca.dot(pose.w[i], M) + ca.dot(pose.v[i], F) for i, (F, M) in enumerate(beyond)]
    subspace = [ca.vertcat(pose.v[i], pose.w[i]) for i in range(N_Q)]
    return ca.Function(
        "newton_euler",
        [q, qd, qdd, geometry, inertia],
        [ca.vertcat(*tau), ca.vertcat(*beyond[0]), ca.densify(ca.vertcat(*subspace))],
    )


@cache
def casadi_function(name: str) -> Any:
    """Give a kernel as a casadi function with dense outputs and no repeated expressions."""
    function = {f.__name__: f for f in (newton_step, segment_poses, newton_euler)}[name]()
    symbols = [ca.SX.sym("x", function.size1_in(i)) for i in range(function.n_in())]
    return ca.Function(name, symbols, [ca.densify(x) for x in ca.cse(function.call(symbols))])
