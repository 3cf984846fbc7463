"""The solver mbdae (or MBDyn): client, protocol, and the matrices it hands over.

SPDX-License-Identifier: BSD-3-Clause
"""
