# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# SLICECORR_SANITIZE: a list of address, undefined, leak, thread. Combinations that can't work are refused by name.
set(SLICECORR_SANITIZE "" CACHE STRING "Sanitizers, separated by semicolons: address, undefined, leak, thread")

foreach(sanitizer IN LISTS SLICECORR_SANITIZE)
  if(NOT sanitizer MATCHES "^(address|undefined|leak|thread)$")
    message(FATAL_ERROR
      "SLICECORR_SANITIZE: '${sanitizer}' is not known here; use address, undefined, leak or thread")
  endif()
endforeach()
foreach(other IN ITEMS address leak)
  if("thread" IN_LIST SLICECORR_SANITIZE AND other IN_LIST SLICECORR_SANITIZE)
    message(FATAL_ERROR
      "SLICECORR_SANITIZE: 'thread' and '${other}' can't be used together: both replace the memory "
      "allocator and shadow memory differently. Use two build folders (presets tsan and asan).")
  endif()
endforeach()

if(SLICECORR_SANITIZE)
  list(JOIN SLICECORR_SANITIZE "," sanitizers)
  set(SLICECORR_SANITIZE_FLAGS -fsanitize=${sanitizers} -fno-omit-frame-pointer)
  if("undefined" IN_LIST SLICECORR_SANITIZE)
    # A finding must fail the test, not only print. A null pointer that is used ends the program anyway; to look at
    # each before its use is a fifth of the time that GCC takes.
    list(APPEND SLICECORR_SANITIZE_FLAGS -fno-sanitize-recover=undefined -fno-sanitize=null)
  endif()
  add_compile_options(${SLICECORR_SANITIZE_FLAGS})
  add_link_options(${SLICECORR_SANITIZE_FLAGS})
endif()

# Fuzzers of what reads other programs' files; each is a program with the fuzzer's main.
option(SLICECORR_FUZZ "Build the fuzzers (tests/fuzz); needs Clang" OFF)
if(SLICECORR_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "SLICECORR_FUZZ: the fuzzer is part of Clang; configure with -DCMAKE_CXX_COMPILER=clang++ (preset fuzz)")
  endif()
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()
