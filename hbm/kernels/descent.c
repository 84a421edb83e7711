/* Newton's method on whole stretches of frames, `LANES` of them side by side.
 *
 * Compiled together with the kernels that casadi writes, whose numbers are vectors with one lane per
 * frame; N, SEGMENTS, SUMS and GEOMETRY come with them. Every frame goes its own way: it goes back
 * most of a step where the cost rises, drops the curvature where the Hessian is not positive, and
 * leaves its lane to the next one once its step is below the tolerance. `hbm.ik.descent` does the same
 * in NumPy where there is no compiler.
 */

enum { MOST_ITERATIONS = 60, MOST_RETREATS = 20 };

static const double FLOOR = 1e-9, LARGEST_STEP = 0.5, NEAR = 0.1;

/* The task: markers on a skeleton, where they were measured, and frames to solve. `row` says where in
 * the measured markers each frame is; a prior or reference that all frames share has a stride of 0. */
typedef struct {
  long long frames, markers, measured, prior_stride, reference_stride;
  const long long *row, *column, *segment;
  const double *local, *weight, *geometry, *position, *start, *prior, *reference;
  double tolerance, *q, *pivots, *error, *gradient;
  unsigned char *converged;
} task;

/* Frames on their way, one in each lane; `frame` is -1 in an empty lane. Places are about `origin`,
 * the pelvis of the starting point, so that rounding does not grow with the distance from the lab's
 * origin. */
typedef struct {
  long long frame[LANES];
  lanes at[N], best[N], move[N], sums[SUMS * SEGMENTS], pull[N], toward[N], origin[3];
  lanes cost, slope, curvature, retreats, iterations, pivots[N];
} walkers;

static const lanes zero = {0};

/* Where a marker was measured in the block of frames that begins with `first`. */
static inline void measured_at(const task *of, long long k, long long first, const lanes *origin,
                               lanes *m) {
  for (int l = 0; l < LANES; ++l) {
    const long long t = first + l < of->frames ? first + l : first;
    const double *p = of->position + 3 * (of->measured * of->row[t] + of->column[k]);
    for (int i = 0; i < 3; ++i) m[i][l] = p[i];
  }
  for (int i = 0; i < 3; ++i) m[i] -= origin[i];
}

/* Give three columns of a table for a block of frames. */
static inline void three(const task *of, const double *table, long long first, lanes *out) {
  for (int l = 0; l < LANES; ++l) {
    const long long t = first + l < of->frames ? first + l : first;
    for (int i = 0; i < 3; ++i) out[i][l] = table[N * t + i];
  }
}

/* Sum the markers of a block per segment: w, wp, wpp, wm, wmp, wmm (see hbm.kernels.skeleton). */
static void sum_markers(const task *of, long long first, double waiting[LANES][SUMS * SEGMENTS]) {
  lanes origin[3], sums[SUMS * SEGMENTS];
  three(of, of->start, first, origin);
  for (int i = 0; i < SUMS * SEGMENTS; ++i) sums[i] = zero;
  for (long long k = 0; k < of->markers; ++k) {
    const double *p = of->local + 3 * k;
    lanes *s = sums + SUMS * of->segment[k], m[3];
    measured_at(of, k, first, origin, m);
    const mask seen = m[0] == m[0];
    const lanes w = pick(seen, broadcast(of->weight[k]), zero);
    s[0] += w;
    for (int i = 0; i < 3; ++i) {
      const lanes wm = pick(seen, w * m[i], zero);
      s[1 + i] += w * p[i];
      s[4 + i] += w * (p[i] * p[i]);
      s[7 + i] += w * (p[i / 2] * p[1 + (i + 1) / 2]);
      s[10 + i] += wm;
      for (int a = 0; a < 3; ++a) s[13 + 3 * a + i] += wm * p[a];
      s[22] += pick(seen, wm * m[i], zero);
    }
  }
  for (int i = 0; i < SUMS * SEGMENTS; ++i)
    for (int l = 0; l < LANES; ++l) waiting[l][i] = sums[i][l];
}

/* Distance of the markers from the model in a block of solved frames. */
static void measure_errors(const task *of, long long first, const lanes *shape) {
  lanes at[N], pose[12 * SEGMENTS], origin[3];
  for (int l = 0; l < LANES; ++l)
    for (int i = 0; i < N; ++i) at[i][l] = of->q[N * (first + l < of->frames ? first + l : first) + i];
  three(of, of->start, first, origin);
  for (int i = 0; i < 3; ++i) at[i] -= origin[i];
  const lanes *in[] = {at, shape};
  lanes *out[] = {pose};
  segment_poses(in, out, 0, 0, 0);
  for (long long k = 0; k < of->markers; ++k) {
    const double *p = of->local + 3 * k;
    const lanes *R = pose + 12 * of->segment[k];
    lanes m[3], square = zero;
    measured_at(of, k, first, origin, m);
    for (int i = 0; i < 3; ++i) {
      const lanes away = R[i] * p[0] + R[3 + i] * p[1] + R[6 + i] * p[2] + R[9 + i] - m[i];
      square += away * away;
    }
    for (int l = 0; l < LANES && first + l < of->frames; ++l)
      of->error[of->markers * (first + l) + k] = sqrt(square[l]);
  }
}

