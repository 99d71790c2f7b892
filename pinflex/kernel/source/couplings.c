/* Joints that follow others: rows c = sum_j A_j Q_j - offset, straight in the expanded coordinates.

     c' = sum_j A_j V_j     c'' = sum_j A_j V'_j     force on joint j: lam A_j     J = sum_j A_j X_j

   The forces are those of joints, so that bodies carry none of them; X_j: row j of the map. */
#include "tangent.h"

void coupling_motion(const Tables *t, const Work *w, Lane *value, Lane *rate, Lane *second) {
  for (Int k = 0; k < t->couplings; k++) {
    Int row = t->couple_row[k];
    value[row] = lane(-t->couple_offset[k]), rate[row] = second[row] = lane(0);
    for (Int p = t->couple_at[k]; p < t->couple_at[k + 1]; p++) {
      value[row] += t->couple_factor[p] * w->Q[t->couple_q[p]];
      rate[row] += t->couple_factor[p] * w->V[t->couple_v[p]];
      second[row] += t->couple_factor[p] * w->A[t->couple_v[p]];
    }
  }
}

/* Closures, and what the joints need less by; w->V holds their forces. */
void couple_joints(const Tables *t, Work *w, const Lane *lam, Lane *c) {
  for (Int k = 0; k < t->couplings; k++) {
    Int row = t->couple_row[k];
    c[row] = lane(-t->couple_offset[k]);
    for (Int p = t->couple_at[k]; p < t->couple_at[k + 1]; p++) {
      c[row] += t->couple_factor[p] * w->Q[t->couple_q[p]];
      w->V[t->couple_v[p]] -= t->couple_factor[p] * lam[row];
    }
  }
}

void coupling_jacobian(const Tables *t, const Tangent *w, double *J) {
  for (Int k = 0; k < t->couplings; k++) {
    double *row = J + t->couple_row[k] * t->nv;
    memset(row, 0, t->nv * sizeof(double));
    for (Int p = t->couple_at[k]; p < t->couple_at[k + 1]; p++) {
      Int j = t->couple_v[p];
      const double *x = w->x + t->x_at[j];
      for (Int k = 0; k < columns_of(t, t->block_of[j]); k++)
        row[t->block_at[t->block_of[j]] + k] += t->couple_factor[p] * x[k];
    }
  }
}

void coupling_rates(const Tables *t, const Tangent *w, double *out) {
  for (Int k = 0; k < t->couplings; k++) {
    double second = 0.0;
    for (Int p = t->couple_at[k]; p < t->couple_at[k + 1]; p++)
      second += t->couple_factor[p] * w->growth[t->couple_v[p]];
    out[t->couple_row[k]] = second;
  }
}
