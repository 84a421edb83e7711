/* Newton's method on whole stretches of frames, `LANES` of them side by side.
 *
 * Compiled together with the kernels that casadi writes, whose numbers are vectors with one lane per
 * frame; N, SEGMENTS, SUMS and GEOMETRY come with them. Every lane goes its own way: it halves its step where the cost rises, drops the curvature
 * where the Hessian is not positive, and rests once its step is below the tolerance. The block ends
 * with its slowest lane. `hbm.descent` does the same in NumPy where there is no compiler.
 */

enum { MOST_ITERATIONS = 60, MOST_RETREATS = 20 };

static const double FLOOR = 1e-9, LARGEST_STEP = 0.5, NEAR = 0.1;

/* Sum a frame's markers per segment: w, wp, wpp, wm, wmp, wmm (see hbm.skeleton). */
static void sum_markers(long long markers, const double *position, const double *weight,
                        const double *local, const long long *segment, int lane, lanes *sums) {
  for (long long k = 0; k < markers; ++k) {
    const double *m = position + 3 * k, *p = local + 3 * k;
    if (isnan(m[0])) continue;
    lanes *s = sums + SUMS * segment[k];
    const double w = weight[k], wp[3] = {w * p[0], w * p[1], w * p[2]};
    s[0][lane] += w;
    for (int i = 0; i < 3; ++i) {
      s[1 + i][lane] += wp[i];
      s[4 + i][lane] += wp[i] * p[i];
      s[10 + i][lane] += w * m[i];
      s[22][lane] += w * m[i] * m[i];
      for (int a = 0; a < 3; ++a) s[13 + 3 * a + i][lane] += wp[a] * m[i];
    }
    s[7][lane] += wp[0] * p[1];
    s[8][lane] += wp[0] * p[2];
    s[9][lane] += wp[1] * p[2];
  }
}

/* Distance of a frame's markers from the model. */
static void measure_errors(long long markers, const double *position, const double *local,
                           const long long *segment, const lanes *pose, int lane, double *error) {
  for (long long k = 0; k < markers; ++k) {
    const double *m = position + 3 * k, *p = local + 3 * k;
    const lanes *R = pose + 12 * segment[k];
    double square = 0;
    for (int i = 0; i < 3; ++i) {
      const double away = R[i][lane] * p[0] + R[3 + i][lane] * p[1] + R[6 + i][lane] * p[2] +
                          R[9 + i][lane] - m[i];
      square += away * away;
    }
    error[k] = sqrt(square);
  }
}

/* Solve `frames` frames; q holds the starting points and then the solutions. */
EXPORT
void solve_frames(long long frames, long long markers, const double *position,
                  const double *weight, const double *local, const long long *segment,
                  const double *prior, const double *reference, const double *geometry,
                  double tolerance, double *q, double *pivots, double *error, double *gradient,
                  unsigned char *converged) {
  lanes at[N], sums[SUMS * SEGMENTS], pull[N], towards[N], damping, curvature, shape[GEOMETRY];
  lanes step[N], report[N + 2], pose[12 * SEGMENTS];
  double best[LANES][N], move[LANES][N], cost[LANES];
  int active[LANES], retreats[LANES];
  damping = broadcast(FLOOR);
  for (int i = 0; i < GEOMETRY; ++i) shape[i] = broadcast(geometry[i]);

  for (long long first = 0; first < frames; first += LANES) {
    const int used = frames - first < LANES ? (int)(frames - first) : LANES;
    for (int i = 0; i < SUMS * SEGMENTS; ++i) sums[i] = broadcast(0);
    curvature = broadcast(1);
    for (int l = 0; l < LANES; ++l) {
      const long long t = first + (l < used ? l : 0);
      sum_markers(markers, position + 3 * markers * t, weight, local, segment, l, sums);
      for (int i = 0; i < N; ++i) {
        at[i][l] = q[N * t + i];
        pull[i][l] = prior[N * t + i];
        towards[i][l] = reference[N * t + i];
        move[l][i] = 0;
        best[l][i] = q[N * t + i];
      }
      active[l] = l < used;
      retreats[l] = 0;
      cost[l] = INFINITY;
      if (l < used) converged[t] = 0;
    }
    int left = used;
    for (int iteration = 0; left > 0 && iteration < MOST_ITERATIONS; ++iteration) {
      const lanes *in[] = {at, sums, pull, towards, &damping, &curvature, shape};
      lanes *out[] = {step, report};
      newton_step(in, out, 0, 0, 0);
      for (int l = 0; l < used; ++l) {
        if (!active[l]) continue;
        const long long t = first + l;
        if (!(report[0][l] <= cost[l] * (1 + 1e-9) + 1e-12)) { /* worse: go back most of the way */
          for (int i = 0; i < N; ++i) at[i][l] = best[l][i] + (move[l][i] /= 4);
          if (++retreats[l] > MOST_RETREATS) active[l] = 0, --left;
          continue;
        }
        double lowest = INFINITY, size = 0;
        for (int i = 0; i < N; ++i) lowest = fmin(lowest, report[2 + i][l]);
        if (lowest <= 0 && curvature[l] > 0) { /* not positive: without curvature it is */
          curvature[l] = 0;
          continue;
        }
        for (int i = 0; i < N; ++i) size = fmax(size, fabs(step[i][l]));
        const double share = size > LARGEST_STEP ? LARGEST_STEP / size : 1;
        cost[l] = report[0][l];
        gradient[t] = report[1][l];
        for (int i = 0; i < N; ++i) {
          pivots[N * t + i] = report[2 + i][l];
          best[l][i] = at[i][l];
          move[l][i] = share * step[i][l];
          at[i][l] += move[l][i];
        }
        if (size < NEAR) curvature[l] = 1;
        if (size < tolerance) converged[t] = 1, active[l] = 0, --left;
      }
    }
    const lanes *in[] = {at, shape};
    lanes *out[] = {pose};
    segment_poses(in, out, 0, 0, 0);
    for (int l = 0; l < used; ++l) {
      const long long t = first + l;
      for (int i = 0; i < N; ++i) q[N * t + i] = at[i][l];
      measure_errors(markers, position + 3 * markers * t, local, segment, pose, l,
                     error + markers * t);
    }
  }
}
