/* The coordinate map: minimal coordinates y = (q, eta) to the expanded ones, and forces back. */
#include "kernel.h"

/* Products of two coordinates and their rates: rows of a body are sums of the same ones. */
static void take_products(const Tables *t, Work *w) {
  const Lane *eta = w->eta, *rate = w->rate, *growth = w->growth;
  for (Int q = 0; q < t->products; q++) {
    Int i = t->g_first[q], j = t->g_second[q];
    Lane *out = w->product + 3 * q;
    out[0] = eta[i] * eta[j];
    out[1] = eta[i] * rate[j] + eta[j] * rate[i];
    out[2] = eta[i] * growth[j] + eta[j] * growth[i] + 2.0 * (rate[i] * rate[j]);
  }
}

/* Q = q_rigid | Phi eta + 1/2 eta' G eta,  V = X v,  A = X a + Xdot v,  X = Phi + G eta.
   Of the symmetric G the upper triangle is kept, with half the diagonal: eta' G eta / 2 is then the
   sum of g eta_i eta_j. Rows of many such products that are sums of a few squares, k s^2 with
   s = psi . eta, are those. */
static void one_square(const double *psi, Int n, const Lane *eta, const Lane *rate, const Lane *growth,
                       Lane *out) {
  Lane s = lane(0), ds = lane(0), dds = lane(0);
  for (Int i = 0; i < n; i++) s += psi[i] * eta[i], ds += psi[i] * rate[i], dds += psi[i] * growth[i];
  out[0] = s, out[1] = s * s, out[2] = 2.0 * s * ds, out[3] = 2.0 * (ds * ds + s * dds);
}

/* FOUR at a time what is read serves four times. */
enum { FOUR = 4 };

static void four_squares(const double *psi, Int n, const Lane *eta, const Lane *rate,
                         const Lane *growth, Lane *out) {
  Lane s[FOUR] = {0}, ds[FOUR] = {0}, dds[FOUR] = {0};
  for (Int i = 0; i < n; i++)
    for (int k = 0; k < FOUR; k++) {
      double x = psi[k * n + i];
      s[k] += x * eta[i], ds[k] += x * rate[i], dds[k] += x * growth[i];
    }
  for (int k = 0; k < FOUR; k++, out += 4) {
    out[0] = s[k], out[1] = s[k] * s[k], out[2] = 2.0 * s[k] * ds[k];
    out[3] = 2.0 * (ds[k] * ds[k] + s[k] * dds[k]);
  }
}

static void take_squares(const Tables *t, Work *w) {
  for (Int q = 0; q < t->squares;) {
    Int at = t->square_eta[q], n = t->square_at[q + 1] - t->square_at[q];
    int four = q + FOUR <= t->squares && t->square_eta[q + FOUR - 1] == at;
    (four ? four_squares : one_square)(t->square + t->square_at[q], n, w->eta + at, w->rate + at,
                                       w->growth + at, w->square + 4 * q);
    q += four ? FOUR : 1;
  }
}

/* Whether FOUR rows from e on are sums of the same squares. */
static int four_alike(const Tables *t, Int e) {
  if (e + FOUR > t->rows) return 0;
  for (Int k = 1; k < FOUR; k++)
    if (t->sum_from[e + k] != t->sum_from[e]
        || t->sum_at[e + k + 1] - t->sum_at[e + k] != t->sum_at[e + 1] - t->sum_at[e])
      return 0;
  return 1;
}

/* Sums of squares for some rows, and their rates. */
static void add_sums(const Tables *t, const Work *w, Int e, int rows) {
  const Lane *square = w->square + 4 * t->sum_from[e];
  const double *sum = t->sum + t->sum_at[e];
  Int n = t->sum_at[e + 1] - t->sum_at[e];
  Lane u[FOUR] = {0}, du[FOUR] = {0}, ddu[FOUR] = {0};
  if (rows == FOUR)
    for (Int p = 0; p < n; p++)
      for (int k = 0; k < FOUR; k++) {
        double x = sum[k * n + p];
        u[k] += x * square[4 * p + 1], du[k] += x * square[4 * p + 2], ddu[k] += x * square[4 * p + 3];
      }
  else
    for (Int p = 0; p < n; p++) {
      double x = sum[p];
      u[0] += x * square[4 * p + 1], du[0] += x * square[4 * p + 2], ddu[0] += x * square[4 * p + 3];
    }
  for (int k = 0; k < rows; k++) {
    w->Q[t->row_q[e + k]] += u[k];
    w->V[t->row_v[e + k]] += du[k];
    w->A[t->row_v[e + k]] += ddu[k];
  }
}

static void sum_squares(const Tables *t, const Work *w) {
  for (Int e = 0; t->squares && e < t->rows;) {
    int rows = four_alike(t, e) ? FOUR : 1;
    if (t->sum_at[e + 1] > t->sum_at[e]) add_sums(t, w, e, rows);
    e += rows;
  }
}

