# No fused multiply-add: a compiler that contracts a*b+c rounds once where the other path rounds twice.
# With contraction off the scalar and the vector kernels, and every CPU they are dispatched to, give the
# same bits, so a stack has the same bytes everywhere. -ffast-math would break the same promise.
add_compile_options(-ffp-contract=off)
