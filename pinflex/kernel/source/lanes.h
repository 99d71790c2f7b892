/* Several states side by side: each number of a state is one lane of a vector.

   GCC and Clang turn arithmetic on these types into the widest instructions of the target. */
#ifndef PINFLEX_LANES_H
#define PINFLEX_LANES_H

#include <math.h>
#include <stdint.h>

enum { LANES = 4 };
typedef int64_t Int;
typedef double Lane __attribute__((vector_size(8 * LANES)));
typedef double LooseLane __attribute__((vector_size(8 * LANES), aligned(8))); /* not aligned */
typedef int64_t LaneBits __attribute__((vector_size(8 * LANES)));

#if defined(__GNUC__) && !defined(__clang__) /* lanes pass between files compiled alike */
#pragma GCC diagnostic ignored "-Wpsabi"
#endif

static inline Lane lane(double x) { return (Lane){x, x, x, x}; }

/* sum of a_k b_k, n numbers */
static inline double inner(const double *a, const double *b, Int n) {
  Lane sums = lane(0);
  double sum = 0.0;
  Int k = 0;
  for (; k + LANES <= n; k += LANES) sums += *(const LooseLane *)(a + k) * *(const LooseLane *)(b + k);
  for (; k < n; k++) sum += a[k] * b[k];
  for (int l = 0; l < LANES; l++) sum += sums[l];
  return sum;
}

/* out += k sum_l w_l x_l of `count` rows x, which are `apart`: the first n numbers of each */
static inline void blend(Int count, Int n, Int apart, double k, const double *w, const double *x,
                         double *out) {
  Int i = 0;
  for (; i + LANES <= n; i += LANES) {
    Lane sum = *(LooseLane *)(out + i);
    for (Int l = 0; l < count; l++) sum += k * w[l] * *(const LooseLane *)(x + l * apart + i);
    *(LooseLane *)(out + i) = sum;
  }
  for (; i < n; i++) {
    double sum = out[i];
    for (Int l = 0; l < count; l++) sum += k * w[l] * x[l * apart + i];
    out[i] = sum;
  }
}

/* out_i = sum_l W_il x_l, of `count` rows x of n numbers */
static inline void blends(Int rows, Int count, Int n, const double *W, const double *x, double *out) {
  for (Int i = 0; i < rows * n; i++) out[i] = 0.0;
  for (Int i = 0; i < rows; i++) blend(count, n, n, 1.0, W + i * count, x, out + i * n);
}

static inline Lane dot(const Lane *a, const Lane *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out = a x b */
static inline void cross(const Lane *a, const Lane *b, Lane *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* out = R v and out = R' v, R row by row */
static inline void turn(const Lane *R, const Lane *v, Lane *out) {
  for (int i = 0; i < 3; i++) out[i] = R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2];
}

static inline void turn_back(const Lane *R, const Lane *v, Lane *out) {
  for (int i = 0; i < 3; i++) out[i] = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2];
}

/* The same with a constant rotation, and with a constant vector. */
static inline void turn_by(const double *R, const Lane *v, Lane *out) {
  for (int i = 0; i < 3; i++) out[i] = R[3 * i] * v[0] + R[3 * i + 1] * v[1] + R[3 * i + 2] * v[2];
}

static inline void turn_back_by(const double *R, const Lane *v, Lane *out) {
  for (int i = 0; i < 3; i++) out[i] = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2];
}

/* Sine and cosine. x = k pi/2 + z with |z| <= pi/4, whose Taylor series end below round-off
   (z^19/19! < 1e-19). Angles above 1e5 rad, where k pi/2 would lose digits, go to libm. */
static inline void sine_cosine(Lane x, Lane *sine, Lane *cosine) {
  int far = 0;
  for (int l = 0; l < LANES; l++) far |= !(fabs(x[l]) < 1e5);
  if (far) {
    for (int l = 0; l < LANES; l++) (*sine)[l] = sin(x[l]), (*cosine)[l] = cos(x[l]);
    return;
  }
  const double rounding = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to an integer */
  Lane shifted = x * 0.63661977236758134308 + rounding; /* 2 / pi */
  LaneBits quarter = (LaneBits)shifted;
  Lane k = shifted - rounding;
  /* pi / 2 in three parts, of which the first two have zeros behind: their products are exact. */
  Lane z = ((x - k * 1.57079632673412561417) - k * 6.07710050630396597660e-11)
           - k * 2.02226624879595063154e-21;
  Lane q = z * z;
  Lane s = lane(1.0 / 355687428096000.0);
  s = s * q - 1.0 / 1307674368000.0;
  s = s * q + 1.0 / 6227020800.0;
  s = s * q - 1.0 / 39916800.0;
  s = s * q + 1.0 / 362880.0;
  s = s * q - 1.0 / 5040.0;
  s = s * q + 1.0 / 120.0;
  s = s * q - 1.0 / 6.0;
  s = z + z * q * s;
  Lane c = lane(1.0 / 20922789888000.0);
  c = c * q - 1.0 / 87178291200.0;
  c = c * q + 1.0 / 479001600.0;
  c = c * q - 1.0 / 3628800.0;
  c = c * q + 1.0 / 40320.0;
  c = c * q - 1.0 / 720.0;
  c = c * q + 1.0 / 24.0;
  c = 1.0 - 0.5 * q + q * q * c;
  LaneBits odd = -(quarter & 1), flip_s = (quarter & 2) << 62, flip_c = ((quarter + 1) & 2) << 62;
  LaneBits sin_bits = (odd & (LaneBits)c) | (~odd & (LaneBits)s);
  LaneBits cos_bits = (odd & (LaneBits)s) | (~odd & (LaneBits)c);
  *sine = (Lane)(sin_bits ^ flip_s);
  *cosine = (Lane)(cos_bits ^ flip_c);
}

#endif
