/* Equal steps of the alpha family: Newton's iteration on tangents that are kept while it contracts.

     [ m M + gamma h C + beta h^2 K    J' ] [  ds  ]     [ r              ]
     [ J                               0  ] [ -dlam] = - [ c / (beta h^2) ],    m = da/ds

   What fails so is tried from the last acceleration, with the exact tangent in every iteration; but
   not where a step may take so many tangents only: what it costs at the most is known then, and
   new tangents are made ahead of need, a part of one behind each of three steps.
   pinflex/integrators/plain/alpha.py has the same steps, plainly, and the states they begin from. */
#include "alpha.h"
#include "lu.h"
#include "march.h"
#include <stddef.h>

static const double RESTING = 100.0; /* first correction over noise: up to 25 at rest, 450 in motion */
static const double STUCK = 1e-8; /* of the inertia forces, where nothing moves any more */
/* A tangent is replaced before the next step from a rate of contraction LATE on; or, where what a step
   costs is bounded, behind the next ones, which get on with the old one until then: from as many
   iterations as LONG, or once steps have taken WORTH more than at first, where a new one would do better
   than SOON (it costs as much as ten). Steps of delta, ur5, 3rrr and hexapod at 1 kHz then take 3.1 to 3.6
   iterations and 6 at the most. */
static const double LATE = 0.1, SOON = 0.01;
enum { LONG = 4, WORTH = 3 };

/* sqrt(a' W a) of free rows of `a`, W the diagonal of the iteration matrix. */
static double size_of(const Alpha *m, const double *a, const Int *at) {
  double sum = 0.0;
  for (Int i = 0; i < m->joints->free; i++) {
    double x = a[at ? at[i] : i];
    sum += m->weight[i] * x * x;
  }
  return sqrt(sum);
}

static double largest(const double *x, Int n) {
  double most = 0.0;
  for (Int i = 0; i < n; i++)
    if (!(fabs(x[i]) <= most)) most = fabs(x[i]);
  return most;
}

/* M, C, K and J of a state, or a part of them; `exact`: with the rates of second-order rows. */
static void evaluate(const Tables *t, char *memory, Alpha *m, Int part, const State *x,
                     const double *scale, Int exact) {
  Int square = t->nv * t->nv;
  double *M = m->tangent, *C = M + square, *K = C + square, *J = K + square;
  tangent_part(t, memory, part, exact, x->y, x->v, x->a, x->lam, scale, M, C, K, J);
  if (part == FORMER) return;
  pull_tangent(t, m->joints, C, K);
  if (m->law) feed_back_tangent(t, m->law, C, K);
}

/* The iteration matrix of what was evaluated, factored. */
static int assemble(const Tables *t, Alpha *m) {
  const Stages *st = m->joints;
  Int n = st->free, nv = t->nv, rows = t->closures, size = n + rows, square = nv * nv;
  double *M = m->tangent, *C = M + square, *K = C + square, *J = K + square, sum = 0.0;
  for (Int i = 0; i < square; i++) M[i] = m->mass * M[i] + m->by_v * C[i] + m->by_y * K[i];
  for (Int j = 0; j < n; j++) {
    for (Int i = 0; i < n; i++) m->lu[j * size + i] = M[st->free_at[i] * nv + st->free_at[j]];
    for (Int k = 0; k < rows; k++)
      m->lu[j * size + n + k] = m->lu[(n + k) * size + j] = J[k * nv + st->free_at[j]];
    m->weight[j] = fabs(m->lu[j * size + j]);
    sum += m->weight[j];
    for (Int k = 0; k < st->motors; k++)
      m->motor_rows[k * n + j] = M[st->motor_v[k] * nv + st->free_at[j]];
  }
  for (Int k = 0; k < rows; k++) {
    for (Int i = n; i < size; i++) m->lu[(n + k) * size + i] = 0.0;
    for (Int j = 0; j < st->motors; j++)
      m->motor_J[k * st->motors + j] = J[k * nv + st->motor_v[j]];
  }
  /* Positions are known to 1e-15 (m, rad); as accelerations that is this much noise. */
  m->noise = 1e-15 / m->by_y * sqrt(sum);
  m->refreshed++, m->age = 0, m->ready = 0, m->fewest = -1, m->wasted = 0, m->rate = 0.1, m->usual = INFINITY;
  m->band = narrow_order(m->lu, size, m->order, m->order + size);
  if (is_narrow(size, m->band))
    return narrow_factors(m->lu, size, m->order, m->band, m->narrow, m->pivot);
  return factors(m->lu, size, m->pivot);
}

