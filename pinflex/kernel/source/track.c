/* Sections of a beam: polynomials in their place s, times modal coordinates.

   Between the breaks of a track each entry c(s) of Phi or G is a sum of z^d, z from -1 to 1. A row
   is a sum of c eta_i and c eta_i eta_j; of the symmetric G the upper triangle is kept, with half
   the diagonal. The section sits, in the frame of its stretch's root, at

     r(s) = (s + u, v + kappa_y b, w + kappa_z b),   b = s^2 (s - l) / l^2

   turned by R = Rz(rz) Ry(ry) Rx(rx); kappa is what the slope at the far end lacks of the axis
   there (see pinflex/mechanics/guide.py). */
#include "sleeves.h"

/* c and three derivatives of every entry of a track at s, (4, entries); beyond an end the Taylor
   series of third order goes on. */
static const double *entries(Sleeve *w, Int track, double s) {
  const Tables *t = w->t;
  Int n = t->entry_at[track + 1] - t->entry_at[track], first = t->piece_at[track];
  Int last = t->piece_at[track + 1] - 1, degrees = t->track_degrees[track];
  double length = t->piece_start[last] + 2.0 * t->piece_half[last];
  double inside = fmin(fmax(s, 0.0), length), gap = s - inside;
  Int k = first, above = last;
  while (k < above) {
    Int middle = (k + above + 1) / 2;
    if (t->piece_start[middle] <= inside) k = middle;
    else above = middle - 1;
  }
  double half = t->piece_half[k], z = (inside - t->piece_start[k]) / half - 1.0;
  double power[4] = {1.0, 0.0, 0.0, 0.0}; /* of z^d by s, times z^d */
  double *out = take(&w->room, 4 * n);
  const double *c = t->power + t->power_at[track] + (k - first) * degrees * n;
  for (Int d = 0; d < degrees; d++, c += n) {
    for (int order = 0; order < 4 && order <= d; order++) {
      double x = power[order], *row = out + order * n;
      for (Int i = 0; i < n; i++) row[i] += x * c[i];
    }
    for (int order = 3; order > 0; order--)
      power[order] = z * power[order] + order * power[order - 1] / half;
    power[0] *= z;
  }
  if (gap != 0.0)
    for (Int i = 0; i < n; i++) {
      double *x = out + i, c1 = x[n], c2 = x[2 * n], c3 = x[3 * n];
      x[0] += gap * (c1 + gap * (c2 / 2.0 + gap * c3 / 6.0));
      x[n] += gap * (c2 + gap * c3 / 2.0);
      x[2 * n] += gap * c3;
    }
  return out;
}

/* row += c f of one coordinate or two, where the variables are time and s. */
static void add_moving(const Sleeve *w, Jet row, const double *c, const double *f) {
  const Room *r = &w->room;
  row[0] += c[0] * f[0], row[1] += c[1] * f[0];
  if (r->m == 1) return;
  row[2] += c[0] * f[1];
  row[hess(r, 0, 0)] += c[2] * f[0];
  row[hess(r, 1, 0)] += c[1] * f[1];
  row[hess(r, 1, 1)] += c[0] * f[2];
}

/* row += c eta_i (j < 0) or c eta_i eta_j by s and the coordinates; first: variable of eta_0. */
static void add_entry(const Sleeve *w, Jet row, const double *c, const double *eta, Int i, Int j,
                      Int first) {
  const Room *r = &w->room;
  double by_i = j < 0 ? 1.0 : eta[j], x = by_i * eta[i];
  row[0] += c[0] * x, row[1] += c[1] * x;
  row[1 + first + i] += c[0] * by_i;
  if (j >= 0) row[1 + first + j] += c[0] * eta[i];
  if (!r->second) return;
  row[hess(r, 0, 0)] += c[2] * x;
  row[hess(r, first + i, 0)] += c[1] * by_i;
  if (j < 0) return;
  row[hess(r, first + j, 0)] += c[1] * eta[i];
  row[hess(r, first + j, first + i)] += (i == j ? 2.0 : 1.0) * c[0]; /* i <= j */
}

