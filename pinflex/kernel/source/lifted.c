/* Jacobians of nodes in minimal coordinates, and products with them. */
#include "tangent.h"

void lift(const Tables *t, const Tangent *w, Int node, double *out) {
  memset(out, 0, 6 * t->nv * sizeof(double));
  for (; node >= 0; node = t->parent[node]) {
    Int block = t->node_block[node], n = columns_of(t, block);
    for (Int j = t->node_v[node]; j < t->node_v[node] + width(t->kind[node]); j++)
      for (int d = 0; d < 6; d++) {
        const double *x = w->x + t->x_at[j];
        double *to = out + d * t->nv + t->block_at[block], S = w->column[j].S[d];
        for (Int k = 0; k < n; k++) to[k] += S * x[k];
      }
  }
}

void lift_speeds(const Tables *t, const Tangent *w, Int node, double *out) {
  memset(out, 0, 6 * t->nv * sizeof(double));
  for (; node >= 0; node = t->parent[node]) {
    Int block = t->node_block[node], n = columns_of(t, block);
    for (Int j = t->node_v[node]; j < t->node_v[node] + width(t->kind[node]); j++)
      for (int d = 0; d < 6; d++) {
        const double *x = w->x + t->x_at[j], *dx = w->dx + t->x_at[j];
        double *to = out + d * t->nv + t->block_at[block];
        double S = w->column[j].S[d], Y = w->column[j].Y[d];
        for (Int k = 0; k < n; k++) to[k] += Y * x[k] + S * dx[k];
      }
  }
}

void add_transposed(Int nv, const double *J, const double *P, double sign, double *K) {
  const double *p = P, *q = P + nv, *r = P + 2 * nv, *s = P + 3 * nv, *u = P + 4 * nv, *v = P + 5 * nv;
  for (Int i = 0; i < nv; i++) {
    double x[6], *to = K + i * nv, most = 0.0;
    for (int d = 0; d < 6; d++) x[d] = sign * J[d * nv + i], most += fabs(x[d]);
    if (most == 0.0) continue;
    for (Int j = 0; j < nv; j++)
      to[j] += x[0] * p[j] + x[1] * q[j] + x[2] * r[j] + x[3] * s[j] + x[4] * u[j] + x[5] * v[j];
  }
}

void add_product(Int nv, const double *J, const double *S, const double *D, double sign,
                 double *pushed, double *K) {
  for (int d = 0; d < 6; d++)
    for (Int j = 0; j < nv; j++) {
      double sum = 0;
      for (int e = 0; e < 6; e++) sum += S[6 * d + e] * D[e * nv + j];
      pushed[d * nv + j] = sum;
    }
  add_transposed(nv, J, pushed, sign, K);
}
