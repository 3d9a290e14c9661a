/* SHA-512, and Ed25519 by it, as Monocypher has them (vendor/README.md). */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wsign-conversion"
#endif
#include "monocypher-ed25519_c.h"
