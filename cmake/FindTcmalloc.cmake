# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# tcmalloc of gperftools: memory of programs, in place of the C library's.
# Defines the target Tcmalloc::minimal.
find_library(TCMALLOC_LIBRARY NAMES tcmalloc_minimal)
mark_as_advanced(TCMALLOC_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Tcmalloc REQUIRED_VARS TCMALLOC_LIBRARY)

if(Tcmalloc_FOUND AND NOT TARGET Tcmalloc::minimal)
  add_library(Tcmalloc::minimal UNKNOWN IMPORTED)
  set_target_properties(Tcmalloc::minimal PROPERTIES IMPORTED_LOCATION "${TCMALLOC_LIBRARY}")
endif()
