/* Newton's method for many frames, `LANES` of them at a time, one in each SIMD lane.
 *
 * Compiled together with the kernels that casadi writes; N_Q, MOVING, SUMS and GEOMETRY (numbers of
 * coordinates, segments, marker sums per segment, and geometry) are written before it. Each frame
 * iterates independently: a step that raises the cost is computed again with more damping, the
 * curvature is dropped where the Hessian is indefinite, and a finished frame frees its lane for the
 * next one. `hbm.ik.descent` does the same in NumPy where there is no compiler, and passes its
 * constants.
 */

/* Markers attached to a skeleton, where they were measured, and frames to solve. `row` is the row of
 * each frame in the measured markers; a prior or reference that is the same for all frames has a
 * stride of 0. The fields are those of `hbm.ik.descent.DescentProblem`, in the same order. */
typedef struct {
  long long frames, markers, measured, prior_stride, reference_stride;
  long long max_iterations, slow;
  double tolerance, damping, max_step, near_optimum, relative_rise, absolute_rise;
  double damping_factor, damping_divisor, negligible_damping, negligible_gain, saddle;
  const long long *row, *column, *segment;
  const double *local, *weight, *geometry, *position, *start, *prior, *reference;
  double *q, *pivots, *error, *gradient;
  unsigned char *converged;
} problem;

/* The frames being solved, one in each lane; `frame` is -1 where a lane is empty. Positions are
 * relative to `origin`, the pelvis of the starting point, so that rounding does not grow with the
 * distance from the lab's origin. `step` leads from `accepted_q` to `q`; it was computed with
 * `step_damping`, and the next one will be with `damping`. `slope` is gradient times step, with the
 * square of what the step was cut by, `lowest` the lowest pivot of the Hessian when it was last indefinite. */
typedef struct {
  long long frame[LANES];
  simd q[N_Q], accepted_q[N_Q], step[N_Q], prior[N_Q], reference[N_Q];
  simd sums[SUMS * MOVING], origin[3], report[3 + N_Q];
  simd cost, slope, gradient, curvature, lowest, damping, step_damping, iterations;
} active_frames;

static const simd zero = {0};

/* A marker's measured position in the block of frames that begins with `first`. */
static inline void measured_position(const problem *in, long long k, long long first,
                                     const simd *origin, simd *m) {
  for (int lane = 0; lane < LANES; ++lane) {
    const long long t = first + lane < in->frames ? first + lane : first;
    const double *p = in->position + 3 * (in->measured * in->row[t] + in->column[k]);
    for (int i = 0; i < 3; ++i) m[i][lane] = p[i];
  }
  for (int i = 0; i < 3; ++i) m[i] -= origin[i];
}

/* The pelvis' starting position in a block of frames. */
static inline void starting_pelvis(const problem *in, long long first, simd *origin) {
  for (int lane = 0; lane < LANES; ++lane) {
    const long long t = first + lane < in->frames ? first + lane : first;
    for (int i = 0; i < 3; ++i) origin[i][lane] = in->start[N_Q * t + i];
  }
}

/* Sum a block's markers per segment: w, wp, wpp, wm, wmp, wmm (see hbm.kernels.skeleton). */
static void sum_markers(const problem *in, long long first, double block[LANES][SUMS * MOVING]) {
  simd origin[3], sums[SUMS * MOVING];
  starting_pelvis(in, first, origin);
  for (int i = 0; i < SUMS * MOVING; ++i) sums[i] = zero;
  for (long long k = 0; k < in->markers; ++k) {
    const double *p = in->local + 3 * k;
    simd *s = sums + SUMS * in->segment[k], m[3];
    measured_position(in, k, first, origin, m);
    const simd_mask seen = m[0] == m[0];
    const simd w = simd_select(seen, broadcast(in->weight[k]), zero);
    s[0] += w;
    for (int i = 0; i < 3; ++i) {
      const simd wm = simd_select(seen, w * m[i], zero);
      s[1 + i] += w * p[i];
      s[4 + i] += w * (p[i] * p[i]);
      s[7 + i] += w * (p[i / 2] * p[1 + (i + 1) / 2]);
      s[10 + i] += wm;
      for (int a = 0; a < 3; ++a) s[13 + 3 * a + i] += wm * p[a];
      s[22] += simd_select(seen, wm * m[i], zero);
    }
  }
  for (int i = 0; i < SUMS * MOVING; ++i)
    for (int lane = 0; lane < LANES; ++lane) block[lane][i] = sums[i][lane];
}

