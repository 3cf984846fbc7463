"""Where the time goes: `python -m pilotgen.bench`, or `make bench`. The results of a run are in docs/performance.md.

All times are CPU time, of this process and of the solver, because wall time on a shared machine says more about the
neighbours than about the program; the minimum of several runs is the best estimate, the median shows the spread.

SPDX-License-Identifier: BSD-3-Clause
"""
