/* Laws that bend: of pieces, each smooth, over one coordinate or the elongation of a spring.

   With d = x - x_0, s its sign, a piece resists by

     f = f_0 + (s k |d|^n)(1 + s c_h x') + c x',     E = E_0 + f_0 d + k |d|^(n+1) / (n+1)

   so that dead zones, stops, cables, tables (n = 1) and Hertz's contact (n = 3/2) are the same thing.
   c_h = chi / v_0, v_0 the speed at which the piece was entered, is the damping of Hunt and Crossley
   (1975) by a coefficient of restitution; it is 0 for a state by itself. A step keeps to the pieces it
   began in, also beyond their ends, where it is cut (events.c): inside steps equations are smooth. */
#include "group.h"
#include <string.h>

enum { PLACE, FORCE, STIFFNESS, POWER, DAMPER, CHI, ENERGY, NUMBERS };
#define HERTZ 1.5

static Int piece_at(const Tables *t, Int k, double x) {
  Int p = t->kink_at[k];
  while (p + 1 < t->kink_at[k + 1] && x >= t->kink_start[p + 1]) p++;
  return p;
}

Kink kinked(const Tables *t, const Work *w, Int k, double x, double rate) {
  Int p = w->piece[k] ? t->kink_at[k] + w->piece[k] - 1 : piece_at(t, k, x);
  const double *law = t->kink_piece + NUMBERS * p;
  double d = x - law[PLACE], deep = fabs(d), n = law[POWER], spring, slope, chi = 0.0;
  slope = law[STIFFNESS] * (n == 1.0 ? 1.0 : n == HERTZ ? n * sqrt(deep) : n * pow(deep, n - 1.0));
  spring = slope * deep / n;
  if (law[CHI] != 0.0 && w->hit[k] > 0.0) chi = law[CHI] / w->hit[k];
  double sign = d < 0.0 ? -1.0 : 1.0, damping = law[DAMPER] + spring * chi;
  return (Kink){.force = law[FORCE] + sign * spring + damping * rate,
                .slope = slope * (1.0 + sign * chi * rate),
                .damping = damping,
                .energy = law[ENERGY] + law[FORCE] * d + spring * deep / (n + 1.0),
                .loss = damping * rate * rate};
}

/* Whether a step keeps to a piece of this law that resists nothing and stores nothing. */
int idle(const Tables *t, const Work *w, Int k) {
  if (!w->piece[k]) return 0;
  const double *law = t->kink_piece + NUMBERS * (t->kink_at[k] + w->piece[k] - 1);
  return law[FORCE] == 0.0 && law[STIFFNESS] == 0.0 && law[DAMPER] == 0.0 && law[ENERGY] == 0.0;
}

static double place(const Tables *t, Int k, const Lane *y, int l) {
  const Lane *q = y + t->kink_q[k];
  return t->kink_paired[k] ? atan2(q[1][l], q[0][l]) : q[0][l];
}

void add_kinks(const Tables *t, const Work *w, const Lane *y, const Lane *v, Lane *r) {
  for (Int k = 0; k < t->kinks; k++)
    for (int l = 0; t->kink_v[k] >= 0 && l < LANES; l++)
      r[t->kink_v[k]][l] += kinked(t, w, k, place(t, k, y, l), v[t->kink_v[k]][l]).force;
}

void kink_tangent(const Tables *t, const Work *w, const Lane *y, const Lane *v, double *C, double *K) {
  for (Int k = 0; k < t->kinks; k++) {
    if (t->kink_v[k] < 0) continue;
    Int diagonal = t->kink_v[k] * (t->nv + 1);
    Kink now = kinked(t, w, k, place(t, k, y, 0), v[t->kink_v[k]][0]);
    C[diagonal] += now.damping, K[diagonal] += now.slope;
  }
}

/* Of those of elastic coordinates, or of the others. */
Lane kink_energy(const Tables *t, const Work *w, const Lane *y, int elastic) {
  Lane energy = lane(0);
  for (Int k = 0; k < t->kinks; k++)
    for (int l = 0; t->kink_v[k] >= 0 && (t->kink_v[k] >= t->nv_rigid) == elastic && l < LANES; l++)
      energy[l] += kinked(t, w, k, place(t, k, y, l), 0.0).energy;
  return energy;
}

double kink_loss(const Tables *t, const Work *w, const double *y, const double *v) {
  double loss = 0.0;
  for (Int k = 0; k < t->kinks; k++) {
    if (t->kink_v[k] < 0) continue;
    const double *q = y + t->kink_q[k];
    double x = t->kink_paired[k] ? atan2(q[1], q[0]) : q[0];
    loss += kinked(t, w, k, x, v[t->kink_v[k]]).loss;
  }
  return loss;
}

/* Whether any law is in a piece that is not linear. */
int hardens(const Tables *t, const Int *piece) {
  for (Int k = 0; k < t->kinks; k++)
    if (t->kink_piece[NUMBERS * (t->kink_at[k] + piece[k]) + POWER] != 1.0) return 1;
  return 0;
}

/* Let a workspace keep to pieces; NULL: to those of the states. */
void keep_to_pieces(const Tables *t, char *memory, const Int *piece, const double *hit) {
  Work w;
  Group g;
  if (!t->kinks) return;
  lay_out(t, memory, &w, &g);
  for (Int k = 0; k < t->kinks; k++) w.piece[k] = piece ? piece[k] + 1 : 0, w.hit[k] = piece ? hit[k] : 0.0;
}

/* Coordinates and elongations that laws are over, at `count` poses Y (count, nq): (count, kinks). */
EXPORT void pinflex_elongations(const Tables *t, char *memory, Int count, const double *Y, double *x) {
  Work w;
  Group g;
  int springs = t->touches > 0;
  lay_out(t, memory, &w, &g);
  for (Int k = 0; k < t->springs; k++) springs |= t->spring_kink[k] >= 0;
  for (Int first = 0; first < count; first += LANES) {
    if (springs) stand(t, &w, &g, Y, count, first);
    else gather(Y, count, t->nq, first, g.y);
    for (int l = 0; l < LANES && first + l < count; l++)
      for (Int k = 0; k < t->kinks; k++)
        if (t->kink_v[k] >= 0) x[(first + l) * t->kinks + k] = place(t, k, g.y, l);
    touch_places(t, &w, count - first < LANES ? count - first : LANES, x + first * t->kinks);
    for (Int k = 0; k < t->springs; k++) {
      if (t->spring_kink[k] < 0) continue;
      Lane length;
      spring_lengths(t, &w, k, &length);
      for (int l = 0; l < LANES && first + l < count; l++)
        x[(first + l) * t->kinks + t->spring_kink[k]] = length[l] - t->spring_law[3 * k + 2];
    }
  }
}