/* A new tangent at the next state. */
static int refresh(const Tables *t, char *memory, Alpha *m, const double *scale, Int exact) {
  evaluate(t, memory, m, WHOLE, &m->next, scale, exact);
  return assemble(t, m);
}

/* The next state by a continuation of a and lam, straight from `last`, and the move to it. */
static void predict(const Tables *t, Alpha *m, const Rows *to, const State *last) {
  const Stages *st = m->joints;
  const State *now = &m->now, *x = &m->next;
  const double *P = m->predict;
  double bent = m->curved > 0 && last != now;
  for (Int i = 0; i < t->nv; i++) x->a[i] = 2.0 * now->a[i] - last->a[i] + bent * m->bend[i];
  for (Int k = 0; k < t->closures; k++)
    x->lam[k] = 2.0 * now->lam[k] - last->lam[k] + bent * m->bend_lam[k];
  for (Int k = 0; k < led(st); k++) x->a[st->motor_v[k]] = to->feed[k];
  for (Int i = 0; i < t->nv; i++) {
    double a = x->a[i], b = now->a[i], s = now->s[i], v = now->v[i];
    x->s[i] = P[0] * a + P[1] * b + P[2] * s + P[3] * v;
    x->v[i] = P[4] * a + P[5] * b + P[6] * s + P[7] * v;
    m->move[i] = P[8] * a + P[9] * b + P[10] * s + P[11] * v;
  }
  for (Int k = 0; k < led(st); k++) {
    x->s[st->motor_v[k]] = to->feed[k];
    x->v[st->motor_v[k]] = to->velocity[k];
  }
  retract(t, st, now->y, m->move, x->y);
  write_motors(st, to->position, x->y);
}

/* ds (x) and dlam (x + n) from the residual; the norm of ds. */
static double solved(const Tables *t, Alpha *m) {
  const Stages *st = m->joints;
  Int n = st->free, rows = t->closures;
  for (Int i = 0; i < n; i++) m->x[i] = -m->r[st->free_at[i]];
  for (Int k = 0; k < rows; k++) m->x[n + k] = -m->open[k] / m->by_y;
  if (is_narrow(n + rows, m->band))
    narrow_solve(m->narrow, n + rows, m->order, m->band, m->pivot, m->room, m->x);
  else
    solve(m->lu, n + rows, m->pivot, m->x);
  for (Int k = 0; k < rows; k++) m->x[n + k] = -m->x[n + k];
  return size_of(m, m->x, NULL);
}

static void correct(const Tables *t, Alpha *m, const Rows *to) {
  const Stages *st = m->joints;
  const State *x = &m->next;
  for (Int j = 0; j < st->free; j++) {
    Int i = st->free_at[j];
    double ds = m->x[j];
    x->s[i] += ds, x->v[i] += m->by_v * ds, x->a[i] += m->mass * ds, m->move[i] += m->by_y * ds;
  }
  for (Int k = 0; k < t->closures; k++) x->lam[k] += m->x[st->free + k];
  retract(t, st, m->now.y, m->move, x->y);
  write_motors(st, to->position, x->y);
}