/* r_eta += 2 k g s psi, of the rows' forces g. */
static void project_squares(const Tables *t, const Work *w, Lane *r_eta) {
  for (Int q = 0; q < t->squares; q++) w->square[4 * q + 1] = lane(0);
  for (Int e = 0; t->squares && e < t->rows;) {
    Int n = t->sum_at[e + 1] - t->sum_at[e];
    Lane g[FOUR], *push = w->square + 4 * t->sum_from[e] + 1;
    const double *sum = t->sum + t->sum_at[e];
    int rows = four_alike(t, e) ? FOUR : 1;
    for (int k = 0; k < rows; k++) g[k] = w->V[t->row_v[e + k]];
    if (rows == FOUR)
      for (Int p = 0; p < n; p++)
        push[4 * p] += (sum[p] * g[0] + sum[n + p] * g[1]) + (sum[2 * n + p] * g[2] + sum[3 * n + p] * g[3]);
    else
      for (Int p = 0; p < n; p++) push[4 * p] += sum[p] * g[0];
    e += rows;
  }
  for (Int q = 0; q < t->squares;) {
    const double *psi = t->square + t->square_at[q];
    Int at = t->square_eta[q], n = t->square_at[q + 1] - t->square_at[q];
    int four = q + FOUR <= t->squares && t->square_eta[q + FOUR - 1] == at;
    Lane push[FOUR], *square = w->square + 4 * q, *to = r_eta + at;
    for (int k = 0; k < (four ? FOUR : 1); k++) push[k] = 2.0 * square[4 * k] * square[4 * k + 1];
    if (four)
      for (Int i = 0; i < n; i++)
        to[i] += (push[0] * psi[i] + push[1] * psi[n + i])
                 + (push[2] * psi[2 * n + i] + push[3] * psi[3 * n + i]);
    else
      for (Int i = 0; i < n; i++) to[i] += push[0] * psi[i];
    q += four ? FOUR : 1;
  }
}

/* Rows of Phi and of products. What tables point to is named first: to the compiler, a lane that is
   stored may be one of the pointers. */
static void sum_products(const Tables *t, const Work *w) {
  const Lane *eta = w->eta, *rate = w->rate, *growth = w->growth, *product = w->product;
  const Int *phi_at = t->phi_at, *phi_i = t->phi_i;
  const Int *g_at = t->g_at, *g_rest = t->g_rest, *g_pair = t->g_pair;
  const double *phi = t->phi, *g = t->g;
  for (Int e = 0, rows = t->rows; e < rows; e++) {
    Lane u = lane(0), du = lane(0), ddu = lane(0);
    for (Int p = phi_at[e], end = phi_at[e + 1]; p < end; p++) {
      Int i = phi_i[p];
      u += phi[p] * eta[i], du += phi[p] * rate[i], ddu += phi[p] * growth[i];
    }
    for (Int p = g_at[e], end = g_rest[e]; p < end; p++) {
      const Lane *of = product + 3 * g_pair[p];
      u += g[p] * of[0], du += g[p] * of[1], ddu += g[p] * of[2];
    }
    w->Q[t->row_q[e]] = u, w->V[t->row_v[e]] = du, w->A[t->row_v[e]] = ddu;
  }
}

/* r_eta += X' g of the same rows */
static void project_products(const Tables *t, const Work *w, const Lane *eta, Lane *r_eta) {
  const Int *phi_at = t->phi_at, *phi_i = t->phi_i;
  const Int *g_at = t->g_at, *g_rest = t->g_rest, *g_pair = t->g_pair;
  const double *phi = t->phi, *g = t->g;
  const Int *row = t->row_v, *first = t->g_first, *second = t->g_second;
  const Lane *force = w->V;
  Lane *push = w->push;
  Int rows = t->rows, products = t->products;
  for (Int q = 0; q < products; q++) push[q] = lane(0);
  for (Int e = 0; e < rows; e++) {
    Lane f = force[row[e]];
    for (Int p = phi_at[e], end = phi_at[e + 1]; p < end; p++) r_eta[phi_i[p]] += phi[p] * f;
    for (Int p = g_at[e], end = g_rest[e]; p < end; p++) push[g_pair[p]] += g[p] * f;
  }
  for (Int q = 0; q < products; q++) {
    Int i = first[q], j = second[q];
    r_eta[i] += push[q] * eta[j];
    r_eta[j] += push[q] * eta[i];
  }
}

void expand(const Tables *t, Work *w, const Lane *y, const Lane *v, const Lane *a) {
  const Lane *eta = y + t->nq_rigid, *rate = v + t->nv_rigid, *growth = a + t->nv_rigid;
  w->eta = eta, w->rate = rate, w->growth = growth;
  take_products(t, w);
  take_squares(t, w);
  for (Int k = 0; k < t->nq_rigid; k++) w->Q[t->q_at[k]] = y[k];
  for (Int k = 0; k < t->nv_rigid; k++) w->V[t->v_at[k]] = v[k], w->A[t->v_at[k]] = a[k];
  sum_products(t, w);
  sum_squares(t, w);
}

Lane joint_spring_angle(const Tables *t, Int k, const Lane *y) {
  y += t->joint_spring_q[k];
  if (!t->joint_spring_paired[k]) return y[0];
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
  project_products(t, w, eta, r_eta);
  project_squares(t, w, r_eta);
  add_strain(t, eta, r_eta); /* stiff forces come last */
  for (Int i = 0; i < t->nv; i++)
    for (Int p = t->d_at[i]; p < t->d_at[i + 1]; p++) r[i] += t->d[p] * v[t->d_j[p]];
  for (Int k = 0; k < t->joint_springs; k++) {
    const double *law = t->joint_spring_law + 2 * k;
    r[t->joint_spring_v[k]] += law[0] * (joint_spring_angle(t, k, y) - law[1]);
  }
  add_friction(t, v, r);
  add_kinks(t, w, y, v, r);
}
