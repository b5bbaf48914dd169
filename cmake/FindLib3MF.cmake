# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# lib3mf 1.8: 3D Manufacturing Format. Include paths start at its own folder (Model/COM/...).
# Defines the target Lib3MF::Lib3MF.
find_path(Lib3MF_INCLUDE_DIR NAMES Model/COM/NMR_DLLInterfaces.h PATH_SUFFIXES lib3mf)
find_library(Lib3MF_LIBRARY NAMES 3MF)
mark_as_advanced(Lib3MF_INCLUDE_DIR Lib3MF_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(Lib3MF REQUIRED_VARS Lib3MF_LIBRARY Lib3MF_INCLUDE_DIR)

if(Lib3MF_FOUND AND NOT TARGET Lib3MF::Lib3MF)
  add_library(Lib3MF::Lib3MF UNKNOWN IMPORTED)
  set_target_properties(Lib3MF::Lib3MF PROPERTIES
    IMPORTED_LOCATION "${Lib3MF_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${Lib3MF_INCLUDE_DIR}")
endif()
