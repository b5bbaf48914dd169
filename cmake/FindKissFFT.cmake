# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# KissFFT: Fourier transforms. Its template only, which has every precision; the CMake package in Debian 12 is about the
# compiled library, which has float alone.
# Defines the target KissFFT::kissfft.
find_path(KissFFT_INCLUDE_DIR NAMES kissfft/kissfft.hh)
mark_as_advanced(KissFFT_INCLUDE_DIR)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(KissFFT REQUIRED_VARS KissFFT_INCLUDE_DIR)

if(KissFFT_FOUND AND NOT TARGET KissFFT::kissfft)
  add_library(KissFFT::kissfft INTERFACE IMPORTED)
  set_target_properties(KissFFT::kissfft PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${KissFFT_INCLUDE_DIR}")
endif()
