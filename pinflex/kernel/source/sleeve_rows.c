/* The rows of a sleeve by where it is and how the beam is bent.

   On one body (pinflex/mechanics/evaluation/equations.py), with v, w and the twist psi at X = p_x, at
   X +- a, and n_y = (-v', 1, psi), n_z = (-w', -psi, 1):

     hold  p_y - v     right  v(X + a) - v - a v'     left  v(X - a) - v + a v'     chord  p_y
     tilt  e_x . n_y   twist  e_y . n_z               pivot  v(X + a) - 2 v + v(X - a)

   On stretches (pinflex/mechanics/passing.py) the section s with (p - r) . t = 0 counts, with the
   axes t, n_y, n_z of its curve, and at the ends (r(s+-) - r) . t = +- a:

     hold  (p - r) . n_y   right, left  (r(s+-) - r) . n_y   pivot  right + left   tilt  e_x . n_y */
#include "sleeves.h"

enum { LOOKS = 20 }; /* iterations for s */
static const double NEAR = 1e-7, MET = 1e-9; /* last step over the length: its square is left */

static void begin(Sleeve *w, int by, int second) {
  const Tables *t = w->t;
  Int m = by == COORDINATES ? FIRST : by == TIME ? 2 : 1;
  for (Int k = 0; k < 3; k++) {
    Int stretch = w->on - 1 + k;
    w->reached[k] = 0;
    if (by != COORDINATES || stretch < w->low || stretch > w->high) continue;
    w->reached[k] = m, m += t->track_n[t->stretch_track[stretch]];
  }
  set_variables(&w->room, m, second);
}

/* z_k as a jet. */
static Jet variable(Sleeve *w, Int k, int by) {
  Room *r = &w->room;
  Jet x = jet(r, w->z[k]);
  if (by == COORDINATES) x[2 + k] = 1.0;
  if (by == TIME) x[2] = w->dz[k], x[hess(r, 1, 1)] = w->ddz[k];
  return x;
}

/* One body. */

/* Value of a direction (1: v, 2: w) or the twist (5) and its slope where `order` is 1. */
static Jet bent(Sleeve *w, const double *X, double ahead, Int order, Int row) {
  Jet rows[TRACK_ROWS];
  track_rows(w, w->on, w->z[0] + ahead, order, 0, rows);
  eliminate(&w->room, X, rows[row]);
  return rows[row];
}

static Jet flat_row(Sleeve *w, Int sort, Int axis, int by, const double *X, Jet psi, Jet *f) {
  Room *r = &w->room;
  double a = w->t->sleeve_half[w->sleeve];
  Jet h = jet(r, 0.0);
  if (sort == HOLD || sort == CHORD) add_jet(r, h, 1.0, variable(w, axis, by));
  if (sort == TILT || sort == TWIST) {
    Int e = sort == TILT ? 3 : 6;
    add_jet(r, h, 1.0, variable(w, e + axis, by));
    add_jets(r, h, -1.0, variable(w, e, by), f[1]);
    add_jets(r, h, axis == 1 ? 1.0 : -1.0, variable(w, e + 3 - axis, by), psi);
  }
  if (sort <= PIVOT) add_jet(r, h, sort == PIVOT ? -2.0 : -1.0, f[0]);
  if (sort == RIGHT || sort == PIVOT) add_jet(r, h, 1.0, bent(w, X, a, 0, axis));
  if (sort == LEFT || sort == PIVOT) add_jet(r, h, 1.0, bent(w, X, -a, 0, axis));
  if (sort == RIGHT || sort == LEFT) add_jet(r, h, sort == RIGHT ? -a : a, f[1]);
  return h;
}

static void flat_rows(Sleeve *w, int by, Jet *rows) {
  const Tables *t = w->t;
  Jet X = variable(w, 0, by), here[TRACK_ROWS], slope[TRACK_ROWS];
  track_rows(w, w->on, w->z[0], 0, 0, here);
  track_rows(w, w->on, w->z[0], 1, 0, slope);
  for (Int k = 1; k < 6; k++) eliminate(&w->room, X, here[k]), eliminate(&w->room, X, slope[k]);
  for (Int k = t->sleeve_at[w->sleeve]; k < t->sleeve_at[w->sleeve + 1]; k++) {
    Int axis = t->sleeve_axis[k];
    Jet f[2] = {here[axis], slope[axis]};
    *rows++ = flat_row(w, t->sleeve_sort[k], axis, by, X, here[5], f);
  }
}

/* Stretches. */

/* A section's place in the frame of stretch `on`; R (r) or R' (r - p) with the neighbour's frame. */
static void seen(Sleeve *w, Int stretch, double s, int held, Jet *r) {
  Jet own[3], p[3], R[9];
  section(w, stretch, s, held, stretch == w->on ? r : own, 0);
  if (stretch == w->on) return;
  Int before = stretch < w->on ? stretch : w->on;
  section(w, before, w->t->stretch_length[before], 1, p, R);
  for (int d = 0; d < 3; d++) {
    if (stretch < w->on) add_jet(&w->room, own[d], -1.0, p[d]);
    else r[d] = p[d];
  }
  for (int d = 0; d < 3; d++) {
    if (stretch < w->on) r[d] = sum_of_products(&w->room, R + 3 * d, own);
    else
      for (int e = 0; e < 3; e++) add_jets(&w->room, r[d], 1.0, R[3 * e + d], own[e]);
  }
}

