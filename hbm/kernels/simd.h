/* Numbers with one SIMD lane per frame, the functions that the kernels call on them, and kernels run
 * over many frames.
 *
 * The vectors are a C extension that GCC and Clang share. The compiler is told their number of lanes,
 * LANES, and for a wider one than every processor has, which one may be assumed.
 */
#include <math.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef double simd __attribute__((vector_size(8 * LANES)));
typedef long long simd_mask __attribute__((vector_size(8 * LANES)));
typedef int kernel(const simd **, simd **, long long *, simd *, int);

/* Lanes of this library, and of the widest one that this processor runs. */
EXPORT int lanes(void) { return LANES; }
EXPORT int lanes_of_processor(void) {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512f") ? 8 : __builtin_cpu_supports("avx2") ? 4 : 2;
#else
  return 2;
#endif
}

static inline simd broadcast(double x) { return (simd){0} + x; }
static inline simd casadi_sq(simd x) { return x * x; }
/* sin(x + quarter_turns π/2): subtract the nearest multiple of π/2, which is held in three parts so
 * that the subtraction is exact up to a million turns (Cody and Waite 1980), then sum Taylor's series
 * on ±π/4. Adding 1.5 · 2^52 rounds to the nearest whole number. */
__attribute__((noinline)) static simd shifted_sin(long long quarter_turns, simd x) {
  const double rounding = 0x1.8p52, quarters_per_radian = 0x1.45f306dc9c883p-1;
  const simd nearest = x * quarters_per_radian + rounding, k = nearest - rounding;
  const simd r = x - k * 0x1.921fb544p0 - k * 0x1.0b4611a6p-34 - k * 0x1.3198a2e037073p-69;
  const simd s = r * r;
  simd sine = broadcast(0), cosine = broadcast(0);
#pragma GCC unroll 8
  for (int n = 16; n > 0; n -= 2) {
    sine = (1 - sine) * s * (1.0 / (n * (n + 1)));
    cosine = (1 - cosine) * s * (1.0 / (n * (n - 1)));
  }
  const simd_mask quadrant = (simd_mask)nearest + quarter_turns, odd = -(quadrant & 1);
  const simd_mask size = ((simd_mask)(1 - cosine) & odd) | ((simd_mask)(r - r * sine) & ~odd);
  return (simd)(size ^ (quadrant & 2) << 62);
}
static inline simd simd_sin(simd x) { return shifted_sin(0, x); }
static inline simd simd_cos(simd x) { return shifted_sin(1, x); }
static inline simd simd_select(simd_mask where, simd yes, simd no) {
  return (simd)(((simd_mask)yes & where) | ((simd_mask)no & ~where));
}
static inline simd simd_fabs(simd x) { return simd_select(x < 0, -x, x); }
static inline simd simd_fmax(simd x, simd y) { return simd_select(x > y, x, y); }

/* Evaluate a kernel for many frames. Sizes are numbers per frame; inputs marked `constant` are the
 * same for all frames; outputs whose address is null are not asked for; `workspace` holds one block's
 * inputs and outputs. */
static void evaluate_frames(kernel evaluate, long long frames, int inputs, const int *size_in,
                            const int *constant, int outputs, const int *size_out,
                            const double *const *in, double *const *out, simd *workspace) {
  const simd *arg[16];
  simd *block[16], *res[16];
  for (int i = 0; i < inputs; workspace += size_in[i++]) arg[i] = block[i] = workspace;
  for (int i = 0; i < outputs; workspace += size_out[i++]) res[i] = out[i] ? workspace : 0;
  for (int i = 0; i < inputs; ++i)
    for (int j = 0; constant[i] && j < size_in[i]; ++j) block[i][j] = broadcast(in[i][j]);

  for (long long first = 0; first < frames; first += LANES) {
    const int used = frames - first < LANES ? (int)(frames - first) : LANES;
    for (int i = 0; i < inputs; ++i)
      for (int lane = 0; !constant[i] && lane < LANES; ++lane) {
        const double *row = in[i] + size_in[i] * (first + (lane < used ? lane : 0));
        for (int j = 0; j < size_in[i]; ++j) block[i][j][lane] = row[j];
      }
    evaluate(arg, res, 0, 0, 0);
    for (int i = 0; i < outputs; ++i)
      for (int lane = 0; out[i] && lane < used; ++lane) {
        double *row = out[i] + size_out[i] * (first + lane);
        for (int j = 0; j < size_out[i]; ++j) row[j] = res[i][j][lane];
      }
  }
}
