/* Where the factors of a Newton matrix are zero (sparsity.c). */
#ifndef PINFLEX_SPARSITY_H
#define PINFLEX_SPARSITY_H

#include "stages.h"

enum { SPANS = 4, UNKNOWN = 0, DENSE = 1 };

/* Unknowns up to `end` with the same neighbours: these are in spans [at[0], at[1]), [at[2], at[3]) ... */
typedef struct {
  Int end, spans, at[2 * SPANS];
} Group;

/* groups: how many there are. DENSE: all unknowns are one group; UNKNOWN: so they are after `dense`,
   until `find_sparsity` looks again. order: which unknown stands where, free rows before closures;
   place: the other way. top: of each column, the first row of U, or that of the column beside it,
   which is taken off with it. links: by unknown, a bit for each that an entry links it with. All
   behind the pivots of the stages, in (17 + 2 ((n + 63) / 64)) n + 1 numbers for n unknowns. */
typedef struct {
  Int *groups, *order, *top, *place;
  uint64_t *links;
  Group *group;
} Sparsity;

Sparsity sparsity(const Tables *t, const Stages *st);
void find_sparsity(const Tables *t, const Stages *st); /* of M, C, K and J; known ones stay */
void dense(const Tables *t, const Stages *st);         /* one group: pivots from every row */

static inline Int words_of(Int n) { return (n + 63) / 64; }

/* The first number from `i` on that is in a set; n where none is. */
static inline Int next_of(const uint64_t *set, Int i, Int n) {
  for (; i < n; i = (i | 63) + 1) {
    uint64_t rest = set[i >> 6] >> (i & 63);
    if (rest) return i + __builtin_ctzll(rest) < n ? i + __builtin_ctzll(rest) : n;
  }
  return n;
}

#endif
