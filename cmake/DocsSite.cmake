# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# README.md and docs/ as pages for a browser, installed with the programs. Needs the Debian package python3-markdown.
set(SLICECORR_DOCS_PYTHON "/usr/bin/python3" CACHE FILEPATH "Python with the module markdown, which makes the pages of docs/")
execute_process(COMMAND "${SLICECORR_DOCS_PYTHON}" -c "import markdown" RESULT_VARIABLE no_markdown OUTPUT_QUIET ERROR_QUIET)
if(NOT no_markdown STREQUAL "0")
  message(STATUS "python3-markdown not found: no pages of docs/ for a browser (scripts/setup installs it)")
  return()
endif()
set(SLICECORR_DOCS_SITE ON)
file(GLOB_RECURSE docs_sources CONFIGURE_DEPENDS "${CMAKE_SOURCE_DIR}/docs/*.md" "${CMAKE_SOURCE_DIR}/docs/*.png"
  "${CMAKE_SOURCE_DIR}/docs/*.svg" "${CMAKE_SOURCE_DIR}/docs/site/*" "${CMAKE_SOURCE_DIR}/*.md")
add_custom_command(
  OUTPUT "${CMAKE_BINARY_DIR}/docs/html/index.html"
  COMMAND "${SLICECORR_DOCS_PYTHON}" "${CMAKE_SOURCE_DIR}/scripts/docs-site" "${CMAKE_BINARY_DIR}/docs/html"
  DEPENDS "${CMAKE_SOURCE_DIR}/scripts/docs-site" ${docs_sources}
  COMMENT "Pages of docs/ for a browser"
  VERBATIM)
add_custom_target(docs-site ALL DEPENDS "${CMAKE_BINARY_DIR}/docs/html/index.html")
# OPTIONAL: a build of single targets may not have made them.
install(DIRECTORY "${CMAKE_BINARY_DIR}/docs/html" DESTINATION "${CMAKE_INSTALL_DOCDIR}" OPTIONAL)