void track_rows(Sleeve *w, Int stretch, double s, Int order, int held, Jet *rows) {
  const Tables *t = w->t;
  Int track = t->stretch_track[stretch], from = t->entry_at[track];
  Int n = t->entry_at[track + 1] - from, at = t->stretch_eta[stretch];
  Int first = w->reached[stretch - w->on + 1];
  for (Int k = 0; k < TRACK_ROWS; k++) rows[k] = jet(&w->room, 0.0);
  const double *c = entries(w, track, s), *eta = w->eta + at;
  for (Int e = 0; e < n; e++) {
    Int i = t->entry_i[from + e], j = t->entry_j[from + e];
    Jet row = rows[t->entry_row[from + e]];
    double x[3] = {0};
    for (Int k = 0; k < 3 && order + k < 4; k++) x[k] = held && k ? 0.0 : c[(order + k) * n + e];
    if (first) {
      add_entry(w, row, x, eta, i, j, first);
      continue;
    }
    double f[3] = {eta[i], 0.0, 0.0};
    if (w->room.m > 1) f[1] = w->rate[at + i], f[2] = w->growth[at + i];
    if (j >= 0) {
      double g[3] = {eta[j], 0.0, 0.0};
      if (w->room.m > 1) g[1] = w->rate[at + j], g[2] = w->growth[at + j];
      f[2] = f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2];
      f[1] = f[1] * g[0] + f[0] * g[1];
      f[0] *= g[0];
    }
    add_moving(w, row, x, f);
  }
}

/* kappa of a stretch, (y, z); shear is no part of it: a section is not square to a beam that shears. */
static void kink(Sleeve *w, Int stretch, Jet *kappa) {
  Room *r = &w->room;
  double length = w->t->stretch_length[stretch];
  Jet rate[TRACK_ROWS], row[TRACK_ROWS];
  track_rows(w, stretch, length, 1, 1, rate);
  track_rows(w, stretch, length, 0, 1, row);
  rate[0][0] += 1.0;
  double a = row[3][0], b = row[4][0], ta = tan(a), tb = tan(b), sec = 1.0 / cos(a);
  Jet tan_a = function_of(r, row[3], ta, 1.0 + ta * ta, 2.0 * ta * (1.0 + ta * ta));
  Jet tan_b = function_of(r, row[4], tb, 1.0 + tb * tb, 2.0 * tb * (1.0 + tb * tb));
  Jet secant = function_of(r, row[3], sec, sec * ta, sec * (2.0 * sec * sec - 1.0));
  kappa[0] = product(r, rate[0], tan_a);
  add_jet(r, kappa[0], -1.0, rate[1]);
  add_jet(r, kappa[0], 1.0, row[6]);
  kappa[1] = jet(r, 0.0);
  add_jets(r, kappa[1], -1.0, product(r, rate[0], tan_b), secant);
  add_jet(r, kappa[1], -1.0, rate[2]);
  add_jet(r, kappa[1], 1.0, row[7]);
}

/* R = Rz Ry Rx, the section's axes one after the other. */
static void turned(Room *r, Jet *angle, Jet *R) {
  Jet c[3], s[3];
  for (int k = 0; k < 3; k++) {
    double x = angle[k][0];
    c[k] = function_of(r, angle[k], cos(x), -sin(x), -cos(x));
    s[k] = function_of(r, angle[k], sin(x), cos(x), -sin(x));
  }
  Jet over = product(r, s[1], s[2]), back = product(r, s[1], c[2]);
  R[0] = product(r, c[0], c[1]);
  R[1] = product(r, s[0], c[1]);
  R[2] = jet(r, 0.0);
  add_jet(r, R[2], -1.0, s[1]);
  R[3] = product(r, c[0], over), add_jets(r, R[3], -1.0, s[0], c[2]);
  R[4] = product(r, s[0], over), add_jets(r, R[4], 1.0, c[0], c[2]);
  R[5] = product(r, c[1], s[2]);
  R[6] = product(r, c[0], back), add_jets(r, R[6], 1.0, s[0], s[2]);
  R[7] = product(r, s[0], back), add_jets(r, R[7], -1.0, c[0], s[2]);
  R[8] = product(r, c[1], c[2]);
}

void section(Sleeve *w, Int stretch, double s, int held, Jet *r, Jet *R) {
  Room *room = &w->room;
  double l = w->t->stretch_length[stretch];
  Jet rows[TRACK_ROWS], kappa[2];
  track_rows(w, stretch, s, 0, held, rows);
  rows[0][0] += s;
  if (!held) { /* at the far end, where sections are held, there is no bump */
    Jet bump = jet(room, s * s * (s - l) / (l * l));
    rows[0][1] += 1.0;
    bump[1] = s * (3.0 * s - 2.0 * l) / (l * l);
    if (room->second) bump[hess(room, 0, 0)] = (6.0 * s - 2.0 * l) / (l * l);
    kink(w, stretch, kappa);
    for (int d = 0; d < 2; d++) add_jets(room, rows[1 + d], 1.0, kappa[d], bump);
  }
  for (int d = 0; d < 3; d++) r[d] = rows[d];
  if (R) turned(room, rows + 3, R);
}