/* Error that the corrections of a step leave; `stuck`: they shrink no more. */
static double left(Alpha *m, Int iteration, double size, int *stuck) {
  /* The first correction is the predictor's error, the second what it bent the equations by; only
     from then on do ratios show how the iteration contracts. Where a step ends before that, the
     rate of an earlier one holds as long as its second correction was like this one. */
  double rate = 0.5, ratio = m->ratio = size / fmax(m->previous, 1e-300);
  if (iteration == 0) m->began = size;
  if (iteration == 1) {
    m->second = ratio;
    if (m->usual == INFINITY) m->usual = fmax(ratio, 1e-6); /* below that it is round-off */
    rate = m->rate * fmax(1.0, ratio / m->usual);
  } else if (iteration > 1) {
    rate = fmax(ratio, 1e-3);
    m->usual = fmax(m->second, 1e-6);
    /* At rest the goal lies below round-off: corrections are no more than that, and tell nothing;
       round-off does not shrink a hundredfold. */
    if (m->began > RESTING * fmin(m->noise, size) || m->tolerance * m->reference > m->noise)
      m->rate = rate;
  }
  /* Forces that move little answer displacements, and these those: corrections may shrink only every
     other time. */
  *stuck = iteration >= 3 && size > 0.5 * fmax(m->previous, m->before);
  m->before = m->previous, m->previous = size;
  return rate < 0.9 ? size * rate / (1.0 - rate) : INFINITY;
}

/* Whether forces balance to a goal (or round-off) and loops are shut to round-off: next to a
   singular pose round-off alone moves the weak direction by more than the goal. */
static int spent(const Tables *t, const Alpha *m, double goal) {
  const Stages *st = m->joints;
  double sum = 0.0;
  for (Int i = 0; i < st->free; i++) {
    double r = m->r[st->free_at[i]];
    sum += r * r / fmax(m->weight[i], 1e-300);
  }
  return sqrt(sum) <= fmax(goal, m->noise) && largest(m->open, t->closures) < 1e-13;
}

/* With an old tangent it may only contract slowly: a new one tells, where it can be had, by two
   corrections of its own. `fresh`: how many it has made with new ones; 0: the tangent is old. */
static int converged(const Tables *t, Alpha *m, Int iteration, double size, Int fresh) {
  int stuck;
  double rest = left(m, iteration, size, &stuck);
  if (iteration >= 2 && rest > fmax(m->tolerance * m->reference, m->noise))
    m->reference = fmax(m->reference, size_of(m, m->next.a, m->joints->free_at));
  double goal = fmax(m->tolerance * m->reference, 0.01 * m->noise);
  if (rest <= goal && (t->closures == 0 || largest(m->open, t->closures) < 1e-9)) return 1;
  return stuck && (fresh > 1 || m->allowed) && spent(t, m, fmax(goal, STUCK * m->reference));
}

/* Whether the next state is one of this motion: far from it the equations have other roots. */
static int is_near(const Tables *t, const Alpha *m) {
  return largest(m->next.y + t->nq_rigid, t->nq - t->nq_rigid) < m->farthest;
}

/* No state, and no residual that would tell where. */
static int lost(const Tables *t, Alpha *m) {
  for (Int i = 0; i < t->nv; i++) m->r[i] = NAN;
  return 0;
}

/* Whether a new tangent pays after a step of i + 1 iterations with an old one. */
static Int pays(Alpha *m, Int i) {
  if (m->fewest < 0 || i < m->fewest) m->fewest = i;
  m->wasted += i - m->fewest;
  return m->rate > SOON && (m->wasted >= WORTH || i >= LONG);
}

