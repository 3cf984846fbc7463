"""What is not known of one pilot: draws of it, and how his margins and responses spread.

SPDX-License-Identifier: BSD-3-Clause
"""
