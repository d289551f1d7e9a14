/* SHA-256 (FIPS 180-4) and HMAC-SHA-256 (RFC 2104). No allocation. */
#ifndef SHA256_H
#define SHA256_H

#include <stddef.h>
#include <stdint.h>

enum { SHA256_SIZE = 32, SHA256_BLOCK = 64 };

typedef struct {
    uint32_t state[8];
    uint64_t length; /* bytes so far */
    uint8_t block[SHA256_BLOCK];
} sha256;

void sha256_begin(sha256 *s);
void sha256_add(sha256 *s, const void *bytes, size_t count);
void sha256_end(sha256 *s, uint8_t digest[SHA256_SIZE]);

/* The code of a message under a key of any length. */
void hmac_sha256(const uint8_t *key, size_t key_size, const void *message, size_t size, uint8_t code[SHA256_SIZE]);

#endif
