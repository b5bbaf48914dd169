# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""What scripts/bench and scripts/bench-guard are made of. Python's standard library only."""
