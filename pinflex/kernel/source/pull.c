/* Torques of motors that are driven, not prescribed, and their derivatives:

     tau = tau_0(t) + kp (q_d - q) + kd (v_d - v),     r -= tau */
#include "march.h"

/* How far a motor is behind: of one that turns without end, the shorter way round. */
static double behind(const Stages *st, Int k, double wanted, const double *y) {
  const double *q = y + st->motor_q[k];
  return st->motor_paired[k] ? remainder(wanted - atan2(q[1], q[0]), 8.0 * atan(1.0))
                             : wanted - q[0];
}

void pull(const Stages *st, const Told *told, const double *y, const double *v, double *torque,
          double *r) {
  if (st->prescribed) return;
  for (Int k = 0; k < st->motors; k++) {
    Int row = st->motor_v[k];
    torque[k] = told->feed[k] + st->kp[k] * behind(st, k, told->position[k], y)
                + st->kd[k] * (told->velocity[k] - v[row]);
    if (r) r[row] -= torque[k];
  }
}

void pull_tangent(const Tables *t, const Stages *st, double *C, double *K) {
  for (Int k = 0; k < st->motors && !st->prescribed; k++) {
    Int diagonal = st->motor_v[k] * (t->nv + 1);
    C[diagonal] += st->kd[k], K[diagonal] += st->kp[k];
  }
}

/* Residuals and closures of the stages of a step. */
EXPORT void pinflex_balance(const Tables *t, char *memory, const Stages *st) {
  pinflex_residuals(t, memory, st->s, st->y, st->v, st->a, st->lam, st->scale, st->r, st->open);
  for (Int i = 0; i < st->s; i++) {
    Told told = told_at(st, i);
    pull(st, &told, st->y + i * t->nq, st->v + i * t->nv, st->torque + i * st->motors,
         st->r + i * t->nv);
  }
}
