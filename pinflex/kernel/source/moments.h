/* Six-vectors, and the moments of mass and momentum that a tangent is made of (see tangent.c). */
#ifndef PINFLEX_MOMENTS_H
#define PINFLEX_MOMENTS_H

#include "lanes.h"
#include <string.h>

/* Mass, first and second moments of a set of bodies, and those of its momentum. */
typedef struct { double m, h[3], J[9], P[3], Z[9]; } Moments;

static inline void crossed(const double *a, const double *b, double *out) {
  double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0], out[0] = x, out[1] = y;
}

static inline double times(const double *a, const double *b, Int n) {
  double sum = 0;
  for (Int i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

/* Motion x motion: (w x a + v x b, w x b) of (v, w) and (a, b). */
static inline void motion_cross(const double *m, const double *s, double *out) {
  double p[3], q[3];
  crossed(m + 3, s, p);
  crossed(m, s + 3, q);
  crossed(m + 3, s + 3, out + 3);
  for (int d = 0; d < 3; d++) out[d] = p[d] + q[d];
}

/* Motion x wrench: (w x F, w x N + v x F). */
static inline void wrench_cross(const double *m, const double *f, double *out) {
  double p[3], q[3];
  crossed(m + 3, f + 3, p);
  crossed(m, f, q);
  crossed(m + 3, f, out);
  for (int d = 0; d < 3; d++) out[3 + d] = p[d] + q[d];
}

static inline void inertia_times(const Moments *I, const double *s, double *out) {
  double turned[3], arm[3], trace = I->J[0] + I->J[4] + I->J[8];
  crossed(s + 3, I->h, turned);
  crossed(I->h, s, arm);
  for (int d = 0; d < 3; d++) {
    out[d] = I->m * s[d] + turned[d];
    out[3 + d] = arm[d] + trace * s[3 + d] - times(I->J + 3 * d, s + 3, 3);
  }
}

/* out += B s, which depends on the turning part of s alone. */
static inline void add_momentum_times(const Moments *I, const double *s, double *out) {
  double turned[3], trace = I->Z[0] + I->Z[4] + I->Z[8];
  crossed(s + 3, I->P, turned);
  for (int d = 0; d < 3; d++) {
    out[d] += 2.0 * turned[d];
    out[3 + d] += 2.0 * (trace * s[3 + d] - times(I->Z + 3 * d, s + 3, 3));
  }
}

/* B' s: its turning part; the other is zero. */
static inline void momentum_transposed(const Moments *I, const double *s, double *out) {
  double turned[3], trace = I->Z[0] + I->Z[4] + I->Z[8];
  crossed(I->P, s, turned);
  for (int d = 0; d < 3; d++) {
    double back = I->Z[d] * s[3] + I->Z[3 + d] * s[4] + I->Z[6 + d] * s[5];
    out[d] = 2.0 * (turned[d] + trace * s[3 + d] - back);
  }
}

/* P = m v + w x h,  Z = v h' + [w x] J  of a body that moves by (v, w). */
static inline void set_momentum(Moments *I, const double *motion) {
  double turned[3];
  crossed(motion + 3, I->h, turned);
  for (int d = 0; d < 3; d++) I->P[d] = I->m * motion[d] + turned[d];
  for (int e = 0; e < 3; e++) {
    double column[3] = {I->J[e], I->J[3 + e], I->J[6 + e]};
    crossed(motion + 3, column, turned);
    for (int d = 0; d < 3; d++) I->Z[3 * d + e] = motion[d] * I->h[e] + turned[d];
  }
}

static inline void add_moments(Moments *total, const Moments *part) {
  double *to = &total->m;
  const double *from = &part->m;
  for (unsigned i = 0; i < sizeof(Moments) / sizeof(double); i++) to[i] += from[i];
}

/* m, h, J of a mass m at c. */
static inline void point_moments(double m, const double *c, Moments *I) {
  memset(I, 0, sizeof *I);
  I->m = m;
  for (int d = 0; d < 3; d++) {
    I->h[d] = m * c[d];
    for (int e = 0; e < 3; e++) I->J[3 * d + e] = m * c[d] * c[e];
  }
}

/* Add a tensor of inertia (own axes, turned by R): J += tr/2 - R I R'. */
static inline void add_tensor(const double *R, const double *tensor, Moments *I) {
  double RI[9], trace = 0.5 * (tensor[0] + tensor[4] + tensor[8]);
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++)
      RI[3 * d + e] = R[3 * d] * tensor[e] + R[3 * d + 1] * tensor[3 + e]
                      + R[3 * d + 2] * tensor[6 + e];
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++)
      I->J[3 * d + e] += (d == e ? trace : 0.0) - times(RI + 3 * d, R + 3 * e, 3);
}

static inline void rotated(const double *R, const double *n, double *out) {
  for (int d = 0; d < 3; d++) out[d] = times(R + 3 * d, n, 3);
}

/* [a] as a (3, 3) block, times k, into columns of a (6, 6). */
static inline void add_skew(const double *a, double k, double *out) {
  out[1] -= k * a[2], out[2] += k * a[1], out[6] += k * a[2];
  out[8] -= k * a[0], out[12] -= k * a[1], out[13] += k * a[0];
}

/* k [a][b] likewise. */
static inline void add_twice_skew(const double *a, const double *b, double k, double *out) {
  double ab = times(a, b, 3);
  for (int d = 0; d < 3; d++)
    for (int e = 0; e < 3; e++) out[6 * d + e] += k * (b[d] * a[e] - (d == e ? ab : 0.0));
}

#endif
