# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# No fused multiply-add: a compiler that contracts a*b+c rounds once where the other path rounds twice.
# With contraction off the scalar and the vector kernels, and every CPU they are dispatched to, give the
# same bits, so a stack has the same bytes everywhere. -ffast-math would break the same promise. Consumers of the
# library get the flag with its target, for what public headers compute (libslicecorr/CMakeLists.txt).
add_compile_options(-ffp-contract=off)
