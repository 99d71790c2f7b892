/* Where the factors of a Newton matrix are zero: an order of the unknowns that keeps them few.

   Coordinates first, those with the fewest neighbours before others (minimum degree: Tinney, Walker
   1967), closures behind them; then along the branches of the elimination tree, so that unknowns
   with the same neighbours stand side by side (supernodes: Liu, Ng, Peyton 1993). A group of them is
   eliminated as a dense block; the rows and columns behind it that it touches are some spans. */
#include "sparsity.h"
#include "march.h"

enum { FEW = 32 }; /* unknowns, below which no order pays */
static const double WORTH = 0.5; /* of the products of all as one group: short spans are slower */
enum { SLACK = 4, GAP = 4 }; /* zeros that are worth a wider group, and a longer span */

static void put(uint64_t *set, Int i) { set[i >> 6] |= (uint64_t)1 << (i & 63); }

static Int count(const uint64_t *set, Int words) {
  Int n = 0;
  for (Int w = 0; w < words; w++) n += __builtin_popcountll(set[w]);
  return n;
}

/* Which unknowns an entry links: free rows, then closures; both ways. */
static void links(const Stages *st, Int rows, uint64_t *set) {
  Int n = st->free, size = n + rows, words = words_of(size);
  for (Int i = 0; i < size * words; i++) set[i] = 0;
  for (Int i = 0; i < n; i++)
    for (Int j = 0, at = i * n; j < n; j++, at++)
      if (st->M[at] != 0.0 || st->K[at] != 0.0 || st->C[at] != 0.0)
        put(set + i * words, j), put(set + j * words, i);
  for (Int k = 0; k < rows; k++)
    for (Int j = 0; j < n; j++)
      if (st->J[k * n + j] != 0.0) put(set + (n + k) * words, j), put(set + j * words, n + k);
}

/* Eliminate unknowns `first` to `last`, those with the fewest neighbours before others: `set` becomes
   what each touches of those after it; rank: when it was, or -1. */
static Int eliminated(Int first, Int last, Int n, uint64_t *set, Int *rank, Int done) {
  Int words = words_of(n);
  for (Int left = last - first; left > 0; left--) {
    Int best = -1, fewest = n + 1;
    for (Int i = first; i < last; i++) {
      Int degree = rank[i] < 0 ? count(set + i * words, words) : n + 1;
      if (degree < fewest) best = i, fewest = degree;
    }
    uint64_t *own = set + best * words;
    rank[best] = done++;
    for (Int j = next_of(own, 0, n); j < n; j = next_of(own, j + 1, n)) {
      uint64_t *other = set + j * words;
      for (Int w = 0; w < words; w++) other[w] |= own[w];
      other[j >> 6] &= ~((uint64_t)1 << (j & 63)), other[best >> 6] &= ~((uint64_t)1 << (best & 63));
    }
  }
  return done;
}

/* The elimination tree, and the order along its branches. */
static void branches(Int n, const uint64_t *set, const Int *rank, Int *parent, Int *room, Int *order) {
  Int words = words_of(n), *below = room, *end = room + n, *ranked = order, roots = n;
  for (Int i = 0; i < n; i++) ranked[rank[i]] = i, below[i] = 1, parent[i] = -1;
  for (Int k = 0; k < n; k++) {
    Int i = ranked[k];
    const uint64_t *own = set + i * words;
    for (Int j = next_of(own, 0, n); j < n; j = next_of(own, j + 1, n))
      if (parent[i] < 0 || rank[j] < rank[parent[i]]) parent[i] = j;
    if (parent[i] >= 0) below[parent[i]] += below[i];
  }
  for (Int k = n - 1; k >= 0; k--) { /* end: where the branches of an unknown not yet placed end */
    Int i = ranked[k], *last = parent[i] < 0 ? &roots : end + parent[i];
    end[i] = *last - 1, *last -= below[i];
    below[i] = end[i]; /* its place */
  }
  for (Int i = 0; i < n; i++) order[below[i]] = i;
}

