/* Dry friction of joints, smooth in their speed, and its slope:

     F(v) = (F_c + E exp(-(v / v_s)^2)) tanh(v / v_0) */
#include "tangent.h"

typedef struct { double level, fall, smooth, v; } Rubbing;

static Rubbing rub(const double *law, double v) {
  Rubbing now = {.fall = exp(-(v / law[2]) * (v / law[2])), .smooth = tanh(v / law[3]), .v = v};
  now.level = law[0] + law[1] * now.fall;
  return now;
}

void add_friction(const Tables *t, const Lane *v, Lane *r) {
  for (Int k = 0; k < t->rubs; k++)
    for (int l = 0; l < LANES; l++) {
      Rubbing now = rub(t->rub_law + 4 * k, v[t->rub_v[k]][l]);
      r[t->rub_v[k]][l] += now.level * now.smooth;
    }
}

void friction_tangent(const Tables *t, const Lane *v, double *C) {
  for (Int k = 0; k < t->rubs; k++) {
    const double *law = t->rub_law + 4 * k;
    Rubbing now = rub(law, v[t->rub_v[k]][0]);
    double bend = -2.0 * law[1] * now.fall * now.v / (law[2] * law[2]);
    C[t->rub_v[k] * (t->nv + 1)] +=
        now.level * (1.0 - now.smooth * now.smooth) / law[3] + bend * now.smooth;
  }
}

double dissipation(const Tables *t, const double *v) {
  double loss = 0.0;
  for (Int i = 0; i < t->nv; i++)
    for (Int p = t->d_at[i]; p < t->d_at[i + 1]; p++) loss += v[i] * t->d[p] * v[t->d_j[p]];
  for (Int k = 0; k < t->rubs; k++) {
    Rubbing now = rub(t->rub_law + 4 * k, v[t->rub_v[k]]);
    loss += now.level * now.smooth * now.v;
  }
  return loss;
}
