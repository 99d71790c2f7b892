/* Numbers with their first and, where wanted, second derivatives by m variables.

   A jet is its value, its gradient (m) and the lower triangle of its Hessian, row by row, one after
   the other. Jets are taken out of a room one after the other, and given back all at once. */
#ifndef PINFLEX_JETS_H
#define PINFLEX_JETS_H

#include "lanes.h"
#include <string.h>

typedef double *Jet;
typedef struct { double *at; Int m, size; int second; } Room;

/* Place of row i, column j <= i of a Hessian in its jet. */
static inline Int hess(const Room *r, Int i, Int j) { return 1 + r->m + i * (i + 1) / 2 + j; }

static inline Int jet_size(Int m, int second) { return 1 + m + (second ? m * (m + 1) / 2 : 0); }

static inline void set_variables(Room *r, Int m, int second) {
  r->m = m, r->second = second, r->size = jet_size(m, second);
}

static inline double *take(Room *r, Int n) {
  double *found = r->at;
  r->at += n;
  memset(found, 0, (size_t)n * sizeof(double));
  return found;
}

static inline Jet jet(Room *r, double x) {
  Jet f = take(r, r->size);
  f[0] = x;
  return f;
}

/* to += k f */
static inline void add_jet(const Room *r, Jet to, double k, const double *f) {
  for (Int i = 0; i < r->size; i++) to[i] += k * f[i];
}

/* to += k f g */
static inline void add_jets(const Room *r, Jet to, double k, const double *f, const double *g) {
  const double *fh = f + 1 + r->m, *gh = g + 1 + r->m, *gi = g + 1, *fi = f + 1;
  double x = k * f[0], y = k * g[0], *h = to + 1 + r->m;
  to[0] += x * g[0];
  for (Int i = 1; i <= r->m; i++) to[i] += x * g[i] + y * f[i];
  for (Int i = 0; r->second && i < r->m; i++) {
    double p = k * fi[i], q = k * gi[i];
    for (Int j = 0; j <= i; j++) h[j] += x * gh[j] + y * fh[j] + p * gi[j] + q * fi[j];
    h += i + 1, fh += i + 1, gh += i + 1;
  }
}

static inline Jet product(Room *r, const double *f, const double *g) {
  Jet to = jet(r, 0.0);
  add_jets(r, to, 1.0, f, g);
  return to;
}

static inline Jet sum_of_products(Room *r, Jet *f, Jet *g) {
  Jet to = jet(r, 0.0);
  for (int d = 0; d < 3; d++) add_jets(r, to, 1.0, f[d], g[d]);
  return to;
}

/* A function of f by its value and derivatives there. */
static inline Jet function_of(Room *r, const double *f, double x, double dx, double ddx) {
  Jet to = jet(r, x);
  for (Int i = 1; i < r->size; i++) to[i] = dx * f[i];
  for (Int i = 0; r->second && i < r->m; i++)
    for (Int j = 0; j <= i; j++) to[hess(r, i, j)] += ddx * f[1 + i] * f[1 + j];
  return to;
}

/* The first variable s by the others where F = 0:

     s_i = -F_i / F_s,   s_ij = -(F_ij + F_si s_j + F_sj s_i + F_ss s_i s_j) / F_s */
static inline Jet solved(Room *r, const double *F) {
  Jet s = jet(r, 0.0);
  const double *S = s + 1;
  double k = -1.0 / F[1];
  for (Int i = 1; i < r->m; i++) s[1 + i] = k * F[1 + i];
  for (Int i = 1; r->second && i < r->m; i++)
    for (Int j = 1; j <= i; j++) {
      double x = F[hess(r, i, j)] + F[hess(r, i, 0)] * S[j] + F[hess(r, j, 0)] * S[i];
      s[hess(r, i, j)] = k * (x + F[hess(r, 0, 0)] * S[i] * S[j]);
    }
  return s;
}

/* f where the first variable is s: nothing then depends on it. */
static inline void eliminate(const Room *r, const double *s, Jet f) {
  const double *S = s + 1;
  double by = f[1];
  for (Int i = 1; r->second && i < r->m; i++)
    for (Int j = 1; j <= i; j++) {
      double x = f[hess(r, i, 0)] * S[j] + f[hess(r, j, 0)] * S[i];
      f[hess(r, i, j)] += x + f[hess(r, 0, 0)] * S[i] * S[j] + by * s[hess(r, i, j)];
    }
  for (Int i = 1; i < r->m; i++) f[1 + i] += by * S[i];
  f[1] = 0.0;
  for (Int i = 0; r->second && i < r->m; i++) f[hess(r, i, 0)] = 0.0;
}

#endif