/* Distance of the markers from the model in a block of solved frames. */
static void marker_errors(const problem *in, long long first, const simd *geometry) {
  simd q[N_Q], pose[12 * MOVING], origin[3];
  for (int lane = 0; lane < LANES; ++lane) {
    const long long t = first + lane < in->frames ? first + lane : first;
    for (int i = 0; i < N_Q; ++i) q[i][lane] = in->q[N_Q * t + i];
  }
  starting_pelvis(in, first, origin);
  for (int i = 0; i < 3; ++i) q[i] -= origin[i];
  const simd *arg[] = {q, geometry};
  simd *res[] = {pose};
  segment_poses(arg, res, 0, 0, 0);
  for (long long k = 0; k < in->markers; ++k) {
    const double *p = in->local + 3 * k;
    const simd *R = pose + 12 * in->segment[k];
    simd m[3], square = zero;
    measured_position(in, k, first, origin, m);
    for (int i = 0; i < 3; ++i) {
      const simd error = R[i] * p[0] + R[3 + i] * p[1] + R[6 + i] * p[2] + R[9 + i] - m[i];
      square += error * error;
    }
    for (int lane = 0; lane < LANES && first + lane < in->frames; ++lane)
      in->error[in->markers * (first + lane) + k] = sqrt(square[lane]);
  }
}

/* Put a frame into an empty lane. */
static void load_frame(const problem *in, active_frames *active, const double *sums, long long t,
                       int lane) {
  active->frame[lane] = t;
  for (int i = 0; i < N_Q; ++i) {
    active->q[i][lane] = in->start[N_Q * t + i];
    active->prior[i][lane] = in->prior[in->prior_stride * t + i];
    active->reference[i][lane] = in->reference[in->reference_stride * t + i];
    active->step[i][lane] = 0;
  }
  for (int i = 0; i < 3; ++i) {
    active->origin[i][lane] = active->q[i][lane];
    active->reference[i][lane] -= active->q[i][lane];
    active->q[i][lane] -= active->q[i][lane]; /* 0, or NaN where there is no starting point */
  }
  for (int i = 0; i < N_Q; ++i) active->accepted_q[i][lane] = active->q[i][lane];
  for (int i = 0; i < SUMS * MOVING; ++i) active->sums[i][lane] = sums[i];
  active->cost[lane] = INFINITY;
  active->gradient[lane] = NAN;
  active->curvature[lane] = 1;
  active->lowest[lane] = 0;
  active->damping[lane] = active->step_damping[lane] = in->damping;
  active->slope[lane] = active->iterations[lane] = 0;
}

/* Write a finished frame's solution and empty its lane. */
static void store_frame(const problem *in, active_frames *active, int converged, int lane) {
  const long long t = active->frame[lane];
  for (int i = 0; i < N_Q; ++i) {
    in->q[N_Q * t + i] = active->q[i][lane] + (i < 3 ? active->origin[i][lane] : 0);
    in->pivots[N_Q * t + i] = active->report[3 + i][lane];
  }
  in->gradient[t] = active->gradient[lane];
  in->converged[t] = converged;
  active->frame[lane] = -1;
}

/* The damping of the next step where the last one was too far: of those that raised the cost, a
 * multiple of the second derivative along the step or of its damping; of those that were cut, what
 * would have made them as long as they became. */
static void damp(const problem *in, active_frames *active, simd_mask rejected, simd_mask cut,
                 simd size) {
  simd square = zero;
  for (int i = 0; i < N_Q; ++i) square += active->step[i] * active->step[i];
  const simd along = -active->slope / square - active->step_damping;
  const simd more = in->damping_factor * simd_fmax(along, active->step_damping);
  const simd enough = simd_fmax(along * (size / in->max_step - 1), active->damping);
  active->damping = simd_select(rejected, more, simd_select(cut, enough, active->damping));
}

