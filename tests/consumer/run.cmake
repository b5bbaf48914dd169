# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# Installs the build into a fresh prefix, then configures, builds and runs the consumer against it.
# Called by ctest with BUILD_DIR, SOURCE_DIR, WORK_DIR, CONFIG, GENERATOR, C_COMPILER, CXX_COMPILER, CXX_FLAGS, VERSION.
set(prefix "${WORK_DIR}/prefix")
file(REMOVE_RECURSE "${WORK_DIR}")

function(run)
  execute_process(COMMAND ${ARGV} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    list(JOIN ARGV " " command)
    message(FATAL_ERROR "${command}\nfailed (${result}):\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

run("${CMAKE_COMMAND}" --install "${BUILD_DIR}" --config "${CONFIG}" --prefix "${prefix}")
run("${CMAKE_COMMAND}" -S "${SOURCE_DIR}" -B "${WORK_DIR}/build" -G "${GENERATOR}"
  "-DCMAKE_BUILD_TYPE=${CONFIG}" "-DCMAKE_CXX_COMPILER=${CXX_COMPILER}" "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}"
  "-DCMAKE_PREFIX_PATH=${prefix}")
run("${CMAKE_COMMAND}" --build "${WORK_DIR}/build" --config "${CONFIG}")

find_program(consumer consumer REQUIRED NO_DEFAULT_PATH
  PATHS "${WORK_DIR}/build" "${WORK_DIR}/build/${CONFIG}")
run("${consumer}")
if(NOT output MATCHES "slicecorr ${VERSION}")
  message(FATAL_ERROR "the consumer printed:\n${output}\nexpected version ${VERSION}")
endif()
find_program(same_bits same-bits NO_DEFAULT_PATH PATHS "${WORK_DIR}/build" "${WORK_DIR}/build/${CONFIG}")
if(same_bits)
  run("${same_bits}")
endif()

# The C interface, as a package of CMake and through pkg-config.
run("${CMAKE_COMMAND}" -S "${SOURCE_DIR}/c" -B "${WORK_DIR}/build-c" -G "${GENERATOR}"
  "-DCMAKE_BUILD_TYPE=${CONFIG}" "-DCMAKE_C_COMPILER=${C_COMPILER}" "-DCMAKE_C_FLAGS=${CXX_FLAGS}"
  "-DCMAKE_PREFIX_PATH=${prefix}")
run("${CMAKE_COMMAND}" --build "${WORK_DIR}/build-c" --config "${CONFIG}")
find_program(c_consumer consumer REQUIRED NO_DEFAULT_PATH
  PATHS "${WORK_DIR}/build-c" "${WORK_DIR}/build-c/${CONFIG}")
run("${c_consumer}")
if(NOT output MATCHES "slicecorr ${VERSION}, interface [1-9]")
  message(FATAL_ERROR "the C consumer printed:\n${output}\nexpected version ${VERSION}")
endif()
find_program(PKG_CONFIG pkg-config)
if(PKG_CONFIG)
  file(GLOB_RECURSE pc_file "${prefix}/*/slicecorr.pc")
  cmake_path(GET pc_file PARENT_PATH pc_folder)
  set(ENV{PKG_CONFIG_PATH} "${pc_folder}")
  run("${PKG_CONFIG}" --modversion slicecorr)
  if(NOT output MATCHES "^${VERSION}\n")
    message(FATAL_ERROR "pkg-config says version ${output}, expected ${VERSION}")
  endif()
  run("${PKG_CONFIG}" --cflags --libs slicecorr)
  string(STRIP "${output} ${CXX_FLAGS}" flags)
  separate_arguments(flags UNIX_COMMAND "${flags}")
  run("${C_COMPILER}" "${SOURCE_DIR}/c/main.c" -o "${WORK_DIR}/pkg-config-consumer" ${flags})
  run("${PKG_CONFIG}" --variable=libdir slicecorr)
  string(STRIP "${output}" libdir)
  run("${CMAKE_COMMAND}" -E env "LD_LIBRARY_PATH=${libdir}" "${WORK_DIR}/pkg-config-consumer")
  if(NOT output MATCHES "slicecorr ${VERSION}")
    message(FATAL_ERROR "the program linked through pkg-config printed:\n${output}")
  endif()
endif()

# The Python module, moved with its prefix, with the library that was installed beside it.
find_program(python python3 NO_DEFAULT_PATH PATHS /usr/bin /usr/local/bin)
file(GLOB_RECURSE module "${prefix}/__init__.py")
list(FILTER module INCLUDE REGEX "/slicecorr/__init__[.]py$")
if(NOT module)
  message(FATAL_ERROR "no Python module in ${prefix}")
endif()
if(python AND NOT CXX_FLAGS)  # the sanitizer's library must be loaded first
  cmake_path(GET module PARENT_PATH module_folder)
  cmake_path(GET module_folder PARENT_PATH module_folder)
  run("${CMAKE_COMMAND}" -E env --unset=SLICECORR_LIBRARY "PYTHONPATH=${module_folder}" "${python}" -B -c
    "from slicecorr import library_path, version\nprint(version(), library_path())")
  if(NOT output MATCHES "^${VERSION} ${prefix}/")
    message(FATAL_ERROR "the Python module printed:\n${output}\nexpected ${VERSION} and a library in ${prefix}")
  endif()
endif()

# The installed program, with the database that was installed beside it.
run("${CMAKE_COMMAND}" -E env --unset=SLICECORR_DB "${prefix}/bin/slicecorr" --version)
if(NOT output MATCHES "${VERSION}")
  message(FATAL_ERROR "slicecorr --version printed:\n${output}\nexpected version ${VERSION}")
endif()
file(GLOB_RECURSE installed_db "${prefix}/share/slicecorr/db/*.toml")
if(NOT installed_db)
  message(FATAL_ERROR "no database in ${prefix}/share/slicecorr/db")
endif()
