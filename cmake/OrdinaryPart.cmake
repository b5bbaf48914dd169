# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# slicecorr_part(TARGET NAME OPTION SOURCE...): sources of a library that are compiled with an option of their own. Called
# when the library has its include folders and what it links. slicecorr_ordinary_part: those in which no time is spent;
# slicecorr_busy_part: those in which most of it is.
function(slicecorr_ordinary_part target)
  slicecorr_part(${target} ordinary "${SLICECORR_ORDINARY_SPEED}" ${ARGN})
endfunction()
function(slicecorr_busy_part target)
  slicecorr_part(${target} busy "${SLICECORR_BUSY_SPEED}" ${ARGN})
endfunction()
function(slicecorr_part target name option)
  set(part ${target}-${name})
  add_library(${part} OBJECT ${ARGN})
  get_target_property(position_independent ${target} POSITION_INDEPENDENT_CODE)
  set_target_properties(${part} PROPERTIES POSITION_INDEPENDENT_CODE ${position_independent})
  get_target_property(folders ${target} INCLUDE_DIRECTORIES)
  target_include_directories(${part} PRIVATE ${folders})
  get_target_property(libraries ${target} LINK_LIBRARIES)
  target_link_libraries(${part} PRIVATE ${libraries})
  target_compile_features(${part} PRIVATE cxx_std_20)
  target_compile_options(${part} PRIVATE "${option}")
  target_sources(${target} PRIVATE $<TARGET_OBJECTS:${part}>)
endfunction()

# Parts the sources of the folders MODULES: OUT_ORDINARY gets those of the folders in the list ORDINARY, OUT_SOURCES the
# others.
function(slicecorr_part_sources out_sources out_ordinary ordinary)
  set(fast)
  set(slow)
  foreach(module IN LISTS ARGN)
    file(GLOB found CONFIGURE_DEPENDS
      "${CMAKE_CURRENT_SOURCE_DIR}/${module}/*.cpp" "${CMAKE_CURRENT_SOURCE_DIR}/${module}/*/*.cpp")
    foreach(source IN LISTS found)
      cmake_path(RELATIVE_PATH source OUTPUT_VARIABLE folder)
      cmake_path(GET folder PARENT_PATH folder)
      if(folder IN_LIST ordinary)
        list(APPEND slow "${source}")
      else()
        list(APPEND fast "${source}")
      endif()
    endforeach()
  endforeach()
  set(${out_sources} ${fast} PARENT_SCOPE)
  set(${out_ordinary} ${slow} PARENT_SCOPE)
endfunction()
