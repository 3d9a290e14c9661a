/* What the harnesses share. A local variable without a value has any value, here; a global one is zero. */
#ifndef PROVE_H
#define PROVE_H

#include <stddef.h>
#include <stdint.h>

void __ESBMC_assume(_Bool condition);
void __ESBMC_assert(_Bool condition, const char *text);

uint8_t nondet_uchar(void);
uint32_t nondet_uint(void);
int nondet_int(void);
int64_t nondet_long(void);
double nondet_double(void);

#define ASSUME(condition) __ESBMC_assume(condition)
#define PROVE(condition) __ESBMC_assert(condition, #condition)

#endif
