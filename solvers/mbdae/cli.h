// The command line of mbdae.
//
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mbdae {

/// Does what the arguments say; returns the exit code: 0 ok, 1 deck, usage or file error, 2 not converged.
int run_command_line(int argc, char** argv);

}  // namespace mbdae
