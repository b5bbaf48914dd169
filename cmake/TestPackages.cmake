# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# Looks for the packages of SLICECORR_TEST_PACKAGES. Sets SLICECORR_MISSING to those that are not whole.
set(SLICECORR_MISSING)
foreach(package IN LISTS SLICECORR_TEST_PACKAGES)
  string(REPLACE "=" ";" package "${package}")
  list(POP_FRONT package name)
  find_package(${name} QUIET)
  foreach(target IN LISTS package)
    if(NOT TARGET ${target})
      # GTest without GMock, X11 without Xfixes: the target says what is not there.
      if(${name}_FOUND)
        list(APPEND SLICECORR_MISSING ${target})
      else()
        list(APPEND SLICECORR_MISSING ${name})
      endif()
    endif()
  endforeach()
endforeach()
list(REMOVE_DUPLICATES SLICECORR_MISSING)