/* The spans of places in `touched`, behind `end`. */
static void find_spans(const unsigned char *touched, Int end, Int n, Group *group) {
  Int spans = 0, last = 0;
  for (Int i = end; i < n; i++) {
    if (!touched[i]) continue;
    if (!spans || (i - last >= GAP && spans < SPANS)) group->at[2 * spans++] = last = i;
    group->at[2 * spans - 1] = last = i + 1;
  }
  group->spans = spans;
}

/* Groups of unknowns with the same neighbours, and the first row of each column of U. */
static void find_groups(Int n, const uint64_t *set, const Int *parent, unsigned char *touched,
                        Sparsity *s) {
  Int words = words_of(n);
  *s->groups = 0;
  for (Int k = 0; k < n; k++) s->place[s->order[k]] = k, s->top[k] = n;
  for (Int first = 0, end; first < n; first = end) {
    Group *group = s->group + (*s->groups)++;
    for (end = first + 1; end < n; end++) {
      Int i = s->order[end - 1], j = s->order[end];
      if (parent[i] != j || count(set + i * words, words) + SLACK <= count(set + j * words, words))
        break;
    }
    const uint64_t *own = set + s->order[end - 1] * words;
    for (Int k = end; k < n; k++) touched[k] = 0;
    for (Int j = next_of(own, 0, n); j < n; j = next_of(own, j + 1, n)) touched[s->place[j]] = 1;
    group->end = end;
    find_spans(touched, end, n, group);
    for (Int k = first; k < end; k++) s->top[k] = s->top[k] < first ? s->top[k] : first;
    for (Int p = 0; p < group->spans; p++)
      for (Int k = group->at[2 * p]; k < group->at[2 * p + 1]; k++)
        s->top[k] = s->top[k] < first ? s->top[k] : first;
  }
  for (Int k = n - 1; k > 0; k -= 2) { /* two columns at a time are taken off */
    Int *top = s->top + k;
    top[0] = top[-1] = top[0] < top[-1] ? top[0] : top[-1];
  }
}

Sparsity sparsity(const Tables *t, const Stages *st) {
  Int n = st->free + t->closures, *room = st->pivot + st->values * n + 1;
  Group *group = (Group *)(room + 3 * n);
  Sparsity s = {room - 1, room, room + n, room + 2 * n, (uint64_t *)(group + n), group};
  return s;
}

static void one_group(Int n, Sparsity *s) {
  if (n) s->group->end = n, s->group->spans = 0;
  for (Int k = 0; k < n; k++) s->order[k] = s->place[k] = k, s->top[k] = 0;
}

void dense(const Tables *t, const Stages *st) {
  Sparsity s = sparsity(t, st);
  *s.groups = UNKNOWN;
  one_group(st->free + t->closures, &s);
}

/* Products of a factorisation, group by group. */
static double products(Int n, const Sparsity *s) {
  const Group *g = s->group;
  double sum = 0.0;
  for (Int k = 0; k < n; k++) {
    Int rows = g->end - k - 1;
    for (Int p = 0; p < g->spans; p++) rows += g->at[2 * p + 1] - g->at[2 * p];
    sum += (double)rows * (double)rows;
    if (k + 1 == g->end) g++;
  }
  return sum;
}

void find_sparsity(const Tables *t, const Stages *st) {
  Sparsity s = sparsity(t, st);
  Int n = st->free + t->closures, words = words_of(n), same = *s.groups != UNKNOWN;
  uint64_t *set = s.links + n * words;
  Int *rank = (Int *)(set + n * words), *parent = rank + n, *more = parent + n;
  if (n < FEW) {
    if (!same) one_group(n, &s), *s.groups = DENSE;
    return;
  }
  links(st, t->closures, set);
  for (Int i = 0; i < n * words; i++) same = same && s.links[i] == set[i], s.links[i] = set[i];
  if (same) return;
  for (Int i = 0; i < n; i++) rank[i] = -1, set[i * words + (i >> 6)] &= ~((uint64_t)1 << (i & 63));
  eliminated(st->free, n, n, set, rank, eliminated(0, st->free, n, set, rank, 0));
  branches(n, set, rank, parent, more, s.order);
  find_groups(n, set, parent, (unsigned char *)more, &s);
  if (3.0 * products(n, &s) < WORTH * n * n * n) return;
  one_group(n, &s), *s.groups = DENSE;
}
