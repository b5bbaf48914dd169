add_compile_options(-Wall -Wextra)
if(SLICECORR_WERROR)
  add_compile_options(-Werror)
endif()
