# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# The one list of packages. It is installed too: a consumer of the static library needs the first list.
# ISAL, LibDeflate, LibZip and OpenImageIO are found by modules of ours: in Debian 12 the first two have no CMake
# package, and those of the others refuse to load unless command-line tools are installed too.
set(SLICECORR_LINKED_PACKAGES Threads TBB LibZip ISAL LibDeflate hwy ZLIB fmt pugixml)
# Headers only, used while building and not seen by consumers.
set(SLICECORR_BUILD_PACKAGES nlohmann_json TomlPlusPlus CLI11 Boost Eigen3 KissFFT nanoflann)
# Used by programs and by the modules (images, meshes, tars, windows) only.
set(SLICECORR_PROGRAM_PACKAGES OpenImageIO OpenMesh EXPAT LibArchive Ceres SQLite3 OpenSSL Httplib Modbus SDL2 LibDRM X11 Tcmalloc)
# What tests need beside these, each with the targets that they link. Without one of them there are no tests.
set(SLICECORR_TEST_PACKAGES GTest=GTest::gtest=GTest::gmock PNG=PNG::PNG X11=X11::Xfixes
  SUNDIALS=SUNDIALS::cvode=SUNDIALS::nvecserial=SUNDIALS::sunmatrixband=SUNDIALS::sunlinsolband)
# Without one of these some tests are left out, or the benchmarks, which is said.
set(SLICECORR_TEST_EXTRA_PACKAGES FFTW benchmark)
