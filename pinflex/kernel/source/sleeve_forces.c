/* What a sleeve does to its beam: (x, F, M, stretch) at its ends and its middle, x - a, x, x + a, in the
   frame of the stretch that it is on. With the rows h and multipliers lam of sleeve_rows.c:

   on one body  F = lam h_f of the deflections f = v, w there, M = lam h_g of the slopes and the twist
                in the middle, and along the beam -lam h_X, by which a bent beam pushes the sleeve;
   on stretches the forces along n_y and n_z by which the rows hold the middle and the ends:

     hold  -lam n at r    right, left  lam n at the end, -lam n and -+a lam t x n at r
     tilt  lam n x e_x    pivot  lam n at both ends, -2 lam n at r    twist  lam n_z x e_y */
#include "moments.h"
#include "sleeves.h"

enum { WIDE = 8, MIDDLE = 8, FORCE = 1, MOMENT = 4 }; /* of a place: x, F, M, stretch */

/* Add a force k n at an end or the middle (side -1, 0, 1). */
static void hold(double *out, int side, double k, const double *n) {
  for (int d = 0; d < 3; d++) out[MIDDLE + side * WIDE + FORCE + d] += k * n[d];
}

/* Of a row that holds points of the beam: by lam on them, along n. */
static void hold_points(Int sort, double lam, const double *n, double *out) {
  if (sort == HOLD) hold(out, 0, -lam, n);
  if (sort == RIGHT || sort == PIVOT) hold(out, 1, lam, n), hold(out, 0, -lam, n);
  if (sort == LEFT || sort == PIVOT) hold(out, -1, lam, n), hold(out, 0, -lam, n);
}

static void on_body(Sleeve *w, const Lane *lam, int l, double *out) {
  const Tables *t = w->t;
  double a = t->sleeve_half[w->sleeve], *moment = out + MIDDLE + MOMENT;
  Jet h[MOST_SLEEVE_ROWS];
  sleeve_rows(w, COORDINATES, 0, h);
  for (int side = 0; side < 3; side++) out[side * WIDE] = w->z[0] + (side - 1) * a;
  for (Int k = t->sleeve_at[w->sleeve]; k < t->sleeve_at[w->sleeve + 1]; k++) {
    Int sort = t->sleeve_sort[k], axis = t->sleeve_axis[k], e = sort == TWIST ? 6 : 3;
    double push = lam[t->sleeve_row[k]][l], n[3] = {0, axis == 1, axis == 2}, slope = 0.0;
    hold_points(sort, push, n, out);
    out[MIDDLE + FORCE] -= push * h[k - t->sleeve_at[w->sleeve]][2];
    if (sort == RIGHT || sort == LEFT) slope = sort == RIGHT ? -a * push : a * push;
    if (sort == TILT || sort == TWIST) {
      slope = -push * w->z[e];
      moment[0] += (axis == 1 ? push : -push) * w->z[e + 3 - axis];
    }
    moment[axis == 1 ? 2 : 1] += axis == 1 ? slope : -slope; /* v' turns about z, w' about -y */
  }
}

static void on_stretches(Sleeve *w, const Lane *lam, int l, double *out) {
  const Tables *t = w->t;
  double a = t->sleeve_half[w->sleeve], *moment = out + MIDDLE + MOMENT;
  Jet r[3], R[9];
  section(w, w->on, w->s, 0, r, R);
  double axes[9];
  for (int d = 0; d < 9; d++) axes[d] = R[d][0];
  for (int side = 0; side < 3; side++) {
    out[side * WIDE] = r[0][0] + (side - 1) * a * axes[0];
    out[side * WIDE + 7] = (double)(w->on - t->stretch_at[w->sleeve]);
  }
  for (Int k = t->sleeve_at[w->sleeve]; k < t->sleeve_at[w->sleeve + 1]; k++) {
    Int sort = t->sleeve_sort[k];
    double push = lam[t->sleeve_row[k]][l], about[3];
    const double *n = axes + 3 * (sort == TWIST ? 2 : t->sleeve_axis[k]);
    hold_points(sort, push, n, out);
    if (sort == RIGHT || sort == LEFT) {
      crossed(axes, n, about);
      push *= sort == RIGHT ? -a : a;
    } else if (sort == TILT || sort == TWIST) {
      crossed(n, w->z + (sort == TWIST ? 6 : 3), about);
    } else {
      continue;
    }
    for (int d = 0; d < 3; d++) moment[d] += push * about[d];
  }
}

void sleeve_forces(const Tables *t, const Work *lanes, const Lane *lam, Int count, double *out) {
  for (Int k = 0; k < t->sleeves; k++)
    for (int l = 0; l < count && l < LANES; l++) {
      Sleeve w;
      Pose a, b;
      double *table = out + 3 * WIDE * (l * t->sleeves + k);
      sleeve_of_lane(t, lanes, k, l, &w, &a, &b);
      memset(table, 0, 3 * WIDE * sizeof(double));
      (t->sleeve_passes[k] ? on_stretches : on_body)(&w, lam, l, table);
    }
}