/* Put a frame into a lane. */
static void enter(const task *of, walkers *all, const double *sums, long long t, int l) {
  all->frame[l] = t;
  for (int i = 0; i < N; ++i) {
    all->at[i][l] = of->start[N * t + i];
    all->pull[i][l] = of->prior[of->prior_stride * t + i];
    all->toward[i][l] = of->reference[of->reference_stride * t + i];
    all->move[i][l] = 0;
  }
  for (int i = 0; i < 3; ++i) {
    all->origin[i][l] = all->at[i][l];
    all->toward[i][l] -= all->at[i][l];
    all->at[i][l] -= all->at[i][l]; /* nothing, or not a number */
  }
  for (int i = 0; i < N; ++i) all->best[i][l] = all->at[i][l];
  for (int i = 0; i < SUMS * SEGMENTS; ++i) all->sums[i][l] = sums[i];
  all->cost[l] = INFINITY;
  all->slope[l] = NAN;
  all->curvature[l] = 1;
  all->retreats[l] = all->iterations[l] = 0;
}

/* Take the frame out of a lane. */
static void leave(const task *of, walkers *all, int converged, int l) {
  const long long t = all->frame[l];
  for (int i = 0; i < N; ++i) {
    of->q[N * t + i] = all->at[i][l] + (i < 3 ? all->origin[i][l] : 0);
    of->pivots[N * t + i] = all->pivots[i][l];
  }
  of->gradient[t] = all->slope[l];
  of->converged[t] = converged;
  all->frame[l] = -1;
}

/* Take one step in every lane; frames that end, or come to no end, leave theirs. */
static void advance(const task *of, walkers *all, const lanes *shape) {
  const lanes damping = broadcast(FLOOR);
  lanes step[N], report[2 + N], size = zero, lowest;
  const lanes *in[] = {all->at, all->sums, all->pull, all->toward, &damping, &all->curvature, shape};
  lanes *out[] = {step, report};
  newton_step(in, out, 0, 0, 0);
  const lanes cost = report[0], slope = report[1], *pivots = report + 2;
  lowest = pivots[0];
  for (int i = 0; i < N; ++i) {
    all->pivots[i] = pivots[i];
    lowest = pick(pivots[i] < lowest, pivots[i], lowest);
    size = lanes_fmax(lanes_fabs(step[i]), size);
  }
  const mask worse = ~(cost <= all->cost * (1 + 1e-9) + 1e-12);
  const mask bent = ~worse & (lowest <= 0) & (all->curvature > 0);
  const mask fine = ~worse & ~bent;
  const lanes share = pick(size > LARGEST_STEP, LARGEST_STEP / size, broadcast(1));
  for (int i = 0; i < N; ++i) {
    all->move[i] = pick(fine, share * step[i], pick(worse, all->move[i] / 4, all->move[i]));
    all->best[i] = pick(fine, all->at[i], all->best[i]);
    all->at[i] = pick(fine | worse, all->best[i] + all->move[i], all->at[i]);
  }
  all->retreats += pick(worse, broadcast(1), zero);
  all->iterations += 1;
  const mask lost = (worse & (all->cost == INFINITY)) | (all->retreats > MOST_RETREATS);
  all->cost = pick(fine, cost, all->cost);
  all->slope = pick(fine, slope, all->slope);
  all->curvature = pick(bent, zero, pick(fine & (size < NEAR), broadcast(1), all->curvature));
  const mask ended = fine & (size < of->tolerance);
  const mask out_of = ended | lost | (all->iterations >= MOST_ITERATIONS);
  for (int l = 0; l < LANES; ++l)
    if (all->frame[l] >= 0 && out_of[l]) leave(of, all, ended[l] != 0, l);
}

/* Solve frames: whenever one leaves its lane the next one takes it. */
EXPORT
void solve_frames(const task *of) {
  lanes shape[GEOMETRY];
  double waiting[LANES][SUMS * SEGMENTS];
  walkers all = {.frame = {0}};
  for (int i = 0; i < GEOMETRY; ++i) shape[i] = broadcast(of->geometry[i]);
  for (int l = 0; l < LANES; ++l) all.frame[l] = -1;
  for (long long next = 0, busy = 1; busy;) {
    busy = 0;
    for (int l = 0; l < LANES; ++l) {
      if (all.frame[l] < 0 && next < of->frames) {
        if (next % LANES == 0) sum_markers(of, next, waiting);
        enter(of, &all, waiting[next % LANES], next, l);
        ++next;
      }
      busy |= all.frame[l] >= 0;
    }
    if (busy) advance(of, &all, shape);
  }
  for (long long first = 0; first < of->frames; first += LANES) measure_errors(of, first, shape);
}
