/* Elastic potential of links, e' K e / 2 of e = eta - rest, with rest where they are free of stress,
   and that of bends that are not small, of fourth order in eta (pinflex/bodies/basis.py):

     V = 1/2 sum_p k_p m_p^2,   m = v' v'' + w' w''  at the points p of a body,  v' = slope eta, v'' = bend eta
     dV/deta = sum_p k m u,   d2V/deta2 = sum_p k (u u' + m (slope bend' + bend slope')),   u = dm/deta

   Rows of slope and bend: point by point, of each its one or two directions. */
#include "tangent.h"

/* v', w' and v'', w'' at a point. */
static void bends(Int n, Int directions, const double *slope, const double *bend, const Lane *x,
                  Lane *first, Lane *second) {
  for (Int d = 0; d < directions; d++) {
    first[d] = second[d] = lane(0);
    for (Int i = 0; i < n; i++)
      first[d] += slope[d * n + i] * x[i], second[d] += bend[d * n + i] * x[i];
  }
}

static Lane curvature_energy(const Tables *t, const Lane *eta) {
  Lane energy = lane(0);
  for (Int b = 0; b < t->bent; b++) {
    Int n = t->bent_n[b], directions = t->bent_directions[b], at = t->bent_at[b];
    for (Int p = t->bent_point[b]; p < t->bent_point[b + 1]; p++, at += directions * n) {
      Lane first[2], second[2], m = lane(0);
      bends(n, directions, t->bent_slope + at, t->bent_bend + at, eta + t->bent_first[b], first, second);
      for (Int d = 0; d < directions; d++) m += first[d] * second[d];
      energy += 0.5 * t->bent_weight[p] * m * m;
    }
  }
  return energy;
}

static void add_curvature(const Tables *t, const Lane *eta, Lane *r) {
  for (Int b = 0; b < t->bent; b++) {
    Int n = t->bent_n[b], directions = t->bent_directions[b];
    const double *slope = t->bent_slope + t->bent_at[b], *bend = t->bent_bend + t->bent_at[b];
    const Lane *x = eta + t->bent_first[b];
    Lane *out = r + t->bent_first[b];
    for (Int p = t->bent_point[b]; p < t->bent_point[b + 1]; p++) {
      Lane first[2], second[2], push = lane(0);
      bends(n, directions, slope, bend, x, first, second);
      for (Int d = 0; d < directions; d++) push += t->bent_weight[p] * first[d] * second[d];
      for (Int d = 0; d < directions; d++)
        for (Int i = 0; i < n; i++)
          out[i] += push * (second[d] * slope[d * n + i] + first[d] * bend[d * n + i]);
      slope += directions * n, bend += directions * n;
    }
  }
}

/* Row i of K (eta - rest). Stiff forces are one sum: small ones would each be rounded to their digits. */
static Lane resistance(const Tables *t, const Lane *eta, Int i) {
  Lane sum = lane(0);
  for (Int p = t->k_at[i]; p < t->k_at[i + 1]; p++) {
    Int j = t->k_j[p];
    sum += t->k[p] * (eta[j] - t->rest[j]);
  }
  return sum;
}

void add_strain(const Tables *t, const Lane *eta, Lane *r) {
  for (Int i = 0; i < t->nv - t->nv_rigid; i++) r[i] += resistance(t, eta, i);
  add_curvature(t, eta, r);
}

Lane strain_energy(const Tables *t, const Lane *eta) {
  Lane energy = curvature_energy(t, eta);
  for (Int i = 0; i < t->nv - t->nv_rigid; i++)
    energy += 0.5 * (eta[i] - t->rest[i]) * resistance(t, eta, i);
  return energy;
}

/* K (nv, nv) from its row and column of the first elastic coordinate on; u: room for nv. */
void curvature_tangent(const Tables *t, const Lane *eta, double *u, double *K) {
  Int nv = t->nv;
  for (Int b = 0; b < t->bent; b++) {
    Int n = t->bent_n[b], directions = t->bent_directions[b];
    const double *slope = t->bent_slope + t->bent_at[b], *bend = t->bent_bend + t->bent_at[b];
    const Lane *x = eta + t->bent_first[b];
    double *out = K + t->bent_first[b] * (nv + 1);
    for (Int p = t->bent_point[b]; p < t->bent_point[b + 1]; p++) {
      double k = t->bent_weight[p], mixed = 0.0;
      for (Int i = 0; i < n; i++) u[i] = 0.0;
      for (Int d = 0; d < directions; d++) {
        const double *s = slope + d * n, *c = bend + d * n;
        double first = 0.0, second = 0.0;
        for (Int i = 0; i < n; i++) first += s[i] * x[i][0], second += c[i] * x[i][0];
        for (Int i = 0; i < n; i++) u[i] += second * s[i] + first * c[i];
        mixed += first * second;
      }
      for (Int i = 0; i < n; i++)
        for (Int j = 0; j < n; j++) {
          double both = u[i] * u[j];
          for (Int d = 0; d < directions; d++)
            both += mixed * (slope[d * n + i] * bend[d * n + j] + bend[d * n + i] * slope[d * n + j]);
          out[i * nv + j] += k * both;
        }
      slope += directions * n, bend += directions * n;
    }
  }
}