/* s of the section that frame b stands before. */
static void find_foot(Sleeve *w) {
  double *from = w->room.at;
  w->s = w->z[0];
  for (int k = 0; k < LOOKS; k++) {
    Jet r[3], R[9];
    double gap = 0.0, slope = 0.0;
    section(w, w->on, w->s, 0, r, R);
    for (int d = 0; d < 3; d++) {
      double apart = w->z[d] - r[d][0];
      gap += apart * R[d][0], slope += apart * R[d][1] - R[d][0] * r[d][1];
    }
    w->room.at = from;
    w->s -= gap / slope;
    if (fabs(gap / slope) < NEAR * w->t->stretch_length[w->on]) break;
  }
}

/* s of a stretch at which t . r is a distance. */
static double ahead(Sleeve *w, Int stretch, const double *t, double distance) {
  double *from = w->room.at, s = 0.0;
  for (int k = 0; k < LOOKS; k++) {
    Jet r[3];
    double gap = distance, slope = 0.0;
    seen(w, stretch, s, 0, r);
    for (int d = 0; d < 3; d++) gap -= t[d] * r[d][0], slope += t[d] * r[d][1];
    w->room.at = from;
    s += gap / slope;
    if (fabs(gap / slope) < MET * w->t->stretch_length[stretch]) break;
  }
  return s;
}

static double along(const double *t, Jet *r) {
  return t[0] * r[0][0] + t[1] * r[1][0] + t[2] * r[2][0];
}

void find_sleeve(Sleeve *w) {
  const Tables *t = w->t;
  Int first = t->stretch_at[w->sleeve], last = t->stretch_at[w->sleeve + 1] - 1;
  double half = t->sleeve_half[w->sleeve];
  w->low = w->high = w->on, w->s = w->z[0];
  if (!t->sleeve_passes[w->sleeve]) return;
  begin(w, NOTHING, 0);
  find_foot(w);
  if (half == 0.0) return;
  double *from = w->room.at, axis[3], place;
  Jet r[3], R[9], tip[3];
  section(w, w->on, w->s, 0, r, R);
  for (int d = 0; d < 3; d++) axis[d] = R[d][0];
  section(w, w->on, t->stretch_length[w->on], 1, tip, 0);
  place = along(axis, r);
  if (w->on > first && place < half) w->low--;
  if (w->on < last && along(axis, tip) - place < half) w->high++;
  w->room.at = from;
  w->s_low = ahead(w, w->low, axis, place - half);
  w->s_high = ahead(w, w->high, axis, place + half);
}

/* The beam at an end of the sleeve, less r. */
static void end_at(Sleeve *w, int side, Jet *r, Jet *axis, Jet *out) {
  Room *room = &w->room;
  seen(w, side < 0 ? w->low : w->high, side < 0 ? w->s_low : w->s_high, 0, out);
  for (int d = 0; d < 3; d++) add_jet(room, out[d], -1.0, r[d]);
  Jet F = sum_of_products(room, out, axis);
  F[0] -= side * w->t->sleeve_half[w->sleeve];
  Jet s = solved(room, F);
  for (int d = 0; d < 3; d++) eliminate(room, s, out[d]);
}

static void curved_rows(Sleeve *w, int by, Jet *rows) {
  const Tables *t = w->t;
  Room *room = &w->room;
  Jet r[3], R[9], apart[3], e_x[3], e_y[3], end[2][3];
  section(w, w->on, w->s, 0, r, R);
  for (int d = 0; d < 3; d++) {
    apart[d] = variable(w, d, by), e_x[d] = variable(w, 3 + d, by), e_y[d] = variable(w, 6 + d, by);
    add_jet(room, apart[d], -1.0, r[d]);
  }
  Jet foot = solved(room, sum_of_products(room, apart, R));
  for (int d = 0; d < 3; d++) eliminate(room, foot, r[d]), eliminate(room, foot, apart[d]);
  for (int d = 0; d < 9; d++) eliminate(room, foot, R[d]);
  if (t->sleeve_half[w->sleeve] > 0.0)
    for (int side = 0; side < 2; side++) end_at(w, side ? 1 : -1, r, R, end[side]);
  for (Int k = t->sleeve_at[w->sleeve]; k < t->sleeve_at[w->sleeve + 1]; k++) {
    Int sort = t->sleeve_sort[k];
    Jet *n = R + 3 * t->sleeve_axis[k], *held = sort == TILT ? e_x : sort == TWIST ? e_y : apart;
    if (sort == RIGHT || sort == LEFT || sort == PIVOT) held = end[sort != LEFT];
    *rows = sum_of_products(room, held, n);
    if (sort == PIVOT) add_jet(room, *rows, 1.0, sum_of_products(room, end[0], n));
    rows++;
  }
}

void sleeve_rows(Sleeve *w, int by, int second, Jet *rows) {
  begin(w, by, second);
  if (w->t->sleeve_passes[w->sleeve]) curved_rows(w, by, rows);
  else flat_rows(w, by, rows);
}

double sleeve_place(const Sleeve *w) { return w->t->stretch_from[w->on] + w->s; }
