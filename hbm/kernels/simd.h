/* Numbers with one lane per frame, what the kernels ask of them, and kernels run over many frames.
 *
 * The vectors are a C extension that GCC and Clang share; on a processor without registers of that
 * width they become several narrower ones.
 */
#include <math.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { LANES = 8 };
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));
typedef int kernel(const lanes **, lanes **, long long *, lanes *, int);

static inline lanes broadcast(double x) { return (lanes){0} + x; }
static inline lanes casadi_sq(lanes x) { return x * x; }
/* sin(x + quarters π/2): less the nearest multiple of π/2, which is held in three parts so that
 * taking it off is exact up to a million turns, then Taylor's series on ±π/4. */
__attribute__((noinline)) static lanes sin_after(long long quarters, lanes x) {
  const double whole = 0x1.8p52, quarters_per_radian = 0x1.45f306dc9c883p-1;
  const lanes nearest = x * quarters_per_radian + whole, k = nearest - whole;
  const lanes r = x - k * 0x1.921fb544p0 - k * 0x1.0b4611a6p-34 - k * 0x1.3198a2e037073p-69;
  const lanes s = r * r;
  lanes sine = broadcast(0), cosine = broadcast(0);
#pragma GCC unroll 8
  for (int n = 16; n > 0; n -= 2) {
    sine = (1 - sine) * s * (1.0 / (n * (n + 1)));
    cosine = (1 - cosine) * s * (1.0 / (n * (n - 1)));
  }
  const mask quadrant = (mask)nearest + quarters, odd = -(quadrant & 1);
  const mask size = ((mask)(1 - cosine) & odd) | ((mask)(r - r * sine) & ~odd);
  return (lanes)(size ^ (quadrant & 2) << 62);
}
static inline lanes lanes_sin(lanes x) { return sin_after(0, x); }
static inline lanes lanes_cos(lanes x) { return sin_after(1, x); }
static inline lanes pick(mask where, lanes yes, lanes no) {
  return (lanes)(((mask)yes & where) | ((mask)no & ~where));
}
static inline lanes lanes_fabs(lanes x) { return pick(x < 0, -x, x); }
static inline lanes lanes_fmax(lanes x, lanes y) { return pick(x > y, x, y); }

/* Evaluate a kernel for many frames; sizes are numbers per frame, `shared` inputs are the same for
 * all frames, `room` holds one block's inputs and outputs. */
static void over_frames(kernel evaluate, long long frames, int inputs, const int *size_in,
                        const int *shared, int outputs, const int *size_out,
                        const double *const *in, double *const *out, lanes *room) {
  const lanes *arg[16];
  lanes *block[16], *res[16];
  for (int i = 0; i < inputs; room += size_in[i++]) arg[i] = block[i] = room;
  for (int i = 0; i < outputs; room += size_out[i++]) res[i] = room;
  for (int i = 0; i < inputs; ++i)
    for (int j = 0; shared[i] && j < size_in[i]; ++j) block[i][j] = broadcast(in[i][j]);

  for (long long first = 0; first < frames; first += LANES) {
    const int used = frames - first < LANES ? (int)(frames - first) : LANES;
    for (int i = 0; i < inputs; ++i)
      for (int l = 0; !shared[i] && l < LANES; ++l) {
        const double *row = in[i] + size_in[i] * (first + (l < used ? l : 0));
        for (int j = 0; j < size_in[i]; ++j) block[i][j][l] = row[j];
      }
    evaluate(arg, res, 0, 0, 0);
    for (int i = 0; i < outputs; ++i)
      for (int l = 0; l < used; ++l) {
        double *row = out[i] + size_out[i] * (first + l);
        for (int j = 0; j < size_out[i]; ++j) row[j] = res[i][j][l];
      }
  }
}
