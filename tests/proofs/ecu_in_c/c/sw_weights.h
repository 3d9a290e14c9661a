/* In place of a trained program's: there is none. */
#ifndef SW_WEIGHTS_H
#define SW_WEIGHTS_H

#define SW_OWN_PROGRAM {NULL, NULL}

#endif
