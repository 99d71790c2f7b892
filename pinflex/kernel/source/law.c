/* A continuous linear feedback on what is measured, e = S (y - home) - target:

     x' = A x + B_e e,   u = C x + D e + E e',   r -= B u

   Its states go by the trapezoidal rule: x_1 = x_of_x x_0 + x_of_e (e_0 + e_1). */
#include "law.h"
#include "march.h"

/* out += W x, W (rows, n) */
static void add_product(Int rows, Int n, const double *W, const double *x, double *out) {
  for (Int i = 0; i < rows; i++)
    for (Int j = 0; j < n; j++) out[i] += W[i * n + j] * x[j];
}

void feed_back(const Tables *t, const Stages *st, const Law *law, const double *y, const double *v,
               double *r) {
  Int n = law->measures, m = law->states;
  displacement(t, st, law->home, y, law->way);
  for (Int i = 0; i < n; i++) law->e[i] = -law->target[i], law->rate[i] = 0.0;
  add_product(n, t->nv, law->S, law->way, law->e);
  add_product(n, t->nv, law->S, v, law->rate);
  for (Int i = 0; i < m; i++) {
    law->x[i] = 0.0;
    for (Int j = 0; j < n; j++) law->x[i] += law->x_of_e[i * n + j] * (law->e_before[j] + law->e[j]);
  }
  add_product(m, m, law->x_of_x, law->x_before, law->x);
  for (Int k = 0; k < law->drives; k++) law->u[k] = 0.0;
  add_product(law->drives, m, law->C, law->x, law->u);
  add_product(law->drives, n, law->D, law->e, law->u);
  add_product(law->drives, n, law->E, law->rate, law->u);
  for (Int i = 0; r && i < t->nv; i++)
    for (Int k = 0; k < law->drives; k++) r[i] -= law->B[i * law->drives + k] * law->u[k];
}

void feed_back_tangent(const Tables *t, const Law *law, double *C, double *K) {
  Int n = law->measures, m = law->states, nv = t->nv;
  for (Int k = 0; k < law->drives; k++)
    for (Int j = 0; j < n; j++) {
      double by_e = law->D[k * n + j], by_rate = law->E[k * n + j];
      for (Int l = 0; l < m; l++) by_e += law->C[k * m + l] * law->x_of_e[l * n + j];
      for (Int row = 0; row < nv; row++) {
        double b = law->B[row * law->drives + k];
        for (Int i = 0; b != 0.0 && i < nv; i++) {
          K[row * nv + i] -= b * by_e * law->S[j * nv + i];
          C[row * nv + i] -= b * by_rate * law->S[j * nv + i];
        }
      }
    }
}

double law_power(const Tables *t, const Law *law, const double *v) {
  double power = 0.0;
  for (Int i = 0; i < t->nv; i++)
    for (Int k = 0; k < law->drives; k++) power += law->B[i * law->drives + k] * law->u[k] * v[i];
  return power;
}

void end_step(const Law *law) {
  copy(law->x_before, law->x, law->states);
  copy(law->e_before, law->e, law->measures);
}
