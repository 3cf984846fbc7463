"""The loop of pilot and rotorcraft, its crossings and its margins.

SPDX-License-Identifier: BSD-3-Clause
"""
