# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# libdrm. Defines the target LibDRM::LibDRM.
find_path(LibDRM_INCLUDE_DIR NAMES xf86drmMode.h)
# Headers of the kernel's interface, which that one includes.
find_path(LibDRM_KERNEL_INCLUDE_DIR NAMES drm_mode.h PATH_SUFFIXES libdrm)
find_library(LibDRM_LIBRARY NAMES drm)
mark_as_advanced(LibDRM_INCLUDE_DIR LibDRM_KERNEL_INCLUDE_DIR LibDRM_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LibDRM
  REQUIRED_VARS LibDRM_LIBRARY LibDRM_INCLUDE_DIR LibDRM_KERNEL_INCLUDE_DIR)

if(LibDRM_FOUND AND NOT TARGET LibDRM::LibDRM)
  add_library(LibDRM::LibDRM UNKNOWN IMPORTED)
  set_target_properties(LibDRM::LibDRM PROPERTIES
    IMPORTED_LOCATION "${LibDRM_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${LibDRM_INCLUDE_DIR};${LibDRM_KERNEL_INCLUDE_DIR}")
endif()
