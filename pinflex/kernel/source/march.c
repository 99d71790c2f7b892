/* The steps of a run, one after the other, until a batch is full or something else has to answer:
   pinflex/integrators/march.py sets it off, and says what the numbers are. */
#include "march.h"
#include <stddef.h>
#include <time.h>

enum { FULL, INPUTS, START, STUCK, PAUSED, SAMPLE, EVENT };
/* How a run goes on from a stop, and the end of a step: anew, under other forces that are held, or on. */
enum { RESTARTS, HOLDS, ON };

/* Length of the next step: equal pieces up to a stop that is near. */
static double length(const March *m) {
  double ahead = m->stop_at[m->stop] - m->t, pieces = ceil(ahead / m->h - 1e-9);
  return pieces < 4.0 ? ahead / pieces : m->h;
}

/* The next smaller one of `grain` lengths in an octave: what round-off does to an estimate of error
   then does not change the steps, and so not the next estimates. */
static double rounded(const March *m, double h) {
  int octave;
  double part = frexp(h, &octave);
  if (m->grain == 0.0 || !isfinite(h)) return h;
  return ldexp(floor(2.0 * m->grain * part) / (2.0 * m->grain), octave);
}

/* Once more without a prediction and with a new tangent, then shorter. */
static void after_failure(March *m, double size) {
  m->landing = 0, m->rejected++, m->stale = 1, m->h = size;
  if (!m->follows) m->ceiling = m->h = 0.4 * size;
  m->follows = 0;
}

static double grown(const March *m, double coarseness) {
  return 0.9 * pow(m->resolution / fmax(coarseness, 1e-300), 1.0 / m->order);
}

/* What the next step may be longer by. */
static double growth(const March *m, double coarseness) {
  return fmin(grown(m, coarseness), fmax(grown(m, m->held * m->before), 1.0));
}

/* The same where Hertz's law acts: stages of a longer step differ in stiffness, by which Newton's
   iteration converges more slowly, about with the square of the length. */
static double hardening(double rate) { return fmin(1.5, fmax(0.7, sqrt(0.1 / rate))); }

/* The state after the step that is kept as number `count`. */
void advance(const Tables *t, March *m) {
  const Stages *st = m->stages;
  const Steps *x = &m->steps;
  Int k = m->count, s = st->s, nv = t->nv, motors = st->motors, end = k * s + s - 1;
  for (Int l = 0; l < s; l++)
    for (Int i = 0; i < nv; i++)
      m->v[i] += x->h[k] * st->A[(s - 1) * s + l] * x->a[(k * s + l) * nv + i];
  for (Int i = 0; i < led(st); i++) m->v[st->motor_v[i]] = x->velocity[end * motors + i];
  m->t = x->t[k] + x->h[k];
  retract(t, st, x->y0 + k * t->nq, x->move + end * nv, m->y);
  write_motors(st, x->position + end * motors, m->y);
  copy(m->a, x->a + end * nv, nv);
  copy(m->lam, x->lam + end * t->closures, t->closures);
  copy(m->torque, x->torque + end * motors, motors);
}

/* Keep a step with the point that it goes on from, and go there. */
static int accept(const Tables *t, char *memory, March *m, double size, double factor, double scale) {
  Steps *x = &m->steps;
  Int k = m->count + 1;
  double coarseness = x->coarseness[k], h = m->h;
  int hard = hardens(t, m->piece);
  keep(t, memory, m, size);
  x->next[k] = m->h, x->ceiling[k] = m->ceiling, x->before[k] = m->before;
  x->refused[k] = m->refused, x->scale[k] = scale, x->number[k] = m->number;
  x->stop[k] = m->stop, x->follows[k] = m->follows;
  m->count = k;
  advance(t, m);
  if (!(m->idle_from < factor && factor < m->idle_to))
    h = size * fmin(fmax(factor, 0.5), hard ? hardening(x->rate[k]) : 3.0);
  m->ceiling *= m->growth;
  m->h = rounded(m, fmin(h, m->ceiling));
  m->before = coarseness;
  /* Where Hertz's law acts, polynomials that are continued miss its depth: Newton's iteration fails. */
  m->refused = INFINITY, m->follows = !hard, m->number++;
  if (m->t < m->stop_at[m->stop] - m->shortest) return ON;
  m->t = m->stop_at[m->stop]; /* two that differ by round-off are one */
  Int kind = ON;
  for (; m->stop < m->stops && !(m->stop_at[m->stop] > m->t + m->shortest); m->stop++)
    if (m->kind[m->stop] < kind) kind = m->kind[m->stop];
  if (m->stop == m->stops) return ON;
  if (kind == ON) { /* the next step is as long as it is given */
    m->h = fmin(m->first, m->ceiling);
    return ON;
  }
  m->follows &= kind == HOLDS;
  /* In a step ten times shorter inertia counts more than stiffness: of another pose, Newton's iteration
     converges in the large and diverges in the stiff coordinates, which corrections would show. */
  if (kind == RESTARTS) m->stale |= m->first < 0.1 * size, m->h = fmin(m->h, m->first);
  return (int)kind;
}

