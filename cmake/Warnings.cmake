add_compile_options(-Wall -Wextra)

# For what waits for people, files and networks: an eighth less time to compile than at -O3.
set(SLICECORR_ORDINARY_SPEED "$<$<CONFIG:Release>:-O2>")
if(SLICECORR_WERROR)
  add_compile_options(-Werror)
endif()
