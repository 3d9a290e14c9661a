/* The list of keys that may sign releases (contract/release/key_list.py), the header of a release as an image
 * (contract/release/controller_image.py), and the judgement whether this ECU may run the image.
 */
#ifndef SW_RELEASE_H
#define SW_RELEASE_H

#include <stdint.h>

#define SW_MOST_KEYS 16u
#define SW_KEY_LIST_BYTES (48u + 2u * SW_MOST_KEYS * 32u + 64u) /* length of the longest list, in bytes */

/* Returns whether a list is signed by the root key and well-formed. */
int sw_key_list_is_good(const uint8_t *data, uint32_t length, const uint8_t root[32]);

/* Returns the version of a valid list; 0 for a list of zeros, which means that there is no list. */
uint32_t sw_key_list_version(const uint8_t *list);
int sw_key_is_allowed(const uint8_t *list, const uint8_t key[32]);
int sw_key_is_revoked(const uint8_t *list, const uint8_t key[32]);

#define SW_HEADER_BYTES 512u
#define SW_NAME_BYTES 64u

/* The verdict names the first failed check. Testers receive these numbers (can_bridge/flashing/verdicts.py). */
typedef enum {
    SW_VERDICT_GOOD = 0,
    SW_VERDICT_INCOMPLETE = 1,
    SW_VERDICT_WRONG_HASH = 2,
    SW_VERDICT_DAMAGED = 3,
    SW_VERDICT_UNSIGNED = 4,
    SW_VERDICT_BAD_SIGNATURE = 5,
    SW_VERDICT_UNKNOWN_KEY = 6,
    SW_VERDICT_REVOKED_KEY = 7,
    SW_VERDICT_WRONG_DBC = 8,
    SW_VERDICT_WRONG_HARDWARE = 9,
    SW_VERDICT_WRONG_PERIOD = 10,
    SW_VERDICT_WRONG_VEHICLE = 11,
    SW_VERDICT_TOO_OLD = 12,
    SW_VERDICT_UNREADABLE = 13,
    SW_VERDICT_EMPTY = 14,
    SW_VERDICT_WRONG_BUILD = 15, /* checked after WRONG_DBC, and again in the last check, by sw_image_open */
    SW_VERDICT_NONE = 0xff       /* the image is not judged yet */
} sw_verdict;

/* The properties of this ECU against which releases are judged. */
typedef struct {
    uint8_t root[32];        /* Ed25519 key that signs key lists */
    uint8_t layout[32];      /* SHA-256 of the payload's layout in this build */
    uint8_t dbc[32];         /* SHA-256 of stillwake.dbc */
    uint8_t hardware[64];    /* name of the hardware in UTF-8, padded with zeros */
    uint8_t vehicle[44];     /* bytes 148..191 of the header of every image for this vehicle: control period,
                                operating point, action limit, number of sensors */
} sw_rules;

/* The data that the store saves about a valid image. */
typedef struct {
    uint32_t security_version;
    uint8_t digest[32]; /* digest of the release */
    uint8_t name[SW_NAME_BYTES];
    uint8_t name_length;
    uint8_t signer[32];
} sw_release_facts;

/* Judges the header of an image of `length` bytes against the rules and a key list; `payload_sha256` is the SHA-256 of
 * the image's payload. The caller has to detect WRONG_HASH, INCOMPLETE, UNREADABLE and EMPTY, and has to check whether
 * the build can run the payload.
 */
sw_verdict sw_release_judge(const uint8_t header[SW_HEADER_BYTES], uint32_t length, const uint8_t payload_sha256[32],
                            const uint8_t *keys, const sw_rules *rules, uint32_t least_security_version);

/* Returns the length of a name of printable ASCII characters, padded with zeros; 0 if the name is invalid. */
uint32_t sw_name_length(const uint8_t field[SW_NAME_BYTES]);

/* Reads the facts about a release from the header of an image whose verdict is GOOD. */
void sw_release_read(const uint8_t header[SW_HEADER_BYTES], sw_release_facts *facts);

#endif
