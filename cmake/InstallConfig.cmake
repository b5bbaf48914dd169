# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# find_package(slicecorr) for programs outside of this project.
set(package_dir "${CMAKE_INSTALL_LIBDIR}/cmake/slicecorr")

configure_package_config_file(
  "${CMAKE_CURRENT_LIST_DIR}/slicecorrConfig.cmake.in" "${CMAKE_BINARY_DIR}/slicecorrConfig.cmake"
  INSTALL_DESTINATION "${package_dir}")
write_basic_package_version_file("${CMAKE_BINARY_DIR}/slicecorrConfigVersion.cmake"
  COMPATIBILITY SameMinorVersion)

install(EXPORT slicecorrTargets NAMESPACE slicecorr:: DESTINATION "${package_dir}")
install(EXPORT slicecorrCTargets NAMESPACE slicecorr:: DESTINATION "${package_dir}")
install(
  FILES
    "${CMAKE_BINARY_DIR}/slicecorrConfig.cmake"
    "${CMAKE_BINARY_DIR}/slicecorrConfigVersion.cmake"
    "${CMAKE_CURRENT_LIST_DIR}/SlicecorrDependencies.cmake"
    "${CMAKE_CURRENT_LIST_DIR}/FindISAL.cmake"
    "${CMAKE_CURRENT_LIST_DIR}/FindLibDeflate.cmake"
    "${CMAKE_CURRENT_LIST_DIR}/FindLibZip.cmake"
  DESTINATION "${package_dir}")
install(FILES "${CMAKE_SOURCE_DIR}/LICENSE" DESTINATION "${CMAKE_INSTALL_DOCDIR}")
