/* What a library says of itself, and of the processor. */
#include "kernel.h"
#if defined(__x86_64__)
#include <cpuid.h>
#endif

EXPORT const char *pinflex_fingerprint(void) { return PINFLEX_FINGERPRINT; }

/* Whether the processor has AVX2, FMA and BMI2, and the operating system keeps wide registers. */
EXPORT int pinflex_has_v3(void) {
#if defined(__x86_64__)
  unsigned a, b, c, d, low, high;
  if (!__get_cpuid(1, &a, &b, &c, &d)) return 0;
  const unsigned fma = 1u << 12, saves = 1u << 27, avx = 1u << 28;
  if ((c & (fma | saves | avx)) != (fma | saves | avx)) return 0;
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  if ((low & 6) != 6) return 0;
  if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 0;
  const unsigned avx2 = 1u << 5, bmi2 = 1u << 8, bmi1 = 1u << 3;
  return (b & (avx2 | bmi2 | bmi1)) == (avx2 | bmi2 | bmi1);
#else
  return 0;
#endif
}
