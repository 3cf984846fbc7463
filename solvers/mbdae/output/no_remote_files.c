/* Stands in for what HDF5's driver of remote files (S3) would call of curl and OpenSSL.
 *
 * The solver reads and writes local files only and never asks HDF5 for that driver. Linked statically, HDF5 brings the driver
 * along all the same, and with it some thirty libraries of the network, which start-up would load and a package would have to
 * carry. Whoever opened a remote file in spite of this would be told that it cannot be opened: every call fails.
 *
 * SPDX-License-Identifier: BSD-3-Clause
 */
#include <stddef.h>

enum { FAILED_INIT = 2 }; /* CURLE_FAILED_INIT */

int curl_global_init(long flags) {
  (void)flags;
  return FAILED_INIT;
}
void curl_global_cleanup(void) {}
void* curl_easy_init(void) { return NULL; }
void curl_easy_cleanup(void* handle) { (void)handle; }
int curl_easy_perform(void* handle) {
  (void)handle;
  return FAILED_INIT;
}
int curl_easy_setopt(void* handle, int option, ...) {
  (void)handle;
  (void)option;
  return FAILED_INIT;
}
void* curl_slist_append(void* list, const char* text) {
  (void)list;
  (void)text;
  return NULL;
}
void curl_slist_free_all(void* list) { (void)list; }
const void* EVP_sha256(void) { return NULL; }
unsigned char* HMAC(const void* kind, const void* key, int key_size, const unsigned char* data, size_t size,
                    unsigned char* digest, unsigned int* digest_size) {
  (void)kind, (void)key, (void)key_size, (void)data, (void)size, (void)digest, (void)digest_size;
  return NULL;
}
unsigned char* SHA256(const unsigned char* data, size_t size, unsigned char* digest) {
  (void)data, (void)size, (void)digest;
  return NULL;
}
