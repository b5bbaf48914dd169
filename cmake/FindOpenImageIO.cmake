# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# OpenImageIO: images. Its CMake package in Debian 12 refuses to load unless its command-line tools and the
# headers of OpenCV are installed, which we don't need. Its headers use Imath, whose package warns without
# Imath's Python module.
# Defines the target OpenImageIO::OpenImageIO.
find_path(OpenImageIO_INCLUDE_DIR NAMES OpenImageIO/imageio.h)
find_library(OpenImageIO_LIBRARY NAMES OpenImageIO)
find_library(OpenImageIO_UTIL_LIBRARY NAMES OpenImageIO_Util)
find_library(OpenImageIO_IMATH_LIBRARY NAMES Imath Imath-3_1)
mark_as_advanced(OpenImageIO_INCLUDE_DIR OpenImageIO_LIBRARY OpenImageIO_UTIL_LIBRARY
  OpenImageIO_IMATH_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenImageIO
  REQUIRED_VARS OpenImageIO_LIBRARY OpenImageIO_UTIL_LIBRARY OpenImageIO_IMATH_LIBRARY
    OpenImageIO_INCLUDE_DIR)

if(OpenImageIO_FOUND AND NOT TARGET OpenImageIO::OpenImageIO)
  add_library(OpenImageIO::OpenImageIO UNKNOWN IMPORTED)
  set_target_properties(OpenImageIO::OpenImageIO PROPERTIES
    IMPORTED_LOCATION "${OpenImageIO_LIBRARY}"
    INTERFACE_INCLUDE_DIRECTORIES "${OpenImageIO_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${OpenImageIO_UTIL_LIBRARY};${OpenImageIO_IMATH_LIBRARY}")
endif()
