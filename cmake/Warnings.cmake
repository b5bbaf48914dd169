# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
add_compile_options(-Wall -Wextra)
if(SLICECORR_WERROR)
  add_compile_options(-Werror)
endif()
