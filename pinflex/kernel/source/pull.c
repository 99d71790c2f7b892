/* Forces that a digital controller holds, F, and torques of motors that are driven, not prescribed:

     r -= F,    tau = F + tau_0(t) + kp (q_d - q) + kd (v_d - v),     r -= tau - F */
#include "march.h"

/* How far a motor is behind: of one that turns without end, the shorter way round. */
static double behind(const Stages *st, Int k, double wanted, const double *y) {
  const double *q = y + st->motor_q[k];
  return st->motor_paired[k] ? remainder(wanted - atan2(q[1], q[0]), 8.0 * atan(1.0))
                             : wanted - q[0];
}

void pull(const Tables *t, const Stages *st, const Told *told, const double *y, const double *v,
          double *torque, double *r) {
  for (Int i = 0; st->held && r && i < t->nv; i++) r[i] -= st->held[i];
  if (st->prescribed) return;
  for (Int k = 0; k < st->motors; k++) {
    Int row = st->motor_v[k];
    torque[k] = told->feed[k] + st->kp[k] * behind(st, k, told->position[k], y)
                + st->kd[k] * (told->velocity[k] - v[row]);
    if (r) r[row] -= torque[k];
    if (st->held) torque[k] += st->held[row];
  }
}

double motor_power(const Tables *t, const Stages *st, const double *torque, const double *v) {
  double power = 0.0;
  for (Int k = 0; k < st->motors; k++) power += torque[k] * v[st->motor_v[k]];
  if (!st->held) return power;
  for (Int i = 0; i < t->nv; i++) power += st->held[i] * v[i];
  for (Int k = 0; k < st->motors; k++) power -= st->held[st->motor_v[k]] * v[st->motor_v[k]];
  return power;
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
    pull(t, st, &told, st->y + i * t->nq, st->v + i * t->nv, st->torque + i * st->motors,
         st->r + i * t->nv);
  }
}
