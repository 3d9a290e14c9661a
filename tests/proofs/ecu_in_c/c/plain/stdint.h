typedef signed char int8_t; typedef unsigned char uint8_t;
typedef short int16_t; typedef unsigned short uint16_t;
typedef int int32_t; typedef unsigned int uint32_t;
typedef long int64_t; typedef unsigned long uint64_t;
#define INT64_C(x) x##L
#define UINT64_C(x) x##UL
#define UINT32_C(x) x##U
#define INT32_C(x) x
#define UINT32_MAX 4294967295U
#define UINT64_MAX 18446744073709551615UL
#define INT64_MAX 9223372036854775807L
#define INT32_MAX 2147483647
#define UINT16_MAX 65535
#define UINT8_MAX 255
#define INT64_MIN (-INT64_MAX - 1L)
