# Makes a C++ source of text files: cmake -DOUT=x.cpp -DFILES=a;b -P EmbedText.cmake
# Each becomes std::string_view slicecorr::detail::page_NAME_EXT.
set(text "#include \"report/page_text.hpp\"\n\nnamespace slicecorr::detail {\n")
foreach(file IN LISTS FILES)
  get_filename_component(name "${file}" NAME)
  string(REGEX REPLACE "[^a-z0-9]" "_" name "${name}")
  file(READ "${file}" hex HEX)
  string(REGEX REPLACE "(................................................................)" "\\1\n" hex "${hex}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," hex "${hex}")
  string(APPEND text "static constexpr char bytes_${name}[] = {\n${hex}};\n"
    "const std::string_view page_${name}(bytes_${name}, sizeof bytes_${name});\n")
endforeach()
string(APPEND text "}  // namespace slicecorr::detail\n")
file(WRITE "${OUT}" "${text}")