/* Do one iteration in every lane and store the frames that have converged or failed. */
static void iterate(const problem *in, active_frames *active, const simd *geometry) {
  simd step[N_Q], *report = active->report, size = zero, lowest;
  const simd *arg[] = {active->q,         active->sums,     active->prior,
                       active->reference, &active->damping, &active->curvature,
                       geometry};
  simd *res[] = {step, report};
  newton_step(arg, res, 0, 0, 0);
  const simd cost = report[0], gradient = report[1], slope = report[2], *pivots = report + 3;
  lowest = pivots[0];
  for (int i = 0; i < N_Q; ++i) {
    lowest = simd_select(pivots[i] < lowest, pivots[i], lowest);
    size = simd_fmax(simd_fabs(step[i]), size);
  }
  const simd_mask rejected = ~(cost <= active->cost * (1 + in->relative_rise) + in->absolute_rise);
  const simd_mask indefinite = ~rejected & (lowest <= 0) & (active->curvature > 0);
  const simd_mask accepted = ~rejected & ~indefinite, exact = active->curvature > 0;
  const simd_mask cut = accepted & (size > in->max_step);
  const simd scale = simd_select(cut, in->max_step / size, broadcast(1));
  for (int i = 0; i < N_Q; ++i) {
    const simd from = simd_select(rejected, active->accepted_q[i], active->q[i]);
    const simd by = simd_select(accepted, scale * step[i], zero);
    active->accepted_q[i] = from;
    active->q[i] = from + by;
    active->step[i] = simd_select(rejected, active->step[i], by);
  }
  const simd_mask undamped = active->damping <= in->damping;
  const simd_mask slow = active->iterations >= (double)in->slow;
  const simd_mask no_gain =
      -slope < simd_select(slow, broadcast(in->absolute_rise), broadcast(in->negligible_gain));
  const simd_mask still = accepted & undamped & (no_gain | (exact & (size < in->tolerance)));
  const simd_mask failed = rejected & (active->cost == INFINITY);
  active->lowest = simd_select(indefinite, lowest, active->lowest);
  const simd_mask minimum = exact | (active->lowest > in->saddle);
  const simd less = active->damping / in->damping_divisor;
  const simd relaxed =
      simd_select(less < in->negligible_damping, broadcast(in->damping), less);
  active->iterations += 1;
  active->cost = simd_select(accepted, cost, active->cost);
  active->slope = simd_select(accepted, slope * scale * scale, active->slope);
  active->gradient = simd_select(accepted, gradient, active->gradient);
  active->step_damping = simd_select(accepted, active->damping, active->step_damping);
  active->damping = simd_select(accepted, relaxed, active->damping);
  active->curvature = simd_select(accepted & (size < in->near_optimum), broadcast(1),
                                  simd_select(indefinite, zero, active->curvature));
  const simd_mask finished = still | failed | (active->iterations >= (double)in->max_iterations);
  const simd_mask too_far = rejected | cut;
  int any = 0;
  for (int lane = 0; lane < LANES; ++lane) {
    any |= too_far[lane] != 0;
    if (active->frame[lane] >= 0 && finished[lane])
      store_frame(in, active, still[lane] && minimum[lane], lane);
  }
  if (any) damp(in, active, rejected, cut, size);
}

/* Solve all frames: whenever a lane becomes free the next frame takes it. */
EXPORT
void solve_frames(const problem *in) {
  simd geometry[GEOMETRY];
  double block[LANES][SUMS * MOVING];
  active_frames active = {.frame = {0}};
  for (int i = 0; i < GEOMETRY; ++i) geometry[i] = broadcast(in->geometry[i]);
  for (int lane = 0; lane < LANES; ++lane) active.frame[lane] = -1;
  for (long long next = 0, busy = 1; busy;) {
    busy = 0;
    for (int lane = 0; lane < LANES; ++lane) {
      if (active.frame[lane] < 0 && next < in->frames) {
        if (next % LANES == 0) sum_markers(in, next, block);
        load_frame(in, &active, block[next % LANES], next, lane);
        ++next;
      }
      busy |= active.frame[lane] >= 0;
    }
    if (busy) iterate(in, &active, geometry);
  }
  for (long long first = 0; first < in->frames; first += LANES) marker_errors(in, first, geometry);
}
