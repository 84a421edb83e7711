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
typedef int kernel(const lanes **, lanes **, long long *, lanes *, int);

static inline lanes broadcast(double x) { return (lanes){0} + x; }
static inline lanes casadi_sq(lanes x) { return x * x; }
static inline lanes lanes_sin(lanes x) {
  for (int l = 0; l < LANES; ++l) x[l] = sin(x[l]);
  return x;
}
static inline lanes lanes_cos(lanes x) {
  for (int l = 0; l < LANES; ++l) x[l] = cos(x[l]);
  return x;
}
static inline lanes lanes_fabs(lanes x) {
  for (int l = 0; l < LANES; ++l) x[l] = fabs(x[l]);
  return x;
}
static inline lanes lanes_fmax(lanes x, lanes y) {
  for (int l = 0; l < LANES; ++l) x[l] = fmax(x[l], y[l]);
  return x;
}

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
