/* The coordinate map: minimal coordinates y = (q, eta) to the expanded ones, and forces back. */
#include "kernel.h"

/* Q = q_rigid | Phi eta + 1/2 eta' G eta,  V = X v,  A = X a + Xdot v,  X = Phi + G eta.
   Of the symmetric G the upper triangle is kept, with half the diagonal: eta' G eta / 2 is then the
   sum of g eta_i eta_j. */
void expand(const Tables *t, Work *w, const Lane *y, const Lane *v, const Lane *a) {
  const Lane *eta = y + t->nq_rigid, *rate = v + t->nv_rigid, *growth = a + t->nv_rigid;
  w->eta = eta, w->rate = rate, w->growth = growth;
  for (Int k = 0; k < t->nq_rigid; k++) w->Q[t->q_at[k]] = y[k];
  for (Int k = 0; k < t->nv_rigid; k++) w->V[t->v_at[k]] = v[k], w->A[t->v_at[k]] = a[k];
  for (Int e = 0; e < t->rows; e++) {
    Lane u = lane(0), du = lane(0), ddu = lane(0);
    for (Int p = t->phi_at[e]; p < t->phi_at[e + 1]; p++) {
      Int i = t->phi_i[p];
      u += t->phi[p] * eta[i];
      du += t->phi[p] * rate[i];
      ddu += t->phi[p] * growth[i];
    }
    for (Int p = t->g_at[e]; p < t->g_at[e + 1]; p++) {
      Int i = t->g_i[p], j = t->g_j[p];
      double g = t->g[p];
      u += g * (eta[i] * eta[j]);
      du += g * (eta[i] * rate[j] + eta[j] * rate[i]);
      ddu += g * (eta[i] * growth[j] + eta[j] * growth[i] + 2.0 * (rate[i] * rate[j]));
    }
    w->Q[t->row_q[e]] = u;
    w->V[t->row_v[e]] = du;
    w->A[t->row_v[e]] = ddu;
  }
}

static Lane angle(const Lane *y, Int paired) {
  if (!paired) return y[0];
  Lane x;
  for (int l = 0; l < LANES; l++) x[l] = atan2(y[1][l], y[0][l]);
  return x;
}

/* r = X' g + armature a + K eta + D v + k (q - rest) + F(v);  w->V holds g. */
void project(const Tables *t, const Work *w, const Lane *y, const Lane *v, Lane *r) {
  const Lane *eta = y + t->nq_rigid;
  Lane *r_eta = r + t->nv_rigid;
  for (Int k = 0; k < t->nv_rigid; k++) r[k] = w->V[t->v_at[k]];
  for (Int i = 0; i < t->nv - t->nv_rigid; i++) r_eta[i] = t->sleeves ? -w->beam[i] : lane(0);
  for (Int e = 0; e < t->rows; e++) {
    Lane g = w->V[t->row_v[e]];
    for (Int p = t->phi_at[e]; p < t->phi_at[e + 1]; p++) r_eta[t->phi_i[p]] += t->phi[p] * g;
    for (Int p = t->g_at[e]; p < t->g_at[e + 1]; p++) {
      Int i = t->g_i[p], j = t->g_j[p];
      Lane push = t->g[p] * g;
      r_eta[i] += push * eta[j];
      r_eta[j] += push * eta[i];
    }
  }
  /* Stiff forces come last, in one sum: small ones would each be rounded to their digits. */
  for (Int i = 0; i < t->nv - t->nv_rigid; i++) {
    Lane sum = lane(0);
    for (Int p = t->k_at[i]; p < t->k_at[i + 1]; p++) sum += t->k[p] * eta[t->k_j[p]];
    r_eta[i] += sum;
  }
  add_curvature(t, eta, r_eta);
  for (Int i = 0; i < t->nv; i++)
    for (Int p = t->d_at[i]; p < t->d_at[i + 1]; p++) r[i] += t->d[p] * v[t->d_j[p]];
  for (Int k = 0; k < t->joint_springs; k++) {
    const double *law = t->joint_spring_law + 2 * k;
    Lane q = angle(y + t->joint_spring_q[k], t->joint_spring_paired[k]);
    r[t->joint_spring_v[k]] += law[0] * (q - law[1]);
  }
  add_friction(t, v, r);
}
