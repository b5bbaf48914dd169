# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# Makes a C++ source of text files, for slicecorr_embed_text():
# cmake -DOUT=x.cpp -DFILES=a;b -DHEADER=h -DSPACE=n -P EmbedText.cmake
set(text "#include \"${HEADER}\"\n\nnamespace ${SPACE} {\n")
foreach(file IN LISTS FILES)
  get_filename_component(name "${file}" NAME)
  string(REGEX REPLACE "[^a-z0-9]" "_" name "${name}")
  file(READ "${file}" hex HEX)
  string(REGEX REPLACE "(................................................................)" "\\1\n" hex "${hex}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," hex "${hex}")
  string(APPEND text "static constexpr char bytes_${name}[] = {\n${hex}};\n"
    "const std::string_view page_${name}(bytes_${name}, sizeof bytes_${name});\n")
endforeach()
string(APPEND text "}  // namespace ${SPACE}\n")
file(WRITE "${OUT}" "${text}")
