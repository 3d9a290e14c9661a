/* Any values, for Frama-C's Eva. */
#ifndef EVA_H
#define EVA_H

#include <stdint.h>

#include "__fc_builtin.h"

extern volatile int any_int; /* each reading gives another value */

#define ANY(object) Frama_C_make_unknown((char *)&(object), sizeof(object))

#endif