static int stuck(const March *m) { return m->h < m->shortest; }

static double now(void) {
  struct timespec x;
  timespec_get(&x, TIME_UTC);
  return (double)x.tv_sec + 1e-9 * (double)x.tv_nsec;
}

/* One attempt; -1 to go on. */
static int once(const Tables *t, char *memory, March *m) {
  double size = m->size, scale = m->scale;
  int solved = attempt(t, memory, m, size);
  m->given = 0;
  if (!solved) {
    after_failure(m, size);
    return -1;
  }
  double coarseness = m->steps.coarseness[m->count + 1], factor = growth(m, coarseness);
  if (coarseness > m->resolution && !(m->unjudged && m->number == 0)) {
    if (coarseness < 0.5 * m->refused) {
      m->rejected++, m->h = rounded(m, size * fmin(fmax(factor, 0.3), 0.7));
      m->refused = coarseness;
      m->landing = 0;
      return -1;
    }
    m->unresolved++, factor = 1.0;
  }
  int ends = t->kinks ? land(t, memory, m, size) : PASSES;
  if (ends == AGAIN) return -1;
  if (ends == LOST) {
    after_failure(m, size);
    return -1;
  }
  if (ends == AT_ONCE) {
    m->landing = 0, m->h = m->planned;
    return EVENT;
  }
  int met = accept(t, memory, m, size, factor, scale);
  if (ends == LANDS) {
    m->landing = 0, m->follows = 0, m->h = fmin(m->planned, m->ceiling);
    return EVENT;
  }
  if (met == HOLDS) return SAMPLE;
  int outside = m->inputs->pieces == 0 || m->stages->held != NULL;
  return met == RESTARTS && (outside || !begin(t, memory, m)) ? START : -1;
}

static int march(const Tables *t, char *memory, March *m) {
  double until = now() + m->patience;
  while (m->count < m->capacity && m->stop < m->stops) {
    if (stuck(m)) return STUCK;
    if (!m->given) {
      if (!m->landing) m->size = length(m);
      if (m->inputs->pieces == 0) return INPUTS;
    }
    int end = once(t, memory, m);
    if (end >= 0) return end;
    if (now() > until) return PAUSED;
  }
  return FULL;
}

/* Steps until the batch is full or the run ends (FULL), inputs are needed at the stages of a step
   of `size` (INPUTS), a start has to be found elsewhere (START), no step is short enough (STUCK), the
   patience is at its end (PAUSED): signals are seen outside, a controller measures (SAMPLE), or a law
   has left its piece (EVENT). */
EXPORT int pinflex_march(const Tables *t, char *memory, March *m) {
  keep_to_pieces(t, memory, m->piece, m->hit);
  m->solved = 0.0;
  int end = march(t, memory, m);
  keep_to_pieces(t, memory, NULL, NULL);
  return end;
}

/* The start at t, y and v from the inputs there; 0 where another has to find it. */
EXPORT int pinflex_begin(const Tables *t, char *memory, March *m) {
  keep_to_pieces(t, memory, m->piece, m->hit);
  int found = begin(t, memory, m);
  keep_to_pieces(t, memory, NULL, NULL);
  m->given = 0;
  return found;
}
