"""One module per command of the command line: `add_parser(commands)` declares it, `run(args)` does it.

SPDX-License-Identifier: BSD-3-Clause
"""