/* The next state; 0 where Newton does not get there. */
static int reach_next(const Tables *t, char *memory, Alpha *m, const Rows *to, Int exact) {
  const State *x = &m->next;
  const Told told = {to->position, to->velocity, to->feed};
  Int fresh = m->stale, taken = m->stale, begun = taken;
  predict(t, m, to, exact ? &m->now : &m->last);
  if (m->stale && !refresh(t, memory, m, to->scale, exact)) return lost(t, m);
  for (Int i = 0; i < m->most; i++) {
    pinflex_residuals(t, memory, 1, x->y, x->v, x->a, x->lam, to->scale, m->r, m->open);
    pull(t, m->joints, &told, x->y, x->v, m->x, m->r); /* torques in room that is free now */
    if (m->law) feed_back(t, m->joints, m->law, x->y, x->v, m->r);
    double size = solved(t, m);
    m->iterations++;
    if (!isfinite(size)) return 0;
    correct(t, m, to);
    if (converged(t, m, i, size, fresh)) {
      double level = size_of(m, x->a, m->joints->free_at);
      m->due = m->allowed ? taken == begun && pays(m, i) : m->rate > LATE;
      m->stale = m->due && !m->allowed;
      m->peak = fmax(m->peak, level);
      m->reference = fmax(level, fmax(0.9 * m->reference, 1e-3 * m->peak));
      return is_near(t, m) || lost(t, m);
    }
    fresh += fresh > 0;
    Int patient = m->allowed ? LONG : 1; /* a new one may be on its way */
    Int slow = exact || (i > patient && m->ratio > 0.3 && (!fresh || i > 4));
    if (slow && (!m->allowed || taken < m->allowed)) {
      if (!refresh(t, memory, m, to->scale, exact)) return lost(t, m);
      fresh += !fresh, taken++, m->second = 0.0; /* what it will usually be is not known */
    }
  }
  return is_near(t, m) ? 0 : lost(t, m);
}

/* How far the next state is off the line through the last two, and whether it lies nearer to the
   parabola through the last three: at rest that only makes more of round-off. */
static void bend(const Tables *t, Alpha *m) {
  const State *x = &m->next, *now = &m->now, *last = &m->last;
  double line = 0.0, parabola = 0.0;
  for (Int k = 0; k < t->closures; k++)
    m->bend_lam[k] = x->lam[k] - 2.0 * now->lam[k] + last->lam[k];
  for (Int j = 0; j < m->joints->free; j++) {
    Int i = m->joints->free_at[j];
    double off = x->a[i] - 2.0 * now->a[i] + last->a[i], change = off - m->bend[i];
    line += m->weight[j] * off * off, parabola += m->weight[j] * change * change;
    m->bend[i] = off;
  }
  m->curved = m->curved >= 0 && parabola < line;
}

/* Record the next state, with the torques that the last correction completes, and go there. */
static void go_there(const Tables *t, char *memory, Alpha *m, const Rows *to) {
  const Stages *st = m->joints;
  State *x = &m->next, old = m->last;
  Int n = st->free, nv = t->nv, rows = t->closures;
  const Told told = {to->position, to->velocity, to->feed};
  bend(t, m);
  pull(t, st, &told, x->y, x->v, to->torque, NULL);
  for (Int k = 0; k < led(st); k++) {
    double sum = m->r[st->motor_v[k]];
    for (Int j = 0; j < n; j++) sum += m->motor_rows[k * n + j] * m->x[j];
    for (Int j = 0; j < rows; j++) sum -= m->motor_J[j * st->motors + k] * m->x[n + j];
    to->torque[k] = sum;
  }
  to->power[0] = motor_power(t, st, to->torque, x->v);
  pinflex_losses(t, memory, 1, x->y, x->v, to->power + 1);
  if (m->law) {
    feed_back(t, st, m->law, x->y, x->v, NULL);
    end_step(m->law);
    to->power[0] += law_power(t, m->law, x->v);
    copy(to->u, m->law->u, m->law->drives), copy(to->error, m->law->e, m->law->measures);
  }
  copy(to->y, x->y, t->nq);
  copy(to->v, x->v, nv), copy(to->a, x->a, nv), copy(to->s, x->s, nv);
  copy(to->lam, x->lam, rows);
  m->last = m->now, m->now = *x, m->next = old;
  m->age++;
}

/* A motor that the next state has past its stop, or -1. */
static Int past_stop(const Alpha *m) {
  const Stages *st = m->joints;
  for (Int k = 0; m->low && k < st->motors; k++) {
    double q = m->next.y[st->motor_q[k]];
    if (!st->motor_paired[k] && (q < m->low[k] || q > m->high[k])) return k;
  }
  return -1;
}

