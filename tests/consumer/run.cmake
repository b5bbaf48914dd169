# Installs the build into a fresh prefix, then configures, builds and runs the consumer against it.
# Called by ctest with BUILD_DIR, SOURCE_DIR, WORK_DIR, CONFIG, GENERATOR, CXX_COMPILER, CXX_FLAGS, VERSION.
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

# The installed program, with the database that was installed beside it.
run("${CMAKE_COMMAND}" -E env --unset=SLICECORR_DB "${prefix}/bin/slicecorr" --version)
if(NOT output MATCHES "${VERSION}")
  message(FATAL_ERROR "slicecorr --version printed:\n${output}\nexpected version ${VERSION}")
endif()
file(GLOB_RECURSE installed_db "${prefix}/share/slicecorr/db/*.toml")
if(NOT installed_db)
  message(FATAL_ERROR "no database in ${prefix}/share/slicecorr/db")
endif()
