# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# slicecorr_embed_text(OUT FOLDER HEADER SPACE FILE...): sets OUT to a source with the text of files of FOLDER, each as
# std::string_view SPACE::page_NAME_EXT, which HEADER declares. Scripts, styles and markup are files of their own, to be
# read; programs carry their text.
function(slicecorr_embed_text out folder header space)
  list(TRANSFORM ARGN PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/${folder}/" OUTPUT_VARIABLE files)
  string(REPLACE "/" "_" name "${header}")
  string(REPLACE ".hpp" ".cpp" name "${name}")
  set(source "${CMAKE_CURRENT_BINARY_DIR}/${name}")
  set(script "${PROJECT_SOURCE_DIR}/cmake/EmbedText.cmake")
  add_custom_command(OUTPUT "${source}"
    COMMAND "${CMAKE_COMMAND}" "-DOUT=${source}" "-DFILES=${files}" "-DHEADER=${header}" "-DSPACE=${space}" -P "${script}"
    DEPENDS ${files} "${script}"
    COMMENT "Embedding the files of ${folder}" VERBATIM)
  set(${out} "${source}" PARENT_SCOPE)
endfunction()