/* The next state by kept tangents, or else by exact ones; 0 where there is none. */
static int next(const Tables *t, char *memory, Alpha *m, const Rows *to) {
  double reference = m->reference, peak = m->peak;
  m->stopped = -1;
  if (m->every && m->age >= m->every && !m->allowed) m->stale = 1;
  for (Int exact = 0; exact < (m->allowed ? 1 : 2) && m->stopped < 0; exact++) {
    if (reach_next(t, memory, m, to, exact) && (m->stopped = past_stop(m)) < 0) return 1;
    /* What ran away must not loosen the tolerance of what is tried next. */
    m->reference = reference, m->peak = peak, m->stale = 1;
  }
  return 0;
}

/* A new tangent for steps to come, where one is due: evaluated behind two steps, at the state between
   them, and factored behind the next, so that none bears it all; none behind a step that took one
   itself. 0: it has no factors. */
static int prepare(const Tables *t, char *memory, Alpha *m, const double *scale, Int before) {
  if (!m->allowed || m->refreshed != before) return 1;
  if (m->ready == 2) return assemble(t, m);
  if (m->ready) evaluate(t, memory, m, LATTER, &m->last, scale, 0), m->ready = 2;
  else if (m->due || (m->every && m->age + 2 >= m->every))
    evaluate(t, memory, m, FORMER, &m->now, scale, 0), m->ready = 1;
  return 1;
}

/* Up to `count` steps; the number of those that were taken. */
EXPORT Int pinflex_alpha(const Tables *t, char *memory, Alpha *m, Int count, const Rows *rows) {
  Rows to = *rows;
  Int motors = m->joints->motors, nv = t->nv;
  for (Int k = 0; k < count; k++) {
    Int before = m->refreshed;
    if (!next(t, memory, m, &to)) return k;
    go_there(t, memory, m, &to);
    m->stale = m->stale || !prepare(t, memory, m, to.scale, before);
    to.position += motors, to.velocity += motors, to.feed += motors, to.scale += t->forces;
    to.y += t->nq, to.v += nv, to.a += nv, to.s += nv, to.lam += t->closures;
    to.torque += motors, to.power += 2;
    if (m->law) to.u += m->law->drives, to.error += m->law->measures;
  }
  return count;
}

Int pinflex_alpha_slope(const Tables *t, char *memory, Alpha *m, const double *scale, const Rows *by,
                        double *dy, double *dv, double *torque) {
  const Stages *st = m->joints;
  Int n = st->free, nv = t->nv, rows = t->closures, square = nv * nv;
  const double *M = m->tangent, *C = M + square, *K = C + square, *J = K + square;
  evaluate(t, memory, m, WHOLE, &m->now, scale, 1);
  for (Int i = 0; i < nv; i++) m->r[i] = dy[i] = dv[i] = 0.0;
  for (Int k = 0; k < rows; k++) m->open[k] = 0.0;
  for (Int k = 0; k < st->motors; k++) {
    Int at = st->motor_v[k];
    if (!st->prescribed) m->r[at] -= by->feed[k];
    if (!st->prescribed) continue;
    for (Int i = 0; i < nv; i++)
      m->r[i] += M[i * nv + at] * by->feed[k] + C[i * nv + at] * by->velocity[k]
                 + K[i * nv + at] * by->position[k];
    for (Int i = 0; i < rows; i++) m->open[i] += J[i * nv + at] * by->position[k];
    dy[at] = by->position[k], dv[at] = by->velocity[k];
  }
  if (!assemble(t, m)) return 0;
  solved(t, m);
  for (Int j = 0; j < n; j++)
    dy[st->free_at[j]] = m->by_y * m->x[j], dv[st->free_at[j]] = m->by_v * m->x[j];
  for (Int k = 0; k < st->motors; k++) {
    torque[k] = st->prescribed ? m->r[st->motor_v[k]] : by->feed[k];
    if (!st->prescribed) continue;
    for (Int j = 0; j < n; j++) torque[k] += m->motor_rows[k * n + j] * m->x[j];
    for (Int j = 0; j < rows; j++) torque[k] -= m->motor_J[j * st->motors + k] * m->x[n + j];
  }
  return 1;
}
