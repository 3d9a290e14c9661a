/* Scratch memory of a control step of a linear controller. Public only because the caller owns it. */
#ifndef SW_WORKSPACE_H
#define SW_WORKSPACE_H

#include "sw_program.h"
#include "sw_settings.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What a history has for each control step: the differences, then the action. */
#define SW_ROW (SW_DIFFERENCES + 1)

/* Tables start at a cache line where the compiler can align them; only speed depends on it, and images do. */
#if defined(__GNUC__)
#define SW_ALIGNED __attribute__((aligned(SW_ALIGNMENT)))
#else
#define SW_ALIGNED
#endif

typedef struct {
    sw_program program;                            /* that this control step runs */
    float history[SW_WINDOW + SW_HORIZON][SW_ROW]; /* oldest first: what was, then what is predicted */
    float forces[2][SW_HORIZON];                   /* Cd, then Cl */
    float plan[SW_HORIZON];
    float start[SW_HORIZON]; /* of an optimiser; none runs, so it is the plan */
} sw_workspace;

#ifdef __cplusplus
}
#endif

#endif
