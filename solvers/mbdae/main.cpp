// mbdae: from an MBDyn-style deck to its equilibrium, its linearised model or its motion.
//
// SPDX-License-Identifier: BSD-3-Clause
#include <malloc.h>

#include <csignal>
#include <cstdio>
#include <exception>

#include "mbdae/cli.h"

int main(int argc, char** argv) {
  // Keep freed memory: a serving process allocates the same matrices and file images for every deck, and taking their
  // pages from the system each time costs more than filling them.
  mallopt(M_MMAP_THRESHOLD, 64 << 20);
  mallopt(M_TRIM_THRESHOLD, 256 << 20);
  mallopt(M_TOP_PAD, 4 << 20);
  // A file larger than a limit allows is then a write that fails, which is told, not a death.
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return mbdae::run_command_line(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "mbdae: error: unexpected: %s\n", error.what());
  } catch (...) {
    std::fprintf(stderr, "mbdae: error: unexpected exception\n");
  }
  return 1;
}
