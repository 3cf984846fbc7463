"""From biometrics to a body: lengths, inertia, strength and muscles of one pilot.

SPDX-License-Identifier: BSD-3-Clause
"""
